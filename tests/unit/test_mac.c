/* SPDX-License-Identifier: MIT
 *
 * test_mac.c - the edges of the controller's interface: arguments, refusals, forced errors.
 * tests/conformance has its behaviour on the wire.
 */
#include "cases.h"
#include "mac/confinement.h"
#include "mac/mac.h"

static const cw_frame frame = {.id = 0x123, .dlc = 1, .data = {0x55}};

/* Plays recessive bits of the bench; returns the number of dominant levels of the node. */
static unsigned play(cw_mac *mac, unsigned bits, bool level)
{
    cw_mac_report report;
    unsigned dominant = 0;
    for (unsigned i = 0; i < bits; i++) {
        bool own = cw_mac_drive(mac);
        dominant += !own;
        cw_mac_sample(mac, own && level, &report);
    }
    return dominant;
}

static cw_mac idle_mac(unsigned modes)
{
    cw_mac mac;
    cw_mac_init(&mac, modes, 96);
    (void)play(&mac, CW_INTEGRATION_BITS, CW_RECESSIVE);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_IDLE);
    return mac;
}

TEST(overload_requests_are_one_or_two)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_request_overload(&mac, 0), CW_INVALID);
    assert_int_equal(cw_mac_request_overload(&mac, 1), CW_OK);
    assert_int_equal(cw_mac_request_overload(&mac, 2), CW_OK);
    assert_int_equal(cw_mac_request_overload(&mac, 3), CW_INVALID);
}

TEST(counters_have_their_ranges)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_set_counters(&mac, 264, 0), CW_INVALID);
    assert_int_equal(cw_mac_set_counters(&mac, 0, 256), CW_INVALID);
    assert_int_equal(cw_mac_tec(&mac), 0);
    assert_int_equal(cw_mac_set_counters(&mac, 255, 255), CW_OK);
    assert_int_equal(cw_mac_state(&mac), CW_STATE_ERROR_PASSIVE);
    assert_int_equal(cw_mac_set_counters(&mac, 263, 0), CW_OK);
    assert_int_equal(cw_mac_state(&mac), CW_STATE_BUS_OFF);
}

TEST(variants_refuse_frames)
{
    static const struct {
        cw_frame frame;
        unsigned refused_by;
    } cases[] = {
        {{.id = 0x7EF, .dlc = 8}, 0},
        {{.id = 0x7F0}, CW_VARIANT_NO_HIGH_IDS},
        {{.id = 0x7FF, .dlc = 9}, CW_VARIANT_NO_HIGH_IDS | CW_VARIANT_NO_LONG_DLC},
        {{.id = 0x7F0, .flags = CW_FRAME_EXTENDED}, 0},
        {{.id = 0x1FBFFFFF, .flags = CW_FRAME_EXTENDED}, 0},
        {{.id = 0x1FC00000, .flags = CW_FRAME_EXTENDED}, CW_VARIANT_NO_HIGH_IDS},
        {{.id = 1, .flags = CW_FRAME_REMOTE, .dlc = 15}, CW_VARIANT_NO_LONG_DLC},
    };
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_set_variants(&mac, 0x10), CW_INVALID);
    for (unsigned variants = 0; variants < 16; variants++)
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            const bool refused = variants & cases[i].refused_by;
            mac = idle_mac(0);
            assert_int_equal(cw_mac_set_variants(&mac, variants), CW_OK);
            assert_int_equal(cw_mac_offer(&mac, &cases[i].frame), refused ? CW_INVALID : CW_OK);
            assert_int_equal(cw_frame_is_refused(&cases[i].frame, variants), refused);
        }
}

TEST(counters_below_the_limit_end_bus_off)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_set_counters(&mac, 256, 0), CW_OK);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_BUS_OFF);
    assert_int_equal(cw_mac_set_counters(&mac, 10, 0), CW_OK);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_INTEGRATING);
    /* but counters of a node that is on the bus leave it there */
    mac = idle_mac(0);
    assert_int_equal(cw_mac_set_counters(&mac, 10, 0), CW_OK);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_IDLE);
}

TEST(restart_is_for_bus_off_only)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_request_restart(&mac), CW_REFUSED);
    assert_int_equal(cw_mac_set_counters(&mac, 256, 0), CW_OK);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_REFUSED);
    assert_int_equal(cw_mac_request_restart(&mac), CW_OK);
    assert_int_equal(cw_mac_request_restart(&mac), CW_REFUSED);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_REFUSED);
}

TEST(offers_are_checked)
{
    const cw_frame bad = {.id = 0x800};
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_offer(&mac, &bad), CW_INVALID);
    cw_mac listening = idle_mac(CW_MODE_LISTEN_ONLY);
    assert_int_equal(cw_mac_offer(&listening, &frame), CW_REFUSED);
    assert_false(cw_mac_can_start(&listening));
    assert_true(cw_mac_can_start(&mac));
}

/* Six dominant bits, and the counter of the role moves. */
TEST(forced_error_of_an_idle_node)
{
    cw_mac mac = idle_mac(0);
    assert_false(cw_mac_force_error(&mac));
    assert_int_equal(cw_mac_rec(&mac), 1);
    assert_int_equal(play(&mac, 20, CW_RECESSIVE), CW_FLAG_BITS);
}

TEST(forced_error_of_a_transmitter)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)play(&mac, 5, CW_RECESSIVE);
    assert_false(cw_mac_force_error(&mac));
    assert_int_equal(cw_mac_tec(&mac), 8);
    assert_int_equal(play(&mac, CW_FLAG_BITS, CW_RECESSIVE), CW_FLAG_BITS);
}

TEST(forced_error_in_one_shot_gives_the_frame_up)
{
    cw_mac mac = idle_mac(CW_MODE_ONE_SHOT);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)play(&mac, 5, CW_RECESSIVE);
    assert_true(cw_mac_force_error(&mac));
    (void)play(&mac, CW_FLAG_BITS + CW_DELIMITER_BITS + 3, CW_RECESSIVE);
    assert_int_equal(play(&mac, 50, CW_RECESSIVE), 0);
}

TEST(nothing_is_forced_off_the_bus)
{
    cw_mac integrating;
    cw_mac_init(&integrating, 0, 96);
    (void)cw_mac_force_error(&integrating);
    assert_int_equal(cw_mac_rec(&integrating), 0);
    cw_mac off = idle_mac(0);
    cw_mac_disconnect(&off);
    (void)cw_mac_force_error(&off);
    assert_int_equal(play(&off, 20, CW_DOMINANT), 0);
    assert_int_equal(cw_mac_rec(&off), 0);
    cw_mac bus_off = idle_mac(0);
    assert_int_equal(cw_mac_set_counters(&bus_off, 256, 0), CW_OK);
    (void)cw_mac_force_error(&bus_off);
    assert_int_equal(cw_mac_get_phase(&bus_off), CW_MAC_BUS_OFF);
}

TEST(a_disconnected_node_integrates_when_back)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)play(&mac, 5, CW_RECESSIVE);
    cw_mac_disconnect(&mac);
    assert_int_equal(play(&mac, 100, CW_RECESSIVE), 0);
    cw_mac_reconnect(&mac);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_INTEGRATING);
    assert_int_equal(play(&mac, CW_INTEGRATION_BITS, CW_RECESSIVE), 0);
    assert_int_equal(play(&mac, 1, CW_RECESSIVE), 1); /* SOF: the frame was kept */
    cw_mac idle = idle_mac(0);
    cw_mac_reconnect(&idle);
    assert_int_equal(cw_mac_get_phase(&idle), CW_MAC_IDLE);
}

TEST(bus_off_stays_bus_off_when_disconnected)
{
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_set_counters(&mac, 256, 0), CW_OK);
    cw_mac_disconnect(&mac);
    cw_mac_reconnect(&mac);
    assert_int_equal(cw_mac_get_phase(&mac), CW_MAC_BUS_OFF);
}

/* Checks the reports about the offers of a controller, bit by bit: one for each. */
TEST(an_offer_ends_once)
{
    cw_mac_report report;
    cw_mac mac = idle_mac(0);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)play(&mac, 5, CW_RECESSIVE);
    assert_int_equal(cw_mac_set_counters(&mac, 256, 0), CW_OK);
    assert_int_equal(cw_mac_steady_bits(&mac, CW_RECESSIVE), 0); /* there is an event to report */
    (void)cw_mac_drive(&mac);
    cw_mac_sample(&mac, CW_RECESSIVE, &report);
    assert_int_equal(report.what, CW_REPORT_DROPPED | CW_REPORT_STATE);
    assert_int_equal(report.why, CW_DROP_BUS_OFF);
    cw_mac_sample(&mac, CW_RECESSIVE, &report);
    assert_int_equal(report.what, 0);
    assert_true(cw_mac_steady_bits(&mac, CW_RECESSIVE) == CW_QUIET_FOREVER);
    assert_int_equal(cw_mac_set_counters(&mac, 0, 0), CW_OK);
    assert_int_equal(play(&mac, 100, CW_RECESSIVE), 0);
    mac = idle_mac(0); /* by an error of its own */
    assert_int_equal(cw_mac_set_counters(&mac, 248, 0), CW_OK);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)cw_mac_drive(&mac);
    cw_mac_sample(&mac, CW_RECESSIVE, &report);
    assert_int_equal(report.what & CW_REPORT_DROPPED, CW_REPORT_DROPPED);
    assert_int_equal(report.why, CW_DROP_BUS_OFF);
    mac = idle_mac(CW_MODE_ONE_SHOT); /* the same of a one-shot node */
    assert_int_equal(cw_mac_set_counters(&mac, 248, 0), CW_OK);
    assert_int_equal(cw_mac_offer(&mac, &frame), CW_OK);
    (void)cw_mac_drive(&mac);
    cw_mac_sample(&mac, CW_RECESSIVE, &report);
    assert_int_equal(report.what & CW_REPORT_DROPPED, CW_REPORT_DROPPED);
    assert_int_equal(report.why, CW_DROP_ONE_SHOT);
}

/* R9, R11, R13: the state follows the larger counter, up and down. */
TEST(states_follow_the_counters)
{
    static const struct {
        unsigned tec, rec;
        cw_state after_set, after_tx, after_rx;
    } rows[] = {
        {95, 95, CW_STATE_ERROR_ACTIVE, CW_STATE_ERROR_ACTIVE, CW_STATE_ERROR_ACTIVE},
        {96, 0, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_ACTIVE, CW_STATE_ERROR_WARNING},
        {0, 96, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_ACTIVE},
        {96, 96, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_WARNING},
        {128, 0, CW_STATE_ERROR_PASSIVE, CW_STATE_ERROR_WARNING, CW_STATE_ERROR_PASSIVE},
        {0, 128, CW_STATE_ERROR_PASSIVE, CW_STATE_ERROR_PASSIVE, CW_STATE_ERROR_WARNING},
        {255, 0, CW_STATE_ERROR_PASSIVE, CW_STATE_ERROR_PASSIVE, CW_STATE_ERROR_PASSIVE},
        {256, 0, CW_STATE_BUS_OFF, CW_STATE_BUS_OFF, CW_STATE_BUS_OFF},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        cw_confinement c = {.warning_limit = 96};
        cw_confinement_set(&c, rows[i].tec, rows[i].rec);
        assert_int_equal(c.state, rows[i].after_set);
        cw_confinement_tx_success(&c);
        assert_int_equal(c.state, rows[i].after_tx);
        cw_confinement_set(&c, rows[i].tec, rows[i].rec);
        cw_confinement_rx_success(&c);
        assert_int_equal(c.state, rows[i].after_rx);
    }
}

/* R8: from 1 to 127 one down; above that 120, which both readings of the standard allow. */
TEST(a_good_frame_lowers_the_rec)
{
    static const unsigned rows[][2] = {{0, 0},     {1, 0},     {127, 126},
                                       {128, 120}, {129, 120}, {255, 120}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        cw_confinement c = {.warning_limit = 96};
        cw_confinement_set(&c, 0, rows[i][0]);
        cw_confinement_rx_success(&c);
        assert_int_equal(c.rec, rows[i][1]);
    }
}

/* Sends a frame and overwrites its first recessive stuff bit; what is reported for it. */
static cw_error overwrite_stuff_bit(cw_mac *mac, const cw_frame *sent)
{
    cw_mac_report report = {.what = 0};
    cw_bits bits;
    assert_int_equal(cw_bits_encode(&bits, sent), CW_OK);
    assert_int_equal(cw_mac_offer(mac, sent), CW_OK);
    for (unsigned n = 0; !(report.what & CW_REPORT_ERROR); n++) {
        bool recessive_stuff = cw_bits_place(&bits, n).stuff && cw_bits_level(&bits, n);
        bool level = cw_mac_drive(mac);
        cw_mac_sample(mac, level && !recessive_stuff, &report);
    }
    return report.error;
}

/* R3 ii spares a transmitter only before the RTR bit. */
TEST(a_stuff_bit_behind_the_rtr_is_an_ordinary_bit_error)
{
    static const struct {
        cw_frame frame;
        cw_field field;
        cw_error_type type;
        unsigned tec;
    } rows[] = {
        {{.id = 0x07F}, CW_FIELD_ID, CW_ERROR_STUFF, 0}, /* 0 0000 */
        {{.id = 0x7E0}, CW_FIELD_ID, CW_ERROR_STUFF, 0}, /* 111111 00000, the last of the id */
        {{.id = 0x7F0}, CW_FIELD_RTR, CW_ERROR_BIT, 8},  /* 1111111 0000 and RTR */
        {{.id = 0x7F8}, CW_FIELD_IDE, CW_ERROR_BIT, 8},  /* 11111111 000, RTR, IDE */
        {{.id = 0x1FFFFFE0, .flags = CW_FRAME_EXTENDED}, CW_FIELD_ID, CW_ERROR_STUFF, 0},
        {{.id = 0x1FFFFFF0, .flags = CW_FRAME_EXTENDED}, CW_FIELD_RTR, CW_ERROR_BIT, 8},
        {{.id = 0x1FFFFFF8, .flags = CW_FRAME_EXTENDED}, CW_FIELD_R1, CW_ERROR_BIT, 8},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        cw_mac mac = idle_mac(0);
        const cw_error error = overwrite_stuff_bit(&mac, &rows[i].frame);
        assert_int_equal(error.type, rows[i].type);
        assert_int_equal(error.role, CW_ROLE_TRANSMITTER);
        assert_int_equal(error.place.field, rows[i].field);
        assert_true(error.place.stuff);
        assert_int_equal(cw_mac_tec(&mac), rows[i].tec);
        assert_int_equal(cw_mac_rec(&mac), 0);
        assert_int_equal(play(&mac, CW_FLAG_BITS, CW_RECESSIVE), CW_FLAG_BITS);
    }
}

TEST(the_warning_limit_counts_at_once)
{
    cw_confinement c = {.warning_limit = 96};
    cw_confinement_set(&c, 50, 0);
    cw_confinement_set_warning_limit(&c, 50);
    assert_int_equal(c.state, CW_STATE_ERROR_WARNING);
    cw_confinement_set_warning_limit(&c, 51);
    assert_int_equal(c.state, CW_STATE_ERROR_ACTIVE);
}
