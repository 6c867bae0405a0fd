/* SPDX-License-Identifier: MIT
 *
 * test_engine_replay.c - a recording over late wake-ups and reloads.
 *
 * The clock is ours. It jumps between the wake-ups, and within some of them, so that they end with
 * frames in the inbox whose time has not come.
 */
#include "cases.h"
#include "engine_rig.h"

#include <inttypes.h>

#define NS_PER_MS 1000000u
#define WAKE_MAX_NS 50000000 /* see engine_turn_is_over() */
#define FRAMES 400u /* of the recording */
#define PASSES 5u
#define FIRST_ID 0x700u
#define SENT_ID 0x7FFu /* of the lowest priority */
#define EVERY_MS 10u
#define US (CW_CLOCK_HZ / 1000000u) /* in ticks */
#define CROWD 100u /* frames that take 13 ms */
#define GAP_US 1000u                /* between passes, by default */
#define OTHERS_MAX 4u
#define SEEDS 12u

static const engine *hurried; /* its wake-ups end while the inbox has frames */

static void hurry(void)
{
    if (hurried && cw_bus_inbox_first(engine_bus(hurried)) != CW_NEVER)
        clock_now_ns += WAKE_MAX_NS;
}

typedef struct rig {
    uint64_t random;
    bool crowded; /* the recording has more frames of one time than the player's queue holds */
    engine_rig base;
    char config[PATH_BYTES];
    char recording[PATH_BYTES];
    unsigned replayed; /* frames of the recording */
    unsigned sent;     /* ... and others */
} rig;

static unsigned draw(rig *r, unsigned below)
{
    r->random = r->random * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(r->random >> 33) % below;
}

/* Returns the time of a frame in the recording. */
static uint64_t time_us(const rig *r, unsigned i)
{
    uint64_t us = 0;
    if (r->crowded)
        return i / CROWD * UINT64_C(20000);
    for (unsigned k = 0; k < i; k++)
        us += 300 + 7 * k % 900;
    return us;
}

/* Identifiers fall: two frames that wait together in the player's queue would turn round. */
static void write_recording(const rig *r)
{
    FILE *out = fopen(r->recording, "w");
    assert_non_null(out);
    for (unsigned i = 0; i < FRAMES; i++)
        fprintf(out, "(17.%06" PRIu64 ") can0 %03X#%04X\n", time_us(r, i), FIRST_ID - i, i);
    assert_int_equal(fclose(out), 0);
}

/* Writes the player behind other nodes, so that its number changes. */
static void write_config(rig *r)
{
    const unsigned others = draw(r, OTHERS_MAX + 1);
    FILE *out = fopen(r->config, "w");
    assert_non_null(out);
    fprintf(out, "bus: { name: replay, bitrate: 500000 }\ncatch-up: %s\nnodes:\n",
            draw(r, 2) ? "1min" : "20ms");
    for (unsigned i = 0; i <= others; i++)
        fprintf(out, "  - { name: n%u }\n", i);
    fprintf(out, "  - name: player\n    order: %s\n", r->crowded ? "fifo" : "priority");
    fprintf(out, "    traffic:\n      - { replay: %s, count: %u }\n", r->recording, PASSES);
    if (!r->crowded)
        fprintf(out, "      - { send: %03X#, every: %ums }\n", SENT_ID, EVERY_MS);
    assert_int_equal(fclose(out), 0);
}

/* Frames have to be handed in at their times on the bus, which stands still when time is
 * skipped. */
static void check_frame(void *user, const cw_event *event)
{
    rig *r = user;
    if (event->kind != CW_EVENT_TX)
        return;
    if (event->frame.id == SENT_ID) {
        assert_int_equal(event->handed_in, r->sent++ * EVERY_MS * 1000u * US);
        return;
    }
    const unsigned i = r->replayed % FRAMES;
    const uint64_t pass_us = r->replayed / FRAMES * (time_us(r, FRAMES - 1) + GAP_US);
    assert_int_equal(event->frame.id, FIRST_ID - i);
    if (r->crowded)
        assert_true(event->handed_in >= (pass_us + time_us(r, i)) * US);
    else
        assert_int_equal(event->handed_in, (pass_us + time_us(r, i)) * US);
    r->replayed++;
}

static void start_rig(rig *r, unsigned seed, bool crowded)
{
    *r = (rig){.random = seed, .crowded = crowded};
    make_file(r->config, "config");
    make_file(r->recording, "recording");
    write_recording(r);
    write_config(r);
    engine_rig_start(&r->base, cfg_load(r->config, stderr));
    engine_observe(r->base.engine, check_frame, r);
    at_look = hurry;
}

static void end_rig(rig *r)
{
    engine_rig_end(&r->base);
    assert_int_equal(unlink(r->config), 0);
    assert_int_equal(unlink(r->recording), 0);
}

static void reload_another(rig *r)
{
    write_config(r);
    engine_rig_reload(&r->base, r->config);
}

static void let_time_pass(rig *r)
{
    static const unsigned pauses_ms[] = {1, 5, 20, 200};
    clock_now_ns += draw(r, pauses_ms[draw(r, 4)] * NS_PER_MS);
    hurried = draw(r, 2) ? r->base.engine : NULL;
    if (draw(r, 4) == 0)
        reload_another(r);
    else
        engine_update(r->base.engine);
    hurried = NULL;
}

/* Each frame comes once and in its place, whatever the wake-ups, skips and reloads. */
static void check_traffic(bool crowded)
{
    unsigned changes = 0;
    for (unsigned seed = 1; seed <= SEEDS; seed++) {
        rig r;
        start_rig(&r, seed, crowded);
        while (r.replayed < PASSES * FRAMES)
            let_time_pass(&r);
        clock_now_ns += NS_PER_S;
        engine_update(r.base.engine);
        assert_int_equal(r.replayed, PASSES * FRAMES);
        changes += r.base.changes;
        end_rig(&r);
    }
    assert_true(changes > SEEDS);
}

TEST(traffic_comes_once_in_order_at_its_times)
{
    check_traffic(false);
}

TEST(frames_that_the_queue_cannot_hold_wait)
{
    check_traffic(true);
}
