/* SPDX-License-Identifier: MIT
 *
 * test_engine_work.c - how much the engine does between two looks at the clock.
 *
 * The clock is ours: it goes on by a step at each look at it, so that the number of looks is
 * the time. Nothing here depends on the machine: what is bounded is the work of the bus
 * (cw_bus_work()).
 */
#include "cases.h"
#include "engine_rig.h"

#define STEP_NS INT64_C(5000000) /* that a look takes: ten are the time of a wake-up */
#define RULES 1000u
#define LOOKS_MAX 40u /* in one call, with reading clocks and arming the timer */

/* Limit of the work between two readings of the clock: the engine's own limit and the bit that
 * exceeds it. Each rule has its hit, its frame, the event of that and its place in the ring. */
#define WORK_MAX (256u + 8u * RULES)

/* ---- The clock ------------------------------------------------------------------------------- */

static const engine *watched;
static uint64_t work_at_look;
static uint64_t most_work;
static unsigned looks;

static void measure_work(void)
{
    const uint64_t work = cw_bus_work(engine_bus(watched));
    if (work - work_at_look > most_work)
        most_work = work - work_at_look;
    work_at_look = work;
    clock_now_ns += STEP_NS;
    looks++;
}

/* ---- A bus with more to do than any machine can ---------------------------------------------- */

typedef struct rig {
    engine_rig base;
    uint64_t drops;
    uint64_t bits; /* that were shown */
} rig;

static char *make_config(const char *traffic, const char *action)
{
    char *text;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    fprintf(out, "bus: { name: work, bitrate: 1000000 }\ncatch-up: 1s\nnodes:\n"
                 "  - { name: a, queue: 4 %s }\n  - { name: b, queue: 4 }\n%s", traffic,
            *action ? "faults:\n" : "");
    for (unsigned i = 0; i < RULES && *action; i++) {
        fprintf(out, "  - name: r%u\n    when: { time: 0s }\n    do: { ", i);
        fprintf(out, "%s, as: %c }\n", action, i % 2 ? 'a' : 'b');
    }
    fclose(out);
    return text;
}

static void count_drops(void *user, const cw_event *event)
{
    ((rig *)user)->drops += event->kind == CW_EVENT_DROP;
}

static void count_bits(void *user, const cw_bus *bus)
{
    (void)bus;
    ((rig *)user)->bits++;
}

static void start_rig(rig *r, const char *traffic, const char *action)
{
    *r = (rig){.drops = 0};
    engine_rig_start(&r->base, load_text(make_config(traffic, action)));
    engine_observe(r->base.engine, count_drops, r);
    watched = r->base.engine;
    at_look = measure_work;
    work_at_look = cw_bus_work(engine_bus(watched));
    most_work = 0;
    looks = 0;
}

static void end_rig(rig *r)
{
    at_look = NULL;
    engine_rig_end(&r->base);
}

/* Checks that the calls have done a bounded amount of work between readings of the clock. */
static void assert_in_bounds(const char *what)
{
    if (most_work > WORK_MAX || looks > LOOKS_MAX)
        fail_msg("%s: work %llu between two of %u looks", what, (unsigned long long)most_work,
                 looks);
    looks = 0;
}

/* Lets some seconds go by, in which the machine does nothing else; the bus must go on. */
static void wake_often(rig *r, const char *what)
{
    for (unsigned i = 0; i < 20; i++) {
        uint64_t before = cw_bus_now(engine_bus(r->base.engine));
        clock_now_ns += NS_PER_S / 2;
        engine_update(r->base.engine);
        assert_in_bounds(what);
        assert_true(cw_bus_now(engine_bus(r->base.engine)) > before);
    }
}

static const char *const floods[] = {
    "send: 123#1122334455667788, every: 1ns",
    "send: 123#, every: 1bit",
    "babble: 123#",
    "load: 100%",
};

TEST(rules_that_send_faster_than_the_bus)
{
    for (unsigned i = 0; i < sizeof floods / sizeof floods[0]; i++) {
        rig r;
        start_rig(&r, "", floods[i]);
        wake_often(&r, floods[i]);
        assert_int_equal(engine_check_books(r.base.engine), 0);
        end_rig(&r);
    }
}

/* Frames that a bus cannot send are dropped and counted, each of them, and take no memory. */
TEST(what_is_too_much_is_counted)
{
    rig r;
    start_rig(&r, "", floods[0]);
    wake_often(&r, floods[0]);
    cw_node_stats stats;
    uint64_t made = 0;
    for (unsigned i = 0; i < 2; i++) {
        assert_int_equal(cw_node_get_stats(engine_bus(r.base.engine), i, &stats), CW_OK);
        assert_true(cw_node_stats_balance(&stats));
        assert_in_range(stats.queue, 0, 4);
        made += stats.made_by_rules;
        r.drops -= stats.dropped[CW_DROP_QUEUE_FULL];
    }
    cw_bus_stats bus;
    cw_bus_get_stats(engine_bus(r.base.engine), &bus);
    assert_int_equal(r.drops, 0); /* events and counters agree */
    assert_int_equal(made, (bus.bits + 1) * RULES); /* one of each rule a bit, from tick 0 on */
    end_rig(&r);
}

/* A request: the bus is brought up to now before and after. */
TEST(requests_do_not_wait_for_the_bus)
{
    rig r;
    start_rig(&r, "", floods[0]);
    for (unsigned i = 0; i < 10; i++) {
        clock_now_ns += NS_PER_S / 2;
        inputs *in = engine_change(r.base.engine);
        assert_in_bounds("before a request");
        (void)inputs_restart(in, 0);
        engine_update(r.base.engine);
        assert_in_bounds("after a request");
    }
    end_rig(&r);
}

/* With recordings of bits each one is looked at by itself. */
TEST(bits_are_shown_in_turns)
{
    rig r;
    start_rig(&r, "", floods[0]);
    engine_observe_bits(r.base.engine, count_bits, &r);
    wake_often(&r, "bits shown");
    assert_true(r.bits > 0);
    end_rig(&r);
    start_rig(&r, "", "");
    engine_observe_bits(r.base.engine, count_bits, &r);
    wake_often(&r, "bits shown, nothing to do");
    end_rig(&r);
}

/* Traffic of nodes fills the inbox of a bus that is behind. */
TEST(traffic_of_nodes_waits_too)
{
    rig r;
    start_rig(&r, ", traffic: [ { send: 124#, every: 1us }, { send: 125#, every: 2us } ]",
              floods[0]);
    wake_often(&r, "traffic");
    end_rig(&r);
}

/* It stops, though the frame on the wire does not end before long. */
TEST(the_end_comes_in_time)
{
    rig r;
    start_rig(&r, "", floods[0]);
    wake_often(&r, "before the end");
    engine_stop(r.base.engine);
    assert_in_bounds("stop");
    clock_now_ns += NS_PER_S; /* a bus that is as slow as this one gets no more than that */
    assert_true(ev_run(r.base.loop, EVRUN_ONCE)); /* its timer is due */
    assert_in_bounds("stopped");
    end_rig(&r);
}
