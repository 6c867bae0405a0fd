/* SPDX-License-Identifier: MIT
 *
 * test_protect.c - counters and checksums in data: the known answers of AUTOSAR's specification,
 * places and limits, faults, and a counter that goes on at a reload.
 */
#include "cases.h"
#include "rules.h"

#define P1(first, second, by_counter, length)                                                      \
    {                                                                                              \
        .kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .id_first = true, .id_length = (length),     \
        .id_by_counter = (by_counter), .id = {first, second}                                       \
    }
#define H2F(...)                                                                                   \
    {                                                                                              \
        .kind = CW_CHECKSUM_CRC8, .polynomial = 0x2F, .start = 0xFF, .inverted = 0xFF,             \
        __VA_ARGS__                                                                                \
    }
#define LIST                                                                                       \
    .id_by_counter = true, .id_length = 16,                                                        \
    .id = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}
#define NIBBLE                                                                                     \
    {                                                                                              \
        .bit = 12, .bits = 4, .max = 14                                                            \
    }

/* ---- Known answers --------------------------------------------------------------------------- */

typedef struct answer {
    const char *name;
    cw_protection by;
    uint8_t length;
    uint8_t data1; /* before: of the Data ID's nibble */
    uint32_t counter;
    uint8_t at; /* of the bytes that are compared */
    uint8_t bytes[3];
} answer;

/* The examples of AUTOSAR_PRS_E2EProtocol: Data ID 0x123 (profile 5: 0x1234), all data 0. The
 * checksums of CRC catalogues are over "123456789". */
static const answer answers[] = {
    {"1A", {.counter = NIBBLE, .checksum = P1(0x23, 0x01, false, 2)}, 8, 0, 0, 0, {0xCC, 0x00}},
    {"1A", {.counter = NIBBLE, .checksum = P1(0x23, 0x01, false, 2)}, 8, 0, 1, 0, {0x91, 0x01}},
    {"1B", {.counter = NIBBLE, .checksum = P1(0x23, 0x01, true, 2)}, 8, 0, 0, 0, {0xCE, 0x00}},
    {"1B", {.counter = NIBBLE, .checksum = P1(0x23, 0x01, true, 2)}, 8, 0, 1, 0, {0x02, 0x01}},
    {"1C", {.counter = NIBBLE, .checksum = P1(0x23, 0, false, 2)}, 8, 0x10, 0, 0, {0x2A, 0x10}},
    {"1C", {.counter = NIBBLE, .checksum = P1(0x23, 0, false, 2)}, 8, 0x10, 1, 0, {0x77, 0x11}},
    {"2", {.counter = NIBBLE, .checksum = H2F(LIST)}, 8, 0, 1, 0, {0x1B, 0x01}},
    {"2", {.counter = NIBBLE, .checksum = H2F(LIST)}, 8, 0, 15, 0, {0xCD, 0x0F}},
    {"22", {.counter = {.bit = 76, .bits = 4}, .checksum = H2F(LIST, .at = 8)}, 16, 0, 1, 8,
     {0x14, 0x01}},
    {"5",
     {.counter = {.bit = 16, .bits = 8},
      .checksum = {.kind = CW_CHECKSUM_CRC16, .polynomial = 0x1021, .start = 0xFFFF,
                   .id_length = 2, .id = {0x34, 0x12}}},
     8, 0, 0, 0, {0x1C, 0xCA, 0x00}},
    {"5, behind 8 bytes",
     {.counter = {.bit = 80, .bits = 8},
      .checksum = {.kind = CW_CHECKSUM_CRC16, .at = 8, .polynomial = 0x1021, .start = 0xFFFF,
                   .id_length = 2, .id = {0x34, 0x12}}},
     16, 0, 0, 8, {0x28, 0x91, 0x00}},
};

TEST(the_examples_of_autosar_come_out)
{
    for (size_t i = 0; i < sizeof answers / sizeof answers[0]; i++) {
        const answer *a = &answers[i];
        cw_frame frame = {.flags = CW_FRAME_FD, .dlc = (uint8_t)cw_fd_dlc(a->length)};
        frame.data[1] = a->data1;
        cw_protection_write(&a->by, &frame, a->counter);
        const unsigned bytes = a->by.checksum.kind == CW_CHECKSUM_CRC16 ? 3 : 2;
        if (memcmp(&frame.data[a->at], a->bytes, bytes) != 0)
            fail_msg("profile %s: %02X %02X %02X", a->name, frame.data[a->at],
                     frame.data[a->at + 1], frame.data[a->at + 2]);
    }
}

/* Returns the checksum of the bytes "1234567" at byte 0 of a frame, behind or before which its Data
 * ID has two more. */
static unsigned check_value(cw_checksum checksum, const char *text, uint8_t first, uint8_t second)
{
    cw_frame frame = {.dlc = 8};
    checksum.id_length = 2;
    checksum.id[0] = first;
    checksum.id[1] = second;
    memcpy(&frame.data[1], text, 7);
    cw_protection_write(&(cw_protection){.checksum = checksum}, &frame, 0);
    return frame.data[0];
}

/* Of "123456789", as in the catalogues of CRCs. */
TEST(plain_checksums_are_what_they_say)
{
    const cw_checksum j1850 = {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .start = 0xFF,
                               .inverted = 0xFF};
    const cw_checksum before = {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .start = 0xFF,
                                .inverted = 0xFF, .id_first = true};
    const cw_checksum h2f = H2F(.at = 0);
    const cw_checksum plain = {.kind = CW_CHECKSUM_XOR}, sum = {.kind = CW_CHECKSUM_SUM};
    assert_int_equal(check_value(j1850, "1234567", '8', '9'), 0x4B);
    assert_int_equal(check_value(before, "3456789", '1', '2'), 0x4B);
    assert_int_equal(check_value(h2f, "1234567", '8', '9'), 0xDF);
    assert_int_equal(check_value(plain, "1234567", '8', '9'), 0x31);
    assert_int_equal(check_value(sum, "1234567", '8', '9'), 0xDD);
}

/* ---- Places ---------------------------------------------------------------------------------- */

TEST(a_counter_may_lie_across_bytes)
{
    const cw_protection p = {.counter = {.bit = 6, .bits = 12, .max = 0xFFF}};
    cw_frame frame = {.dlc = 3, .data = {0xFF, 0x00, 0xFF}};
    assert_true(cw_protection_fits(&p, &frame));
    cw_protection_write(&p, &frame, 0xA55);
    assert_memory_equal(frame.data, "\xFE\x95\x7F", 3);
    frame.dlc = 2;
    assert_false(cw_protection_fits(&p, &frame));
}

TEST(a_bus_refuses_what_makes_no_sense)
{
    static const cw_protection bad[] = {
        {.node = 2},
        {.id = CW_FILTER_REMOTE | 1},
        {.counter = {.bits = 33}},
        {.counter = {.bits = 4, .max = 16}},
        {.counter = {.bits = 4, .max = 14, .start = 15}},
        {.counter = {.bit = 509, .bits = 4, .max = 1}},
        {.checksum = {.kind = CW_CHECKSUM_COUNT}},
        {.checksum = {.kind = CW_CHECKSUM_XOR, .at = 64}},
        {.checksum = {.kind = CW_CHECKSUM_CRC16, .at = 63}},
        {.checksum = {.kind = CW_CHECKSUM_XOR, .id_length = 17}},
    };
    RIG *r = rig_new(2);
    r->config.protection_count = 1;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        r->config.protections = &bad[i];
        assert_int_equal(cw_bus_size(&r->config), 0);
    }
    const cw_protection twice[] = {{.id = 5}, {.id = 5}}, turned[] = {{.node = 1}, {.node = 0}};
    r->config.protection_count = 2;
    r->config.protections = twice;
    assert_int_equal(cw_bus_size(&r->config), 0);
    r->config.protections = turned;
    assert_int_equal(cw_bus_size(&r->config), 0);
}

/* ---- On a bus -------------------------------------------------------------------------------- */

static const cw_protection counted = {.node = 0, .id = 0x123,
                                      .counter = {.bit = 0, .bits = 8, .max = 4, .start = 1}};

static rig *counting(void)
{
    rig *r = rig_new(2);
    r->config.protections = &counted;
    r->config.protection_count = 1;
    return r;
}

/* Sends some frames and compares the first bytes of all that were sent. */
static void check_sent(rig *r, const char *expected)
{
    const size_t sent = rig_count(r, CW_EVENT_TX, -1);
    assert_int_equal(sent, strlen(expected));
    for (size_t i = 0; i < sent; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, i)->frame.data[0], expected[i] - '0');
}

TEST(frames_of_the_host_are_counted_and_no_others)
{
    RIG *r = counting();
    const cw_frame frame = rig_frame(0x123, 0, 2), empty = rig_frame(0x123, 0, 0);
    cw_frame other = rig_frame(0x124, 0, 1), theirs = frame;
    other.data[0] = 9;
    theirs.data[0] = 8;
    cw_rule rule = new_rule("rule", CW_TRIGGER_TIME, CW_ACTION_SEND);
    rule.frame = theirs;
    rule.time_begin = 900 * BIT;
    rig_rule(r, rule);
    rig_start(r);
    rig_send(r, 0, &frame, 11 * BIT);
    rig_send(r, 0, &empty, 100 * BIT); /* it has no place: not counted */
    rig_send(r, 0, &frame, 300 * BIT);
    rig_send(r, 0, &other, 500 * BIT);
    rig_send(r, 1, &theirs, 700 * BIT);
    for (unsigned i = 0; i < 4; i++)
        rig_send(r, 0, &frame, (1100 + 200 * i) * BIT);
    rig_run_bits(r, 2000);
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 1)->frame.dlc, 0);
    rig_nth(r, CW_EVENT_TX, 1); /* its data are none */
    assert_int_equal(rig_nth(r, CW_EVENT_TX, 0)->frame.data[0], 1);
    static const uint8_t rest[] = {2, 9, 8, 8, 3, 4, 0, 1};
    for (unsigned i = 0; i < sizeof rest; i++)
        assert_int_equal(rig_nth(r, CW_EVENT_TX, 2 + i)->frame.data[0], rest[i]);
}

static void check_faults(cw_counter_fault fault, const char *expected)
{
    RIG *r = counting();
    const cw_frame frame = rig_frame(0x123, 0, 2);
    cw_rule *rule = ADD_RULE(r, "fault", FRAME, COUNTER, .number = fault);
    rule->every = 3; /* frames 1, 4, 7 */
    rig_start(r);
    for (unsigned i = 0; i < 7; i++)
        rig_send(r, 0, &frame, (11 + 200 * i) * BIT);
    rig_run_bits(r, 2000);
    assert_int_equal(hits(r, 0), 3);
    check_sent(r, expected);
}

/* The counter goes 1 2 3 4 0 1 2. The first frame has none before it. */
TEST(faults_change_the_counter)
{
    check_faults(CW_COUNTER_STUCK, "1122344");
    check_faults(CW_COUNTER_SKIP, "2341230");
    check_faults(CW_COUNTER_REPEAT, "1233011");
}

/* The rule would have hit the frame of another identifier before. */
TEST(frames_without_a_counter_are_no_matches)
{
    RIG *r = counting();
    const cw_frame frame = rig_frame(0x123, 0, 2), other = rig_frame(0x124, 0, 2);
    ADD_RULE(r, "counter", FRAME, COUNTER);
    ADD_RULE(r, "checksum", FRAME, CHECKSUM);
    rig_start(r);
    rig_send(r, 0, &other, 11 * BIT);
    rig_send(r, 0, &frame, 200 * BIT);
    rig_run_bits(r, 500);
    assert_int_equal(rule_stats(r, 0).matches, 1);
    assert_int_equal(rule_stats(r, 1).matches, 0);
    cw_rule received = new_rule("rx", CW_TRIGGER_FRAME, CW_ACTION_CHECKSUM);
    received.side = CW_SIDE_RX;
    unsigned index;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &received), CW_INVALID);
}

/* ---- Reload ---------------------------------------------------------------------------------- */

static void check_take_over_of(const cw_protection *before, uint8_t from, uint32_t max,
                               unsigned expected)
{
    RIG *old = counting(), *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 2);
    uint8_t nodes[CW_NODES_MAX];
    cw_protection again = counted;
    memset(nodes, CW_NO_NODE, sizeof nodes);
    nodes[0] = from;
    again.counter.max = max;
    old->config.protections = before;
    old->config.protection_count = before ? 1 : 0;
    r->config.protections = &again;
    r->config.protection_count = 1;
    rig_start(old);
    rig_start(r);
    rig_send(old, 0, &frame, 11 * BIT);
    rig_send(old, 0, &frame, 200 * BIT);
    rig_run_bits(old, 500);
    assert_int_equal(cw_bus_take_over(r->bus, old->bus, nodes), CW_OK);
    rig_send(r, 0, &frame, 600 * BIT);
    rig_run_bits(r, 1000);
    check_sent(r, (char[]){(char)('0' + expected), '\0'});
}

static void check_take_over(uint8_t from, uint32_t max, unsigned expected)
{
    check_take_over_of(&counted, from, max, expected);
}

/* A checksum has no counter that could go on. */
TEST(a_counter_that_joins_a_checksum_begins_at_its_start)
{
    cw_protection before = counted;
    before.counter = (cw_counter){.bits = 0};
    before.checksum = (cw_checksum){.kind = CW_CHECKSUM_XOR, .at = 1};
    check_take_over_of(&before, 0, 4, 1);
    before = counted;
    before.counter.bit = 8;
    check_take_over_of(&before, 0, 4, 1);
}

TEST(counters_go_on_on_another_bus)
{
    check_take_over(0, 4, 3);
    check_take_over(CW_NO_NODE, 4, 1); /* another node */
    check_take_over_of(NULL, 0, 4, 1); /* the old bus had none at all */
    check_take_over(0, 2, 1);          /* it knows no 3 */
}
