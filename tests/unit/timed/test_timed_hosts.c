/* SPDX-License-Identifier: MIT
 *
 * test_timed_hosts.c - hosts that act in the middle of bits, of nodes with clocks of their own. A
 * bit that has been sampled counts, although it has not ended.
 */
#include "cases.h"
#include "canwire.h"

#define BIT_TICKS 160u
#define QUANTUM (CW_TICK * 10)
#define NODES 3u
#define FRAME_ID 0x123u

/* Counts of events about the one frame of node 0. */
typedef struct outcome {
    unsigned sent, dropped, received;
} outcome;

static cw_bus *make_bus_with(unsigned slower, uint16_t queue, unsigned first)
{
    cw_node_config nodes[NODES];
    for (unsigned i = 0; i < NODES; i++)
        nodes[i] = (cw_node_config){
            .queue = queue, .warning_limit = 96,
            .protocol = (uint8_t)(i == 0 ? first : CW_CLASSICAL),
            .timing.bit = {.quantum = QUANTUM + QUANTUM / 2000 * (cw_span)(slower * (i + 1)),
                           .prop_seg = 6, .phase_seg1 = 5, .phase_seg2 = 4, .sjw = 4}};
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = NODES, .inbox = 64,
                                  .events = 256, .nodes = nodes, .rule_room = 1};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    assert_non_null(bus);
    return bus;
}

static cw_bus *make_bus(unsigned slower)
{
    return make_bus_with(slower, 4, CW_CLASSICAL);
}

static void take_events(cw_bus *bus, outcome *o)
{
    cw_event e;
    while (cw_bus_poll(bus, &e)) {
        if (e.kind == CW_EVENT_RX || e.kind == CW_EVENT_TX || e.kind == CW_EVENT_DROP)
            assert_int_equal(e.frame.id, FRAME_ID);
        o->sent += e.kind == CW_EVENT_TX;
        o->dropped += e.kind == CW_EVENT_DROP;
        for (uint64_t rest = e.nodes; e.kind == CW_EVENT_RX && rest; rest &= rest - 1)
            o->received++;
    }
}

static cw_bus *begin(unsigned slower, unsigned bits)
{
    cw_bus *bus = make_bus(slower);
    assert_int_equal(cw_node_send(bus, 0, &(cw_frame){.id = FRAME_ID}, 12 * BIT_TICKS), CW_OK);
    assert_int_equal(cw_bus_advance(bus, bits * BIT_TICKS), CW_OK);
    return bus;
}

static void go_on(cw_bus *bus, outcome *o)
{
    take_events(bus, o);
    assert_int_equal(cw_bus_advance(bus, cw_bus_now(bus) + 200 * BIT_TICKS), CW_OK);
    take_events(bus, o);
    assert_int_equal(cw_bus_pending(bus), 0);
}

/* A frame that all have taken has been sent, and a frame that the sender has dropped has not. */
TEST(a_sender_that_leaves_has_sent_its_frame_or_not)
{
    unsigned sent = 0, dropped = 0;
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned bits = 50; bits < 65; bits++)
            for (unsigned for_good = 0; for_good < 2; for_good++) {
                outcome o = {0};
                FREED cw_bus *bus = begin(slower, bits);
                assert_int_equal(for_good ? cw_node_flush(bus, 0) : cw_node_attach(bus, 0, false),
                                 CW_OK);
                go_on(bus, &o);
                assert_int_equal(o.sent + o.dropped, 1);
                assert_true(!o.sent || o.received == NODES - 1);
                sent += o.sent;
                dropped += o.dropped;
            }
    assert_true(sent > 100 && dropped > 100);
}

/* A receiver that leaves has the frame, or nothing; never another one. */
TEST(a_receiver_that_leaves_has_the_frame_or_nothing)
{
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned bits = 50; bits < 65; bits++) {
            outcome o = {0};
            FREED cw_bus *bus = begin(slower, bits);
            assert_int_equal(cw_node_attach(bus, 2, false), CW_OK);
            go_on(bus, &o);
            assert_true(o.sent == 1 && o.dropped == 0);
            assert_true(o.received == NODES - 1 || o.received == NODES - 2);
        }
}

/* Another bus goes on with a frame whose end has been sampled and not yet been reported. A frame
 * that goes before it in the queue has come meanwhile, for which there may be no room any more. */
static void end_in_another_bus(unsigned slower, unsigned bits, uint16_t queue)
{
    static const uint8_t from[NODES] = {0, 1, 2};
    unsigned sent = 0, urgent = 0, heard = 0, dropped = 0;
    outcome o = {0};
    FREED cw_bus *old = begin(slower, bits), *bus = make_bus_with(slower, queue, CW_CLASSICAL);
    take_events(old, &o);
    assert_int_equal(cw_node_send(old, 0, &(cw_frame){.id = 1}, 0), CW_OK);
    assert_int_equal(cw_bus_take_over(bus, old, from), CW_OK);
    assert_int_equal(cw_bus_advance(bus, cw_bus_now(bus) + 200 * BIT_TICKS), CW_OK);
    cw_event e;
    while (cw_bus_poll(bus, &e)) {
        sent += e.kind == CW_EVENT_TX && e.frame.id == FRAME_ID;
        urgent += e.kind == CW_EVENT_TX && e.frame.id == 1;
        heard += e.kind == CW_EVENT_RX && e.frame.id == 1;
        dropped += e.kind == CW_EVENT_DROP && e.frame.id == 1;
    }
    assert_true(o.sent + sent == 1 && urgent + dropped == 1 && (heard > 0) == (urgent > 0));
    assert_true(urgent == 1 || queue == 1);
}

TEST(a_frame_that_ends_in_another_bus_is_the_right_one)
{
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned bits = 50; bits < 65; bits++) {
            end_in_another_bus(slower, bits, 4);
            end_in_another_bus(slower, bits, 1);
        }
}

#define EVENTS_MOST 64u

typedef struct history {
    cw_event events[EVENTS_MOST];
    unsigned count;
} history;

static void note_events(cw_bus *bus, history *h)
{
    while (h->count < EVENTS_MOST && cw_bus_poll(bus, &h->events[h->count]))
        h->count++;
}

typedef enum course { STAYS, TAKEN_OVER, RELOADED, COURSES } course;

/* Changes the modes of a node; 0: takes it off the bus. */
static void act(cw_bus *bus, unsigned node, unsigned modes)
{
    const cw_settings settings = {.which = CW_SET_MODES, .modes_mask = UINT8_MAX,
                                  .modes = (uint8_t)modes};
    if (modes)
        assert_int_equal(cw_node_set(bus, node, &settings), CW_OK);
    else
        assert_int_equal(cw_node_attach(bus, node, false), CW_OK);
}

/* Lets a host act on a node, and goes on in the bus, or in another one like it. When that reloads
 * settings, it brings the modes. */
static void note_course(history *h, course way, unsigned slower, unsigned bits, unsigned node,
                        unsigned modes)
{
    static const uint8_t from[NODES] = {0, 1, 2};
    FREED cw_bus *bus = begin(slower, bits);
    h->count = 0;
    note_events(bus, h);
    if (way != RELOADED || modes == 0)
        act(bus, node, modes);
    note_events(bus, h);
    if (way != STAYS) {
        cw_bus *next = make_bus(slower);
        if (modes)
            act(next, node, modes);
        assert_int_equal(cw_bus_take_over(next, bus, from), CW_OK);
        free(bus);
        bus = next;
    }
    assert_int_equal(cw_bus_advance(bus, (bits + 200) * BIT_TICKS), CW_OK);
    note_events(bus, h);
}

static void assert_same_history(const history *a, const history *b)
{
    assert_int_equal(a->count, b->count);
    for (unsigned n = 0; n < a->count; n++) {
        assert_int_equal(a->events[n].kind, b->events[n].kind);
        assert_int_equal(a->events[n].tick, b->events[n].tick);
        assert_int_equal(a->events[n].nodes, b->events[n].nodes);
    }
}

/* A node that is made to leave its bit leaves it at that tick, also when another bus takes over. A
 * frame whose end it has sampled has been sent. */
TEST(what_a_host_does_right_before_another_bus_counts)
{
    static const unsigned modes[] = {0, CW_MODE_LISTEN_ONLY, CW_MODE_LOOPBACK, CW_MODE_RESTRICTED};
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned bits = 13; bits < 65; bits++)
            for (unsigned what = 0; what < 8; what++) {
                history h[COURSES];
                for (course way = STAYS; way < COURSES; way++)
                    note_course(&h[way], way, slower, bits, what % 2, modes[what / 2]);
                assert_same_history(&h[STAYS], &h[TAKEN_OVER]);
                assert_same_history(&h[STAYS], &h[RELOADED]);
            }
}

/* Returns the tick of the first error at a receiver. */
static uint64_t first_error(cw_bus *bus)
{
    cw_event e;
    uint64_t tick = CW_NEVER;
    assert_int_equal(cw_bus_advance(bus, cw_bus_now(bus) + 50 * BIT_TICKS), CW_OK);
    while (cw_bus_poll(bus, &e))
        if (e.kind == CW_EVENT_ERROR && e.nodes > 1 && e.tick < tick)
            tick = e.tick;
    free(bus);
    return tick;
}

/* For others that is as if it had been taken off the bus. */
TEST(a_controller_with_another_protocol_leaves_its_bit)
{
    static const uint8_t from[NODES] = {0, 1, 2};
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned bits = 13; bits < 50; bits++) {
            cw_bus *bus = begin(slower, bits), *old = begin(slower, bits);
            cw_bus *next = make_bus_with(slower, 4, CW_FD_TOLERANT);
            act(bus, 0, 0);
            assert_int_equal(cw_bus_take_over(next, old, from), CW_OK);
            free(old);
            assert_int_equal(first_error(next), first_error(bus));
        }
}

/* Frames that come at any time to nodes that are off the bus. Events are polled after each bit. */
TEST(drops_come_in_the_order_of_time)
{
    FREED cw_bus *bus = make_bus(7);
    uint64_t last = 0;
    unsigned drops = 0;
    for (unsigned i = 0; i < NODES; i++)
        assert_int_equal(cw_node_attach(bus, i, false), CW_OK);
    for (unsigned bits = 1; bits < 400; bits++) {
        cw_event e;
        for (unsigned i = NODES; i-- > 0;)
            (void)cw_node_send(bus, i, &(cw_frame){.id = i}, bits * (BIT_TICKS + 1));
        assert_int_equal(cw_bus_advance(bus, bits * BIT_TICKS), CW_OK);
        while (cw_bus_poll(bus, &e)) {
            if (e.kind != CW_EVENT_DROP)
                continue;
            assert_true(e.tick >= last && e.tick <= cw_bus_now(bus));
            assert_true(e.frame.id == drops % NODES);
            last = e.tick;
            drops++;
        }
    }
    assert_true(drops > 1000);
}

/* ---- Another bus on another line ------------------------------------------------------------- */

#define MOST_NODES 5u

typedef struct dice {
    uint64_t state;
} dice;

static uint64_t below(dice *d, uint64_t limit)
{
    d->state ^= d->state << 13;
    d->state ^= d->state >> 7;
    d->state ^= d->state << 17;
    return d->state % limit;
}

static cw_node_timing random_timing(dice *d)
{
    const unsigned ps1 = 1 + (unsigned)below(d, 8), ps2 = 2 + (unsigned)below(d, 7);
    const unsigned prop = (unsigned)below(d, 9), quanta = 1 + prop + ps1 + ps2;
    cw_node_timing t = {.place = CW_TICK * (cw_span)below(d, below(d, 2) ? 30 : 300)};
    t.bit = (cw_bit_timing){.quantum = CW_TICK * BIT_TICKS / quanta, .prop_seg = (uint16_t)prop,
                            .phase_seg1 = (uint16_t)ps1, .phase_seg2 = (uint16_t)ps2, .sjw = 1};
    t.bit.quantum += t.bit.quantum / 1000 * ((cw_span)below(d, 40) - 20);
    const bool delays = below(d, 2);
    for (unsigned level = 0; level < 2 && delays; level++) {
        t.tx_delay[level] = CW_TICK * (cw_span)below(d, 200);
        t.rx_delay[level] = CW_TICK * (cw_span)below(d, 200);
    }
    t.ringing = below(d, 3) ? 0 : CW_TICK * (cw_span)below(d, 300);
    return t;
}

static cw_bus *random_bus(dice *d, unsigned count)
{
    cw_node_config nodes[MOST_NODES];
    for (unsigned i = 0; i < count; i++)
        nodes[i] = (cw_node_config){.queue = 8, .warning_limit = 96, .timing = random_timing(d)};
    const cw_bus_config config = {.bit_ticks = BIT_TICKS, .node_count = (uint8_t)count,
                                  .inbox = 64, .events = 4096, .nodes = nodes,
                                  .rule_room = 1};
    cw_bus *bus = cw_bus_init(malloc(cw_bus_size(&config)), &config);
    assert_non_null(bus);
    return bus;
}

static void forget_events(cw_bus *bus)
{
    cw_event e;
    while (cw_bus_poll(bus, &e))
        assert_true(e.tick <= cw_bus_now(bus) + BIT_TICKS);
}

static void let_it_work(dice *d, cw_bus *bus, unsigned count)
{
    for (unsigned k = 0; k < 6; k++) {
        const cw_frame frame = {.id = (uint32_t)below(d, 2048), .dlc = (uint8_t)below(d, 9),
                                .data = {(uint8_t)below(d, 256), 0, 0xFF}};
        const uint64_t tick = cw_bus_now(bus) + below(d, 20000);
        assert_int_equal(cw_node_send(bus, (unsigned)below(d, count), &frame, tick), CW_OK);
    }
    for (unsigned k = 0; k < 4; k++) {
        const uint64_t bits = 1 + below(d, 200);
        assert_int_equal(cw_bus_advance(bus, cw_bus_now(bus) + bits * BIT_TICKS), CW_OK);
        forget_events(bus);
        if (below(d, 6) == 0)
            assert_int_equal(cw_node_attach(bus, (unsigned)below(d, count), below(d, 2)), CW_OK);
    }
    forget_events(bus);
}

/* Delays, ringing and bit timings are others on the new line, and edges are under way. Nothing of
 * that may bring edges that are over. Time goes on. */
TEST(a_bus_on_another_line_goes_on)
{
    for (unsigned seed = 6500; seed < 6700; seed++) {
        dice d = {seed * UINT64_C(0x9E3779B97F4A7C15)};
        const unsigned count = 2 + (unsigned)below(&d, MOST_NODES - 1);
        FREED cw_bus *bus = random_bus(&d, count);
        for (unsigned round = 0; round < 6; round++) {
            let_it_work(&d, bus, count);
            cw_bus *next = random_bus(&d, count);
            uint8_t from[MOST_NODES] = {0, 1, 2, 3, 4};
            if (below(&d, 3) == 0)
                from[below(&d, count)] = CW_NO_NODE;
            assert_int_equal(cw_bus_take_over(next, bus, from), CW_OK);
            free(bus);
            bus = next;
        }
        forget_events(bus);
    }
}

/* ---- Rules between hosts and controllers ----------------------------------------------------- */

#define SENDS 40u

/* Hands in frames to nodes by turns, some of them within one bit. Their identifiers say in which
 * order they come. */
static void send_closely(dice *d, cw_bus *bus, unsigned count)
{
    uint64_t tick = 0;
    for (unsigned k = 0; k < SENDS; k++) {
        tick += 1 + below(d, k % 4 ? 30 : 200 * BIT_TICKS);
        const cw_frame frame = {.id = k};
        assert_int_equal(cw_node_send(bus, (unsigned)below(d, count), &frame, tick), CW_OK);
    }
}

/* Goes on by single bits. Returns the frames that a rule has dropped, as bits, in order. */
static uint64_t drops_of_rule(cw_bus *bus)
{
    uint64_t dropped = 0, last = 0;
    for (unsigned bits = 0; bits < 8000; bits++) {
        cw_event e;
        assert_int_equal(cw_bus_advance(bus, cw_bus_now(bus) + BIT_TICKS), CW_OK);
        while (cw_bus_poll(bus, &e)) {
            assert_true(e.tick >= last);
            last = e.tick;
            if (e.kind == CW_EVENT_DROP && e.why == CW_DROP_FAULT)
                dropped |= UINT64_C(1) << e.frame.id;
        }
    }
    return dropped;
}

/* A rule takes every third frame in the order in which hosts hand them in. Nodes look at their
 * queues at moments of their own. */
TEST(rules_see_frames_of_all_nodes_in_the_order_of_time)
{
    const cw_rule third = {.name = "third", .trigger = CW_TRIGGER_FRAME, .time_end = CW_NEVER,
                           .every = 3, .probability = UINT64_MAX, .action = CW_ACTION_DROP};
    uint64_t expected = 0;
    for (unsigned k = 0; k < SENDS; k += 3)
        expected |= UINT64_C(1) << k;
    for (unsigned seed = 1; seed < 200; seed++) {
        dice d = {seed * UINT64_C(0x9E3779B97F4A7C15)};
        const unsigned count = 2 + (unsigned)below(&d, MOST_NODES - 1);
        FREED cw_bus *bus = random_bus(&d, count);
        unsigned rule;
        assert_int_equal(cw_bus_add_rule(bus, &rule, &third), CW_OK);
        send_closely(&d, bus, count);
        assert_int_equal(drops_of_rule(bus), expected);
    }
}

/* Hands in a frame to the last node, and one to each other node a tick later. Returns the tick at
 * which the first one has been sent. */
static uint64_t sent_with(const cw_rule *rule, unsigned slower, uint64_t tick)
{
    cw_event e;
    uint64_t sent = CW_NEVER;
    FREED cw_bus *bus = make_bus(slower);
    unsigned index;
    if (rule)
        assert_int_equal(cw_bus_add_rule(bus, &index, rule), CW_OK);
    assert_int_equal(cw_node_send(bus, NODES - 1, &(cw_frame){.id = 1}, tick), CW_OK);
    for (unsigned i = 0; i < NODES - 1; i++)
        assert_int_equal(cw_node_send(bus, i, &(cw_frame){.id = 2 + i}, tick + 1), CW_OK);
    assert_int_equal(cw_bus_advance(bus, tick + 70 * BIT_TICKS), CW_OK);
    while (cw_bus_poll(bus, &e))
        if (e.kind == CW_EVENT_TX && e.frame.id == 1)
            sent = e.tick;
    return sent;
}

/* Clocks run apart before the frames come. A frame that a rule sees before those of other nodes,
 * and with these, begins no earlier than without the rule. */
TEST(a_frame_that_rules_see_begins_as_without_them)
{
    const cw_rule none = {.name = "none", .trigger = CW_TRIGGER_FRAME, .time_end = CW_NEVER,
                          .skip = UINT32_MAX, .probability = UINT64_MAX,
                          .action = CW_ACTION_DROP};
    for (unsigned slower = 0; slower < 20; slower++)
        for (unsigned k = 0; k < BIT_TICKS; k++) {
            const uint64_t tick = 300 * BIT_TICKS + k;
            assert_int_equal(sent_with(&none, slower, tick), sent_with(NULL, slower, tick));
        }
}
