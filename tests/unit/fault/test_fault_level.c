/* SPDX-License-Identifier: MIT
 *
 * test_fault_level.c - what fault rules do to levels: bits at a position, stuck lines.
 */
#include "cases.h"
#include "model.h"
#include "rules.h"
#include "times.h"

/* ---- Positions ------------------------------------------------------------------------------- */

typedef struct flip_case {
    cw_field field;
    unsigned index;
    int plain; /* unstuffed bit of the frame, or */
    int wire;  /* wire bit, or -1: never */
} flip_case;

/* Checks the bit of the first hit in a frame; a listener observes it, so that nothing follows from
 * it. */
static void check_position(const cw_frame *f, const flip_case *c)
{
    model m = model_encode(f);
    int bit = c->plain >= 0 ? (int)m.at[c->plain] : c->wire;
    RIG *r = rig_new(3);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    rig_flip(r, "there", c->field, c->index)->at = NODE(2);
    rig_start(r);
    rig_send(r, 0, f, 0);
    rig_run_bits(r, 300);
    assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), bit >= 0);
    if (bit >= 0)
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(JOIN, (unsigned)bit));
}

/* 000#0000 has stuff bits from the first run on; its fields are at known unstuffed bits. */
TEST(positions_of_a_base_frame)
{
    static const flip_case cases[] = {
        {CW_FIELD_SOF, 0, 0, 0},     {CW_FIELD_SOF, 1, -1, -1},   {CW_FIELD_ID, 0, 1, 0},
        {CW_FIELD_ID, 10, 11, 0},    {CW_FIELD_ID, 11, -1, -1},   {CW_FIELD_RTR, 0, 12, 0},
        {CW_FIELD_SRR, 0, -1, -1},   {CW_FIELD_IDE, 0, 13, 0},    {CW_FIELD_R0, 0, 14, 0},
        {CW_FIELD_R1, 0, -1, -1},    {CW_FIELD_DLC, 0, 15, 0},    {CW_FIELD_DLC, 3, 18, 0},
        {CW_FIELD_DATA, 0, 19, 0},   {CW_FIELD_DATA, 15, 34, 0},  {CW_FIELD_DATA, 16, -1, -1},
        {CW_FIELD_CRC, 0, 35, 0},    {CW_FIELD_CRC, 14, 49, 0},   {CW_FIELD_STUFF, 0, -1, 5},
        {CW_FIELD_BIT, 0, -1, 0},    {CW_FIELD_BIT, 5, -1, 5},    {CW_FIELD_BIT, 40, -1, 40},
        {CW_FIELD_STUFF, 30, -1, -1}, {CW_FIELD_BIT, 200, -1, -1},
    };
    cw_frame f = {.dlc = 2};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

TEST(positions_of_an_extended_frame)
{
    static const flip_case cases[] = {
        {CW_FIELD_ID, 0, 1, 0},    {CW_FIELD_ID, 10, 11, 0}, {CW_FIELD_SRR, 0, 12, 0},
        {CW_FIELD_IDE, 0, 13, 0},  {CW_FIELD_ID, 11, 14, 0}, {CW_FIELD_ID, 28, 31, 0},
        {CW_FIELD_RTR, 0, 32, 0},  {CW_FIELD_R1, 0, 33, 0},  {CW_FIELD_R0, 0, 34, 0},
        {CW_FIELD_DLC, 0, 35, 0},  {CW_FIELD_DATA, 0, 39, 0}, {CW_FIELD_DATA, 63, 102, 0},
        {CW_FIELD_CRC, 0, 103, 0}, {CW_FIELD_CRC, 14, 117, 0},
    };
    cw_frame f = rig_frame(0x1F00FF00, EXTENDED, 8);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

/* The end of a frame is at known bits from its end. */
TEST(positions_behind_the_crc)
{
    cw_frame f = rig_frame(0x123, 0, 5);
    int length = (int)model_encode(&f).length;
    const flip_case cases[] = {
        {CW_FIELD_CRC_DELIMITER, 0, -1, length - 10}, {CW_FIELD_ACK_SLOT, 0, -1, length - 9},
        {CW_FIELD_ACK_DELIMITER, 0, -1, length - 8},  {CW_FIELD_EOF, 0, -1, length - 7},
        {CW_FIELD_EOF, 6, -1, length - 1},            {CW_FIELD_BIT, (unsigned)length - 1, -1,
                                                       length - 1},
        {CW_FIELD_INTERMISSION, 0, -1, length},       {CW_FIELD_INTERMISSION, 2, -1, length + 2},
        {CW_FIELD_EOF, 7, -1, -1},                    {CW_FIELD_INTERMISSION, 3, -1, -1},
        {CW_FIELD_SUSPEND, 0, -1, -1},                {CW_FIELD_ERROR_FLAG, 0, -1, -1},
        {CW_FIELD_OVERLOAD_FLAG, 0, -1, -1},          {CW_FIELD_ERROR_DELIMITER, 0, -1, -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        check_position(&f, &cases[i]);
}

/* Every stuff bit of a frame, by number: it is the N-th, and no other field's. */
TEST(positions_of_stuff_bits)
{
    cw_frame f = {.dlc = 4};
    model m = model_encode(&f);
    unsigned stuff = 0;
    for (unsigned i = 0; m.plain[i]; i++) {
        unsigned next = m.plain[i + 1] ? m.at[i + 1] : m.stuffed;
        if (next == m.at[i] + 1)
            continue;
        flip_case c = {CW_FIELD_STUFF, stuff++, -1, (int)m.at[i] + 1};
        check_position(&f, &c);
    }
    assert_true(stuff > 5);
    check_position(&f, &(flip_case){CW_FIELD_STUFF, stuff, -1, -1});
}

/* The first error frame of the wire: a flip of r0 at the transmitter ends the attempt there. Its
 * flag of six bits starts at the next; the receivers' follows, for they see a stuff error. */
TEST(positions_in_error_frames)
{
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned r0 = model_encode(&f).at[14];
    static const struct {
        cw_field field;
        unsigned index;
        unsigned after; /* the wire bit of r0 */
    } cases[] = {
        {CW_FIELD_ERROR_FLAG, 0, 1},  {CW_FIELD_ERROR_FLAG, 5, 6},
        {CW_FIELD_ERROR_DELIMITER, 0, 0}, {CW_FIELD_ERROR_DELIMITER, 7, 7},
        {CW_FIELD_INTERMISSION, 0, 8}, {CW_FIELD_INTERMISSION, 2, 10},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        rig_flip(r, "first", CW_FIELD_R0, 0)->at = NODE(0);
        r->rules[0].count = 1;
        rig_flip(r, "second", cases[i].field, cases[i].index)->at = NODE(2);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 500);
        /* r0 and IDE, RTR are dominant: the receivers reach six equal bits in the flag */
        model m = model_encode(&f);
        unsigned run = 1;
        while (m.wire[r0 - run] == '0')
            run++;
        unsigned receivers = r0 + 6 - run; /* their error; the flag is the six bits after it */
        unsigned delimiter = receivers + 6 + 1;
        bool in_flag = cases[i].field == CW_FIELD_ERROR_FLAG;
        unsigned bit = (in_flag ? r0 : delimiter) + cases[i].after;
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end_of(JOIN, bit));
    }
}

/* A message doubled (M7): receivers answer `d` in the last EOF bit with an overload flag, and the
 * transmitter with an error flag. */
TEST(positions_in_overload_and_suspend)
{
    cw_frame f = rig_frame(0x123, 0, 1);
    unsigned length = model_encode(&f).length;
    for (unsigned index = 0; index < 6; index++) {
        RIG *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
        rig_flip(r, "first", CW_FIELD_EOF, 6)->count = 1;
        rig_flip(r, "second", CW_FIELD_OVERLOAD_FLAG, index)->at = NODE(2);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 500);
        assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end_of(JOIN, length + index));
    }
    RIG *r = rig_new(1); /* lonely, so passive after 16 errors */
    rig_flip(r, "suspend", CW_FIELD_SUSPEND, 7)->at = NODE(0);
    r->rules[0].count = 1;
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 3000);
    unsigned attempt = length - ACK_FROM_END + 1 + ERROR_FRAME_BITS + INTERMISSION_BITS;
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 0)->tick, end_of(JOIN + 16 * attempt, 7));
}

TEST(two_flips_of_one_bit_cancel)
{
    for (unsigned local = 0; local < 2; local++) {
        RIG *r = rig_new(2);
        cw_frame f = rig_frame(0x123, 0, 1);
        rig_flip(r, "a", CW_FIELD_DATA, 3)->at = local ? NODE(1) : 0;
        rig_flip(r, "b", CW_FIELD_DATA, 3)->at = local ? NODE(1) : 0;
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 2);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
    }
}

/* A wire flip and one at a node: that node alone sees the right level. */
TEST(a_flip_at_a_node_undoes_one_of_the_wire)
{
    RIG *r = rig_new(3);
    cw_frame f = rig_frame(0x123, 0, 1);
    rig_flip(r, "wire", CW_FIELD_EOF, 2)->count = 1;
    rig_flip(r, "node", CW_FIELD_EOF, 2)->count = 1;
    r->rules[1].at = NODE(1);
    rig_start(r);
    rig_send(r, 0, &f, 0);
    rig_run_bits(r, 300);
    uint64_t bit = end_of(JOIN, model_encode(&f).length - 5);
    unsigned at_once = 0;
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == CW_EVENT_ERROR && r->events[i].tick == bit)
            at_once |= (unsigned)r->events[i].nodes;
    assert_int_equal(at_once, NODE(0) | NODE(2));
}

/* The first wrong bit is the receiver's last EOF bit and makes it send an overload flag (O1 c).
 * Each further one is a bit of its flag sampled recessive: a bit error with REC +8 (R5). */
TEST(a_flip_of_many_bits)
{
    for (unsigned bits = 1; bits <= 9; bits++) {
        RIG *r = rig_new(3);
        cw_frame f = rig_frame(0x123, 0, 1);
        rig_flip(r, "wire", CW_FIELD_EOF, 6)->bits = (uint16_t)bits;
        r->rules[0].at = NODE(1);
        rig_start(r);
        rig_send(r, 0, &f, 0);
        rig_run_bits(r, 400);
        assert_int_equal(rig_count(r, CW_EVENT_FAULT, -1), 1); /* one hit, however many bits */
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_count(r, CW_EVENT_ERROR, 1), bits - 1);
        assert_int_equal(rig_stats(r, 1).rec, 8 * (bits - 1));
    }
}

/* ---- Levels for a time ----------------------------------------------------------------------- */

/* Nor does another rule that ends bring a node back, or the transmitter of a stuck line. */
TEST(a_disconnected_node_stays_away)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    ADD_RULE(r, "away", TIME, DISCONNECT, .nodes = NODE(2));
    ADD_RULE(r, "stuck", TIME, STUCK, .line = CW_LINE_TX, .node = 2);
    ADD_RULE(r, "other", TIME, DISCONNECT, .nodes = NODE(1) | NODE(2), .for_ticks = 50 * BIT);
    rig_start(r);
    rig_send(r, 0, &frame, 100 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 1), 1);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 2), 0);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, -1), 0);
}

/* A pattern starts over with each hit. */
TEST(each_hit_of_a_glitch_starts_its_pattern)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x123, 0, 0);
    r->nodes[2].modes = CW_MODE_LISTEN_ONLY;
    cw_rule *rule = ADD_RULE(r, "glitch", FRAME, GLITCH, .field = CW_FIELD_EOF, .bits = 3,
                             .pattern_mask = 7);
    rule->pattern_level = 5; /* only the middle bit is `d` */
    rule->at = NODE(2);
    rig_start(r);
    send_every(r, &frame, 100, 3);
    rig_run_bits(r, 400);
    assert_int_equal(hits(r, 0), 3);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 2), 3);
    for (unsigned i = 0; i < 3; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_ERROR, i)->error.place.index, 1);
}

/* On a partitioned bus a bit is one of its transmitter's wire. */
TEST(bits_are_on_the_wire_of_their_frame)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (unsigned sender = 0; sender < 4; sender += 2) {
        RIG *r = rig_new(4);
        cw_rule *cut = ADD_RULE(r, "cut", TIME, PARTITION);
        cut->group[2] = cut->group[3] = 1;
        cw_rule *flip = rig_flip(r, "flip", CW_FIELD_EOF, 2);
        flip->count = 1;
        rig_start(r);
        rig_send(r, sender, &frame, 0);
        rig_run_bits(r, 300);
        for (unsigned node = 0; node < 4; node++)
            assert_int_equal(rig_count(r, CW_EVENT_ERROR, (int)node), node / 2 == sender / 2);
    }
}

/* Bits go on when the frame, and so what the rule is bound to, is long over. A time that is no
 * whole number of bits is rounded up. */
TEST(bits_last_as_long_as_they_are_told_to)
{
    static const struct {
        uint16_t bits;
        uint64_t ticks;
        unsigned expected;
    } cases[] = {{1, 0, 1},       {3, 0, 3},           {300, 0, 300},    {0, 1, 1},
                 {0, BIT, 1},     {0, BIT + 1, 2},     {0, 2 * BIT, 2},  {0, 200 * BIT, 200}};
    const cw_frame frame = rig_frame(0x123, 0, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        RIG *r = rig_new(3);
        r->nodes[2].modes = CW_MODE_LISTEN_ONLY; /* whom it does not disturb */
        ADD_RULE(r, "force", FRAME, FORCE, .level = CW_RECESSIVE, .field = CW_FIELD_EOF, .index = 6,
                 .bits = cases[i].bits, .for_ticks = cases[i].ticks, .at = NODE(2));
        rig_start(r);
        rig_send(r, 0, &frame, 0);
        unsigned acting = 0;
        for (unsigned bit = 1; bit < 500; bit++) {
            rig_run_bits(r, bit);
            acting += rule_stats(r, 0).active;
        }
        assert_int_equal(acting + 1, cases[i].expected); /* in the last one it ends at its end */
        assert_int_equal(cw_bus_next(r->bus), CW_NEVER); /* nothing to look at any more */
    }
}

/* The flag of the node with the overload ends a bit before the others': the delimiter begins with
 * the first recessive bit. */
TEST(the_overload_delimiter_begins_when_the_wire_is_free)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    RIG *r = rig_new(2);
    ADD_RULE(r, "ask", TIME, OVERLOAD, .nodes = NODE(0));
    ADD_RULE(r, "mark", FRAME, FORCE, .level = CW_RECESSIVE, .field = CW_FIELD_OVERLOAD_DELIMITER);
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, 300);
    uint64_t end = rig_nth(r, CW_EVENT_TX, 0)->tick;
    assert_int_equal(hits(r, 1), 1);
    assert_int_equal(rig_nth(r, CW_EVENT_FAULT, 1)->tick, end + (6 + 1 + 1) * BIT);
}

/* A wire that is stuck dominant and flipped in each bit is recessive, on a bus that is partitioned
 * into one part, too. */
TEST(a_flipped_wire_is_that_of_the_nodes_that_exist)
{
    for (unsigned parts = 0; parts < 2; parts++) {
        RIG *r = rig_new(2);
        ADD_RULE(r, "stuck", TIME, STUCK, .line = CW_LINE_TX);
        ADD_RULE(r, "noise", TIME, NOISE, .error_rate = UINT64_MAX);
        if (parts)
            ADD_RULE(r, "cut", TIME, PARTITION);
        rig_start(r);
        rig_run_bits(r, 100);
        assert_int_equal(cw_bus_recessive_bits(r->bus), 100);
    }
}

/* A level that a single node sees is not on the wire. */
TEST(a_stuck_rx_is_not_on_the_wire)
{
    RIG *r = rig_new(2);
    r->nodes[1].modes = CW_MODE_LISTEN_ONLY; /* it signals to itself only */
    ADD_RULE(r, "stuck", TIME, STUCK, .line = CW_LINE_RX, .node = 1, .time_begin = 50 * BIT);
    rig_start(r);
    rig_run_bits(r, 200);
    assert_int_equal(rig_count(r, CW_EVENT_ERROR, 1), 1);
    assert_int_equal(cw_bus_recessive_bits(r->bus), 200);
}

/* On each line, for good: nothing is to come, and a long time costs no more than a short one. */
TEST(what_is_stuck_recessive_costs_nothing_at_rest)
{
    static const cw_line lines[] = {CW_LINE_TX, CW_LINE_RX, CW_LINE_WIRE};
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        RIG *r = rig_new(3);
        ADD_RULE(r, "stuck", TIME, STUCK, .line = lines[i], .node = 1, .level = CW_RECESSIVE);
        rig_start(r);
        rig_run_bits(r, 100);
        assert_int_equal(hits(r, 0), 1);
        assert_true(cw_bus_next(r->bus) == CW_NEVER);
        const uint64_t before = cw_bus_work(r->bus);
        rig_run_bits(r, 1000000000);
        assert_in_range(cw_bus_work(r->bus) - before, 0, 100);
    }
}
