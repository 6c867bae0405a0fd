/* SPDX-License-Identifier: MIT
 *
 * test_format_fd.c - wire bits and positions of CAN FD frames (D1 to D6).
 *
 * The library is compared with an encoder that goes bit by bit and shares nothing with it.
 */
#include "format/bits.h"
#include "rig.h"

#define SEED 20261123
#define FRAMES 20000
#define HEAD_BITS_MAX 41u

/* ---- An encoder, bit by bit ------------------------------------------------------------------ */

typedef enum bit_kind { PLAIN, DYNAMIC, FIXED } bit_kind;

typedef struct oracle {
    unsigned length, stuffed; /* the latter up to the data field */
    bool level[CW_BITS_MAX];
    bit_kind kind[CW_BITS_MAX];
    cw_field field[CW_BITS_MAX];
    unsigned index[CW_BITS_MAX];
    unsigned run;
    unsigned dynamic;
    bool dropped; /* no stuff bit stands after the last bit of the data field */
    uint32_t crc;
    unsigned crc_bits;
    uint32_t polynomial;
} oracle;

static void add(oracle *o, bool level, bit_kind kind, cw_field field, unsigned index)
{
    const unsigned n = o->length++;
    o->run = n > 0 && o->level[n - 1] == level ? o->run + 1 : 1;
    o->level[n] = level;
    o->kind[n] = kind;
    o->field[n] = field;
    o->index[n] = index;
}

static void divide(oracle *o, bool bit)
{
    const bool top = o->crc >> (o->crc_bits - 1) & 1u;
    o->crc = (o->crc << 1) & ((1u << o->crc_bits) - 1);
    if (top != bit)
        o->crc ^= o->polynomial;
}

/* Adds a number, the highest bit first, with dynamic stuff bits. The one that would come last is
 * added before the next bit. */
static void add_stuffed(oracle *o, uint32_t number, unsigned bits, cw_field field, unsigned first)
{
    for (unsigned i = 0; i < bits; i++) {
        if (o->length > 0 && o->run == 5) {
            const unsigned n = o->length - 1;
            add(o, !o->level[n], DYNAMIC, o->field[n], o->index[n]);
            divide(o, o->level[n + 1]);
            o->dynamic++;
        }
        const bool level = number >> (bits - 1 - i) & 1u;
        add(o, level, PLAIN, field, first + i);
        divide(o, level);
    }
}

/* Adds a number with a fixed stuff bit before each fourth bit. */
static void add_fixed(oracle *o, uint32_t number, unsigned bits, cw_field field, unsigned *count)
{
    for (unsigned i = 0; i < bits; i++) {
        if (i % 4 == 0) {
            add(o, !o->level[o->length - 1], FIXED, CW_FIELD_FIXED_STUFF, (*count)++);
        }
        add(o, number >> (bits - 1 - i) & 1u, PLAIN, field, i);
    }
}

static void add_head(oracle *o, const cw_frame *f)
{
    const bool extended = f->flags & CW_FRAME_EXTENDED;
    add_stuffed(o, 0, 1, CW_FIELD_SOF, 0);
    if (extended) {
        add_stuffed(o, f->id >> 18, 11, CW_FIELD_ID, 0);
        add_stuffed(o, 1, 1, CW_FIELD_SRR, 0);
        add_stuffed(o, 1, 1, CW_FIELD_IDE, 0);
        add_stuffed(o, f->id & 0x3FFFF, 18, CW_FIELD_ID, 11);
        add_stuffed(o, 0, 1, CW_FIELD_RTR, 0);
    } else {
        add_stuffed(o, f->id, 11, CW_FIELD_ID, 0);
        add_stuffed(o, 0, 1, CW_FIELD_RTR, 0);
        add_stuffed(o, 0, 1, CW_FIELD_IDE, 0);
    }
    add_stuffed(o, 1, 1, CW_FIELD_FDF, 0);
    add_stuffed(o, 0, 1, CW_FIELD_RES, 0);
    add_stuffed(o, (f->flags & CW_FRAME_BRS) != 0, 1, CW_FIELD_BRS, 0);
    add_stuffed(o, (f->flags & CW_FRAME_ESI) != 0, 1, CW_FIELD_ESI, 0);
    add_stuffed(o, f->dlc, 4, CW_FIELD_DLC, 0);
}

static void add_tail(oracle *o)
{
    add(o, true, PLAIN, CW_FIELD_CRC_DELIMITER, 0);
    add(o, true, PLAIN, CW_FIELD_ACK_SLOT, 0);
    add(o, true, PLAIN, CW_FIELD_ACK_SLOT, 1);
    add(o, true, PLAIN, CW_FIELD_ACK_DELIMITER, 0);
    for (unsigned i = 0; i < 7; i++)
        add(o, true, PLAIN, CW_FIELD_EOF, i);
}

static void encode(oracle *o, const cw_frame *f)
{
    static const uint8_t lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    static const uint8_t gray[] = {0, 1, 3, 2, 6, 7, 5, 4};
    const bool iso = !(f->flags & CW_FRAME_NON_ISO);
    const unsigned bytes = lengths[f->dlc];
    unsigned fixed = 0;
    *o = (oracle){.crc_bits = bytes > 16 ? 21 : 17, .polynomial = bytes > 16 ? 0x102899 : 0x1685B};
    o->crc = iso ? 1u << (o->crc_bits - 1) : 0;
    add_head(o, f);
    for (unsigned i = 0; i < bytes; i++)
        add_stuffed(o, f->data[i], 8, CW_FIELD_DATA, 8 * i);
    o->dropped = o->run == 5;
    o->stuffed = o->length;
    if (iso) {
        const unsigned code = gray[o->dynamic % 8];
        const unsigned count = code << 1 | ((code ^ code >> 1 ^ code >> 2) & 1u);
        add_fixed(o, count, 4, CW_FIELD_STUFF_COUNT, &fixed);
        for (unsigned i = 0; i < 4; i++)
            divide(o, count >> (3 - i) & 1u);
    }
    add_fixed(o, o->crc, o->crc_bits, CW_FIELD_CRC, &fixed);
    add_tail(o);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Draws a frame with rows of equal bits, and bytes behind the data field that must not count. */
static cw_frame random_frame(rig_random *r)
{
    cw_frame f = {.flags = CW_FRAME_FD, .dlc = (uint8_t)rig_below(r, 16)};
    const bool extended = rig_below(r, 2);
    f.flags |= (uint8_t)((extended ? CW_FRAME_EXTENDED : 0) |
                         (rig_below(r, 2) ? CW_FRAME_BRS : 0) |
                         (rig_below(r, 2) ? CW_FRAME_ESI : 0) |
                         (rig_below(r, 8) ? 0 : CW_FRAME_NON_ISO));
    f.id = (uint32_t)rig_below(r, extended ? 0x20000000 : 0x800);
    if (rig_below(r, 4) == 0)
        f.id = extended ? 0x1F000000 : 0x7C0;
    const bool runs = rig_below(r, 2);
    for (unsigned i = 0; i < CW_FRAME_DATA_MAX; i++)
        f.data[i] = (uint8_t)(runs ? rig_runs(r) : rig_below(r, 256));
    return f;
}

static void check_places(const cw_bits *bits, const oracle *o)
{
    unsigned dynamic = 0;
    for (unsigned n = 0; n < bits->length; n++) {
        const cw_place place = cw_bits_place(bits, n);
        unsigned found;
        assert_int_equal(place.field, o->field[n]);
        assert_int_equal(place.index, o->index[n]);
        assert_int_equal(place.stuff, o->kind[n] != PLAIN);
        assert_int_equal(cw_bits_is_at(bits, n, o->field[n], o->index[n]), o->kind[n] != DYNAMIC);
        const cw_field field = o->kind[n] == DYNAMIC ? CW_FIELD_STUFF : o->field[n];
        const unsigned index = o->kind[n] == DYNAMIC ? dynamic++ : o->index[n];
        assert_true(cw_bits_find(bits, &found, field, index));
        assert_int_equal(found, n);
    }
    unsigned found;
    assert_false(cw_bits_find(bits, &found, CW_FIELD_STUFF, dynamic));
}

/* Only BRS and CRC delimiter have both rates; the function takes them for slow. */
static void check_rates(const cw_bits *bits, const oracle *o, const cw_frame *f)
{
    bool fast = false;
    for (unsigned n = 0; n < bits->length; n++) {
        if (o->field[n] == CW_FIELD_CRC_DELIMITER)
            fast = false;
        assert_int_equal(cw_bits_is_fast(bits, n), fast);
        if (o->field[n] == CW_FIELD_BRS && o->kind[n] == PLAIN)
            fast = f->flags & CW_FRAME_BRS;
    }
}

static void check_frame(const cw_frame *f, oracle *o)
{
    cw_bits bits;
    encode(o, f);
    memset(&bits, 0xA5, sizeof bits);
    assert_true(cw_frame_valid(f));
    assert_int_equal(cw_bits_encode(&bits, f), CW_OK);
    assert_int_equal(bits.length, o->length);
    assert_int_equal(bits.crc, o->crc);
    for (unsigned n = 0; n < o->length; n++)
        assert_int_equal(cw_bits_level(&bits, n), o->level[n]);
    assert_int_equal(cw_frame_wire_bits(f), o->length);
    assert_int_equal(cw_bits_stuffed(&bits), o->stuffed);
    check_rates(&bits, o, f);
    if (f->id % 16 == 0)
        check_places(&bits, o);
}

/* A stuff condition at the end of the data field is met by about 6 % of all frames. */
static void random_frames_encode_as_bit_by_bit(void **state)
{
    (void)state;
    rig_random random = {SEED};
    unsigned dropped = 0;
    oracle o;
    for (unsigned i = 0; i < FRAMES; i++) {
        const cw_frame f = random_frame(&random);
        check_frame(&f, &o);
        dropped += o.dropped;
    }
    assert_in_range(dropped, FRAMES / 50, FRAMES / 5);
}

/* All bytes are equal, in each length and format. */
static void uniform_data_encode_as_bit_by_bit(void **state)
{
    (void)state;
    oracle o;
    for (unsigned byte = 0; byte < 256; byte++)
        for (unsigned dlc = 0; dlc < 16; dlc++) {
            cw_frame f = {.id = 16 * dlc, .dlc = (uint8_t)dlc,
                          .flags = (uint8_t)(CW_FRAME_FD | (byte % 2 ? CW_FRAME_EXTENDED : 0) |
                                             (byte % 3 ? CW_FRAME_BRS : 0))};
            memset(f.data, (int)byte, sizeof f.data);
            check_frame(&f, &o);
        }
}

/* The shortest frames have all bits up to the DLC alone, whose last bit may meet the condition. */
static void frames_without_data_have_a_stuff_count(void **state)
{
    (void)state;
    oracle o;
    const cw_frame f = {.id = 0x2AA, .flags = CW_FRAME_FD | CW_FRAME_BRS};
    check_frame(&f, &o);
    assert_true(o.dropped); /* ESI and DLC are five dominant bits */
    assert_int_equal(o.length, 22 + 27 + 11);
}

static void an_inverted_crc_bit_is_on_the_wire(void **state)
{
    (void)state;
    cw_bits right, wrong;
    unsigned n, count = 0;
    const cw_frame f = {.id = 0x123, .flags = CW_FRAME_FD, .dlc = 15, .data = {1, 2, 3}};
    assert_int_equal(cw_bits_encode_crc(&right, &f, 0), CW_OK);
    assert_int_equal(cw_bits_encode_crc(&wrong, &f, 1), CW_OK);
    assert_true(cw_bits_find(&right, &n, CW_FIELD_CRC, 20));
    for (unsigned i = 0; i < right.length; i++)
        count += cw_bits_level(&right, i) != cw_bits_level(&wrong, i);
    assert_int_equal(count, 1);
    assert_true(cw_bits_level(&right, n) != cw_bits_level(&wrong, n));
}

/* ---- The longest frame ----------------------------------------------------------------------- */

#define RUNS 5u

/* The most stuff bits after which a frame can have a last level and a run of it; -1: it cannot. */
typedef struct reach {
    int most[2][RUNS + 1];
} reach;

static void note(reach *next, bool level, unsigned run, int stuff)
{
    if (stuff > next->most[level][run])
        next->most[level][run] = stuff;
}

/* Adds a bit that may have the levels of a mask: 1 dominant, 2 recessive. */
static reach add_bit(const reach *now, unsigned levels)
{
    reach next;
    memset(&next, 0xFF, sizeof next);
    for (unsigned last = 0; last < 2; last++)
        for (unsigned run = 1; run <= RUNS; run++)
            for (unsigned level = 0; level < 2 && now->most[last][run] >= 0; level++) {
                const bool stuffed = run == RUNS;
                const bool before = stuffed ? !last : last;
                const unsigned before_run = stuffed ? 1 : run;
                if (levels >> level & 1u)
                    note(&next, level, level == before ? before_run + 1 : 1,
                         now->most[last][run] + stuffed);
            }
    return next;
}

static reach add_bits(reach now, unsigned count, unsigned levels)
{
    for (unsigned i = 0; i < count; i++)
        now = add_bit(&now, levels);
    return now;
}

/* A search over all extended frames of 64 bytes: their bits with fixed levels, and the others. */
static void no_frame_is_longer_than_the_longest(void **state)
{
    (void)state;
    const unsigned d = 1, r = 2, any = 3;
    reach now;
    int most = -1;
    memset(&now, 0xFF, sizeof now);
    now.most[0][1] = 0; /* SOF */
    now = add_bits(now, 11, any);
    now = add_bits(now, 2, r); /* SRR, IDE */
    now = add_bits(now, 18, any);
    now = add_bits(now, 1, d); /* RRS */
    now = add_bits(now, 1, r); /* FDF */
    now = add_bits(now, 1, d); /* res */
    now = add_bits(now, 2, any); /* BRS, ESI */
    now = add_bits(now, 4, r); /* DLC */
    now = add_bits(now, 512, any);
    for (unsigned last = 0; last < 2; last++)
        for (unsigned run = 1; run <= RUNS; run++)
            most = now.most[last][run] > most ? now.most[last][run] : most;
    assert_in_range((unsigned)most + HEAD_BITS_MAX + 512 + 32 + 11, 1, CW_FRAME_BITS_MAX);
    assert_int_equal(most, 135);
}

/* The fields of frames of either kind. */
static void fields_are_as_long_as_positions_say(void **state)
{
    (void)state;
    assert_int_equal(cw_field_bits(CW_FIELD_FDF, true), 1);
    assert_int_equal(cw_field_bits(CW_FIELD_FDF, false), 0);
    assert_int_equal(cw_field_bits(CW_FIELD_STUFF_COUNT, true), 4);
    assert_int_equal(cw_field_bits(CW_FIELD_FIXED_STUFF, true), 7);
    assert_int_equal(cw_field_bits(CW_FIELD_CRC, true), 21);
    assert_int_equal(cw_field_bits(CW_FIELD_ACK_SLOT, true), 2);
    assert_int_equal(cw_field_bits(CW_FIELD_DATA, true), 512);
    assert_int_equal(cw_field_bits(CW_FIELD_R0, true), 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_frames_encode_as_bit_by_bit),
        cmocka_unit_test(uniform_data_encode_as_bit_by_bit),
        cmocka_unit_test(frames_without_data_have_a_stuff_count),
        cmocka_unit_test(an_inverted_crc_bit_is_on_the_wire),
        cmocka_unit_test(no_frame_is_longer_than_the_longest),
        cmocka_unit_test(fields_are_as_long_as_positions_say),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
