/* SPDX-License-Identifier: MIT
 *
 * test_journal_play.c - what is done to a bus is written down and run again: the same events, to
 * the byte.
 *
 * The first run is that of a host that does everything that there is at random; it stands for
 * canwired.
 */
#include "cases.h"
#include "journal_rig.h"

#define STEPS 1500u

/* ---- The first run --------------------------------------------------------------------------- */

static uint32_t draw(host *h, uint32_t limit)
{
    h->state ^= h->state << 13;
    h->state ^= h->state >> 7;
    h->state ^= h->state << 17;
    return (uint32_t)(h->state >> 32) % limit;
}

static unsigned any_node(host *h)
{
    return draw(h, (uint32_t)live_config(h->live)->node_count);
}

/* Returns a frame, mostly a good one; some cannot be sent, or have bytes that do not count. */
static cw_frame any_frame(host *h)
{
    static const uint32_t ids[] = {0x100, 0x123, 0x200, 0x7FF};
    cw_frame frame = {.id = ids[draw(h, COUNT(ids))], .dlc = (uint8_t)draw(h, 9)};
    if (draw(h, 6) == 0)
        frame = (cw_frame){.id = draw(h, 0x1FFFFFFF), .flags = CW_FRAME_EXTENDED, .dlc = frame.dlc};
    if (draw(h, 6) == 0)
        frame.flags |= CW_FRAME_REMOTE;
    if (draw(h, 20) == 0)
        frame.dlc = (uint8_t)draw(h, 256);
    if (draw(h, 40) == 0)
        frame.id = UINT32_MAX;
    if (draw(h, 40) == 0)
        frame.flags = (uint8_t)draw(h, 32);
    if (draw(h, 40) == 0)
        frame.flags = CW_FRAME_FD | CW_FRAME_BRS;
    if ((frame.flags & CW_FRAME_FD) && draw(h, 2) == 0)
        frame.dlc = (uint8_t)draw(h, 16);
    bool all = draw(h, 10) == 0;
    const unsigned length = cw_frame_length(&frame);
    const unsigned room =
        frame.flags & CW_FRAME_FD ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX;
    for (unsigned i = 0; i < room && (i < frame.dlc || i < length || all); i++)
        frame.data[i] = (uint8_t)draw(h, 256);
    return frame;
}

/* Sends a frame for now, before or later; in any order. */
static void do_send(host *h)
{
    const uint64_t now = cw_bus_now(h->inputs.bus);
    for (unsigned i = draw(h, 4); i < 4; i++) {
        const cw_frame frame = any_frame(h);
        uint64_t tick = now + draw(h, 1000);
        tick -= tick > 500 ? 500 : tick;
        assert_int_equal(inputs_send(&h->inputs, any_node(h), &frame, tick), CW_OK);
    }
}

static void do_inject(host *h)
{
    static const char *const actions[] = {
        "when: { frame: \"123\", count: 3 }, do: { flip: \"data[0.0]\" }",
        "when: { after: { rule: hand } }, do: { counters: a, tec: 120 }",
        "when: { manual: yes }, do: { bus-off: a }",
        "do: { stuck: recessive, on: a.tx, for: 5ms }",
        "when: { frame: \"100:700\" }, do: { drop: rx, at: c }",
        "when: { nonsense: 1 }, do: { bus-off: a }",
    };
    char text[300];
    FREED char *errors = NULL;
    size_t size;
    FILE *stream = open_memstream(&errors, &size);
    int used = snprintf(text, sizeof text, "- { name: r%u, %s }\n", h->rules, actions[draw(h, 6)]);
    h->rules++;
    snprintf(text + used, sizeof text - (size_t)used, "- { name: r%u, %s }\n", h->rules,
             actions[draw(h, 5)]);
    h->rules++;
    cfg_free_rules(inputs_inject(&h->inputs, text, strlen(text), "test", stream));
    fclose(stream);
}

/* Returns false when there is no rule at the drawn place. */
static bool any_rule(host *h, unsigned *rule)
{
    const cfg *config = live_config(h->live);
    if (config->rule_count == 0)
        return false;
    *rule = draw(h, (uint32_t)config->rule_count);
    return config->rules[*rule].name != NULL;
}

static void do_rule(host *h)
{
    unsigned rule;
    if (!any_rule(h, &rule))
        return;
    if (draw(h, 3) == 0)
        inputs_clear(&h->inputs, rule);
    else
        (void)inputs_fire(&h->inputs, rule);
}

static void do_set(host *h)
{
    cw_settings s = {.which = (uint8_t)draw(h, 32),
                     .modes_mask = CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY,
                     .modes = draw(h, 3) == 0 ? (uint8_t)draw(h, 4) : 0,
                     .order = (cw_order)draw(h, 2),
                     .queue = (uint16_t)(draw(h, 4) ? 1 + draw(h, 6) : CW_QUEUE_MAX),
                     .warning_limit = (uint16_t)(1 + draw(h, 255)),
                     .restart_ticks = draw(h, 3) * (uint64_t)(CW_CLOCK_HZ / 1000)};
    if (s.which)
        (void)inputs_set(&h->inputs, any_node(h), &s);
}

static void do_skip(host *h)
{
    uint64_t ticks = 1 + draw(h, 1000000);
    const cw_event event = inputs_skip(&h->inputs, ticks, draw(h, 2) ? ticks : 0);
    output_event(h->events.out, live_config(h->live), &event);
}

static void do_reload(host *h)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    cfg *config = load_config(draw(h, COUNT(configs)));
    cw_bus *bus = bus_make(&memory, config);
    assert_non_null(bus);
    cfg_match_nodes(from, config, live_config(h->live));
    assert_int_equal(inputs_take_over(&h->inputs, bus, config, from, 0), CW_OK);
    free(h->memory);
    h->memory = memory;
    live_replace(h->live, config);
}

static void do_command(host *h)
{
    switch (draw(h, 8)) {
    case 0:
        do_inject(h);
        break;
    case 1:
    case 2:
        do_rule(h);
        break;
    case 3:
        (void)inputs_restart(&h->inputs, any_node(h));
        break;
    case 4:
        do_set(h);
        break;
    case 5:
        inputs_attach(&h->inputs, any_node(h), draw(h, 3) > 0);
        break;
    case 6:
        do_skip(h);
        break;
    default:
        if (draw(h, 5) == 0)
            do_reload(h);
        break;
    }
}

/* Advances, also by nothing, and into the middle of bits. */
static void do_advance(host *h)
{
    static const uint32_t spans[] = {1, 10, BIT, 5 * BIT, 200 * BIT, 3000 * BIT};
    inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + draw(h, spans[draw(h, COUNT(spans))]));
}

static void host_run(host *h)
{
    for (unsigned i = 0; i < STEPS; i++) {
        uint32_t what = draw(h, 10);
        if (what < 4)
            do_send(h);
        else if (what < 8)
            do_advance(h);
        else if (what < 9)
            do_command(h);
        else if (draw(h, 5) == 0)
            journal_mark(h->journal, &h->inputs);
    }
    inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + 2000 * BIT);
}

/* ---- The second run is as the first ---------------------------------------------------------- */

static void check_same(const char *again, const char *first, unsigned seed)
{
    size_t same = 0;
    while (again[same] && again[same] == first[same])
        same++;
    if (again[same] != first[same])
        fail_msg("seed %u: after %zu bytes '%.200s' is not '%.200s'", seed, same, again + same,
                 first + same);
}

TEST(the_same_inputs_give_the_same_events)
{
    unsigned done[INPUT_COUNT] = {0};
    for (unsigned seed = 1; seed <= 30; seed++) {
        host h;
        FREED char *events;
        FREED char *messages;
        host_begin(&h, seed);
        host_run(&h);
        host_end(&h);
        journal_outcome outcome = play(&events, &messages);
        assert_string_equal(messages, "");
        check_same(events, h.events.text, seed);
        assert_int_equal(outcome, JOURNAL_PLAYED);
        assert_true(h.events.size > 1000);
        for (unsigned i = 0; i < INPUT_COUNT; i++)
            done[i] += h.done[i];
        free(h.events.text);
    }
    for (unsigned i = 0; i < INPUT_COUNT; i++)
        assert_int_not_equal(done[i], 0);
}

/* Cuts a packed journal, and plays it. Returns the events, to be freed; NULL: not even the
 * configuration is there. */
static char *play_cut(const char *whole, size_t cut)
{
    char *events;
    char *messages;
    write_bytes("journal", whole, cut);
    const journal_outcome outcome = play(&events, &messages);
    const bool begun = outcome != JOURNAL_FAILED;
    if (outcome == JOURNAL_INCOMPLETE)
        assert_non_null(strstr(messages, "/journal: the journal is cut off at "));
    else if (begun) /* the last line is there; what is missing has no text */
        assert_string_equal(messages, "");
    else
        assert_non_null(strstr(messages, ":1: "));
    assert_null(strstr(messages, "damaged"));
    free(messages);
    if (begun)
        return events;
    assert_string_equal(events, "");
    free(events);
    return NULL;
}

/* Up to the last block that is complete, whatever byte it ends at: no later byte takes anything
 * away again. */
TEST(a_journal_that_is_cut_off_is_played_as_far_as_it_goes)
{
    size_t size, before = 0, steps = 0;
    host h;
    host_begin(&h, 77);
    host_run(&h);
    host_end(&h);
    char *whole = read_bytes("journal", &size);
    for (size_t cut = 0; cut < size; cut += 1 + size / 100) {
        char *events = play_cut(whole, cut);
        const size_t length = events ? strlen(events) : 0;
        if (events)
            assert_int_equal(strncmp(events, h.events.text, length), 0);
        assert_true(length >= before);
        steps += length > before;
        before = length;
        free(events);
    }
    assert_true(steps > 1);
    free(whole);
    free(h.events.text);
}

TEST(a_small_journal_can_be_cut_at_each_byte)
{
    size_t size, begun = 0;
    free(make_small_journal(&size));
    char *whole = read_bytes("journal", &size);
    for (size_t cut = 0; cut < size; cut++) {
        char *events = play_cut(whole, cut);
        begun += events != NULL;
        free(events);
    }
    assert_true(begun > 0);
    free(whole);
}

TEST(a_damaged_journal_is_played_up_to_the_damage)
{
    size_t size;
    FREED char *events;
    FREED char *messages;
    FREED char *text = make_small_journal(&size);
    *strstr(text, "\"end\"") ^= 1;
    write_file("journal", text);
    assert_int_equal(play(&events, &messages), JOURNAL_FAILED);
    assert_non_null(strstr(messages, ":7:1: damaged: wrong checksum, bytes "));
    assert_non_null(strstr(messages, " of the file, behind 0.000600000 s"));
    assert_string_not_equal(events, "");
}

TESTS_WITH(make_folder, remove_folder)
