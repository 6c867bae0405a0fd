/* SPDX-License-Identifier: MIT
 *
 * test_engine_flood.c - more frames of ECUs at one wake-up than the inbox has room for.
 *
 * The clock is ours. Frames count as of now: the kernel's time stamps, of its own clock, are in the
 * future.
 */
#include "cases.h"
#include "engine_rig.h"

#include <linux/can.h>
#include <sys/socket.h>

#define ECUS 44u
#define FRAMES_EACH 250u /* a socket takes them; together more than the inbox, see bus_make() */
#define EVERY_MS 10u
#define LATE_MS 500u
#define MS (CW_CLOCK_HZ / 1000u) /* in ticks */

typedef struct rig {
    engine_rig base;
    int ecus[ECUS];
    uint64_t sent; /* releases */
} rig;

/* Releases have to come at their times on the bus. */
static void check_release(void *user, const cw_event *event)
{
    rig *r = user;
    if (event->kind == CW_EVENT_TX && event->frame.id == 0)
        assert_int_equal(event->handed_in, r->sent++ * EVERY_MS * MS);
}

static char *make_config(rig *r)
{
    char *text;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    fprintf(out, "bus: { name: flood, bitrate: 1000000 }\ncatch-up: 1min\nnodes:\n"
                 "  - { name: load, traffic: [ { send: 000#, every: %ums } ] }\n", EVERY_MS);
    for (unsigned i = 0; i < ECUS; i++) {
        int ends[2];
        assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK, 0, ends), 0);
        r->ecus[i] = ends[0];
        fprintf(out, "  - { name: e%u, port: \"fd:%d\", queue: 4096, when-full: drop }\n", i,
                ends[1]);
    }
    fclose(out);
    return text;
}

static void start_rig(rig *r)
{
    *r = (rig){.sent = 0};
    engine_rig_start(&r->base, load_text(make_config(r)));
    engine_observe(r->base.engine, check_release, r);
}

static void end_rig(rig *r)
{
    assert_int_equal(engine_check_books(r->base.engine), 0);
    engine_rig_end(&r->base);
    for (unsigned i = 0; i < ECUS; i++)
        assert_int_equal(close(r->ecus[i]), 0);
}

static void write_frames(const rig *r)
{
    const struct can_frame frame = {.can_id = 0x100, .len = 1};
    for (unsigned i = 0; i < ECUS; i++)
        for (unsigned k = 0; k < FRAMES_EACH; k++)
            assert_int_equal(send(r->ecus[i], &frame, sizeof frame, 0), sizeof frame);
}

/* A wake-up comes late and finds the flood: the time until then has had its traffic. */
TEST(a_flood_does_not_put_off_traffic)
{
    rig r;
    start_rig(&r);
    write_frames(&r);
    clock_now_ns += LATE_MS * 1000000u;
    engine_update(r.base.engine);
    clock_now_ns += LATE_MS * 1000000u;
    engine_update(r.base.engine);
    assert_true(r.sent >= 2 * LATE_MS / EVERY_MS);
    end_rig(&r);
}
