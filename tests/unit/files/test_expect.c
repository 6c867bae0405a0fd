/* SPDX-License-Identifier: MIT
 *
 * test_expect.c - what is made of events by expectations, and how it is reported.
 *
 * Each case is one expectation of a configuration, on a run given as events. Each has its result as
 * text.
 */
#include "cases.h"
#include "sim/expect.h"

#include <inttypes.h>
#include <unistd.h>

#define MS (CW_CLOCK_HZ / 1000u)
#define A 1u /* nodes */
#define B 2u
#define C 4u

static const char config_text[] = "bus: { name: test, bitrate: 500000 }\n"
                                  "nodes: [ { name: a }, { name: b }, { name: c } ]\n"
                                  "faults:\n"
                                  "  - { name: one, do: { flip: sof } }\n"
                                  "  - { name: two, do: { flip: sof } }\n"
                                  "expect:\n";

#define FRAME(number) .frame = {.id = (number), .dlc = 2, .data = {0xDE, 0xAD}}

/* A frame that a node has sent or received, in milliseconds. */
#define MOVED(kind_, ms, at, by, handed_in_ms, id)                                                 \
    {                                                                                              \
        .kind = CW_EVENT_##kind_, .tick = (ms) * MS, .nodes = (at), .from = (by),                  \
        .handed_in = (handed_in_ms) * MS, FRAME(id)                                                \
    }

/* A run of 100 ms. Frame 123 of a three times, frame 124 of b once; what b gets comes late. */
static const cw_event run[] = {
    MOVED(RX, 10, B | C, A, 8, 0x123),
    MOVED(TX, 10, A, A, 8, 0x123),
    MOVED(RX, 20, C, A, 19, 0x123),
    MOVED(TX, 20, A, A, 19, 0x123),
    MOVED(RX, 26, B, A, 19, 0x123),
    {.kind = CW_EVENT_FAULT, .tick = 30 * MS, .rule = 0, .hit = 1},
    {.kind = CW_EVENT_ERROR, .tick = 30 * MS, .nodes = B, .error = {.type = CW_ERROR_CRC}},
    {.kind = CW_EVENT_ERROR, .tick = 30 * MS, .nodes = A, .error = {.type = CW_ERROR_FORM}},
    {.kind = CW_EVENT_STATE, .tick = 30 * MS, .nodes = B, .state = CW_STATE_ERROR_PASSIVE},
    {.kind = CW_EVENT_ERROR,
     .tick = 40 * MS,
     .nodes = B,
     .fast = true,
     .error = {.type = CW_ERROR_STUFF}},
    {.kind = CW_EVENT_STATE, .tick = 40 * MS, .nodes = B, .state = CW_STATE_BUS_OFF},
    {.kind = CW_EVENT_DROP, .tick = 45 * MS, .nodes = B, .why = CW_DROP_BUS_OFF, FRAME(0x124)},
    {.kind = CW_EVENT_RESTART, .tick = 50 * MS, .nodes = B},
    {.kind = CW_EVENT_ARBITRATION_LOST, .tick = 60 * MS, .nodes = B, FRAME(0x124)},
    {.kind = CW_EVENT_OVERLOAD, .tick = 61 * MS, .nodes = C},
    {.kind = CW_EVENT_EXCEPTION, .tick = 62 * MS, .nodes = C},
    MOVED(RX, 70, B | C, A, 60, 0x123),
    MOVED(TX, 70, A, A, 60, 0x123),
    MOVED(RX, 80, A | C, B, 55, 0x124),
    MOVED(TX, 80, B, B, 55, 0x124),
    {.kind = CW_EVENT_FAULT, .tick = 90 * MS, .rule = 1, .hit = 1},
};

static cfg *load(const char *expectation)
{
    char path[] = "/tmp/test_expect.XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_true(dprintf(fd, "%s  - %s\n", config_text, expectation) > 0);
    close(fd);
    cfg *config = cfg_load(path, stderr);
    unlink(path);
    assert_non_null(config);
    return config;
}

/* Makes a bus of that configuration, on which nothing happens for 100 ms. */
static cw_bus *make_bus(const cfg *config)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, config);
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&bus_config)), &bus_config);
    assert_non_null(bus);
    assert_int_equal(cw_bus_advance(bus, 100 * MS), CW_OK);
    return bus;
}

static expect_report judge(const cfg *config, const cw_event *events, size_t count)
{
    expect_report report = {.count = 0};
    FREED cw_bus *bus = make_bus(config);
    expect *x = expect_start(config, &(cw_bus_stats){.ticks = 0});
    assert_non_null(x);
    for (size_t i = 0; i < count; i++)
        expect_event(x, &events[i]);
    assert_true(expect_conclude(x, &report, bus));
    expect_free(x);
    return report;
}

typedef struct judgement {
    const char *expectation;
    bool met;
    const char *wanted;
    const char *got;
} judgement;

static const judgement judgements[] = {
    /* delivered: sent, or at each receiver */
    {"{ delivered: 4 }", true, "4 frames", "4"},
    {"{ delivered: 3, frame: 123 }", true, "3 frames 123", "3"},
    {"{ delivered: 2, frame: 123 }", false, "2 frames 123", "3"},
    {"{ delivered: { min: 3 }, from: a }", true, "at least 3 frames from a", "3"},
    {"{ delivered: { min: 4 }, from: a }", false, "at least 4 frames from a", "3"},
    {"{ delivered: { max: 3 }, from: a }", true, "at most 3 frames from a", "3"},
    {"{ delivered: { max: 2 }, from: a }", false, "at most 2 frames from a", "3"},
    {"{ delivered: { min: 1, max: 2 }, from: [ a, b ] }", false, "1 to 2 frames from a, b", "4"},
    {"{ delivered: 3, to: b }", true, "3 frames to b", "3"},
    {"{ delivered: 3, to: [ b, c ], from: a }", true, "3 frames from a to b, c", "b: 3, c: 3"},
    {"{ delivered: 3, to: [ b, c ] }", false, "3 frames to b, c", "b: 3, c: 4"},
    {"{ delivered: 1, to: c, from: b }", true, "1 frame from b to c", "1"},
    {"{ delivered: 0, data: DEAE }", true, "0 frames with data DEAE", "0"},
    {"{ delivered: 4, data: DE.D }", true, "4 frames with data DE.D", "4"},
    {"{ delivered: 0, data: DEAD00 }", true, "0 frames with data DEAD00", "0"},
    {"{ delivered: 1, frame: \"100:700\", time: 10ms..20ms }", true,
     "1 frame 100:700 from 10ms to 20ms", "1"},
    {"{ delivered: 0, before: 10ms }", true, "0 frames before 10ms", "0"},
    {"{ delivered: 1, before: 10.0001ms }", true, "1 frame before 10.0001ms", "1"},
    /* delays: 2, 1, 10 ms and 25 ms at the sender; at b 2, 7, 10 ms */
    {"{ delay: 25ms }", true, "delays of at most 25ms for frames", "at most 25ms (at 80ms), of 4"},
    {"{ delay: 24999us }", false, "delays of at most 24.999ms for frames",
     "at most 25ms (at 80ms), of 4"},
    {"{ delay: { max: 10ms }, to: b }", true, "delays of at most 10ms for frames to b",
     "at most 10ms (at 70ms), of 3"},
    {"{ delay: { max: 1s, p50: 2ms }, from: [ a, b ] }", true,
     "delays of at most 1s, 50 % within 2ms for frames from a, b",
     "at most 25ms (at 80ms), 50.0 % within 2ms, of 4"},
    {"{ delay: { p50: 1999us, p90: 1s } }", false,
     "delays of 50 % within 1.999ms, 90 % within 1s for frames",
     "at most 25ms (at 80ms), 25.0 % within 1.999ms, 100.0 % within 1s, of 4"},
    {"{ delay: { p99: 10ms }, to: [ a, b, c ] }", false,
     "delays of 99 % within 10ms for frames to a, b, c",
     "at most 25ms (at 80ms), 75.0 % within 10ms, of 8"},
    {"{ delay: 1h, frame: 125 }", false, "delays of at most 3600s for frames 125", "no frame"},

    /* gaps: at 0, 10, 20, 70 and 100 ms; b gets the second one at 26 ms */
    {"{ gap: 50ms, frame: 123 }", true, "gaps of at most 50ms between frames 123",
     "at most 50ms (up to 70ms)"},
    {"{ gap: 49999us, frame: 123 }", false, "gaps of at most 49.999ms between frames 123",
     "at most 50ms (up to 70ms)"},
    {"{ gap: 44ms, frame: 123, to: b }", true, "gaps of at most 44ms between frames 123 to b",
     "at most 44ms (up to 70ms)"},
    {"{ gap: 49ms, frame: 123, to: [ b, c ] }", false,
     "gaps of at most 49ms between frames 123 to b, c", "at most 50ms (up to 70ms)"},
    {"{ gap: 29ms, time: 70ms.. }", true, "gaps of at most 29ms between frames from 70ms",
     "at most 20ms (up to 100ms)"},
    {"{ gap: 39ms, frame: 123, time: 20ms..60ms }", false,
     "gaps of at most 39ms between frames 123 from 20ms to 60ms", "at most 40ms (up to 60ms)"},
    {"{ gap: 99ms, frame: 125 }", false, "gaps of at most 99ms between frames 125",
     "at most 100ms (up to 100ms)"},
    /* seen */
    {"{ seen: yes, frame: 124 }", true, "a frame 124", "one at 80ms"},
    {"{ seen: yes, frame: 124, before: 80ms }", false, "a frame 124 before 80ms", "none"},
    {"{ seen: yes, frame: 124, to: [ a, b ] }", false, "a frame 124 to a, b",
     "a: one at 80ms, b: none"},
    {"{ seen: never, frame: 124, before: 80ms }", true, "no frame 124 before 80ms", "none"},
    {"{ seen: never, frame: 124 }", false, "no frame 124", "one at 80ms"},
    {"{ seen: yes, frame: 123, time: 15ms.., to: b }", true, "a frame 123 to b from 15ms",
     "one at 26ms"},
    /* states */
    {"{ state: bus-off, node: b }", true, "bus-off reached at b", "at 40ms"},
    {"{ state: bus-off, node: b, before: 40ms }", false, "bus-off reached at b before 40ms",
     "never"},
    {"{ state: bus-off, node: b, reached: never }", false, "bus-off never reached at b", "at 40ms"},
    {"{ state: bus-off, node: [ a, c ], reached: never }", true, "bus-off never reached at a, c",
     "a: never, c: never"},
    {"{ state: bus-off, node: [ a, b ], reached: never }", false, "bus-off never reached at a, b",
     "a: never, b: at 40ms"},
    {"{ state: [ bus-off, error-passive ], node: b }", true,
     "error-passive or bus-off reached at b", "at 30ms"},
    /* counts */
    {"{ errors: 3 }", true, "3 errors", "3"},
    {"{ errors: 2, node: b }", true, "2 errors at b", "2"},
    {"{ errors: 1, node: [ a, b ] }", false, "1 error at a, b", "a: 1, b: 2"},
    {"{ errors: 2, type: [ crc, stuff ] }", true, "2 errors (stuff, crc)", "2"},
    {"{ errors: 0, type: ack }", true, "0 errors (ack)", "0"},
    {"{ drops: 1 }", true, "1 frame dropped", "1"},
    {"{ drops: 0, why: queue-full }", true, "0 frames dropped (queue-full)", "0"},
    {"{ drops: 1, why: [ queue-full, bus-off ], frame: 124, node: b }", true,
     "1 frame dropped 124 (queue-full, bus-off) at b", "1"},
    {"{ drops: 0, frame: 123 }", true, "0 frames dropped 123", "0"},
    {"{ restarts: 0 }", false, "0 restarts", "1"},
    {"{ restarts: 0, node: a }", true, "0 restarts at a", "0"},
    {"{ overloads: { max: 1 } }", true, "at most 1 overload flag", "1"},
    {"{ protocol-exceptions: 1, node: c }", true, "1 protocol exception at c", "1"},
    {"{ protocol-exceptions: 0 }", false, "0 protocol exceptions", "1"},
    {"{ errors: 1, rate: data }", true, "1 error at the data rate", "1"},
    {"{ errors: 2, rate: nominal }", true, "2 errors at the nominal rate", "2"},
    {"{ errors: 0, rate: data, node: a }", true, "0 errors at the data rate at a", "0"},
    {"{ arbitration-lost: 1, frame: 124 }", true, "1 lost arbitration 124", "1"},
    {"{ arbitration-lost: 1, frame: 123 }", false, "1 lost arbitration 123", "0"},
    {"{ faults: 2 }", true, "2 hits", "2"},
    {"{ faults: 1, rule: two }", true, "1 hit of two", "1"},
    {"{ faults: 1, rule: one, time: 50ms.. }", false, "1 hit of one from 50ms", "0"},
    {"{ load: { max: 50% } }", true, "a load of 0.0 % to 50.0 %", "0.0 %"},
    {"{ load: { min: 0.1% } }", false, "a load of 0.1 % to 100.0 %", "0.0 %"},
    /* a window that the run did not come to */
    {"{ errors: 0, time: 100ms.. }", true, "0 errors from 100ms", "0"},
    {"{ errors: 0, time: 101ms.. }", false, "0 errors from 101ms",
     "nothing: the run ended at 100ms"},
    {"{ seen: never, time: 2s..3s }", false, "no frame from 2s to 3s",
     "nothing: the run ended at 100ms"},
};

TEST(runs_are_judged)
{
    for (size_t i = 0; i < COUNT(judgements); i++) {
        const judgement *j = &judgements[i];
        cfg *config = load(j->expectation);
        expect_report report = judge(config, run, COUNT(run));
        assert_int_equal(report.count, 1);
        const expect_outcome *o = &report.outcomes[0];
        if (o->met != j->met || strcmp(o->wanted, j->wanted) != 0 || strcmp(o->got, j->got) != 0)
            fail_msg("%s: %s, wanted '%s', got '%s'", j->expectation, o->met ? "met" : "failed",
                     o->wanted, o->got);
        assert_string_equal(o->name, j->wanted);
        assert_int_equal(report.failed, !j->met);
        expect_report_free(&report);
        cfg_free(config);
    }
}

/* Its sender has left the bus before its end. */
TEST(a_frame_of_unknown_age_has_no_delay)
{
    const cw_event events[] = {{.kind = CW_EVENT_RX,
                                .tick = 10 * MS,
                                .nodes = B,
                                .handed_in = CW_NEVER,
                                FRAME(0x123)},
                               {.kind = CW_EVENT_RX,
                                .tick = 20 * MS,
                                .nodes = B,
                                .from = A,
                                .handed_in = 18 * MS,
                                FRAME(0x123)}};
    cfg *config = load("{ delay: 2ms, to: b }");
    expect_report report = judge(config, events, COUNT(events));
    assert_true(report.outcomes[0].met);
    assert_string_equal(report.outcomes[0].got, "at most 2ms (at 20ms), of 1");
    expect_report_free(&report);
    cfg_free(config);
}

/* The rate of a frame is that of its data field: only BRS of a CAN FD frame switches it (D10). */
TEST(frames_have_a_rate)
{
    static const struct {
        uint8_t flags;
        bool data;
    } cases[] = {{0, false},
                 {CW_FRAME_EXTENDED, false},
                 {CW_FRAME_FD, false},
                 {CW_FRAME_FD | CW_FRAME_ESI, false},
                 {CW_FRAME_FD | CW_FRAME_BRS, true},
                 {CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_EXTENDED | CW_FRAME_ESI, true}};
    for (size_t i = 0; i < COUNT(cases); i++)
        for (unsigned data = 0; data < 2; data++) {
            const cw_event sent = {.kind = CW_EVENT_TX,
                                   .tick = MS,
                                   .nodes = A,
                                   .from = A,
                                   .frame = {.id = 0x123, .flags = cases[i].flags}};
            cfg *config = load(data ? "{ delivered: 1, rate: data }"
                                    : "{ delivered: 1, rate: nominal }");
            expect_report report = judge(config, &sent, 1);
            assert_int_equal(report.failed, cases[i].data != (data != 0));
            expect_report_free(&report);
            cfg_free(config);
        }
}

TEST(outcomes_say_how_long_they_looked)
{
    static const struct {
        const char *expectation;
        uint64_t ticks;
    } cases[] = {
        {"{ errors: 3 }", 100 * MS},
        {"{ errors: 3, time: 10ms.. }", 90 * MS},
        {"{ errors: 3, time: 10ms..30ms }", 20 * MS},
        {"{ errors: 3, before: 1s }", 100 * MS},
        {"{ errors: 3, time: 1s..2s }", 0},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        cfg *config = load(cases[i].expectation);
        expect_report report = judge(config, run, COUNT(run));
        assert_int_equal(report.outcomes[0].ticks, cases[i].ticks);
        expect_report_free(&report);
        cfg_free(config);
    }
}

/* ---- While the bus runs ---------------------------------------------------------------------- */

typedef struct heard {
    unsigned count;
    uint64_t tick;
    char got[200];
    char event[200];
} heard;

static void on_failed(void *user, const expect_failure *failure)
{
    heard *h = user;
    h->count++;
    h->tick = failure->tick;
    (void)snprintf(h->got, sizeof h->got, "%s", failure->got);
    (void)snprintf(h->event, sizeof h->event, "%s", failure->event);
}

/* Judges the run while it goes on, as canwired does. */
static heard watch(const cfg *config)
{
    heard h = {.count = 0};
    expect *x = expect_start(config, &(cw_bus_stats){.ticks = 0});
    assert_non_null(x);
    expect_watch(x, on_failed, &h);
    for (size_t i = 0; i < COUNT(run); i++)
        expect_event(x, &run[i]);
    expect_pass(x, 100 * MS);
    expect_free(x);
    return h;
}

typedef struct failing {
    const char *expectation;
    unsigned ms;
    const char *event;
    const char *got;
} failing;

static const failing failures[] = {
    {"{ delivered: { max: 2 }, from: a }", 70, "tx 123#DEAD at a", "3"},
    {"{ delivered: { max: 2 }, to: [ b, c ], from: a }", 70, "rx 123#DEAD at b, c", "b: 3, c: 3"},
    {"{ delivered: { min: 3 }, before: 50ms }", 50, "", "2"},
    {"{ delay: 24999us }", 80, "tx 124#DEAD at b", "at most 25ms (at 80ms), of 4"},
    {"{ delay: 1h, frame: 125, before: 50ms }", 50, "", "no frame"},
    {"{ delay: { p50: 1500us }, before: 75ms }", 75, "",
     "at most 10ms (at 70ms), 33.3 % within 1.5ms, of 3"},
    {"{ gap: 39ms, frame: 123, time: 20ms..60ms }", 59, "", "none since 20ms"},
    {"{ gap: 49ms, frame: 123, to: [ b, c ] }", 69, "", "none since 20ms"},
    {"{ gap: 99ms, frame: 125 }", 99, "", "none since 0ns"},
    {"{ seen: yes, frame: 124, before: 80ms }", 80, "", "none"},
    {"{ seen: never, frame: 124 }", 80, "tx 124#DEAD at b", "one at 80ms"},
    {"{ state: bus-off, node: b, before: 40ms }", 40, "", "never"},
    {"{ state: bus-off, node: [ a, b ], reached: never }", 40, "state bus-off at b",
     "a: never, b: at 40ms"},
    {"{ errors: 1, node: [ a, b ] }", 40, "error stuff at b", "a: 1, b: 2"},
    {"{ drops: 0 }", 45, "drop 124#DEAD (bus-off) at b", "1"},
    {"{ restarts: 0 }", 50, "restart at b", "1"},
    {"{ arbitration-lost: 0 }", 60, "arbitration-lost 124#DEAD at b", "1"},
    {"{ overloads: 0 }", 61, "overload at c", "1"},
    {"{ faults: 0, rule: one }", 30, "fault one", "1"},
};

TEST(failures_are_told_at_once_with_their_event)
{
    for (size_t i = 0; i < COUNT(failures); i++) {
        const failing *f = &failures[i];
        cfg *config = load(f->expectation);
        const heard h = watch(config);
        if (h.count != 1 || h.tick != f->ms * MS || strcmp(h.event, f->event) != 0 ||
            strcmp(h.got, f->got) != 0)
            fail_msg("%s: %u times, at %" PRIu64 ", '%s', got '%s'", f->expectation, h.count,
                     h.tick, h.event, h.got);
        cfg_free(config);
    }
}

/* One that has failed meanwhile fails at the end, too. */
TEST(no_failure_is_told_that_the_end_takes_back)
{
    unsigned told = 0;
    for (size_t i = 0; i < COUNT(judgements); i++) {
        cfg *config = load(judgements[i].expectation);
        const heard h = watch(config);
        assert_in_range(h.count, 0, !judgements[i].met);
        told += h.count;
        cfg_free(config);
    }
    assert_in_range(told, 12, COUNT(judgements));
}

/* Nodes have changed their places meanwhile, and one is new. */
TEST(findings_go_on_in_another_configuration)
{
    static const uint8_t from[CW_NODES_MAX] = {1, 0, CW_NO_NODE, [3 ... 63] = CW_NO_NODE};
    heard h = {.count = 0};
    cfg *config = load("{ errors: { max: 2 }, node: [ a, b ] }");
    expect *old = expect_start(config, &(cw_bus_stats){.ticks = 0});
    expect *next = expect_start(config, &(cw_bus_stats){.ticks = 50 * MS});
    const cw_event more = {.kind = CW_EVENT_ERROR, .tick = 60 * MS, .nodes = A,
                           .error = {.type = CW_ERROR_CRC}};
    for (size_t i = 0; i < COUNT(run); i++)
        expect_event(old, &run[i]);
    expect_watch(next, on_failed, &h);
    expect_adopt(next, 0, old, 0, from);
    expect_free(old);
    expect_event(next, &more);
    assert_int_equal(h.count, 1);
    assert_string_equal(h.got, "a: 3, b: 1");
    expect_free(next);
    cfg_free(config);
}

/* Of a window that was over before, nothing is known. */
TEST(a_window_that_was_over_before_fails)
{
    heard h = {.count = 0};
    cfg *config = load("{ gap: 1ms, before: 10ms }");
    expect *x = expect_start(config, &(cw_bus_stats){.ticks = 50 * MS});
    expect_watch(x, on_failed, &h);
    expect_pass(x, 51 * MS);
    assert_int_equal(h.count, 1);
    expect_free(x);
    cfg_free(config);
}

/* ---- Reports --------------------------------------------------------------------------------- */

typedef void writer(FILE *out, const expect_report *report);

static char *written(writer *write, const expect_report *report)
{
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    write(out, report);
    fclose(out);
    return text;
}

static void write_junit(FILE *out, const expect_report *report)
{
    const expect_suite suite = {.report = report, .bus = "bus \"<&>'"};
    expect_report_junit(out, &suite, 1, 5 * CW_CLOCK_HZ + 12345679u);
}

static expect_report make_report(void)
{
    expect_report report = {.count = 0};
    assert_true(
        expect_report_add(&report, (expect_outcome){.name = strdup("a <b> & \"c\" \xC3\xA4"),
                                                    .wanted = strdup("x > 1"),
                                                    .got = strdup("2"),
                                                    .met = true,
                                                    .ticks = 2 * CW_CLOCK_HZ}));
    assert_true(expect_report_add(
        &report, (expect_outcome){.wanted = strdup("w<\xEF\xBF\xBF>"), .got = strdup("g\x01&")}));
    return report;
}

TEST(the_text_has_a_line_for_each)
{
    expect_report report = make_report();
    char *text = written(expect_report_text, &report);
    assert_string_equal(text, "ok     a <b> & \"c\" \xC3\xA4: wanted x > 1, got 2\n"
                              "FAILED wanted w<\xEF\xBF\xBF>, got g?&\n"
                              "2 expectations, 1 met, 1 failed\n");
    free(text);
    expect_report_free(&report);
}

/* Characters that XML does not allow are replaced, and its special characters are escaped. */
TEST(junit_is_good_xml)
{
    expect_report report = make_report();
    char *text = written(write_junit, &report);
    assert_string_equal(
        text,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<testsuites name=\"canwire\" tests=\"2\" failures=\"1\" errors=\"0\" time=\"5.154\">\n"
        "  <testsuite name=\"bus &quot;&lt;&amp;&gt;'\" tests=\"2\" failures=\"1\" errors=\"0\""
        " skipped=\"0\" time=\"5.154\">\n"
        "    <testcase name=\"a &lt;b&gt; &amp; &quot;c&quot; \xC3\xA4\""
        " classname=\"bus &quot;&lt;&amp;&gt;'\" time=\"2.000\"/>\n"
        "    <testcase name=\"w&lt;?&gt;\" classname=\"bus &quot;&lt;&amp;&gt;'\" time=\"0.000\">\n"
        "      <failure type=\"expectation\" message=\"wanted w&lt;?&gt;, got g?&amp;\"/>\n"
        "    </testcase>\n"
        "  </testsuite>\n"
        "</testsuites>\n");
    free(text);
    expect_report_free(&report);
}

/* To the nearest millisecond; three decimals are what all readers take. */
TEST(junit_times_are_rounded)
{
    static const struct {
        uint64_t ticks;
        const char *time;
    } cases[] = {
        {0, "0.000"},
        {1, "0.001"}, /* never nothing for something */
        {39999, "0.001"},
        {80000, "0.001"},
        {119999, "0.001"},
        {120000, "0.002"},
        {CW_CLOCK_HZ - 40001, "0.999"},
        {CW_CLOCK_HZ - 40000, "1.000"}, /* carried */
        {61 * (uint64_t)CW_CLOCK_HZ + 40000, "61.001"},
    };
    const expect_report none = {.count = 0};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char wanted[32];
        FREED char *text = NULL;
        size_t size = 0;
        FILE *out = open_memstream(&text, &size);
        assert_non_null(out);
        expect_report_junit(out, &(expect_suite){.report = &none, .bus = "b"}, 1, cases[i].ticks);
        fclose(out);
        (void)snprintf(wanted, sizeof wanted, " time=\"%s\"", cases[i].time);
        if (!strstr(text, wanted))
            fail_msg("%" PRIu64 " ticks: %s wanted, got %s", cases[i].ticks, wanted, text);
    }
}

TEST(outcomes_without_memory_are_refused)
{
    expect_report report = {.count = 0};
    assert_false(expect_report_add(&report, (expect_outcome){.wanted = strdup("x")}));
    assert_false(expect_report_add(&report, (expect_outcome){.got = strdup("x")}));
    assert_int_equal(report.count, 0);
    expect_report_free(&report);
}
