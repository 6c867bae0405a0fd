/* SPDX-License-Identifier: MIT
 *
 * test_senders.c - who has sent a received frame, and since when it waited.
 *
 * Senders leave the bus while their last bits are on the wire, all of them recessive. Others are
 * still at a frame before.
 *
 * Each case runs in single bits and in fast ones, with the sender before and behind the receivers.
 */
#include "cases.h"
#include "rules.h"

#define HANDED_IN 100u /* tick of the frame */

typedef struct senders_case {
    rig *r;
    unsigned sender;
    cw_frame frame;
} senders_case;

/* Makes a bus of three nodes, of which one sends a frame. */
static senders_case new_case(unsigned variant)
{
    rig *r = rig_new(3);
    r->config.rule_room = 1;
    return (senders_case){.r = r, .sender = variant & 1 ? 2 : 0, .frame = rig_frame(0x123, 0, 1)};
}

static void start(senders_case *c, unsigned variant)
{
    rig_start(c->r);
    cw_bus_set_stepping(c->r->bus, variant & 2);
    rig_send(c->r, c->sender, &c->frame, HANDED_IN);
}

static void set_counters(const senders_case *c, unsigned tec)
{
    cw_rule rule = new_rule("counters", CW_TRIGGER_TIME, CW_ACTION_COUNTERS);
    rule.nodes = NODE(c->sender);
    rule.tec = (uint16_t)tec;
    rig_rule(c->r, rule);
}

/* An error at one bit of the frame, for its sender alone. */
static void stop_at(const senders_case *c, cw_field field, unsigned index)
{
    cw_rule *rule = rig_flip(c->r, "error", field, index);
    rule->at = NODE(c->sender);
    rule->count = 1;
}

/* Checks that all others have the frame, from its sender. */
static void check_received(const senders_case *c)
{
    uint64_t nodes = 0;
    for (size_t i = 0; i < rig_count(c->r, CW_EVENT_RX, -1); i++) {
        const cw_event *rx = rig_nth(c->r, CW_EVENT_RX, i);
        assert_true(cw_frame_equal(&rx->frame, &c->frame));
        assert_int_equal(rx->from, NODE(c->sender));
        assert_int_equal(rx->handed_in, HANDED_IN);
        nodes |= rx->nodes;
    }
    assert_int_equal(nodes, 7 & ~NODE(c->sender));
}

/* ---- Senders that leave ---------------------------------------------------------------------- */

typedef struct place {
    cw_field field;
    unsigned index;
} place;

/* The last but one bit of EOF is that in which the others have the frame. */
static const place places[] = {
    {CW_FIELD_CRC_DELIMITER, 0}, {CW_FIELD_EOF, 0}, {CW_FIELD_EOF, 5}};

TEST(a_sender_that_goes_bus_off_by_an_error_is_the_sender)
{
    for (unsigned variant = 0; variant < 4 * 3; variant++) {
        senders_case c = new_case(variant);
        set_counters(&c, 250);
        stop_at(&c, places[variant / 4].field, places[variant / 4].index);
        start(&c, variant);
        rig_run_bits(c.r, 90);
        const size_t states = rig_count(c.r, CW_EVENT_STATE, -1);
        assert_int_equal(rig_nth(c.r, CW_EVENT_STATE, states - 1)->state, CW_STATE_BUS_OFF);
        check_received(&c);
        rig_free(c.r);
    }
}

/* L1: it sends no flag, and waits for the bus to be idle at once. */
TEST(a_time_triggered_sender_with_an_error_is_the_sender)
{
    for (unsigned variant = 0; variant < 4 * 3; variant++) {
        senders_case c = new_case(variant);
        c.r->nodes[c.sender].modes = CW_MODE_TIME_TRIGGERED;
        stop_at(&c, places[variant / 4].field, places[variant / 4].index);
        start(&c, variant);
        rig_run_bits(c.r, 90);
        assert_int_equal(rig_nth(c.r, CW_EVENT_ERROR, 0)->error.flag, CW_FLAG_NONE);
        check_received(&c);
        rig_free(c.r);
    }
}

static void leave(const senders_case *c, unsigned how)
{
    cw_rule rule = new_rule("leaves", CW_TRIGGER_TIME, CW_ACTION_BUS_OFF);
    static const cw_action actions[] = {CW_ACTION_BUS_OFF, CW_ACTION_SOFTWARE_RESET,
                                        CW_ACTION_HARDWARE_RESET, CW_ACTION_DISCONNECT};
    rule.nodes = NODE(c->sender);
    if (how == 0) {
        assert_int_equal(cw_node_attach(c->r->bus, c->sender, false), CW_OK);
    } else if (how == 1) {
        assert_int_equal(cw_node_flush(c->r->bus, c->sender), CW_OK);
    } else if (how == 2) {
        const cw_settings settings = {.which = CW_SET_MODES, .modes = CW_MODE_LISTEN_ONLY,
                                      .modes_mask = CW_MODE_LISTEN_ONLY};
        assert_int_equal(cw_node_set(c->r->bus, c->sender, &settings), CW_OK);
    } else {
        rule.action = actions[how - 3];
        (void)add(c->r, rule);
    }
}

/* Its host or a rule takes it away in the EOF. */
TEST(a_sender_that_is_taken_away_is_the_sender)
{
    for (unsigned variant = 0; variant < 4 * 7; variant++) {
        senders_case c = new_case(variant);
        start(&c, variant);
        rig_run_bits(c.r, JOIN + cw_frame_wire_bits(&c.frame) - 5);
        assert_int_equal(rig_count(c.r, CW_EVENT_RX, -1), 0);
        leave(&c, variant / 4);
        rig_run_bits(c.r, 90);
        assert_int_equal(rig_count(c.r, CW_EVENT_TX, -1), 0);
        check_received(&c);
        rig_free(c.r);
    }
}

/* ---- A frame that has been given up ---------------------------------------------------------- */

/* Nobody acknowledges. The next frame takes the place of the first one in the queue, before the
 * listener has that. */
TEST(a_frame_that_was_given_up_keeps_its_time)
{
    for (unsigned stepping = 0; stepping < 2; stepping++) {
        RIG *r = rig_new(2);
        const cw_frame f = rig_frame(0x123, 0, 1), next = rig_frame(0x124, 0, 1);
        r->nodes[0].modes = CW_MODE_ONE_SHOT;
        r->nodes[0].queue = 1;
        r->nodes[1].modes = CW_MODE_LISTEN_ONLY;
        const senders_case c = {.r = r, .sender = 0};
        set_counters(&c, 130);
        rig_start(r);
        cw_bus_set_stepping(r->bus, stepping);
        rig_send(r, 0, &f, HANDED_IN);
        while (rig_count(r, CW_EVENT_DROP, -1) == 0)
            rig_run(r, cw_bus_now(r->bus) + BIT);
        rig_send(r, 0, &next, cw_bus_now(r->bus) + BIT);
        rig_run_bits(r, 90);
        const cw_event *rx = rig_nth(r, CW_EVENT_RX, 0);
        assert_true(rx->tick > rig_nth(r, CW_EVENT_DROP, 0)->tick + BIT);
        assert_int_equal(rx->from, NODE(0));
        assert_int_equal(rx->handed_in, HANDED_IN);
    }
}

/* ---- A sender that is still at a frame before ------------------------------------------------ */

/* Its receiver sticks behind its frame, so it waits for the end of the overload flag of others. */
TEST(a_node_that_is_stuck_behind_its_frame_is_no_sender)
{
    for (unsigned variant = 0; variant < 4; variant++) {
        senders_case c = new_case(variant);
        const cw_frame second = rig_frame(0x222, 0, 1);
        cw_rule stuck = new_rule("stuck", CW_TRIGGER_TIME, CW_ACTION_STUCK);
        stuck.line = CW_LINE_RX;
        stuck.node = (uint8_t)c.sender;
        stuck.level = CW_DOMINANT;
        stuck.time_begin = (JOIN + cw_frame_wire_bits(&c.frame)) * BIT;
        rig_rule(c.r, stuck);
        start(&c, variant);
        rig_send(c.r, 1, &second, 300);
        rig_run_bits(c.r, 180);
        assert_int_equal(rig_nth(c.r, CW_EVENT_OVERLOAD, 0)->nodes & NODE(c.sender),
                         NODE(c.sender));
        const size_t received = rig_count(c.r, CW_EVENT_RX, -1);
        const cw_event *last = rig_nth(c.r, CW_EVENT_RX, received - 1);
        assert_true(cw_frame_equal(&last->frame, &second));
        assert_int_equal(last->from, NODE(1));
        assert_int_equal(last->handed_in, 300);
        rig_free(c.r);
    }
}
