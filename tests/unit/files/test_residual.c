/* SPDX-License-Identifier: MIT
 *
 * test_residual.c - errors that nobody finds: what the CRC of a classical frame promises for
 * bursts, and identifiers without stuff bits.
 */

#include "cases.h"
#include "canwire.h"
#include "record/residual.h"

#define CRC_BURST 15u /* bits of the CRC: each burst up to that length is found */
#define AFTER_CRC 10u /* CRC delimiter, ACK slot and delimiter, EOF */
#define WIRE_MAX 160u

typedef struct wire {
    unsigned length;
    bool level[WIRE_MAX];
} wire;

static wire encode(const cw_frame *frame)
{
    cw_bits bits;
    wire w = {.length = 0};
    assert_int_equal(cw_bits_encode(&bits, frame), CW_OK);
    for (; w.length < bits.length; w.length++)
        w.level[w.length] = cw_bits_level(&bits, w.length);
    return w;
}

/* Marks the bits that are stuff bits to a reader of these levels. */
static void mark_stuff(const wire *w, bool stuff[WIRE_MAX])
{
    unsigned run = 1;
    stuff[0] = false;
    for (unsigned n = 1; n < w->length; n++) {
        stuff[n] = run == 5;
        run = !stuff[n] && w->level[n] == w->level[n - 1] ? run + 1 : 1;
    }
}

/* Returns true when the same bits are stuff bits in both, and none of them is in the burst. */
static bool leaves_stuffing_alone(const wire *sent, const wire *seen, unsigned from, unsigned bits)
{
    bool before[WIRE_MAX], after[WIRE_MAX];
    mark_stuff(sent, before);
    mark_stuff(seen, after);
    for (unsigned n = 1; n < sent->length - AFTER_CRC; n++)
        if (before[n] != after[n] || (before[n] && n >= from && n < from + bits))
            return false;
    return true;
}

/* Returns true when a receiver takes these levels for a frame. It acknowledges it itself. */
static bool is_accepted(const wire *w)
{
    cw_mac mac;
    cw_mac_report report;
    bool accepted = false;
    cw_mac_init(&mac, 0, 96);
    for (unsigned n = 0; n < 11; n++) {
        (void)cw_mac_drive(&mac);
        cw_mac_sample(&mac, CW_RECESSIVE, &report);
    }
    for (unsigned n = 0; n < w->length; n++) {
        const bool own = cw_mac_drive(&mac);
        cw_mac_sample(&mac, own && w->level[n], &report);
        accepted = accepted || (report.what & CW_REPORT_RX);
    }
    return accepted;
}

/* Inverts bits. The lowest bit of the pattern comes first. */
static wire with_burst(const wire *w, unsigned from, uint32_t pattern)
{
    wire seen = *w;
    for (unsigned k = 0; pattern >> k; k++)
        seen.level[from + k] ^= pattern >> k & 1u;
    return seen;
}

static unsigned bits_of(uint32_t pattern)
{
    return 32u - (unsigned)__builtin_clz(pattern);
}

typedef struct tally {
    unsigned clean;   /* bursts that leave the stuffing alone */
    unsigned others;
} tally;

static void try_burst(tally *t, const wire *w, unsigned from, uint32_t pattern)
{
    const wire seen = with_burst(w, from, pattern);
    if (!leaves_stuffing_alone(w, &seen, from, bits_of(pattern))) {
        t->others++;
        return;
    }
    t->clean++;
    assert_false(is_accepted(&seen));
}

/* Tries each burst of up to so many bits at each place behind SOF and before the CRC delimiter. */
static void try_all(tally *t, const cw_frame *frame, unsigned longest)
{
    const wire w = encode(frame);
    assert_true(is_accepted(&w));
    for (unsigned from = 1; from < w.length - AFTER_CRC; from++)
        for (uint32_t pattern = 1; pattern < UINT32_C(1) << longest; pattern += 2)
            if (from + bits_of(pattern) <= w.length - AFTER_CRC)
                try_burst(t, &w, from, pattern);
}

TEST(each_short_burst_is_found)
{
    tally t = {.clean = 0};
    const cw_frame frames[] = {{.id = 0x555, .dlc = 2, .data = {0x55, 0xAA}},
                               {.id = 0x123, .dlc = 3, .data = {0xDE, 0xAD, 0x00}},
                               {.id = 0x2AA, .dlc = 0, .flags = CW_FRAME_REMOTE}};
    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        try_all(&t, &frames[i], 8);
    assert_true(t.clean > 5000 && t.others > 1000);
}

/* Bursts of any length up to that of the CRC, in frames of both formats with any data. */
TEST(each_burst_that_the_crc_covers_is_found)
{
    tally t = {.clean = 0};
    uint64_t draws = 0;
    while (t.clean < 20000) {
        const uint64_t r = cw_random(1, "bursts", draws++), data = cw_random(1, "bursts", draws++);
        const bool extended = r & 1u;
        const uint32_t most = extended ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX;
        cw_frame frame = {.id = (uint32_t)(r >> 8) & most,
                          .flags = extended ? CW_FRAME_EXTENDED : 0, .dlc = r >> 4 & 7};
        for (unsigned k = 0; k < 8; k++)
            frame.data[k] = (uint8_t)(data >> 8 * k);
        const wire w = encode(&frame);
        const uint64_t draw = cw_random(1, "bursts", draws++);
        const unsigned bits = 1 + (unsigned)(draw % CRC_BURST);
        const uint32_t pattern = (uint32_t)(draw >> 8 & ((1u << bits) - 1)) | 1u << (bits - 1) | 1u;
        const unsigned places = w.length - AFTER_CRC - CRC_BURST;
        try_burst(&t, &w, 1 + (unsigned)((draw >> 32) % places), pattern);
    }
}

/* A burst that is a bit longer may be the polynomial of the CRC itself. */
TEST(a_burst_of_sixteen_bits_may_not_be_found)
{
    const cw_frame frame = {.id = 0x555, .dlc = 8,
                            .data = {0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55}};
    const uint32_t polynomial = 0xC599; /* x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 */
    uint32_t first_bit_lowest = 0;
    unsigned accepted = 0;
    for (unsigned k = 0; k < 16; k++)
        first_bit_lowest |= (polynomial >> (15 - k) & 1u) << k;
    const wire w = encode(&frame);
    for (unsigned from = 20; from < 70; from++) {
        const wire seen = with_burst(&w, from, first_bit_lowest);
        accepted += leaves_stuffing_alone(&w, &seen, from, 16) && is_accepted(&seen);
    }
    assert_true(accepted > 0);
}

/* Known answer: 1490 of the 2048 base identifiers have no stuff bit in SOF and identifier. */
TEST(most_base_identifiers_have_no_stuff_bit)
{
    unsigned without = 0;
    for (uint32_t id = 0; id <= CW_BASE_ID_MAX; id++) {
        const cw_frame frame = {.id = id};
        without += cw_frame_id_stuff_bits(&frame) == 0;
    }
    assert_int_equal(without, 1490);
}

/* The stuff bits are those of the encoded frame. A stuff bit behind the last bit of the identifier
 * is one of it. */
TEST(stuff_bits_of_identifiers_are_those_on_the_wire)
{
    for (uint64_t n = 0; n < 4000; n++) {
        const bool extended = n & 1u;
        const uint32_t most = extended ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX;
        const uint32_t few = n & 2u ? (uint32_t)cw_random(2, "few", n) : UINT32_MAX;
        const cw_frame frame = {.id = (uint32_t)cw_random(1, "ids", n) & few & most,
                                .flags = extended ? CW_FRAME_EXTENDED : 0};
        cw_bits bits;
        unsigned stuff = 0;
        assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
        for (unsigned k = 0; k < bits.length; k++) {
            const cw_place place = cw_bits_place(&bits, k);
            const bool of_id = place.field == CW_FIELD_ID || place.field == CW_FIELD_SOF ||
                               place.field == CW_FIELD_SRR || place.field == CW_FIELD_IDE;
            stuff += place.stuff && of_id && (extended || place.field != CW_FIELD_IDE);
        }
        assert_int_equal(cw_frame_id_stuff_bits(&frame), stuff);
    }
}

/* ---- Expected numbers ------------------------------------------------------------------------ */

/* Known answer of CiA: an error each 0.7 s, 8 hours a day, leaves one undetected in 1000 years. */
TEST(one_undetected_error_in_a_thousand_years)
{
    const uint64_t seconds = UINT64_C(1000) * 365 * 8 * 3600;
    const cw_bus_stats stats = {.frames = seconds * 1000, .error_frames = seconds * 10 / 7};
    assert_in_range(residual_expected_ppt(&stats), UINT64_C(500000000000), UINT64_C(1500000000000));
    assert_in_range(residual_error_ppm(&stats), 1420, 1430);
}

TEST(error_rates_are_parts_of_all_frames)
{
    assert_int_equal(residual_error_ppm(&(cw_bus_stats){.frames = 0}), 0);
    assert_int_equal(residual_error_ppm(&(cw_bus_stats){.error_frames = 3}), 1000000);
    assert_int_equal(residual_error_ppm(&(cw_bus_stats){.frames = 3, .error_frames = 1}), 250000);
    assert_int_equal(residual_expected_ppt(&(cw_bus_stats){.error_frames = 2}), 94);
}
