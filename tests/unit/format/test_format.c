/* SPDX-License-Identifier: MIT
 *
 * test_format.c - frames to wire bits and back (F1..F8), against a model of its own.
 */
#include "bitwise.h"
#include "format/bits.h"
#include "format/head.h"
#include "model.h"
#include "rig.h"

#define FRAMES 20000
#define BITWISE_FRAMES 300000
#define FLIP_FRAMES 300
#define SEED UINT64_C(0x1234567)

/* ---- Encoding -------------------------------------------------------------------------------- */

static void bits_to_text(char *text, const cw_bits *bits)
{
    for (unsigned n = 0; n < bits->length; n++)
        text[n] = cw_bits_level(bits, n) ? '1' : '0';
    text[bits->length] = '\0';
}

TEST(random_frames_encode_as_the_model_does)
{
    rig_random random = {SEED};
    for (unsigned i = 0; i < FRAMES; i++) {
        char text[MODEL_BITS_MAX];
        cw_bits bits;
        cw_frame f = rig_random_frame(&random);
        model m = model_encode(&f);
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        bits_to_text(text, &bits);
        assert_string_equal(text, m.wire);
        assert_int_equal(bits.crc, strtoul(m.plain + strlen(m.plain) - 15, NULL, 2));
    }
}

#define CLASSICAL_WORDS 3u /* of levels */
#define CLASSICAL_BITS 157u

/* ---- Encoding against one that goes bit by bit ----------------------------------------------- */

/* Checks what is found without the bits: their number, and the last edge before the ACK slot. */
static void check_measured(const cw_frame *f, const cw_bits *expected)
{
    unsigned n = expected->length - CW_TAIL_BITS - 1, length;
    while (cw_bits_level(expected, n) || !cw_bits_level(expected, n - 1))
        n--;
    assert_int_equal(cw_frame_wire_bits(f), expected->length);
    assert_int_equal(cw_bits_last_edge(f, &length), n);
    assert_int_equal(length, expected->length);
}

/* Compares all parts of cw_bits, including bytes behind the last bit. */
static void check_bitwise(const cw_frame *f, uint16_t inverted)
{
    cw_bits bits;
    uint64_t stuff[CW_BIT_WORDS] = {0};
    cw_bits expected = bitwise_encode(f, inverted, stuff);
    memset(&bits, 0xA5, sizeof bits);
    assert_int_equal(cw_bits_encode_crc(&bits, f, inverted), CW_OK);
    assert_memory_equal(bits.level, expected.level, CLASSICAL_WORDS * sizeof bits.level[0]);
    const cw_stuffing stuffing = cw_bits_stuffing(&bits);
    assert_memory_equal(stuffing.set, stuff, stuffing.words * sizeof stuff[0]);
    assert_int_equal(bits.crc, expected.crc);
    assert_int_equal(bits.length, expected.length);
    if (!inverted)
        check_measured(f, &expected);
    assert_int_equal(bits.bytes, expected.bytes);
    assert_int_equal(bits.format, expected.format);
}

/* Bytes behind the data field must not count. */
TEST(random_frames_encode_as_bit_by_bit)
{
    rig_random random = {SEED + 7};
    for (unsigned i = 0; i < BITWISE_FRAMES; i++) {
        cw_frame f = rig_random_frame(&random);
        for (unsigned byte = cw_frame_length(&f); byte < CW_FRAME_DATA_MAX; byte++)
            f.data[byte] = (uint8_t)rig_runs(&random);
        check_bitwise(&f, 0);
        check_bitwise(&f, (uint16_t)rig_below(&random, 0x8000));
    }
}

/* Rows of equal bits from each bit of the frame on, of each length and level. */
TEST(rows_of_equal_bits_encode_as_bit_by_bit)
{
    static const uint64_t around[] = {0, UINT64_MAX, UINT64_C(0x5555555555555555)};
    for (unsigned i = 0; i < 3 * 4 * 9 * 64 * 2; i++) {
        unsigned from = i % 64, length = i / 64 % 9, kind = i / 576 % 4, level = i / 2304 % 2;
        uint64_t row = UINT64_MAX >> from;
        cw_frame f = {.flags = (uint8_t)kind, .dlc = (uint8_t)length};
        for (unsigned bits = 1; bits <= 64 - from; bits++) {
            uint64_t ones = row & ~(bits + from < 64 ? UINT64_MAX >> (from + bits) : 0);
            uint64_t data = level ? around[i / 4608] | ones : around[i / 4608] & ~ones;
            f.id = (uint32_t)data & (kind & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu);
            for (unsigned byte = 0; byte < 8; byte++)
                f.data[byte] = (uint8_t)(data >> (56 - 8 * byte));
            check_bitwise(&f, 0);
        }
    }
}

TEST(every_base_identifier_encodes_as_bit_by_bit)
{
    for (unsigned i = 0; i < 0x800 * 16 * 2; i++) {
        cw_frame f = {.id = i % 0x800, .dlc = (uint8_t)(i / 0x800 % 16)};
        f.flags = i / 0x8000 ? CW_FRAME_REMOTE : 0;
        check_bitwise(&f, 0);
    }
}

TEST(every_dlc_of_every_format_encodes_as_bit_by_bit)
{
    rig_random random = {SEED + 8};
    for (unsigned i = 0; i < 4 * 16 * 1000; i++) {
        cw_frame f = {.flags = (uint8_t)(i % 4), .dlc = (uint8_t)(i / 4 % 16)};
        f.id = rig_runs(&random) & (f.flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu);
        for (unsigned byte = 0; byte < CW_FRAME_DATA_MAX; byte++)
            f.data[byte] = (uint8_t)rig_runs(&random);
        check_bitwise(&f, 0);
    }
}

/* Among them CRCs that end in five equal bits, with a stuff bit before the delimiter (F7). */
TEST(every_crc_encodes_as_bit_by_bit)
{
    unsigned stuffed_ends = 0;
    for (unsigned inverted = 0; inverted < 0x8000; inverted++) {
        cw_bits bits;
        const cw_frame f = rig_frame(0x123, inverted & 1u ? CW_FRAME_EXTENDED : 0, 2);
        check_bitwise(&f, (uint16_t)inverted);
        assert_int_equal(cw_bits_encode_crc(&bits, &f, (uint16_t)inverted), CW_OK);
        stuffed_ends += cw_bits_place(&bits, bits.length - MODEL_TAIL_BITS - 1u).stuff;
    }
    assert_in_range(stuffed_ends, 1000, 4000);
}

/* ---- The table of parts ---------------------------------------------------------------------- */

TEST(parts_follow_in_the_order_of_the_wire)
{
    for (unsigned part = 0; part < CW_PART_COUNT; part++)
        for (unsigned level = 0; level < 2; level++)
            assert_in_range(cw_parts[part].next[level], part + 1, CW_PART_END);
}

/* From the highest bit of the key on, without SOF; what follows RTR or IDE is 0. */
TEST(the_arbitration_key_is_the_arbitration_field)
{
    rig_random random = {SEED + 9};
    for (unsigned i = 0; i < FRAMES; i++) {
        const cw_frame f = rig_random_frame(&random);
        uint32_t key = 0;
        unsigned bits = 0;
        for (cw_walk w = cw_walk_begin(&f); w.part != CW_PART_DLC; cw_walk_on(&w))
            if (cw_part_is(w.part, CW_PART_ARBITRATION))
                key |= (uint32_t)cw_walk_level(&w) << (31 - bits++);
        assert_int_equal(bits, f.flags & CW_FRAME_EXTENDED ? 32 : 13);
        assert_int_equal(cw_arbitration_key(&f), key);
    }
}

/* Returns the number that a controller reports when it loses at this bit of its frame to a dominant
 * level. */
static unsigned lost_bit_at(const cw_frame *frame, unsigned n)
{
    cw_mac mac;
    cw_mac_report report = {.what = 0};
    cw_mac_init(&mac, 0, 96);
    for (unsigned i = 0; i < 11; i++) {
        (void)cw_mac_drive(&mac);
        cw_mac_sample(&mac, CW_RECESSIVE, &report);
    }
    assert_int_equal(cw_mac_offer(&mac, frame), CW_OK);
    for (unsigned i = 0; i <= n; i++) {
        bool own = cw_mac_drive(&mac);
        cw_mac_sample(&mac, i < n ? own : CW_DOMINANT, &report);
    }
    assert_true(report.what & CW_REPORT_ARBITRATION_LOST);
    return report.lost_bit;
}

/* At recessive bits of the arbitration field, wherever stuff bits are. */
TEST(lost_bits_are_numbered_as_the_sja1000_does)
{
    rig_random random = {SEED + 10};
    for (unsigned i = 0; i < 500; i++) {
        const cw_frame f = rig_random_frame(&random);
        const bool extended = f.flags & CW_FRAME_EXTENDED;
        cw_bits bits;
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        for (unsigned n = 1, number = 0; number < (extended ? 32u : 12u); n++) {
            if (cw_bits_place(&bits, n).stuff)
                continue;
            if (cw_bits_level(&bits, n) == CW_RECESSIVE)
                assert_int_equal(lost_bit_at(&f, n), number);
            number++;
        }
    }
}

TEST(fields_are_as_long_as_positions_say)
{
    static const uint8_t bits[CW_FIELD_COUNT] = {
        [CW_FIELD_SOF] = 1,           [CW_FIELD_ID] = 29,
        [CW_FIELD_SRR] = 1,           [CW_FIELD_IDE] = 1,
        [CW_FIELD_RTR] = 1,           [CW_FIELD_R1] = 1,
        [CW_FIELD_R0] = 1,            [CW_FIELD_DLC] = 4,
        [CW_FIELD_DATA] = 64,         [CW_FIELD_CRC] = 15,
        [CW_FIELD_CRC_DELIMITER] = 1, [CW_FIELD_ACK_SLOT] = 1,
        [CW_FIELD_ACK_DELIMITER] = 1, [CW_FIELD_EOF] = MODEL_EOF_BITS,
        [CW_FIELD_INTERMISSION] = 3,  [CW_FIELD_SUSPEND] = 8,
    };
    for (unsigned field = 0; field < CW_FIELD_COUNT; field++)
        assert_int_equal(cw_field_bits((cw_field)field, false), bits[field]);
}

/* F7, counting stuff bits as equal bits. */
TEST(never_more_than_five_equal_bits_up_to_the_crc)
{
    rig_random random = {SEED + 1};
    for (unsigned i = 0; i < FRAMES; i++) {
        cw_bits bits;
        cw_frame f = rig_random_frame(&random);
        unsigned run = 0;
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        for (unsigned n = 0; n < bits.length - MODEL_TAIL_BITS; n++) {
            bool same = n > 0 && cw_bits_level(&bits, n) == cw_bits_level(&bits, n - 1);
            run = same ? run + 1 : 1;
            assert_in_range(run, 1, 5);
        }
    }
}

/* Counts the stuff bits of a sequence of bits, without writing it down. */
static unsigned count_stuff_bits(const char *plain)
{
    unsigned stuff = 0;
    unsigned run = 0;
    char last = 'x';
    for (; *plain; plain++) {
        run = *plain == last ? run + 1 : 1;
        last = *plain;
        if (run == 5) {
            stuff++;
            run = 1;
            last = last == '1' ? '0' : '1';
        }
    }
    return stuff;
}

TEST(length_is_the_closed_formula)
{
    rig_random random = {SEED + 2};
    for (unsigned i = 0; i < FRAMES; i++) {
        cw_bits bits;
        cw_frame f = rig_random_frame(&random);
        unsigned bytes = f.flags & CW_FRAME_REMOTE ? 0 : f.dlc < 8 ? f.dlc : 8u;
        unsigned fixed = f.flags & CW_FRAME_EXTENDED ? 64 : 44;
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        assert_int_equal(bits.length,
                         fixed + 8 * bytes + count_stuff_bits(model_encode(&f).plain));
        assert_in_range(bits.length, 44, 157);
    }
}

/* ---- Places ---------------------------------------------------------------------------------- */

typedef struct field_run {
    cw_field field;
    unsigned first;
    unsigned bits;
} field_run;

static const field_run base_head[] = {
    {CW_FIELD_SOF, 0, 1}, {CW_FIELD_ID, 0, 11}, {CW_FIELD_RTR, 0, 1}, {CW_FIELD_IDE, 0, 1},
    {CW_FIELD_R0, 0, 1},  {CW_FIELD_DLC, 0, 4},
};
static const field_run extended_head[] = {
    {CW_FIELD_SOF, 0, 1}, {CW_FIELD_ID, 0, 11},  {CW_FIELD_SRR, 0, 1},
    {CW_FIELD_IDE, 0, 1}, {CW_FIELD_ID, 11, 18}, {CW_FIELD_RTR, 0, 1},
    {CW_FIELD_R1, 0, 1},  {CW_FIELD_R0, 0, 1},   {CW_FIELD_DLC, 0, 4},
};
static const field_run tail[] = {
    {CW_FIELD_CRC_DELIMITER, 0, 1},
    {CW_FIELD_ACK_SLOT, 0, 1},
    {CW_FIELD_ACK_DELIMITER, 0, 1},
    {CW_FIELD_EOF, 0, 7},
};

static void assert_found(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    unsigned found;
    assert_true(cw_bits_find(bits, &found, field, index));
    assert_int_equal(found, n);
    assert_true(cw_bits_find(bits, &found, CW_FIELD_BIT, n));
    assert_int_equal(found, n);
}

/* Positions that are none of the frame's bits are not found. */
static void assert_no_more_found(const cw_bits *bits)
{
    unsigned there[CW_FIELD_COUNT] = {[CW_FIELD_BIT] = bits->length};
    unsigned found;
    for (unsigned n = 0; n < bits->length; n++) {
        cw_place place = cw_bits_place(bits, n);
        there[place.stuff ? CW_FIELD_STUFF : place.field]++;
    }
    for (unsigned field = CW_FIELD_SOF; field < CW_FIELD_COUNT; field++)
        for (unsigned index = there[field]; index < 2 * CLASSICAL_BITS; index++)
            assert_false(cw_bits_find(bits, &found, (cw_field)field, index));
}

/* Checks one field from wire bit n on; returns the bit behind it. stuff counts stuff bits. */
static unsigned check_field(const cw_bits *bits, unsigned n, field_run run, unsigned *stuff)
{
    for (unsigned i = 0; i < run.bits; i++) {
        cw_place place = cw_bits_place(bits, n);
        assert_int_equal(place.field, run.field);
        assert_int_equal(place.index, run.first + i);
        assert_false(place.stuff);
        assert_true(cw_bits_is_at(bits, n, run.field, run.first + i));
        assert_true(cw_bits_is_at(bits, n, CW_FIELD_BIT, n));
        assert_found(bits, n, run.field, run.first + i);
        n++;
        if (n == bits->length || !(cw_bits_place(bits, n).stuff))
            continue;
        place = cw_bits_place(bits, n);
        assert_int_equal(place.field, run.field);
        assert_int_equal(place.index, run.first + i);
        assert_false(cw_bits_is_at(bits, n, run.field, run.first + i));
        assert_found(bits, n, CW_FIELD_STUFF, *stuff);
        assert_true(cw_bits_is_at(bits, n, CW_FIELD_STUFF, (*stuff)++));
        assert_true(cw_bits_is_at(bits, n, CW_FIELD_BIT, n));
        n++;
    }
    return n;
}

static unsigned check_fields(const cw_bits *bits, unsigned n, const field_run *runs, size_t count,
                             unsigned *stuff)
{
    for (size_t i = 0; i < count; i++)
        n = check_field(bits, n, runs[i], stuff);
    return n;
}

TEST(every_bit_has_its_place)
{
    rig_random random = {SEED + 3};
    for (unsigned i = 0; i < FRAMES / 10; i++) {
        cw_bits bits;
        unsigned stuff = 0;
        cw_frame f = rig_random_frame(&random);
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        unsigned n = f.flags & CW_FRAME_EXTENDED
                         ? check_fields(&bits, 0, extended_head, 9, &stuff)
                         : check_fields(&bits, 0, base_head, 6, &stuff);
        field_run data = {CW_FIELD_DATA, 0, 8 * cw_frame_length(&f)};
        n = check_field(&bits, n, data, &stuff);
        n = check_field(&bits, n, (field_run){CW_FIELD_CRC, 0, 15}, &stuff);
        n = check_fields(&bits, n, tail, 4, &stuff);
        assert_int_equal(n, bits.length);
        assert_int_equal(stuff, count_stuff_bits(model_encode(&f).plain));
        assert_no_more_found(&bits);
    }
}

/* ---- Frames ---------------------------------------------------------------------------------- */

typedef struct validity {
    cw_frame frame;
    bool valid;
} validity;

TEST(only_frames_in_range_with_flags_that_go_together_are_encoded)
{
    static const validity cases[] = {
        {{.id = 0}, true}, /* F8: no identifier is special */
        {{.id = 0x7FF}, true},
        {{.id = 0x7F0}, true},
        {{.id = 0x800}, false},
        {{.id = 0x1FFFFFFF, .flags = CW_FRAME_EXTENDED}, true},
        {{.id = 0x20000000, .flags = CW_FRAME_EXTENDED}, false},
        {{.id = 1, .dlc = 15}, true},
        {{.id = 1, .dlc = 16}, false},
        {{.id = 1, .flags = CW_FRAME_FD}, true},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI, .dlc = 15}, true},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_NON_ISO | CW_FRAME_EXTENDED}, true},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_REMOTE}, false},
        {{.id = 1, .flags = CW_FRAME_FD | CW_FRAME_CUT}, false},
        {{.id = 1, .flags = CW_FRAME_FD, .dlc = 16}, false},
        {{.id = 0x800, .flags = CW_FRAME_FD}, false},
        {{.id = 1, .flags = CW_FRAME_BRS}, false},
        {{.id = 1, .flags = CW_FRAME_ESI}, false},
        {{.id = 1, .flags = CW_FRAME_NON_ISO}, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        cw_bits bits;
        memset(&bits, 0xA5, sizeof bits);
        cw_bits before = bits;
        assert_int_equal(cw_frame_valid(&cases[i].frame), cases[i].valid);
        assert_int_equal(cw_bits_encode(&bits, &cases[i].frame),
                         cases[i].valid ? CW_OK : CW_INVALID);
        assert_int_equal(cw_frame_wire_bits(&cases[i].frame), cases[i].valid ? bits.length : 0);
        if (!cases[i].valid)
            assert_memory_equal(&bits, &before, sizeof bits);
    }
}

TEST(length_follows_dlc_but_not_in_remote_frames)
{
    for (unsigned dlc = 0; dlc <= 15; dlc++) {
        cw_frame data = {.dlc = (uint8_t)dlc};
        cw_frame remote = {.dlc = (uint8_t)dlc, .flags = CW_FRAME_REMOTE};
        assert_int_equal(cw_frame_length(&data), dlc < 8 ? dlc : 8); /* F4 */
        assert_int_equal(cw_frame_length(&remote), 0);               /* F3 */
    }
}

TEST(frames_are_equal_as_they_are_on_the_wire)
{
    cw_frame a = rig_frame(0x123, 0, 3);
    cw_frame b = a;
    b.data[3] = 0xFF; /* behind the data field */
    assert_true(cw_frame_equal(&a, &b));
    b.data[2] ^= 1;
    assert_false(cw_frame_equal(&a, &b));
    cw_frame eight = rig_frame(0x123, 0, 8);
    cw_frame nine = eight;
    nine.dlc = 9;
    assert_false(cw_frame_equal(&eight, &nine));
    cw_frame remote = {.id = 0x123, .flags = CW_FRAME_REMOTE};
    cw_frame empty = {.id = 0x123};
    cw_frame extended = {.id = 0x123, .flags = CW_FRAME_EXTENDED};
    assert_false(cw_frame_equal(&remote, &empty));
    assert_false(cw_frame_equal(&extended, &empty));
}

/* ---- Decoding by a controller ---------------------------------------------------------------- */

static void integrate(cw_mac *mac)
{
    cw_mac_report report;
    cw_mac_init(mac, 0, 96);
    for (unsigned i = 0; i < JOIN; i++) {
        assert_true(cw_mac_drive(mac));
        cw_mac_sample(mac, CW_RECESSIVE, &report);
    }
    assert_int_equal(cw_mac_get_phase(mac), CW_MAC_IDLE);
}

/* Feeds a frame to a receiver. Returns whether it took it; it must acknowledge exactly then. */
static bool receive(cw_mac *mac, const char *wire)
{
    cw_mac_report report;
    bool taken = false;
    size_t length = strlen(wire);
    for (size_t n = 0; n < length; n++) {
        bool own = cw_mac_drive(mac);
        bool slot = n == length - 2 - MODEL_EOF_BITS;
        cw_mac_sample(mac, own && wire[n] == '1', &report);
        if (report.what & CW_REPORT_ERROR)
            return false;
        assert_int_equal(own, !slot); /* M5 */
        assert_int_equal((report.what & CW_REPORT_RX) != 0, n == length - 2); /* M7 */
        taken = taken || (report.what & CW_REPORT_RX);
    }
    return taken;
}

TEST(decoding_what_was_encoded_gives_the_same_frame)
{
    rig_random random = {SEED + 4};
    cw_mac mac;
    integrate(&mac);
    for (unsigned i = 0; i < FRAMES; i++) {
        cw_mac_report report;
        char text[MODEL_BITS_MAX];
        cw_bits bits;
        cw_frame f = rig_random_frame(&random);
        assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
        bits_to_text(text, &bits);
        assert_true(receive(&mac, text));
        assert_true(cw_frame_equal(cw_mac_received(&mac), &f));
        for (unsigned n = 0; n < 3; n++) {
            assert_true(cw_mac_drive(&mac));
            cw_mac_sample(&mac, CW_RECESSIVE, &report);
            assert_int_equal(report.what, 0);
        }
    }
}

/* F5: SRR dominant, r0 and r1 recessive, in all combinations; CRC and stuffing by these levels. */
TEST(receivers_take_srr_and_reserved_bits_at_either_level)
{
    rig_random random = {SEED + 5};
    for (unsigned i = 0; i < 2000; i++) {
        const model_levels levels = {.srr = i & 1u ? '0' : '1',
                                     .r1 = i & 2u ? '1' : '0',
                                     .r0 = i & 4u ? '1' : '0'};
        cw_mac mac;
        cw_frame f = rig_random_frame(&random);
        model m = model_encode_as(&f, levels);
        integrate(&mac);
        assert_true(receive(&mac, m.wire));
        assert_true(cw_frame_equal(cw_mac_received(&mac), &f));
    }
}

/* Checks one wrong bit between SOF and the ACK slot: no frame is taken, whatever stuffing makes of
 * it. */
static bool takes_anything(cw_mac *mac, const char *wire)
{
    cw_mac_report report;
    for (; *wire; wire++) {
        bool own = cw_mac_drive(mac);
        cw_mac_sample(mac, own && *wire == '1', &report);
        if (report.what & (CW_REPORT_RX | CW_REPORT_ERROR))
            return report.what & CW_REPORT_RX;
    }
    return false;
}

TEST(one_wrong_bit_is_always_found)
{
    rig_random random = {SEED + 6};
    for (unsigned i = 0; i < FLIP_FRAMES; i++) {
        cw_frame f = rig_random_frame(&random);
        model m = model_encode(&f);
        for (unsigned n = 1; n < m.stuffed + 1; n++) {
            cw_mac mac;
            m.wire[n] ^= 1;
            integrate(&mac);
            assert_false(takes_anything(&mac, m.wire));
            m.wire[n] ^= 1;
        }
    }
}

/* ---- Names ----------------------------------------------------------------------------------- */

TEST(fields_are_named_as_in_fault_rules)
{
    static const char *const names[CW_FIELD_COUNT] = {
        [CW_FIELD_SOF] = "sof", [CW_FIELD_ID] = "id", [CW_FIELD_SRR] = "srr",
        [CW_FIELD_IDE] = "ide", [CW_FIELD_RTR] = "rtr", [CW_FIELD_R1] = "r1",
        [CW_FIELD_R0] = "r0", [CW_FIELD_FDF] = "fdf", [CW_FIELD_RES] = "res",
        [CW_FIELD_BRS] = "brs", [CW_FIELD_ESI] = "esi",
        [CW_FIELD_STUFF_COUNT] = "stuff-count", [CW_FIELD_FIXED_STUFF] = "fixed-stuff",
        [CW_FIELD_DLC] = "dlc", [CW_FIELD_DATA] = "data",
        [CW_FIELD_CRC] = "crc", [CW_FIELD_CRC_DELIMITER] = "crc-delimiter",
        [CW_FIELD_ACK_SLOT] = "ack-slot", [CW_FIELD_ACK_DELIMITER] = "ack-delimiter",
        [CW_FIELD_EOF] = "eof", [CW_FIELD_INTERMISSION] = "intermission",
        [CW_FIELD_SUSPEND] = "suspend", [CW_FIELD_ERROR_FLAG] = "error-flag",
        [CW_FIELD_ERROR_DELIMITER] = "error-delimiter",
        [CW_FIELD_OVERLOAD_FLAG] = "overload-flag",
        [CW_FIELD_OVERLOAD_DELIMITER] = "overload-delimiter",
        [CW_FIELD_STUFF] = "stuff", [CW_FIELD_BIT] = "bit",
    };
    for (unsigned i = CW_FIELD_SOF; i < CW_FIELD_COUNT; i++)
        assert_string_equal(cw_field_name((cw_field)i), names[i]);
}
