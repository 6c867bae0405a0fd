/* SPDX-License-Identifier: MIT
 *
 * test_buffers.c - what sits between controllers and hosts: acceptance filters (M12), receive
 * buffers and mailboxes.
 */
#include "model.h"
#include "rig.h"

#define US 80u         /* ticks */
#define SLOT (50 * BIT)
#define FRAMES 40u

static cw_host_stats host_stats(const rig *r, unsigned node)
{
    cw_host_stats s;
    assert_int_equal(cw_node_get_host_stats(r->bus, node, &s), CW_OK);
    return s;
}

/* Returns the n-th frame that fits into a slot of 50 bits, with its intermission. */
static cw_frame short_frame(unsigned n)
{
    cw_frame f = {.id = 0x100};
    while (model_encode(&f).length > 47 || n-- > 0)
        f.id++;
    return f;
}

/* Node 0 sends frames in slots of 50 bits. */
static void send_in_slots(rig *r, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        const cw_frame f = short_frame(i);
        rig_send(r, 0, &f, JOIN * BIT + (uint64_t)i * SLOT);
    }
}

static void balance(const rig *r)
{
    for (unsigned i = 0; i < r->config.node_count; i++) {
        const cw_node_stats s = rig_stats(r, i);
        assert_true(cw_node_stats_balance(&s));
    }
}

/* ---- Filters --------------------------------------------------------------------------------- */

TEST(filters_decide_what_a_host_gets_and_nothing_else)
{
    static const cw_filter all_of_these = {.value = 0x100, .mask = 0x7F0, .inverted = true};
    const cw_filter some[] = {{.value = short_frame(0).id, .mask = 0x7FF},
                              {.value = short_frame(3).id, .mask = 0x7FF},
                              {.value = short_frame(4).id, .mask = 0x7FF}};
    RIG *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.filters = some, .filter_count = 3};
    r->nodes[2].host = (cw_host_config){.filters = &all_of_these, .filter_count = 1};
    rig_start(r);
    send_in_slots(r, FRAMES);
    rig_run_bits(r, 60 * FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 3);
    assert_int_equal(host_stats(r, 1).filtered, FRAMES - 3);
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_RX && (r->events[i].nodes & NODE(2)))
            assert_true(r->events[i].frame.id >= 0x110);
    assert_int_equal(host_stats(r, 2).filtered + rig_count(r, CW_EVENT_RX, 2), FRAMES);
    assert_true(host_stats(r, 2).filtered > 0 && rig_count(r, CW_EVENT_RX, 2) > 0);
    balance(r);
}

/* A node alone with the sender acknowledges frames that its host never gets, and loses REC. */
TEST(a_filtered_frame_is_acknowledged_and_lowers_rec)
{
    static const cw_filter other = {.value = 0x7FF, .mask = 0x7FF};
    RIG *r = rig_new(2);
    r->nodes[1].host = (cw_host_config){.filters = &other, .filter_count = 1};
    r->rules[r->config.rule_count++] =
        (cw_rule){.name = "rec", .action = CW_ACTION_COUNTERS, .trigger = CW_TRIGGER_TIME,
                  .nodes = NODE(1), .tec = CW_KEEP, .rec = 9, .time_end = CW_NEVER,
                  .probability = UINT64_MAX, .every = 1};
    rig_start(r);
    send_in_slots(r, 5);
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 5);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 0);
    assert_int_equal(rig_stats(r, 1).rec, 4);
}

/* ---- Receive buffers ------------------------------------------------------------------------- */

static rig *slow_host(uint64_t service_ticks, unsigned buffers)
{
    rig *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.receive_buffers = (uint16_t)buffers,
                                        .service_ticks = service_ticks};
    rig_start(r);
    send_in_slots(r, FRAMES);
    rig_run_bits(r, 200 * FRAMES);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), FRAMES);
    assert_int_equal(rig_stats(r, 1).rx_held, 0);
    assert_int_equal(cw_bus_pending(r->bus), 0);
    balance(r);
    return r;
}

static void check_lost(uint64_t service_ticks, unsigned buffers, unsigned lost)
{
    RIG *r = slow_host(service_ticks, buffers);
    assert_int_equal(rig_count(r, CW_EVENT_OVERRUN, 1), lost);
    assert_int_equal(host_stats(r, 1).overruns, lost);
    assert_int_equal(rig_stats(r, 1).rx_dropped[CW_DROP_QUEUE_FULL], lost);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), FRAMES - lost);
}

/* Slots of 100 us. */
TEST(a_slow_host_loses_what_it_has_no_buffer_for)
{
    check_lost(90 * US, 1, 0);
    check_lost(150 * US, 1, FRAMES / 2);
    check_lost(250 * US, 1, FRAMES - (FRAMES + 2) / 3);
    check_lost(150 * US, 2, 12); /* of three, one is lost, once both are full */
    check_lost(150 * US, CW_RECEIVE_BUFFERS_MAX, 0);
}

/* The host has a frame when it has fetched it; the new frame is lost, and no older one. */
TEST(frames_come_in_their_order_after_the_time_of_service)
{
    RIG *r = slow_host(150 * US, 1);
    unsigned got = 0;
    uint64_t received = 0;
    for (size_t i = 0; i < r->count; i++) {
        const cw_event *e = &r->events[i];
        if (e->kind == CW_EVENT_RX && e->nodes == NODE(2) && e->frame.id == short_frame(2 * got).id)
            received = e->tick;
        if (e->kind == CW_EVENT_RX && e->nodes == NODE(1)) {
            assert_int_equal(e->frame.id, short_frame(2 * got++).id);
            assert_in_range(e->tick, received + 150 * US, received + 150 * US + BIT - 1);
        }
    }
    assert_int_equal(got, FRAMES / 2);
}

TEST(a_node_off_the_bus_drops_what_its_host_has_not_fetched)
{
    RIG *r = rig_new(3);
    r->nodes[1].host = (cw_host_config){.receive_buffers = 8, .service_ticks = 10000 * US};
    rig_start(r);
    send_in_slots(r, 4);
    rig_run_bits(r, 300);
    assert_int_equal(rig_stats(r, 1).rx_held, 4);
    assert_int_equal(cw_bus_pending(r->bus), 4);
    assert_int_equal(cw_node_attach(r->bus, 1, false), CW_OK);
    rig_run_bits(r, 310);
    assert_int_equal(rig_stats(r, 1).rx_dropped[CW_DROP_LINK_DOWN], 4);
    assert_int_equal(rig_stats(r, 1).rx_held, 0);
    balance(r);
}

/* Returns true when frames came to a node in the order in which they were sent. */
static bool in_order(const rig *r, unsigned node)
{
    unsigned n = 0;
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_RX && r->events[i].nodes == NODE(node) &&
            r->events[i].frame.id != short_frame(n++).id)
            return false;
    return true;
}

/* Frames that wait go on waiting in the bus that takes over. A host with too few buffers for them
 * has the first ones at once. */
TEST(a_bus_that_takes_over_has_the_frames)
{
    static const uint8_t from[] = {0, 1, 2};
    for (unsigned buffers = 0; buffers <= 8; buffers++) {
        RIG *old = rig_new(3), *r = rig_new(3);
        old->nodes[1].host =
            (cw_host_config){.receive_buffers = 8, .service_ticks = 1000 * US};
        r->nodes[1].host =
            (cw_host_config){.receive_buffers = (uint16_t)buffers, .service_ticks = 1000 * US};
        rig_start(old);
        rig_start(r);
        send_in_slots(old, 4);
        rig_run_bits(old, 300);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
        rig_run_bits(r, 310);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), buffers < 4 ? 4 - buffers : 0);
        rig_run_bits(r, 4000);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 4);
        assert_true(in_order(r, 1));
        balance(r);
    }
}

TEST(a_bus_without_any_has_no_counts)
{
    cw_host_stats s;
    RIG *r = rig_new(2);
    rig_start(r);
    assert_int_equal(cw_node_get_host_stats(r->bus, 1, &s), CW_REFUSED);
    assert_int_equal(cw_node_get_host_stats(r->bus, 2, &s), CW_INVALID);
    r->nodes[0].host.receive_buffers = CW_RECEIVE_BUFFERS_MAX + 1;
    assert_int_equal(cw_bus_size(&r->config), 0);
}

/* ---- The receive buffer of the SJA1000 ------------------------------------------------------- */

/* A frame with n bytes of data takes 3 + n of 64 bytes, with an extended identifier 5 + n. */
TEST(a_buffer_of_bytes_has_room_for_more_short_frames)
{
    static const struct {
        unsigned flags, dlc, fit;
    } cases[] = {{0, 0, 21}, {0, 8, 5}, {CW_FRAME_EXTENDED, 0, 12}, {CW_FRAME_EXTENDED, 8, 4},
                 {CW_FRAME_REMOTE, 8, 21}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        RIG *r = rig_new(2);
        r->nodes[0].queue = 40;
        r->nodes[1].host = (cw_host_config){.receive_buffers = 64, .receive_bytes = 64,
                                            .service_ticks = 1000000 * US};
        rig_start(r);
        const cw_frame f = rig_frame(0x123, cases[c].flags, cases[c].dlc);
        for (unsigned i = 0; i < 30; i++)
            rig_send(r, 0, &f, 0);
        rig_run_bits(r, 30 * 160);
        assert_int_equal(rig_stats(r, 1).rx_held, cases[c].fit);
        assert_int_equal(host_stats(r, 1).overruns, 30 - cases[c].fit);
        balance(r);
    }
}

/* ---- Receive mailboxes ----------------------------------------------------------------------- */

#define ID(identifier) {.value = (identifier), .mask = CW_FILTER_BASE_MASK}
#define HOST(boxes, ...) \
    (cw_host_config){.mailboxes = (boxes), .mailbox_count = sizeof(boxes) / sizeof((boxes)[0]), \
                     __VA_ARGS__}

TEST(the_newest_frame_of_a_mailbox_is_whole_and_the_older_one_counts)
{
    static const cw_mailbox boxes[] = {{.filter = ID(0x200)}, {.filter = ID(0x123)}};
    RIG *r = rig_new(2);
    r->nodes[1].host = HOST(boxes, .service_ticks = 180 * US);
    rig_start(r);
    for (unsigned i = 0; i < 8; i++) {
        cw_frame f = rig_frame(0x123, 0, 0);
        f.dlc = (uint8_t)(i % 2); /* 47 or 55 bits: the buffer must have both whole */
        f.data[0] = (uint8_t)i;
        rig_send(r, 0, &f, (JOIN + 65 * i) * (uint64_t)BIT);
        const cw_frame other = rig_frame(0x300, 0, 0);
        if (i == 7)
            rig_send(r, 0, &other, (JOIN + 65 * 8) * (uint64_t)BIT);
    }
    rig_run_bits(r, 1000);
    /* slots of 130 us: each second frame is fetched 180 us after the one before it has come */
    assert_int_equal(host_stats(r, 1).overwritten, 4);
    assert_int_equal(host_stats(r, 1).overruns, 0);
    assert_int_equal(host_stats(r, 1).filtered, 1);
    assert_int_equal(rig_count(r, CW_EVENT_OVERRUN, 1), 4);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 4);
    for (unsigned i = 0; i < 4; i++) {
        const cw_event *lost = rig_nth(r, CW_EVENT_OVERRUN, i);
        const cw_event *got = rig_nth(r, CW_EVENT_RX, i);
        assert_int_equal(lost->frame.dlc, 0);
        assert_int_equal(got->frame.dlc, 1);
        assert_int_equal(got->frame.data[0], 2 * i + 1);
    }
    assert_int_equal(rig_stats(r, 1).rx_dropped[CW_DROP_QUEUE_FULL], 4);
    balance(r);
}

/* Frames go into the first mailbox that is free; with none free the last one is overwritten. */
TEST(several_mailboxes_take_a_frame_in_turn)
{
    const cw_mailbox boxes[] = {{.filter = ID(0x7FF)}, {0}, {.filter = ID(short_frame(0).id)}, {0}};
    RIG *r = rig_new(2);
    r->nodes[1].host = HOST(boxes, .service_ticks = 10000 * US);
    rig_start(r);
    static const uint8_t sent[] = {0, 0, 1, 2, 3}; /* into 1, 2, 3, and twice into 3 again */
    static const uint8_t got[] = {0, 0, 3};
    for (unsigned i = 0; i < 5; i++) {
        const cw_frame f = short_frame(sent[i]);
        rig_send(r, 0, &f, JOIN * BIT + i * (uint64_t)SLOT);
    }
    rig_run_bits(r, 300);
    assert_int_equal(rig_stats(r, 1).rx_held, 3);
    assert_int_equal(host_stats(r, 1).overwritten, 2);
    rig_run_bits(r, 30000);
    for (unsigned i = 0; i < 3; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_RX, i)->frame.id, short_frame(got[i]).id);
    balance(r);
}

TEST(a_quick_host_gets_what_its_mailboxes_take_at_once)
{
    static const cw_mailbox boxes[] = {{.filter = {.value = 0x100, .mask = 0x70F}},
                                       {.use = CW_MAILBOX_TRANSMIT}};
    RIG *r = rig_new(2);
    r->nodes[1].host = HOST(boxes, .receive_fifo = false);
    rig_start(r);
    send_in_slots(r, FRAMES);
    rig_run_bits(r, 60 * FRAMES);
    unsigned match = 0;
    for (unsigned i = 0; i < FRAMES; i++)
        match += (short_frame(i).id & 0x70F) == 0x100;
    assert_in_range(match, 1, FRAMES - 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), match);
    assert_int_equal(host_stats(r, 1).filtered, FRAMES - match);
    balance(r);
}

/* ---- Transmit mailboxes ---------------------------------------------------------------------- */

/* Writes frames to node 0 while the bus is busy with a frame of node 1, and compares the order in
 * which they come. */
static void check_order(const cw_host_config *host, cw_order order, const uint16_t *ids,
                        unsigned count, const uint16_t *sent)
{
    RIG *r = rig_new(3);
    r->nodes[0].host = *host;
    r->nodes[0].order = order;
    rig_start(r);
    const cw_frame first = rig_frame(0, 0, 8);
    rig_send(r, 1, &first, 0);
    for (unsigned i = 0; i < count; i++) {
        const cw_frame f = rig_frame(ids[i], 0, 0);
        rig_send(r, 0, &f, (JOIN + 20 + i) * (uint64_t)BIT);
    }
    rig_run_bits(r, 1000);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), count);
    for (unsigned i = 0; i < count; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 1 + i)->frame.id, sent[i]);
    balance(r);
}

TEST(mailboxes_decide_on_the_order_and_the_queue_waits_behind_them)
{
    static const cw_mailbox two[] = {{.use = CW_MAILBOX_TRANSMIT}, {.use = CW_MAILBOX_TRANSMIT}};
    static const uint16_t ids[] = {0x500, 0x400, 0x100, 0x300, 0x200};
    /* 500 and 400 are in mailboxes; when one is free, 100 comes */
    check_order(&HOST(two, .transmit = CW_TRANSMIT_PRIORITY), CW_ORDER_FIFO, ids, 5,
                (const uint16_t[]){0x400, 0x100, 0x300, 0x200, 0x500});
    check_order(&HOST(two, .transmit = CW_TRANSMIT_NUMBER), CW_ORDER_FIFO, ids, 5,
                (const uint16_t[]){0x500, 0x100, 0x300, 0x200, 0x400});
    check_order(&HOST(two, .transmit = CW_TRANSMIT_REQUEST), CW_ORDER_FIFO, ids, 5,
                (const uint16_t[]){0x500, 0x400, 0x100, 0x300, 0x200});
    check_order(&HOST(two, .transmit = CW_TRANSMIT_REQUEST), CW_ORDER_PRIORITY, ids, 5,
                (const uint16_t[]){0x500, 0x400, 0x100, 0x200, 0x300});
}

/* A frame waits for a mailbox that takes it, and not for others. */
TEST(a_mailbox_of_its_own_keeps_a_frame_from_waiting)
{
    static const cw_mailbox own[] = {{.use = CW_MAILBOX_TRANSMIT, .filter = ID(0x500)},
                                     {.use = CW_MAILBOX_TRANSMIT, .filter = ID(0x100)}};
    static const uint16_t ids[] = {0x500, 0x500, 0x500, 0x100, 0x100};
    check_order(&HOST(own, .transmit = CW_TRANSMIT_PRIORITY), CW_ORDER_FIFO, ids, 5,
                (const uint16_t[]){0x100, 0x100, 0x500, 0x500, 0x500});
    RIG *r = rig_new(2);
    r->nodes[0].host = HOST(own, .transmit = CW_TRANSMIT_PRIORITY);
    rig_start(r);
    const cw_frame none = rig_frame(0x200, 0, 0);
    rig_send(r, 0, &none, 0);
    rig_run_bits(r, 100);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->why, CW_DROP_BAD_FRAME);
    balance(r);
}

/* ---- Replies --------------------------------------------------------------------------------- */

static const cw_mailbox replies[] = {{.use = CW_MAILBOX_TRANSMIT},
                                     {.use = CW_MAILBOX_REPLY, .filter = ID(0x123)}};

static cw_frame value(unsigned byte, unsigned dlc)
{
    cw_frame f = rig_frame(0x123, 0, dlc);
    memset(f.data, (int)byte, sizeof f.data);
    return f;
}

static void write_value(rig *r, unsigned byte, unsigned dlc, uint64_t bit)
{
    const cw_frame f = value(byte, dlc);
    rig_send(r, 0, &f, bit * BIT);
}

static void ask(rig *r, unsigned node, uint64_t bit)
{
    const cw_frame f = rig_frame(0x123, CW_FRAME_REMOTE, 0);
    rig_send(r, node, &f, bit * BIT);
}

static rig *answering_rig(bool stepping)
{
    rig *r = rig_new(3);
    r->nodes[0].host = HOST(replies, .receive_fifo = true);
    rig_start(r);
    cw_bus_set_stepping(r->bus, stepping);
    return r;
}

TEST(a_remote_frame_is_answered_in_the_next_arbitration_by_the_data_last_written)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = answering_rig(stepping);
        ask(r, 1, JOIN); /* nothing is written: the host gets it */
        write_value(r, 0x11, 8, 100);
        write_value(r, 0x22, 3, 101);
        ask(r, 1, 110);
        ask(r, 1, 110);
        const cw_frame later = rig_frame(0x124, 0, 0);
        rig_send(r, 2, &later, 110 * BIT);
        rig_run_bits(r, 200);
        write_value(r, 0x33, 5, 200);
        rig_run_bits(r, 1000);
        assert_int_equal(host_stats(r, 0).replies, 2);
        assert_int_equal(rig_stats(r, 0).stored, 3);
        assert_int_equal(rig_stats(r, 0).made_by_rules, 2);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
        assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 2); /* the first request, and 124 */
        const cw_event *request = rig_nth(r, CW_EVENT_TX, 1), *reply = rig_nth(r, CW_EVENT_TX, 2);
        const cw_frame first = value(0x22, 3);
        assert_int_equal(request->frame.flags, CW_FRAME_REMOTE);
        assert_true(cw_frame_equal(&reply->frame, &first));
        assert_int_equal(reply->from, NODE(0));
        /* 3 bits of intermission, then the frame */
        assert_int_equal(reply->tick,
                         request->tick + (3 + cw_frame_wire_bits(&first)) * (uint64_t)BIT);
        /* the reply wins against the second request; 124 comes last */
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 3)->frame.flags, CW_FRAME_REMOTE);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 5)->frame.id, 0x124);
        balance(r);
    }
}

/* The reply waits behind a more urgent frame. Data that come meanwhile are sent whole; data that
 * come while it is on the wire are for the next one. */
TEST(a_reply_has_the_data_written_before_it_begins)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = answering_rig(stepping);
        const cw_frame urgent = rig_frame(0x001, 0, 8);
        write_value(r, 0x11, 8, 5);
        ask(r, 1, JOIN);
        rig_send(r, 2, &urgent, (JOIN + 20) * BIT);
        write_value(r, 0x22, 2, JOIN + 90); /* 001 is on the wire */
        rig_run_bits(r, JOIN + 190);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 2), 1);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 0);
        write_value(r, 0x33, 1, JOIN + 190); /* the reply is */
        ask(r, 1, JOIN + 300);
        rig_run_bits(r, 600);
        const cw_frame first = value(0x22, 2), second = value(0x33, 1);
        assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_TX, 2)->frame, &first));
        assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_TX, 4)->frame, &second));
        balance(r);
    }
}

/* A full queue does not keep a mailbox from replying, and a reply takes no place of the queue. */
TEST(replies_have_room_of_their_own)
{
    RIG *r = rig_new(3);
    r->nodes[0].host = HOST(replies, .receive_fifo = true);
    r->nodes[0].queue = 1;
    rig_start(r);
    write_value(r, 0x11, 1, 0);
    ask(r, 1, JOIN);
    const cw_frame idle = rig_frame(0x7FF, 0, 0);
    rig_send(r, 0, &idle, (JOIN + 1) * BIT);
    rig_run_bits(r, JOIN + 46); /* the request has come */
    assert_int_equal(rig_stats(r, 0).queue, 2);
    assert_int_equal(cw_node_room(r->bus, 0), 0);
    rig_run_bits(r, 400);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 2);
    assert_int_equal(rig_count(r, CW_EVENT_DROP, 0), 0);
    balance(r);
}

/* Data that a host has written stay; others are those of the new configuration. */
TEST(mailboxes_go_over_to_another_bus)
{
    static const uint8_t from[] = {0, 1, 2};
    cw_mailbox others[] = {
        {.use = CW_MAILBOX_REPLY, .filter = ID(0x7F), .filled = true,
         .frame = {.id = 0x7F, .dlc = 1}},
        {.use = CW_MAILBOX_REPLY, .filter = ID(0x123), .filled = true,
         .frame = {.id = 0x123, .dlc = 0}},
        {.use = CW_MAILBOX_TRANSMIT, .filter = ID(0x7FF)}};
    RIG *old = answering_rig(false), *r = rig_new(3);
    r->nodes[0].host = HOST(others, .receive_fifo = true);
    rig_start(r);
    write_value(old, 0x11, 2, 0);
    ask(old, 1, JOIN);
    const cw_frame lost = rig_frame(0x400, 0, 0), kept = rig_frame(0x7FF, 0, 0);
    rig_send(old, 0, &lost, (JOIN + 1) * BIT);
    rig_send(old, 0, &kept, (JOIN + 1) * BIT);
    rig_run_bits(old, JOIN + 46); /* the reply waits, and so do the two frames */
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, from), CW_OK);
    ask(r, 1, 300);
    const cw_frame other = rig_frame(0x7F, CW_FRAME_REMOTE, 0);
    rig_send(r, 1, &other, 400 * BIT);
    rig_run_bits(r, 600);
    const cw_frame reply = value(0x11, 2);
    assert_int_equal(rig_nth(r, CW_EVENT_DROP, 0)->frame.id, 0x400);
    assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_TX, 0)->frame, &reply));
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->frame.id, 0x7FF);
    assert_true(cw_frame_equal(&rig_nth(r, CW_EVENT_TX, 3)->frame, &reply));
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 5)->frame.id, 0x7F);
    assert_int_equal(host_stats(r, 0).replies, 3);
    balance(r);
}

TEST(mailboxes_that_cannot_be_are_refused)
{
    const cw_mailbox wrong[] = {
        {.use = CW_MAILBOX_USES},
        {.use = CW_MAILBOX_REPLY, .filter = {.value = 0x100, .mask = 0x700}},
        {.use = CW_MAILBOX_REPLY, .filter = ID(0x123), .filled = true, .frame = {.id = 0x124}},
        {.use = CW_MAILBOX_REPLY, .filter = ID(0x123), .filled = true,
         .frame = {.id = 0x123, .flags = CW_FRAME_REMOTE}}};
    RIG *r = rig_new(2);
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        r->nodes[0].host = (cw_host_config){.mailboxes = &wrong[i], .mailbox_count = 1};
        assert_int_equal(cw_bus_size(&r->config), 0);
    }
    r->nodes[0].host = HOST(replies, .transmit = CW_TRANSMIT_COUNT);
    assert_int_equal(cw_bus_size(&r->config), 0);
    r->nodes[0].host = (cw_host_config){.mailboxes = replies,
                                        .mailbox_count = CW_MAILBOXES_MAX + 1};
    assert_int_equal(cw_bus_size(&r->config), 0);
}
