/* SPDX-License-Identifier: MIT
 *
 * test_raw.c - frames with deviating bits, and bits that a node drives without its controller.
 */
#include "cases.h"
#include "rules.h"
#include "times.h"

#define FRAMES 3000
#define SEED 11

/* ---- Encoding, written from F1 to F7 alone --------------------------------------------------- */

typedef struct row {
    bool level[256];
    unsigned count;
} row;

static void put(row *to, uint32_t number, unsigned bits)
{
    for (unsigned i = bits; i-- > 0;)
        to->level[to->count++] = number >> i & 1u;
}

static unsigned check_sequence(const row *of)
{
    unsigned crc = 0;
    for (unsigned i = 0; i < of->count; i++) {
        const bool next = of->level[i] != (crc >> 14 & 1u);
        crc = (crc << 1 & 0x7FFF) ^ (next ? 0x4599u : 0);
    }
    return crc;
}

static row stuff(const row *plain)
{
    row wire = {.count = 0};
    unsigned run = 0;
    for (unsigned i = 0; i < plain->count; i++) {
        const bool level = plain->level[i];
        run = wire.count > 0 && level == wire.level[wire.count - 1] ? run + 1 : 1;
        put(&wire, level, 1);
        if (run < 5)
            continue;
        put(&wire, !level, 1);
        run = 1;
    }
    return wire;
}

static row wire_of(const cw_frame *f, bool srr, bool r1, bool r0)
{
    row plain = {.count = 1}; /* SOF */
    const bool remote = f->flags & CW_FRAME_REMOTE;
    if (f->flags & CW_FRAME_EXTENDED) {
        put(&plain, f->id >> 18, 11);
        put(&plain, srr, 1);
        put(&plain, 1, 1);
        put(&plain, f->id & 0x3FFFF, 18);
        put(&plain, remote, 1);
        put(&plain, r1, 1);
    } else {
        put(&plain, f->id, 11);
        put(&plain, remote, 1);
        put(&plain, 0, 1);
    }
    put(&plain, r0, 1);
    put(&plain, f->dlc, 4);
    for (unsigned i = 0; i < cw_frame_length(f); i++)
        put(&plain, f->data[i], 8);
    put(&plain, check_sequence(&plain), 15);
    row wire = stuff(&plain);
    put(&wire, 0x3FF, 10); /* CRC delimiter, ACK slot and delimiter, EOF */
    return wire;
}

static cw_mac receive(const row *wire, bool *accepted)
{
    cw_mac mac;
    cw_mac_report report;
    cw_mac_init(&mac, 0, 96);
    for (unsigned i = 0; i < JOIN; i++)
        cw_mac_sample(&mac, CW_RECESSIVE, &report);
    for (unsigned i = 0; i < wire->count; i++) {
        const bool own = cw_mac_drive(&mac);
        cw_mac_sample(&mac, own && wire->level[i], &report);
        assert_false(report.what & (CW_REPORT_ERROR | CW_REPORT_OVERLOAD));
        *accepted = *accepted || (report.what & CW_REPORT_RX);
    }
    return mac;
}

static void check(const cw_frame *f, unsigned deviations)
{
    cw_bits bits;
    bool accepted = false;
    const row wire = wire_of(f, !(deviations & CW_DEVIATES_SRR), deviations & CW_DEVIATES_R1,
                             deviations & CW_DEVIATES_R0);
    const bool base = !(f->flags & CW_FRAME_EXTENDED);
    if (base && (deviations & ~CW_DEVIATES_R0)) {
        assert_int_equal(cw_bits_encode_deviant(&bits, f, deviations), CW_INVALID);
        return;
    }
    assert_int_equal(cw_bits_encode_deviant(&bits, f, deviations), CW_OK);
    assert_int_equal(bits.length, wire.count);
    for (unsigned i = 0; i < wire.count; i++)
        assert_int_equal(cw_bits_level(&bits, i), wire.level[i]);
    const cw_mac mac = receive(&wire, &accepted);
    assert_true(accepted);
    assert_true(cw_frame_equal(cw_mac_received(&mac), f));
}

/* F5: the CRC covers the deviating bits, stuff bits follow from them, and a receiver takes the
 * frame. */
TEST(deviating_frames_are_good_ones)
{
    rig_random random = {SEED};
    for (unsigned i = 0; i < FRAMES; i++) {
        const cw_frame f = rig_random_frame(&random);
        for (unsigned deviations = 0; deviations < 8; deviations++)
            check(&f, deviations);
    }
    cw_bits bits;
    const cw_frame fd = {.id = 1, .flags = CW_FRAME_FD};
    assert_int_equal(cw_bits_encode_deviant(&bits, &fd, CW_DEVIATES_R0), CW_INVALID);
    assert_int_equal(cw_bits_encode_deviant(&bits, &fd, 8), CW_INVALID);
}

/* ---- Rules ----------------------------------------------------------------------------------- */

static const cw_frame extended = {.id = 0x12345678, .flags = CW_FRAME_EXTENDED, .dlc = 1,
                                  .data = {1}};

static cw_rule *raw_frame(rig *r, unsigned deviations, uint64_t bit)
{
    cw_rule *rule = ADD_RULE(r, "raw", TIME, RAW_FRAME, .frame = extended,
                             .deviations = (uint8_t)deviations, .time_begin = bit * BIT);
    return rule;
}

/* Drives a whole frame of node 2. */
static cw_rule *raw_bits(rig *r, const cw_frame *frame, uint64_t bit)
{
    cw_rule *rule = ADD_RULE(r, "bits", TIME, RAW);
    cw_bits bits;
    assert_int_equal(cw_bits_encode(&bits, frame), CW_OK);
    memcpy(rule->raw, bits.level, sizeof rule->raw);
    rule->bits = bits.length;
    rule->raw_when_idle = true;
    rule->node = 2;
    rule->time_begin = bit * BIT;
    return rule;
}

TEST(impossible_rules_are_refused)
{
    for (unsigned deviations = 0; deviations < 16; deviations++) {
        RIG *r = rig_new(2);
        cw_rule *rule = raw_frame(r, deviations, 0);
        assert_true((cw_bus_size(&r->config) != 0) && deviations < 16);
        rule->node = 1;
        FREED void *memory = malloc(cw_bus_size(&r->config));
        assert_int_equal(cw_bus_init(memory, &r->config) != NULL, deviations < 8);
        r->nodes[1].protocol = CW_FD_TOLERANT; /* its r1 is FDF */
        assert_int_equal(cw_bus_init(memory, &r->config) != NULL,
                         deviations < 8 && !(deviations & CW_DEVIATES_R1));
    }
    for (unsigned bits = 0; bits < 194; bits += 64) {
        RIG *r = rig_new(3);
        raw_bits(r, &extended, 0)->bits = (uint16_t)bits;
        FREED void *memory = malloc(cw_bus_size(&r->config));
        assert_int_equal(cw_bus_init(memory, &r->config) != NULL, bits > 0 && bits <= CW_RAW_MAX);
    }
}

static uint64_t tx_end(unsigned begin, unsigned deviations)
{
    cw_bits bits;
    assert_int_equal(cw_bits_encode_deviant(&bits, &extended, deviations), CW_OK);
    return (begin + bits.length) * (uint64_t)BIT;
}

/* The length tells which frame was sent. */
TEST(a_cleared_rule_leaves_an_honest_frame)
{
    for (unsigned cleared = 0; cleared < 2; cleared++) {
        RIG *r = rig_new(2);
        raw_frame(r, CW_DEVIATES_R0 | CW_DEVIATES_R1, 0);
        rig_start(r);
        rig_run_bits(r, JOIN - 1);
        if (cleared)
            assert_int_equal(cw_bus_clear_rule(r->bus, 0), CW_OK);
        rig_run_bits(r, 200);
        assert_int_not_equal(tx_end(JOIN, 0), tx_end(JOIN, CW_DEVIATES_R0 | CW_DEVIATES_R1));
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick,
                         tx_end(JOIN, cleared ? 0 : CW_DEVIATES_R0 | CW_DEVIATES_R1));
    }
}

/* On a new bus a frame under way is finished as it began; one that waits is an honest one. */
TEST(a_raw_frame_is_taken_over)
{
    static const uint8_t same[] = {0, 1};
    for (unsigned begun = 0; begun < 2; begun++) {
        const unsigned deviations = begun ? CW_DEVIATES_R0 | CW_DEVIATES_R1 : 0;
        RIG *old = rig_new(2), *r = rig_new(2);
        raw_frame(old, CW_DEVIATES_R0 | CW_DEVIATES_R1, 0);
        rig_start(old);
        rig_run_bits(old, begun ? JOIN + 40 : JOIN - 1);
        rig_start(r);
        assert_int_equal(cw_bus_take_over(r->bus, old->bus, same), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_TX, 0), 1);
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->tick, tx_end(JOIN, deviations));
    }
}

/* Nodes get a frame that was driven without a controller, from the node that drove it. */
TEST(raw_bits_of_a_frame_are_received)
{
    RIG *r = rig_new(3);
    (void)raw_bits(r, &extended, 0);
    rig_start(r);
    rig_run_bits(r, 300);
    const cw_event *rx = rig_nth(r, CW_EVENT_RX, 0);
    assert_int_equal(rig_count(r, CW_EVENT_RX, -1), 1);
    assert_int_equal(rx->nodes, NODE(0) | NODE(1));
    assert_int_equal(rx->tick, tx_end(JOIN, 0) - BIT);
    assert_int_equal(rx->from, NODE(2));
    assert_int_equal(rx->handed_in, rx->tick);
    assert_int_equal(rig_count(r, CW_EVENT_TX, -1) + rig_count(r, CW_EVENT_ERROR, -1), 0);
    assert_int_equal(rig_bus_stats(r).undetected_errors, 0);
}

/* A node that is cut off drives nothing, and one that its host has taken off neither. */
TEST(a_node_that_is_cut_off_drives_no_bits)
{
    for (unsigned host = 0; host < 2; host++) {
        RIG *r = rig_new(3);
        (void)raw_bits(r, &extended, 20);
        ADD_RULE(r, "cut", TIME, DISCONNECT, .nodes = host ? NODE(1) : NODE(2));
        rig_start(r);
        if (host)
            assert_int_equal(cw_node_attach(r->bus, 2, false), CW_OK);
        rig_run_bits(r, 300);
        assert_int_equal(rig_count(r, CW_EVENT_RX, -1) + rig_count(r, CW_EVENT_ERROR, -1), 0);
    }
}

/* The wait ends with the frame on the wire. A second hit meanwhile changes nothing. Then the node
 * integrates, and sends its own frame. */
TEST(raw_bits_wait_for_an_idle_bus)
{
    RIG *r = rig_new(3);
    const cw_frame frame = rig_frame(0x100, 0, 0), own = rig_frame(0x200, 0, 0);
    cw_rule *rule = raw_bits(r, &extended, 0);
    rule->trigger = CW_TRIGGER_ARMED;
    rule->manual = true;
    rig_start(r);
    rig_send(r, 0, &frame, 0);
    rig_run_bits(r, JOIN + 20);
    for (unsigned i = 0; i < 2; i++) {
        assert_int_equal(cw_bus_fire_rule(r->bus, 0), CW_OK);
        rig_run_bits(r, JOIN + 25 + 5 * i);
    }
    rig_send(r, 2, &own, 0);
    rig_run_bits(r, 500);
    const unsigned begin = JOIN + cw_frame_wire_bits(&frame) + 3;
    assert_int_equal(rig_nth(r, CW_EVENT_RX, 1)->tick, tx_end(begin, 0) - BIT);
    assert_int_equal(rig_count(r, CW_EVENT_RX, 0), 2);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->tick,
                     tx_end(begin, 0) + (JOIN + cw_frame_wire_bits(&own)) * BIT);
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, 0, &stats), CW_OK);
    assert_int_equal(stats.hits, 2);
    assert_false(stats.active);
}
