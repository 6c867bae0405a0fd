/* SPDX-License-Identifier: MIT
 *
 * test_engine_flood.c - more frames of ECUs at one wake-up than the inbox has room for.
 *
 * The clock is ours. Frames count as of now: the kernel's time stamps, of its own clock, are in the
 * future.
 */
#include "engine/engine.h"

#include "config/config.h"

#include <linux/can.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#define NS_PER_S INT64_C(1000000000)
#define ECUS 44u
#define FRAMES_EACH 250u /* a socket takes them; together more than the inbox, see bus_make() */
#define EVERY_MS 10u
#define LATE_MS 500u
#define MS (CW_CLOCK_HZ / 1000u) /* in ticks */

static int64_t clock_now_ns = NS_PER_S;

/* Replaces the C library's function for the whole program. */
int clock_gettime(clockid_t id, struct timespec *t)
{
    (void)id;
    *t = (struct timespec){.tv_sec = clock_now_ns / NS_PER_S, .tv_nsec = clock_now_ns % NS_PER_S};
    return 0;
}

typedef struct rig {
    struct ev_loop *loop;
    live *live;
    engine *engine;
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
    *r = (rig){.loop = ev_loop_new(EVFLAG_AUTO)};
    char *text = make_config(r);
    const cfg_file file = {.name = "flood.yaml", .text = text, .size = strlen(text)};
    cfg *config = cfg_load_given(&file, 1, stderr);
    assert_non_null(config);
    free(text);
    r->live = live_new(config);
    r->engine = engine_start(r->loop, r->live);
    assert_non_null(r->engine);
    engine_observe(r->engine, check_release, r);
}

static void end_rig(rig *r)
{
    assert_int_equal(engine_check_books(r->engine), 0);
    engine_free(r->engine);
    live_free(r->live);
    ev_loop_destroy(r->loop);
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
static void a_flood_does_not_put_off_traffic(void **state)
{
    (void)state;
    rig r;
    start_rig(&r);
    write_frames(&r);
    clock_now_ns += LATE_MS * 1000000u;
    engine_update(r.engine);
    clock_now_ns += LATE_MS * 1000000u;
    engine_update(r.engine);
    assert_true(r.sent >= 2 * LATE_MS / EVERY_MS);
    end_rig(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_flood_does_not_put_off_traffic),
    };
    return cmocka_run_group_tests_name("floods", tests, NULL, NULL);
}
