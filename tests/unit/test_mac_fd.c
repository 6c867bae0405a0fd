/* SPDX-License-Identifier: MIT
 *
 * test_mac_fd.c - controllers that know of FD frames, by themselves and on one wire (D7, D8, D14 to
 * D19). tests/conformance has their behaviour bit by bit.
 */
#include "cases.h"
#include "format/bits.h"
#include "mac/mac.h"

#define NODES_MAX 3

static const cw_frame fd_frame = {.id = 0x123, .flags = CW_FRAME_FD, .dlc = 1, .data = {0x55}};
static const cw_frame switched = {.id = 0x123, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 11,
                                  .data = {0x55, 0x07}};
static const cw_frame classical_frame = {.id = 0x123, .dlc = 1, .data = {0x55}};

typedef struct node {
    cw_mac mac;
    cw_fd_part part;
    cw_mac_report report; /* of the last bit */
    unsigned what;        /* all reports so far */
    unsigned dominant;    /* bits that it has driven so */
    cw_error error;       /* the first one */
} node;

typedef struct wire {
    node node[NODES_MAX];
    unsigned count;
} wire;

/* Plays one bit; flipped is a set of nodes that sample the other level. */
static void play_bit(wire *w, unsigned flipped)
{
    bool level = CW_RECESSIVE;
    for (unsigned i = 0; i < w->count; i++) {
        const bool own = cw_mac_drive(&w->node[i].mac);
        w->node[i].dominant += !own;
        level = level && own;
    }
    for (unsigned i = 0; i < w->count; i++) {
        node *n = &w->node[i];
        cw_mac_sample(&n->mac, level != ((flipped >> i & 1) != 0), &n->report);
        if ((n->report.what & CW_REPORT_ERROR) && !(n->what & CW_REPORT_ERROR))
            n->error = n->report.error;
        n->what |= n->report.what;
    }
}

static void play(wire *w, unsigned bits)
{
    for (; bits > 0; bits--)
        play_bit(w, 0);
}

/* Begins the bits of a wire with nodes that know these frames. All of them are idle. */
static void begin(wire *w, unsigned count, const unsigned protocol[])
{
    memset(w, 0, sizeof *w);
    w->count = count;
    for (unsigned i = 0; i < count; i++) {
        node *n = &w->node[i];
        const bool fd = (protocol[i] & CW_PROTOCOL_MASK) == CW_FD;
        cw_mac_init(&n->mac, 0, 96);
        assert_int_equal(cw_mac_set_protocol(&n->mac, protocol[i], fd ? &n->part : NULL), CW_OK);
    }
    play(w, CW_INTEGRATION_BITS);
    for (unsigned i = 0; i < count; i++)
        assert_int_equal(cw_mac_get_phase(&w->node[i].mac), CW_MAC_IDLE);
}

static void begin_two(wire *w, unsigned sender, unsigned receiver)
{
    begin(w, 2, (const unsigned[]){sender, receiver});
}

static void offer(wire *w, unsigned i, const cw_frame *frame)
{
    assert_int_equal(cw_mac_offer(&w->node[i].mac, frame), CW_OK);
}

/* Returns the wire bit of a field in the frame that the node sends. */
static unsigned at(const node *n, cw_field field, unsigned index)
{
    unsigned bit = 0;
    assert_true(cw_bits_find(cw_mac_tx(&n->mac), &bit, field, index));
    return bit;
}

static void assert_received(const node *n, const cw_frame *frame)
{
    assert_true(n->what & CW_REPORT_RX);
    assert_true(cw_frame_equal(cw_mac_received(&n->mac), frame));
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

TEST(a_protocol_needs_its_part)
{
    cw_mac mac;
    cw_fd_part part;
    cw_mac_init(&mac, 0, 96);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD, NULL), CW_INVALID);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_CLASSICAL, &part), CW_INVALID);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD_TOLERANT, &part), CW_INVALID);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD + 1, NULL), CW_INVALID);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD | 0x40, &part), CW_INVALID);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD_TOLERANT, NULL), CW_OK);
    assert_int_equal(cw_mac_set_protocol(&mac, CW_FD, &part), CW_OK);
}

TEST(only_fd_nodes_take_offers_of_fd_frames)
{
    wire w;
    begin(&w, 3, (const unsigned[]){CW_CLASSICAL, CW_FD_TOLERANT, CW_FD});
    assert_int_equal(cw_mac_offer(&w.node[0].mac, &fd_frame), CW_INVALID);
    assert_int_equal(cw_mac_offer(&w.node[1].mac, &fd_frame), CW_INVALID);
    assert_int_equal(cw_mac_offer(&w.node[2].mac, &fd_frame), CW_OK);
}

TEST(a_new_protocol_leaves_the_bus_and_withdraws_the_offer)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    offer(&w, 0, &fd_frame);
    play(&w, 30);
    assert_true(cw_mac_is_sending(&w.node[0].mac));
    assert_int_equal(cw_mac_set_protocol(&w.node[0].mac, CW_CLASSICAL, NULL), CW_OK);
    assert_int_equal(cw_mac_get_phase(&w.node[0].mac), CW_MAC_INTEGRATING);
    play(&w, 100);
    assert_int_equal(cw_mac_get_phase(&w.node[0].mac), CW_MAC_IDLE);
    assert_false(w.node[0].what & (CW_REPORT_TX | CW_REPORT_ERROR));
}

/* ---- D7: the ACK slot ------------------------------------------------------------------------ */

/* Plays a frame up to the ACK slot and chooses its two levels for the sender. Node 1 is the only
 * receiver; its own bit is dominant. */
static void play_ack(wire *w, bool first, bool second)
{
    begin_two(w, CW_FD, CW_FD);
    assert_int_equal(cw_mac_set_counters(&w->node[1].mac, 0, 9), CW_OK);
    offer(w, 0, &fd_frame);
    play(w, at(&w->node[0], CW_FIELD_ACK_SLOT, 0));
    play_bit(w, first ? 1 : 0);
    assert_int_equal(cw_mac_rec(&w->node[1].mac), 8); /* R8: at the first bit */
    play_bit(w, second ? 0 : 1);
}

TEST(either_bit_acknowledges)
{
    for (unsigned levels = 0; levels < 4; levels++) {
        wire w;
        play_ack(&w, levels & 1, levels & 2);
        assert_int_equal(w.node[0].report.what, levels == 3 ? CW_REPORT_ERROR : 0);
        if (levels < 3)
            continue;
        assert_int_equal(w.node[0].error.type, CW_ERROR_ACK);
        assert_int_equal(w.node[0].error.place.field, CW_FIELD_ACK_SLOT);
        assert_int_equal(w.node[0].error.place.index, 1);
    }
}

TEST(receivers_take_any_level_in_the_second_bit)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    offer(&w, 0, &fd_frame);
    play(&w, at(&w.node[0], CW_FIELD_ACK_SLOT, 1));
    assert_true(cw_mac_drive(&w.node[1].mac)); /* drives the first bit only */
    play_bit(&w, 2);
    play(&w, 11);
    assert_int_equal(w.node[1].what, CW_REPORT_RX);
    assert_received(&w.node[1], &fd_frame);
}

/* A controller that goes on between the two bits, as after a step over a clean frame. */
TEST(a_sender_between_the_ack_bits_is_acknowledged)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    offer(&w, 0, &fd_frame);
    node *n = &w.node[0];
    const cw_bits bits = *cw_mac_tx(&n->mac);
    const unsigned second = at(n, CW_FIELD_ACK_SLOT, 1);
    for (unsigned from = second - 1; from <= second + 1; from++) {
        const cw_stuffing stuffing = cw_bits_stuffing(&bits);
        cw_mac_go_into_frame(&n->mac, &fd_frame, &bits, &stuffing, from);
        cw_mac_become_transmitter(&n->mac, from);
        n->what = 0;
        for (unsigned i = from; i < bits.length; i++) {
            (void)cw_mac_drive(&n->mac);
            cw_mac_sample(&n->mac, i != second - 1, &n->report);
            n->what |= n->report.what;
        }
        assert_int_equal(n->what, CW_REPORT_TX);
        offer(&w, 0, &fd_frame);
    }
}

/* ---- D8: ESI --------------------------------------------------------------------------------- */

/* Sends a frame. Its sender gets these counters before, and the other ones right before a bit.
 * Returns the ESI that is received. */
static bool esi_with_change(cw_frame frame, unsigned tec, unsigned new_tec, cw_field before)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    assert_int_equal(cw_mac_set_counters(&w.node[0].mac, tec, 0), CW_OK);
    offer(&w, 0, &frame);
    play(&w, at(&w.node[0], before, 0));
    assert_int_equal(cw_mac_set_counters(&w.node[0].mac, new_tec, 0), CW_OK);
    play(&w, 900);
    assert_true(w.node[0].what & CW_REPORT_TX);
    assert_false((w.node[0].what | w.node[1].what) & CW_REPORT_ERROR);
    const bool esi = cw_mac_received(&w.node[1].mac)->flags & CW_FRAME_ESI;
    frame.flags = (uint8_t)((frame.flags & ~CW_FRAME_ESI) | (esi ? CW_FRAME_ESI : 0));
    assert_received(&w.node[1], &frame);
    return esi;
}

TEST(esi_is_decided_when_it_is_sent)
{
    const cw_frame frames[] = {fd_frame, switched};
    for (unsigned i = 0; i < 2; i++) {
        assert_false(esi_with_change(frames[i], 0, 0, CW_FIELD_ESI));
        assert_true(esi_with_change(frames[i], 128, 128, CW_FIELD_ESI));
        assert_true(esi_with_change(frames[i], 0, 128, CW_FIELD_SOF));
        assert_true(esi_with_change(frames[i], 0, 128, CW_FIELD_ESI));
        assert_false(esi_with_change(frames[i], 128, 0, CW_FIELD_ESI));
        assert_false(esi_with_change(frames[i], 128, 127, CW_FIELD_BRS));
        assert_false(esi_with_change(frames[i], 0, 128, CW_FIELD_DLC));
        assert_true(esi_with_change(frames[i], 128, 0, CW_FIELD_DLC));
    }
}

TEST(esi_of_the_host_does_not_count)
{
    cw_frame frame = fd_frame;
    frame.flags |= CW_FRAME_ESI;
    assert_false(esi_with_change(frame, 0, 0, CW_FIELD_SOF));
}

/* The error state may change while a frame waits. */
TEST(the_horizon_knows_the_length_with_esi)
{
    for (unsigned byte = 0; byte < 256; byte++) {
        wire w;
        cw_frame frame = {.id = byte, .flags = CW_FRAME_FD, .dlc = byte % 4};
        begin_two(&w, CW_FD, CW_FD);
        offer(&w, 0, &frame);
        assert_int_equal(cw_mac_set_counters(&w.node[0].mac, 128, 0), CW_OK);
        play(&w, 1);
        const uint64_t horizon = cw_mac_horizon(&w.node[0].mac, false);
        play(&w, (unsigned)horizon - 1);
        assert_false(w.node[1].what & CW_REPORT_RX);
        play(&w, 1);
        assert_true(w.node[1].what & CW_REPORT_RX);
    }
}

/* ---- D14, D15 -------------------------------------------------------------------------------- */

TEST(a_fixed_stuff_bit_is_a_form_error_for_both)
{
    for (unsigned n = 0; n < 7; n++) {
        wire w;
        begin_two(&w, CW_FD, CW_FD);
        offer(&w, 0, &switched);
        play(&w, at(&w.node[0], CW_FIELD_FIXED_STUFF, n));
        play_bit(&w, 3);
        for (unsigned i = 0; i < 2; i++) {
            assert_int_equal(w.node[i].error.type, CW_ERROR_FORM);
            assert_int_equal(w.node[i].error.place.field, CW_FIELD_FIXED_STUFF);
            assert_int_equal(w.node[i].error.place.index, n);
            assert_int_equal(cw_mac_get_phase(&w.node[i].mac), CW_MAC_ERROR_ACTIVE);
        }
    }
}

TEST(a_wrong_stuff_count_is_a_crc_error)
{
    for (unsigned n = 0; n < 4; n++) {
        wire w;
        begin_two(&w, CW_FD, CW_FD);
        cw_mac_set_modes(&w.node[0].mac, CW_MODE_PRESUME_ACK); /* no error but the receiver's */
        offer(&w, 0, &fd_frame);
        /* to the receiver one bit is inverted, with the fixed one behind it that depends on it */
        play(&w, at(&w.node[0], CW_FIELD_STUFF_COUNT, n));
        play_bit(&w, 2);
        if (n == 3)
            play_bit(&w, 2);
        play(&w, 60);
        assert_int_equal(w.node[1].error.type, CW_ERROR_CRC);
        assert_int_equal(w.node[1].error.place.field, CW_FIELD_ACK_DELIMITER);
    }
}

/* ---- D16, D17 -------------------------------------------------------------------------------- */

TEST(an_fd_frame_is_an_exception_to_tolerant_nodes)
{
    wire w;
    begin(&w, 3, (const unsigned[]){CW_FD, CW_FD, CW_FD_TOLERANT});
    assert_int_equal(cw_mac_set_counters(&w.node[2].mac, 5, 9), CW_OK);
    offer(&w, 0, &switched);
    const unsigned fdf = at(&w.node[0], CW_FIELD_FDF, 0);
    play(&w, fdf + 1);
    assert_int_equal(w.node[2].report.what, CW_REPORT_EXCEPTION);
    assert_int_equal(cw_mac_get_phase(&w.node[2].mac), CW_MAC_INTEGRATING);
    play(&w, cw_mac_tx(&w.node[0].mac)->length + 3u - fdf - 1);
    assert_int_equal(w.node[2].what, CW_REPORT_EXCEPTION);
    assert_int_equal(w.node[2].dominant, 0);
    assert_int_equal(cw_mac_rec(&w.node[2].mac), 9);
    assert_int_equal(cw_mac_tec(&w.node[2].mac), 5);
    assert_received(&w.node[1], &switched);
    assert_int_equal(cw_mac_get_phase(&w.node[2].mac), CW_MAC_IDLE);
    offer(&w, 0, &classical_frame);
    play(&w, 80);
    assert_received(&w.node[2], &classical_frame);
    assert_int_equal(cw_mac_rec(&w.node[2].mac), 8);
}

TEST(a_recessive_res_is_an_exception_to_fd_nodes)
{
    for (unsigned off = 0; off < 2; off++) {
        wire w;
        begin_two(&w, CW_FD, CW_FD | (off ? CW_PROTOCOL_NO_EXCEPTION : 0));
        offer(&w, 0, &fd_frame);
        play(&w, at(&w.node[0], CW_FIELD_RES, 0));
        play_bit(&w, 2);
        assert_int_equal(w.node[1].report.what, off ? CW_REPORT_ERROR : CW_REPORT_EXCEPTION);
        assert_int_equal(cw_mac_get_phase(&w.node[1].mac),
                         off ? CW_MAC_ERROR_ACTIVE : CW_MAC_INTEGRATING);
        assert_int_equal(cw_mac_rec(&w.node[1].mac), off);
        if (off)
            assert_int_equal(w.node[1].error.type, CW_ERROR_FORM);
    }
}

TEST(without_exceptions_a_tolerant_node_has_a_form_error)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD_TOLERANT | CW_PROTOCOL_NO_EXCEPTION);
    offer(&w, 0, &fd_frame);
    play(&w, at(&w.node[0], CW_FIELD_FDF, 0) + 1);
    assert_int_equal(w.node[1].report.what, CW_REPORT_ERROR);
    assert_int_equal(w.node[1].error.type, CW_ERROR_FORM);
    assert_int_equal(w.node[1].error.flag, CW_FLAG_ACTIVE);
}

/* The sender is given no frame of another kind: a wrong level of res is its bit error. */
TEST(a_sender_has_a_bit_error_in_res)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    offer(&w, 0, &fd_frame);
    play(&w, at(&w.node[0], CW_FIELD_RES, 0));
    play_bit(&w, 1);
    assert_int_equal(w.node[0].error.type, CW_ERROR_BIT);
    assert_int_equal(w.node[0].error.place.field, CW_FIELD_RES);
}

TEST(a_classical_node_destroys_fd_frames)
{
    wire w;
    begin(&w, 3, (const unsigned[]){CW_FD, CW_FD, CW_CLASSICAL});
    cw_mac_set_modes(&w.node[0].mac, CW_MODE_ONE_SHOT);
    offer(&w, 0, &switched);
    play(&w, 300);
    assert_true(w.node[2].what & CW_REPORT_ERROR);
    assert_true(w.node[2].dominant >= CW_FLAG_BITS);
    assert_true(w.node[0].what & CW_REPORT_DROPPED);
    assert_false(w.node[1].what & CW_REPORT_RX);
    assert_int_equal(cw_mac_tec(&w.node[0].mac), 8);
}

/* D9: the same identifier in both formats. */
TEST(a_classical_frame_is_a_bit_error_to_the_fd_sender)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    cw_mac_set_modes(&w.node[0].mac, CW_MODE_ONE_SHOT);
    offer(&w, 0, &fd_frame);
    offer(&w, 1, &classical_frame);
    play(&w, 200);
    assert_false(w.node[0].what & CW_REPORT_ARBITRATION_LOST);
    assert_int_equal(w.node[0].error.type, CW_ERROR_BIT);
    assert_int_equal(w.node[0].error.place.field, CW_FIELD_FDF);
    assert_received(&w.node[0], &classical_frame);
    assert_true(w.node[1].what & CW_REPORT_TX);
}

/* ---- D19: restricted operation --------------------------------------------------------------- */

static void begin_restricted(wire *w)
{
    begin_two(w, CW_FD, CW_FD);
    cw_mac_set_modes(&w->node[1].mac, CW_MODE_RESTRICTED);
    play(w, CW_INTEGRATION_BITS);
    assert_int_equal(cw_mac_set_counters(&w->node[1].mac, 5, 9), CW_OK);
    w->node[1].what = w->node[1].dominant = 0;
}

static void assert_restricted(const wire *w, unsigned dominant)
{
    assert_int_equal(w->node[1].dominant, dominant);
    assert_int_equal(cw_mac_tec(&w->node[1].mac), 5);
    assert_int_equal(cw_mac_rec(&w->node[1].mac), 9);
}

TEST(a_restricted_node_acknowledges_and_sends_nothing)
{
    wire w;
    begin_restricted(&w);
    assert_int_equal(cw_mac_offer(&w.node[1].mac, &fd_frame), CW_REFUSED);
    assert_int_equal(cw_mac_request_overload(&w.node[1].mac, 2), CW_OK);
    offer(&w, 0, &fd_frame);
    play(&w, 120);
    assert_received(&w.node[1], &fd_frame);
    assert_true(w.node[0].what & CW_REPORT_TX);
    assert_restricted(&w, 1);
}

TEST(a_restricted_node_keeps_its_offer_for_later)
{
    wire w;
    begin_two(&w, CW_FD, CW_FD);
    offer(&w, 1, &fd_frame);
    cw_mac_set_modes(&w.node[1].mac, CW_MODE_RESTRICTED);
    play(&w, 100);
    assert_int_equal(w.node[1].dominant, 0);
    cw_mac_set_modes(&w.node[1].mac, 0);
    play(&w, 100);
    assert_true(w.node[1].what & CW_REPORT_TX);
}

/* In any bit: an error, or what asks for an overload frame. */
TEST(a_restricted_node_answers_no_wrong_bit)
{
    for (unsigned bit = 1; bit < 100; bit++) {
        wire w;
        begin_restricted(&w);
        offer(&w, 0, &fd_frame);
        cw_mac_set_modes(&w.node[0].mac, CW_MODE_PRESUME_ACK);
        const unsigned length = cw_mac_tx(&w.node[0].mac)->length;
        const unsigned ack = at(&w.node[0], CW_FIELD_ACK_SLOT, 0);
        for (unsigned n = 0; n < length + 3; n++)
            play_bit(&w, n == bit ? 2 : 0);
        assert_false(w.node[1].what & (CW_REPORT_OVERLOAD | CW_REPORT_STATE));
        assert_restricted(&w, bit < ack && w.node[1].dominant == 0 ? 0 : 1);
        if (w.node[1].what & CW_REPORT_ERROR) {
            assert_int_equal(w.node[1].error.flag, CW_FLAG_NONE);
            assert_false(cw_mac_is_busy(&w.node[1].mac));
        }
    }
}

/* ---- Frames from before ISO 11898-1:2015 ----------------------------------------------------- */

TEST(non_iso_nodes_understand_each_other)
{
    const unsigned non_iso = CW_FD | CW_PROTOCOL_NON_ISO;
    const cw_frame *const frames[] = {&fd_frame, &switched};
    for (unsigned i = 0; i < 2; i++) {
        wire w;
        cw_frame expected = *frames[i];
        expected.flags |= CW_FRAME_NON_ISO;
        begin_two(&w, non_iso, non_iso);
        offer(&w, 0, frames[i]);
        const unsigned length = cw_mac_tx(&w.node[0].mac)->length;
        /* no stuff count, and one fixed stuff bit less */
        assert_int_equal(length, cw_frame_wire_bits(frames[i]) - 5);
        play(&w, length + 3);
        assert_received(&w.node[1], &expected);
        assert_int_equal(w.node[0].what, CW_REPORT_STARTED | CW_REPORT_TX);
        assert_int_equal(w.node[1].what, CW_REPORT_RX);
    }
}

TEST(non_iso_and_iso_nodes_do_not)
{
    for (unsigned i = 0; i < 2; i++) {
        wire w;
        begin_two(&w, CW_FD | (i ? CW_PROTOCOL_NON_ISO : 0), CW_FD | (i ? 0 : CW_PROTOCOL_NON_ISO));
        cw_mac_set_modes(&w.node[0].mac, CW_MODE_ONE_SHOT);
        offer(&w, 0, &switched);
        play(&w, 400);
        assert_false(w.node[1].what & CW_REPORT_RX);
        assert_true(w.node[1].what & CW_REPORT_ERROR);
    }
}

TEST(a_good_non_iso_frame_follows_one_with_a_crc_error)
{
    const unsigned non_iso = CW_FD | CW_PROTOCOL_NON_ISO;
    wire w;
    begin_two(&w, non_iso, non_iso);
    cw_mac_set_modes(&w.node[0].mac, CW_MODE_PRESUME_ACK);
    offer(&w, 0, &fd_frame);
    play(&w, at(&w.node[0], CW_FIELD_CRC, 1));
    play_bit(&w, 2);
    play(&w, 300);
    assert_int_equal(w.node[1].error.type, CW_ERROR_CRC);
    assert_true(w.node[1].what & CW_REPORT_RX);
    assert_int_equal(cw_mac_tec(&w.node[0].mac), 7);
}
