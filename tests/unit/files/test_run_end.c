/* SPDX-License-Identifier: MIT
 *
 * test_run_end.c - runs to the end of the traffic end as those bit by bit do, in few steps.
 *
 * Frames of a node that is bus-off stay in its queue, so such a run waits for 10 s of bus time.
 */
#include "cases.h"
#include "sim/sim_run.h"

#define EVENTS_MAX 4096u
#define BITS (20000u * 10u) /* of the wait */
#define BIT_TICKS (CW_CLOCK_HZ / 20000u)

typedef struct end_case {
    const char *name;
    const char *text;
    uint64_t work_max; /* steps of the bus, see cw_bus_work() */
    bool waits;        /* for 10 s, in vain */
    uint64_t rules_ms; /* the run goes on to this time of a rule; 0: it ends before any such */
} end_case;

#define BUS(more) "bus: { name: b, bitrate: 20000" more " }\nnodes:\n"
#define SENDS "traffic: [ { send: 123#00, every: 5ms, count: 20 } ] }\n"
#define OTHERS "  - { name: b }\n  - { name: c }\n"
#define KILL "faults:\n  - { name: k, when: { frame: 123 }, do: { flip: \"data[0.1]\" } }\n"

static const end_case cases[] = {
    {"all frames are sent", BUS("") "  - { name: a, " SENDS OTHERS, 1500, false, 0},
    {"more releases than the bus has ahead, and some come at once",
     BUS("") "  - { name: a, queue: 2, traffic: [ { send: 123#00, every: 5ms, count: 150 } ] }\n"
             "  - { name: b, queue: 2, traffic: [ { send: 124#, every: 7ms, count: 100, "
             "jitter: 3ms }, { send: 125#, every: 35ms, count: 20 } ] }\n  - { name: c }\n",
     9000, false, 0},
    {"bus-off", BUS("") "  - { name: a, " SENDS OTHERS KILL, 3000, true, 0},
    {"restarts", BUS("") "  - { name: a, restart-ms: 400, " SENDS OTHERS KILL, 60000, false, 0},
    {"a restart by a rule",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 20ms }, do: { bus-off: a } }\n"
             "  - { name: r, when: { time: 7s }, do: { restart: a } }\n",
     3000, false, 0},
    {"noise",
     BUS("") "  - { name: a, " SENDS OTHERS KILL
             "  - { name: n, when: { time: 0s }, do: { noise: 1e-4 } }\n",
     9000, true, 0},
    {"clocks of their own",
     BUS("") "  - { name: a, ppm: 90, " SENDS "  - { name: b, ppm: -90 }\n  - { name: c }\n" KILL,
     BITS / 8, true, 0},
    {"a data rate",
     BUS(", dbitrate: 40000") "  - { name: a, " SENDS "  - { name: b, traffic: [ { send: "
                              "124##1001122, count: 3, every: 30ms } ] }\n  - { name: c }\n" KILL,
     BITS / 8, true, 0},
    {"a node that sleeps has a frame",
     BUS("") "  - { name: a, sleep: on, " SENDS OTHERS, 3000, false, 0},
    {"a rule comes later",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 25s }, do: { error-flag: b } }\n",
     3000, true, 25000},
    {"a rule follows one that comes later",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 5s }, do: { counters: b, rec: 0 } }\n"
             "  - name: l\n    when: { after: { rule: k, delay: 2s } }\n"
             "    do: { send: 124#, as: b }\n",
     3000, false, 7000},
    {"a rule arms another one in the last bits",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 6s }, do: { counters: b, rec: 0 } }\n"
             "  - name: l\n    when: { after: { rule: k, delay: 4bit } }\n"
             "    do: { counters: b, rec: 0 }\n"
             "  - name: m\n    when: { after: { rule: l, delay: 150us } }\n"
             "    do: { counters: b, rec: 0 }\n",
     3000, false, 6000},
    {"a rule acts behind the last frame",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 98200us }, do: { counters: b, rec: 0 } }\n"
             "  - name: l\n    when: { after: { rule: k, delay: 3bit } }\n"
             "    do: { counters: b, rec: 0 }\n",
     3000, false, 0},
    {"a rule comes again",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 1s.., period: 11s, count: 3 }, do: { bus-off: b } }\n",
     6000, true, 23000},
    {"an action goes on",
     BUS("") "  - { name: a, " SENDS OTHERS "faults:\n"
             "  - { name: k, when: { time: 1s }, do: { send: 124#, as: b, every: 1s, for: 6s } }\n",
     6000, false, 7000},
};

typedef struct course {
    uint64_t end;
    uint64_t work;
    size_t count;
    cw_event events[EVENTS_MAX];
} course;

static void note(void *user, const cw_event *event)
{
    course *c = user;
    assert_true(c->count < EVENTS_MAX);
    c->events[c->count++] = *event;
}

static void go(course *c, const cfg *config, bool step)
{
    const sim_sink sink = {.user = c, .event = note};
    sim_run run;
    assert_true(sim_open(&run, config, NULL));
    run.step = step;
    sim_add_sink(&run, &sink);
    assert_true(sim_go(&run));
    c->end = cw_bus_now(run.bus);
    c->work = cw_bus_work(run.bus);
    sim_close(&run);
}

static void check_events(const course *is, const course *should_be)
{
    assert_int_equal(is->count, should_be->count);
    for (size_t i = 0; i < is->count; i++) {
        assert_int_equal(is->events[i].tick, should_be->events[i].tick);
        assert_int_equal(is->events[i].kind, should_be->events[i].kind);
        assert_int_equal(is->events[i].nodes, should_be->events[i].nodes);
    }
}

/* Checks that the run ends shortly behind the last time of a rule. */
static void check_time_of_rules(const course *is, uint64_t rules_ms)
{
    const uint64_t tick = rules_ms * (CW_CLOCK_HZ / 1000u);
    if (rules_ms > 0)
        assert_in_range(is->end, tick + 11 * BIT_TICKS, tick + 100 * BIT_TICKS);
}

TEST_ROWS(test_end, cases)
{
    const end_case *t = *state;
    const cfg_file file = {.name = "a.yaml", .text = t->text, .size = strlen(t->text)};
    cfg *config = cfg_load_text(&file, stderr);
    FREED course *both = calloc(2, sizeof *both);
    assert_non_null(config);
    assert_non_null(both);
    go(&both[0], config, false);
    go(&both[1], config, true);
    check_events(&both[0], &both[1]);
    assert_int_equal(both[0].end, both[1].end);
    assert_in_range(both[0].work, 1, t->work_max);
    assert_true(t->waits == (both[0].end >= UINT64_C(10) * CW_CLOCK_HZ));
    check_time_of_rules(&both[0], t->rules_ms);
    cfg_free(config);
}
