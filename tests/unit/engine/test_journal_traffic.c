/* SPDX-License-Identifier: MIT
 *
 * test_journal_traffic.c - a journal does not have the frames that the configuration determines,
 * and the run again has them all the same, at their ticks.
 *
 * Configurations are random. The host is like canwired: it hands traffic in ahead of the bus, is
 * late at times, and changes to other configurations.
 */
#include "cases.h"
#include "journal_rig.h"

#include <inttypes.h>

#define SEEDS 20u
#define STEPS 120u
#define NODES 5u
#define TEXT_BYTES 8192

typedef struct sender {
    host h; /* first: it is the user of calls for a host */
    release_plan *plan;
    uint64_t released; /* tick up to which the traffic has been handed in */
    unsigned bitrate;
    bool floods;
} sender;

static uint32_t draw(host *h, uint32_t limit)
{
    h->state ^= h->state << 13;
    h->state ^= h->state >> 7;
    h->state ^= h->state << 17;
    return (uint32_t)(h->state >> 32) % limit;
}

static bool chance(host *h, uint32_t one_in)
{
    return draw(h, one_in) == 0;
}

/* ---- Random configurations ------------------------------------------------------------------- */

static size_t add(char *text, size_t used, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static size_t add(char *text, size_t used, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    used += (size_t)vsnprintf(text + used, TEXT_BYTES - used, format, args);
    va_end(args);
    assert_true(used < TEXT_BYTES);
    return used;
}

/* Adds a `send`: often, seldom, once; with jitter, counter and checksum, or an end. One with a
 * counter has an identifier of its own. */
static size_t add_send(sender *s, char *text, size_t used, unsigned own)
{
    host *h = &s->h;
    const bool counts = chance(h, 4);
    const unsigned every = chance(h, 4) ? 200 + draw(h, 800) : 1000 + draw(h, 20000);
    used = add(text, used, "      - { send: %03X#%04X00000000, offset: %uus",
               counts ? own : 0x100 + draw(h, 6), draw(h, 65536), draw(h, 5000));
    if (!chance(h, 6))
        used = add(text, used, ", every: %uus%s", every, chance(h, 3) ? ", count: 20" : "");
    if (chance(h, 3))
        used = add(text, used, ", jitter: %uus", draw(h, 200));
    if (counts)
        used = add(text, used, ", counter: { at: 2 }, checksum: { kind: crc8-j1850, at: 3 }");
    return add(text, used, " }\n");
}

static size_t add_node(sender *s, char *text, size_t used, unsigned node)
{
    host *h = &s->h;
    used = add(text, used, "  - name: n%u\n    queue: %u\n    restart-ms: %u\n", node,
               1 + draw(h, 8), 1 + draw(h, 5));
    if (chance(h, 6))
        used = add(text, used, "    ppm: %d\n", (int)draw(h, 200) - 100);
    used = add(text, used, "    traffic:\n      - { reply: 7F%u#, to: \"100\" }\n", node);
    for (unsigned i = draw(h, 4); i > 0; i--)
        used = add_send(s, text, used, 0x200 + 4 * node + i);
    if (chance(h, 5))
        used = add(text, used, "      - { replay: profile.yaml, format: candump }\n");
    if (s->floods && node == 0)
        used = add(text, used, "      - { send: 7FF#, every: 2us, offset: 10ms, count: 12000 }\n");
    return used;
}

static cfg *make_config(sender *s)
{
    char text[TEXT_BYTES];
    const unsigned nodes = 1 + draw(&s->h, NODES);
    size_t used = add(text, 0, "bus: { name: test, bitrate: %u }\nseed: %u\nnodes:\n", s->bitrate,
                      draw(&s->h, 100));
    for (unsigned i = 0; i < nodes; i++)
        used = add_node(s, text, used, i);
    (void)add(text, used,
              "faults:\n  - { name: noise, do: { noise: 1e-4 } }\n"
              "  - { name: coin, when: { frame: \"100:7F0\", probability: 0.1 }, "
              "do: { flip: \"crc[3]\" } }\n");
    write_file("bus.yaml", text);
    write_file("profile.yaml", "(0.000100) can0 200#01\n(0.001000) can0 201#02\n"
                               "(0.001000) can0 202#03\n(0.010000) can0 203#04\n");
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    if (!config)
        fail_msg("%s", text);
    return config;
}

/* ---- The first run --------------------------------------------------------------------------- */

static void ignore(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    (void)text;
}

/* Hands in what comes up to a tick, as engine_release_to() does. */
static void release_to(sender *s, uint64_t tick)
{
    inputs *in = &s->h.inputs;
    const uint64_t bit = cw_rate_ticks(live_config(s->h.live)->rate, 1);
    while (release_next_tick(s->plan) <= tick)
        if (inputs_release(in, s->plan) == CW_FULL)
            inputs_advance(in, cw_bus_inbox_first(in->bus) + bit);
    s->released = tick > s->released ? tick : s->released;
}

/* Goes on, bit by bit while a file waits for its node. Sometimes traffic has been handed in beyond
 * that, and sometimes it is late. */
static void go(sender *s, uint64_t ticks)
{
    inputs *in = &s->h.inputs;
    const uint64_t end = cw_bus_now(in->bus) + ticks;
    if (chance(&s->h, 20))
        inputs_advance(in, end);
    release_look(s->plan, in->bus);
    release_to(s, end + (chance(&s->h, 4) ? draw(&s->h, 200000) : 0));
    while (release_is_fast(s->plan) && cw_bus_tick_after(in->bus, 1) < end) {
        inputs_advance(in, cw_bus_tick_after(in->bus, 1));
        release_look(s->plan, in->bus);
        release_to(s, end);
    }
    inputs_advance(in, end);
}

static void send_some(sender *s)
{
    inputs *in = &s->h.inputs;
    const cw_frame frame = {.id = 0x100 + draw(&s->h, 0x600), .dlc = 1, .data = {7}};
    const unsigned node = draw(&s->h, (uint32_t)live_config(s->h.live)->node_count);
    const uint64_t now = cw_bus_now(in->bus);
    const uint64_t next = release_next_tick(s->plan); /* perhaps for the same tick */
    const uint64_t tick = chance(&s->h, 3) ? next : now + draw(&s->h, 5000);
    (void)inputs_send(in, node, &frame, tick == CW_NEVER ? now : tick);
}

static void change(sender *s)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    inputs *in = &s->h.inputs;
    cfg *config = make_config(s);
    cw_bus *bus = bus_make(&memory, config);
    release_plan *plan = release_plan_new(config, ignore, NULL);
    assert_true(bus && plan);
    cfg_match_nodes(from, config, live_config(s->h.live));
    assert_int_equal(inputs_take_over(in, bus, config, from, s->released + 1), CW_OK);
    release_take_over(plan, s->plan, from, s->released + 1);
    release_plan_free(s->plan);
    s->plan = plan;
    free(s->h.memory);
    s->h.memory = memory;
    live_replace(s->h.live, config);
}

static void do_something(sender *s)
{
    inputs *in = &s->h.inputs;
    const unsigned node = draw(&s->h, (uint32_t)live_config(s->h.live)->node_count);
    switch (draw(&s->h, 12)) {
    case 0:
        take_events(&s->h);
        inputs_attach(in, node, !cw_node_attached(in->bus, node));
        break;
    case 1: {
        const cw_event event = inputs_skip(in, 1000, 0);
        output_event(s->h.events.out, live_config(s->h.live), &event);
        break;
    }
    case 2:
        if (chance(&s->h, 6))
            change(s);
        break;
    case 3:
        journal_mark(s->h.journal, in);
        break;
    case 4:
    case 5:
        send_some(s);
        break;
    default:
        go(s, draw(&s->h, chance(&s->h, 5) ? 2000000 : 100000));
        break;
    }
}

static void sender_begin(sender *s, uint64_t seed)
{
    static const unsigned rates[] = {125000, 500000, 1000000};
    *s = (sender){.h = {.state = seed * 0x9E3779B97F4A7C15u | 1u}};
    s->bitrate = rates[draw(&s->h, COUNT(rates))];
    s->floods = seed % 20 == 0;
    cfg *config = make_config(s);
    host_begin_with(&s->h, config);
    s->plan = release_plan_new(config, ignore, NULL);
    assert_non_null(s->plan);
}

static void sender_end(sender *s)
{
    release_plan_free(s->plan);
    host_end(&s->h);
}

/* ---- The second run is as the first ---------------------------------------------------------- */

/* Returns the number of lines of a text with a word. */
static size_t count_lines(const char *text, const char *word)
{
    size_t count = 0;
    for (const char *at = text; (at = strstr(at, word)); at++)
        count++;
    return count;
}

static void check_seed(unsigned seed, size_t *frames, size_t *lines, size_t *late)
{
    char *events, *messages;
    sender s;
    sender_begin(&s, seed);
    for (unsigned i = 0; i < STEPS; i++)
        do_something(&s);
    sender_end(&s);
    const journal_outcome outcome = play(&events, &messages);
    if (outcome != JOURNAL_PLAYED || *messages)
        fail_msg("seed %u: %s", seed, messages);
    if (strcmp(events, s.h.events.text) != 0) {
        size_t same = 0;
        while (events[same] == s.h.events.text[same])
            same++;
        fail_msg("seed %u: after %zu bytes '%.100s' is not '%.100s'", seed, same, events + same,
                 s.h.events.text + same);
    }
    char *text = read_text("journal");
    *frames += s.h.done[INPUT_SEND];
    *lines += count_lines(text, "\"send\":");
    *late += count_lines(text, "\"late\":true");
    free(text);
    free(events);
    free(messages);
    free(s.h.events.text);
}

TEST(frames_that_are_not_written_come_all_the_same)
{
    size_t frames = 0, lines = 0, late = 0;
    for (unsigned seed = 1; seed <= SEEDS; seed++)
        check_seed(seed, &frames, &lines, &late);
    assert_true(late > 0);
    if (lines == 0 || frames < 10 * lines)
        fail_msg("%zu lines for %zu frames", lines, frames);
}

/* The second advance drops a frame. A frame of the configuration behind it has no line, and the
 * next line must have the advance all the same. */
TEST(an_advance_before_a_frame_that_is_not_written_is_repeated)
{
    const cw_frame frame = {.id = 0x123};
    char *events, *messages;
    sender s = {.h = {.live = NULL}};
    write_file("bus.yaml", "bus: { name: test, bitrate: 500000 }\nnodes:\n"
                           "  - { name: full, queue: 1 }\n"
                           "  - { name: other, traffic: [ { send: 100#, offset: 5ms } ] }\n");
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    host_begin_with(&s.h, config);
    s.plan = release_plan_new(config, ignore, NULL);
    inputs *in = &s.h.inputs;
    inputs_advance(in, 20 * BIT);
    for (unsigned i = 0; i < 3; i++)
        assert_int_equal(inputs_send(in, 0, &frame, 0), CW_OK);
    inputs_advance(in, 20 * BIT);
    assert_int_equal(inputs_release(in, s.plan), CW_OK);
    const cw_event event = inputs_skip(in, 1000, 0);
    output_event(s.h.events.out, config, &event);
    inputs_advance(in, 4000 * BIT);
    sender_end(&s);
    assert_non_null(strstr(s.h.events.text, "\"drop\""));
    assert_int_equal(play(&events, &messages), JOURNAL_PLAYED);
    assert_string_equal(events, s.h.events.text);
    free(events);
    free(messages);
    free(s.h.events.text);
}

TESTS_WITH(make_folder, remove_folder)
