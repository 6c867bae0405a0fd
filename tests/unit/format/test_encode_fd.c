/* SPDX-License-Identifier: MIT
 *
 * test_encode_fd.c - CAN FD frames to wire bits and back (D1..D6), against an encoder that is
 * written from these rules alone.
 */
#include "format/bits.h"
#include "format/walk.h"
#include "rig.h"

#include <limits.h>

#define FRAMES 30000
#define PLACED_FRAMES 1500
#define SEED UINT64_C(0x76543210)
#define WIRE_MAX 800u
#define TAIL_BITS 11u /* CRC delimiter, two bits of the ACK slot, ACK delimiter, EOF */
#define LONGEST 731u /* wire bits of an FD frame */
#define OF_FD (CW_FRAME_EXTENDED | CW_FRAME_BRS | CW_FRAME_ESI | CW_FRAME_NON_ISO)

static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

/* ---- The encoder of the rules ---------------------------------------------------------------- */

typedef enum stuff_kind { STUFF_NONE, STUFF_DYNAMIC, STUFF_FIXED } stuff_kind;

typedef struct wire_bit {
    bool level;
    bool fast;
    stuff_kind stuff;
    cw_field field; /* of a dynamic stuff bit: that of the bit before it */
    unsigned index;
} wire_bit;

typedef struct wire {
    wire_bit bit[WIRE_MAX];
    unsigned length;
    unsigned run; /* of equal bits at the end, stuff bits counted */
    unsigned dynamic;
    unsigned fixed_bits; /* behind the first fixed stuff bit, without such */
    unsigned fixed;
    bool data_phase;
    bool open_run; /* D3: five equal bits before the first fixed stuff bit */
    uint32_t crc;
} wire;

static void put(wire *w, bool level, stuff_kind stuff, cw_field field, unsigned index)
{
    assert_in_range(w->length, 0, WIRE_MAX - 1);
    w->run = w->length > 0 && w->bit[w->length - 1].level == level ? w->run + 1 : 1;
    w->bit[w->length++] = (wire_bit){level, w->data_phase, stuff, field, index};
}

/* D3: a stuff bit goes before the bit that follows five equal ones. */
static void put_dynamic(wire *w, bool level, cw_field field, unsigned index)
{
    if (w->run == 5) {
        const wire_bit last = w->bit[w->length - 1];
        put(w, !last.level, STUFF_DYNAMIC, last.field, last.index);
        w->dynamic++;
    }
    put(w, level, STUFF_NONE, field, index);
}

/* D4 */
static void put_fixed(wire *w, bool level, cw_field field, unsigned index)
{
    if (w->fixed_bits++ % 4 == 0)
        put(w, !w->bit[w->length - 1].level, STUFF_FIXED, CW_FIELD_FIXED_STUFF, w->fixed++);
    put(w, level, STUFF_NONE, field, index);
}

static void put_identifier(wire *w, const cw_frame *f, unsigned from, unsigned to, unsigned all)
{
    for (unsigned i = from; i < to; i++)
        put_dynamic(w, f->id >> (all - 1 - i) & 1u, CW_FIELD_ID, i);
}

/* D1, SOF to RRS. */
static void put_arbitration(wire *w, const cw_frame *f)
{
    put_dynamic(w, 0, CW_FIELD_SOF, 0);
    if (f->flags & CW_FRAME_EXTENDED) {
        put_identifier(w, f, 0, 11, 29);
        put_dynamic(w, 1, CW_FIELD_SRR, 0);
        put_dynamic(w, 1, CW_FIELD_IDE, 0);
        put_identifier(w, f, 11, 29, 29);
        put_dynamic(w, 0, CW_FIELD_RTR, 0);
    } else {
        put_identifier(w, f, 0, 11, 11);
        put_dynamic(w, 0, CW_FIELD_RTR, 0);
        put_dynamic(w, 0, CW_FIELD_IDE, 0);
    }
}

/* D1, FDF to data. */
static void put_control_and_data(wire *w, const cw_frame *f)
{
    put_dynamic(w, 1, CW_FIELD_FDF, 0);
    put_dynamic(w, 0, CW_FIELD_RES, 0);
    put_dynamic(w, (f->flags & CW_FRAME_BRS) != 0, CW_FIELD_BRS, 0);
    w->data_phase = f->flags & CW_FRAME_BRS;
    put_dynamic(w, (f->flags & CW_FRAME_ESI) != 0, CW_FIELD_ESI, 0);
    for (unsigned i = 0; i < 4; i++)
        put_dynamic(w, f->dlc >> (3 - i) & 1u, CW_FIELD_DLC, i);
    for (unsigned i = 0; i < 8u * lengths[f->dlc]; i++)
        put_dynamic(w, ((unsigned)f->data[i / 8] >> (7 - i % 8)) & 1u, CW_FIELD_DATA, i);
    w->open_run = w->run == 5;
}

/* Divides a row of bits by a polynomial. The first bits of the row are inverted where those of
 * the value to begin with are 1. Returns the rest. */
static uint32_t divide(const bool *row, unsigned count, unsigned degree, uint32_t polynomial,
                       uint32_t begin)
{
    bool rest[WIRE_MAX + 32] = {0};
    uint32_t number = 0;
    memcpy(rest, row, count);
    for (unsigned i = 0; i < degree; i++)
        rest[i] ^= begin >> (degree - 1 - i) & 1u;
    for (unsigned n = 0; n < count; n++)
        for (unsigned i = 0; rest[n] && i <= degree; i++)
            rest[n + degree - i] ^= (polynomial >> i & 1u) && i < degree;
    for (unsigned i = 0; i < degree; i++)
        number = number << 1 | rest[count + i];
    return number;
}

/* D6, over all bits so far and the stuff count. */
static uint32_t check_sequence(const wire *w, const cw_frame *f, const bool *count, unsigned bits)
{
    bool row[WIRE_MAX];
    for (unsigned n = 0; n < w->length; n++)
        row[n] = w->bit[n].level;
    memcpy(row + w->length, count, bits);
    const unsigned all = w->length + bits;
    const bool iso = !(f->flags & CW_FRAME_NON_ISO);
    return lengths[f->dlc] <= 16 ? divide(row, all, 17, 0x1685B, iso ? 0x10000 : 0)
                                 : divide(row, all, 21, 0x102899, iso ? 0x100000 : 0);
}

/* The Gray codes of D5. */
static const char *const gray[8] = {"000", "001", "011", "010", "110", "111", "101", "100"};

static void encode_by_rules(wire *w, const cw_frame *f, uint32_t inverted)
{
    bool count[4] = {0};
    memset(w, 0, sizeof *w);
    put_arbitration(w, f);
    put_control_and_data(w, f);
    for (unsigned i = 0; i < 3; i++) {
        count[i] = gray[w->dynamic % 8][i] == '1';
        count[3] ^= count[i];
    }
    const unsigned count_bits = f->flags & CW_FRAME_NON_ISO ? 0 : 4;
    const unsigned crc_bits = lengths[f->dlc] <= 16 ? 17 : 21;
    w->crc = check_sequence(w, f, count, count_bits) ^ inverted;
    for (unsigned i = 0; i < count_bits; i++)
        put_fixed(w, count[i], CW_FIELD_STUFF_COUNT, i);
    for (unsigned i = 0; i < crc_bits; i++)
        put_fixed(w, w->crc >> (crc_bits - 1 - i) & 1u, CW_FIELD_CRC, i);
    w->data_phase = false;
    put(w, 1, STUFF_NONE, CW_FIELD_CRC_DELIMITER, 0);
    put(w, 1, STUFF_NONE, CW_FIELD_ACK_SLOT, 0);
    put(w, 1, STUFF_NONE, CW_FIELD_ACK_SLOT, 1);
    put(w, 1, STUFF_NONE, CW_FIELD_ACK_DELIMITER, 0);
    for (unsigned i = 0; i < 7; i++)
        put(w, 1, STUFF_NONE, CW_FIELD_EOF, i);
}

/* ---- Encoding -------------------------------------------------------------------------------- */

static void check_levels(const cw_bits *bits, const wire *w)
{
    uint64_t level[CW_BIT_WORDS] = {0}, stuff[CW_BIT_WORDS] = {0};
    for (unsigned n = 0; n < w->length; n++) {
        level[n / 64] |= (uint64_t)w->bit[n].level << (n % 64);
        stuff[n / 64] |= (uint64_t)(w->bit[n].stuff != STUFF_NONE) << (n % 64);
    }
    const cw_stuffing stuffing = cw_bits_stuffing(bits);
    assert_int_equal(stuffing.words, (w->length + 63) / 64);
    assert_memory_equal(bits->level, level, stuffing.words * sizeof level[0]);
    assert_memory_equal(stuffing.set, stuff, stuffing.words * sizeof stuff[0]);
}

/* Compares all of cw_bits, and the length without them. */
static void check_encoding(wire *w, const cw_frame *f, uint32_t inverted)
{
    cw_bits bits;
    unsigned format = CW_BITS_FD;
    format |= f->flags & CW_FRAME_EXTENDED ? CW_BITS_EXTENDED : 0;
    format |= f->flags & CW_FRAME_NON_ISO ? CW_BITS_NON_ISO : 0;
    encode_by_rules(w, f, inverted);
    memset(&bits, 0xA5, sizeof bits);
    assert_int_equal(cw_bits_encode_crc(&bits, f, inverted), CW_OK);
    assert_int_equal(bits.length, w->length);
    assert_int_equal(bits.crc, w->crc);
    assert_int_equal(bits.bytes, lengths[f->dlc]);
    assert_int_equal(bits.format, format);
    check_levels(&bits, w);
    assert_int_equal(cw_frame_wire_bits(f), w->length);
    assert_in_range(w->length, 1, LONGEST);
}

static uint32_t id_mask(const cw_frame *f)
{
    return f->flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu;
}

/* Draws any FD frame. Bytes behind the data field are random too: they must not count. */
static cw_frame random_frame(rig_random *random)
{
    cw_frame f = {.flags = CW_FRAME_FD, .dlc = (uint8_t)rig_below(random, 16)};
    f.flags |= (uint8_t)(rig_next(random) & OF_FD);
    f.id = rig_runs(random) & id_mask(&f);
    const bool runs = rig_below(random, 2);
    for (unsigned i = 0; i < CW_FRAME_DATA_MAX; i++)
        f.data[i] = (uint8_t)(runs ? rig_runs(random) : rig_next(random));
    return f;
}

TEST(random_frames_encode_as_the_rules_say)
{
    rig_random random = {SEED};
    unsigned open_runs = 0;
    for (unsigned i = 0; i < FRAMES; i++) {
        wire w;
        const cw_frame f = random_frame(&random);
        check_encoding(&w, &f, 0);
        check_encoding(&w, &f, rig_next(&random) & (lengths[f.dlc] <= 16 ? 0x1FFFF : 0x1FFFFF));
        open_runs += w.open_run;
    }
    assert_in_range(open_runs, FRAMES / 50, FRAMES / 4);
}

/* D3: with random data one frame in 30 ends its data field with five equal bits. After a bit that
 * begins a run, 1/2, the shares of runs are 4/15, 2/15, 1/15 and 1/30. */
TEST(one_random_frame_in_thirty_ends_in_a_run_without_its_stuff_bit)
{
    rig_random random = {SEED + 1};
    unsigned open_runs = 0;
    for (unsigned i = 0; i < FRAMES; i++) {
        wire w;
        cw_frame f = {.flags = CW_FRAME_FD, .dlc = (uint8_t)(8 + i % 8), .id = i % 0x800};
        for (unsigned byte = 0; byte < CW_FRAME_DATA_MAX; byte++)
            f.data[byte] = (uint8_t)(rig_next(&random) >> 11);
        check_encoding(&w, &f, 0);
        open_runs += w.open_run;
        if (!w.open_run)
            continue;
        const wire_bit *last = &w.bit[w.length - TAIL_BITS - (lengths[f.dlc] <= 16 ? 27 : 32) - 1];
        assert_int_equal(last->field, CW_FIELD_DATA);
        assert_int_equal(last[1].stuff, STUFF_FIXED);
        assert_int_not_equal(last[1].level, last->level);
    }
    assert_in_range(open_runs, FRAMES / 30 * 8 / 10, FRAMES / 30 * 12 / 10);
}

/* Fills the data with one pattern of bits, beginning somewhere in it. */
static void fill(cw_frame *f, uint64_t pattern, unsigned period, unsigned shift)
{
    memset(f->data, 0, sizeof f->data);
    for (unsigned i = 0; i < 8 * CW_FRAME_DATA_MAX; i++)
        f->data[i / 8] |= (uint8_t)((pattern >> ((i + shift) % period) & 1u) << (7 - i % 8));
}

/* Among them runs of four, which have a stuff bit each, and rows of one level. */
TEST(patterns_encode_as_the_rules_say)
{
    static const uint32_t ids[] = {0, 0x1FFFFFFF, 0x0F0F0F0F, 0x10F0F0F0, 0x15555555};
    wire w;
    for (unsigned flags = 0; flags < 64; flags++)
        for (unsigned i = 0; i < 16 * 5; i++) {
            if (flags & ~OF_FD)
                continue;
            cw_frame f = {.flags = (uint8_t)(CW_FRAME_FD | flags), .dlc = (uint8_t)(i % 16)};
            f.id = ids[i / 16] & id_mask(&f);
            for (unsigned half = 1; half <= 8; half++)
                for (unsigned shift = 0; shift < 2 * half; shift++) {
                    fill(&f, (UINT64_C(1) << half) - 1, 2 * half, shift);
                    check_encoding(&w, &f, 0);
                }
            memset(f.data, 0, sizeof f.data);
            check_encoding(&w, &f, 0);
            memset(f.data, 0xFF, sizeof f.data);
            check_encoding(&w, &f, 0);
        }
}

static void set_row(cw_frame *f, unsigned from, unsigned bits, bool level)
{
    for (unsigned i = from; i < from + bits && i < 8 * CW_FRAME_DATA_MAX; i++) {
        const unsigned bit = 1u << (7 - i % 8);
        f->data[i / 8] = (uint8_t)(level ? f->data[i / 8] | bit : f->data[i / 8] & ~bit);
    }
}

/* From each bit of the data field on. */
TEST(rows_of_equal_bits_encode_as_the_rules_say)
{
    static const uint8_t around[] = {0, 0xFF, 0x55}, rows[] = {4, 5, 6, 9, 14, 33};
    wire w;
    for (unsigned dlc = 1; dlc < 16; dlc++)
        for (unsigned from = 0; from < 8u * lengths[dlc]; from++)
            for (unsigned i = 0; i < 3 * 6 * 2; i++) {
                cw_frame f = {.flags = CW_FRAME_FD | (from % 3 ? 0 : CW_FRAME_EXTENDED),
                              .dlc = (uint8_t)dlc, .id = 0x2A5};
                memset(f.data, around[i % 3], sizeof f.data);
                set_row(&f, from, rows[i / 3 % 6], i / 18);
                check_encoding(&w, &f, 0);
            }
}

TEST(every_base_identifier_encodes_as_the_rules_say)
{
    wire w;
    for (unsigned i = 0; i < 0x800 * 16; i++) {
        cw_frame f = {.flags = CW_FRAME_FD, .id = i % 0x800, .dlc = (uint8_t)(i / 0x800)};
        check_encoding(&w, &f, 0);
        f.flags |= CW_FRAME_ESI | (i & 1u ? CW_FRAME_BRS : 0);
        memset(f.data, 0xFF, sizeof f.data);
        check_encoding(&w, &f, 0);
    }
}

/* ---- The slow walk --------------------------------------------------------------------------- */

/* Returns true when a stuff bit comes before the bit of the walk. */
static bool stuff_is_due(const wire *w, const cw_walk *walk)
{
    return !cw_part_is(walk->part, CW_PART_FIXED_STUFFED) && w->run == 5 &&
           cw_part_is(walk->part, CW_PART_STUFFED);
}

TEST(the_walk_is_what_the_rules_say)
{
    rig_random random = {SEED + 2};
    for (unsigned i = 0; i < FRAMES / 2; i++) {
        wire expected, w = {.length = 0};
        const cw_frame f = random_frame(&random);
        encode_by_rules(&expected, &f, 0);
        for (cw_walk walk = cw_walk_begin(&f); walk.part != CW_PART_END; cw_walk_on(&walk)) {
            const bool fixed = cw_part_is(walk.part, CW_PART_FIXED_STUFFED);
            if (stuff_is_due(&w, &walk)) {
                put(&w, !w.bit[w.length - 1].level, STUFF_DYNAMIC, CW_FIELD_NONE, 0);
                cw_walk_stuff(&walk, w.bit[w.length - 1].level);
            }
            if (fixed)
                put_fixed(&w, cw_walk_level(&walk), CW_FIELD_NONE, 0);
            else
                put(&w, cw_walk_level(&walk), STUFF_NONE, CW_FIELD_NONE, 0);
        }
        assert_int_equal(w.length, expected.length);
        for (unsigned n = 0; n < w.length; n++)
            assert_int_equal(w.bit[n].level, expected.bit[n].level);
    }
}

/* ---- Places ---------------------------------------------------------------------------------- */

static void assert_found(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    unsigned found = UINT_MAX;
    assert_true(cw_bits_find(bits, &found, field, index));
    assert_int_equal(found, n);
    assert_true(cw_bits_is_at(bits, n, field, index));
    assert_false(n > 0 && cw_bits_is_at(bits, n - 1, field, index));
}

static void check_place(const cw_frame *f, const cw_bits *bits, unsigned n, const wire_bit *bit)
{
    const cw_place place = cw_bits_place(bits, n);
    assert_int_equal(cw_bits_level(bits, n), bit->level);
    assert_int_equal(place.field, bit->field);
    assert_int_equal(place.index, bit->index);
    assert_int_equal(place.stuff, bit->stuff != STUFF_NONE);
    assert_int_equal(place.extended, (f->flags & CW_FRAME_EXTENDED) != 0);
    assert_int_equal(cw_bits_is_fast(bits, n), bit->fast);
    assert_int_equal(cw_bits_is_at(bits, n, bit->field, bit->index), bit->stuff != STUFF_DYNAMIC);
    assert_found(bits, n, CW_FIELD_BIT, n);
}

/* Looks for each position, also for those that the frame does not have. */
static void check_no_other(const cw_frame *f, const cw_bits *bits, const unsigned *there)
{
    static const unsigned far[] = {0x33333334, 0x66666667, 0x9999999A, 0xFFFF, UINT_MAX};
    unsigned n;
    for (unsigned field = CW_FIELD_SOF; field < CW_FIELD_COUNT; field++) {
        for (unsigned index = there[field]; index < WIRE_MAX; index++)
            assert_false(cw_bits_find(bits, &n, (cw_field)field, index));
        for (unsigned i = 0; i < 5; i++)
            assert_false(cw_bits_find(bits, &n, (cw_field)field, far[i]));
        if (field != CW_FIELD_STUFF && field != CW_FIELD_BIT && field != CW_FIELD_FIXED_STUFF)
            assert_false(cw_frame_find(f, &n, (cw_field)field, there[field]));
    }
}

static void check_places(const cw_frame *f)
{
    wire w;
    cw_bits bits;
    unsigned there[CW_FIELD_COUNT] = {0}, plain = 0, n = UINT_MAX;
    encode_by_rules(&w, f, 0);
    assert_int_equal(cw_bits_encode(&bits, f), CW_OK);
    const cw_stuffing stuffing = cw_bits_stuffing(&bits);
    for (unsigned i = 0; i < w.length; i++) {
        const wire_bit *bit = &w.bit[i];
        check_place(f, &bits, i, bit);
        if (bit->stuff == STUFF_DYNAMIC) {
            assert_found(&bits, i, CW_FIELD_STUFF, there[CW_FIELD_STUFF]++);
            continue;
        }
        assert_found(&bits, i, bit->field, bit->index);
        there[bit->field]++;
        if (bit->stuff == STUFF_FIXED)
            continue;
        assert_true(cw_frame_find(f, &n, bit->field, bit->index));
        assert_int_equal(n, plain);
        assert_int_equal(cw_wire_index(&stuffing, plain++), i);
    }
    there[CW_FIELD_BIT] = w.length;
    check_no_other(f, &bits, there);
}

TEST(every_bit_has_its_place_and_its_rate)
{
    rig_random random = {SEED + 3};
    for (unsigned i = 0; i < PLACED_FRAMES; i++) {
        cw_frame f = random_frame(&random);
        f.dlc = (uint8_t)(i % 16);
        check_places(&f);
    }
}

TEST(fields_are_as_long_as_positions_say)
{
    static const uint16_t bits[CW_FIELD_COUNT] = {
        [CW_FIELD_SOF] = 1,           [CW_FIELD_ID] = 29,          [CW_FIELD_SRR] = 1,
        [CW_FIELD_IDE] = 1,           [CW_FIELD_RTR] = 1,          [CW_FIELD_R1] = 1,
        [CW_FIELD_R0] = 1,            [CW_FIELD_FDF] = 1,          [CW_FIELD_RES] = 1,
        [CW_FIELD_BRS] = 1,           [CW_FIELD_ESI] = 1,          [CW_FIELD_DLC] = 4,
        [CW_FIELD_DATA] = 512,        [CW_FIELD_STUFF_COUNT] = 4,  [CW_FIELD_CRC] = 21,
        [CW_FIELD_FIXED_STUFF] = 7,   [CW_FIELD_CRC_DELIMITER] = 1, [CW_FIELD_ACK_SLOT] = 2,
        [CW_FIELD_ACK_DELIMITER] = 1, [CW_FIELD_EOF] = 7,          [CW_FIELD_INTERMISSION] = 3,
        [CW_FIELD_SUSPEND] = 8,
    };
    for (unsigned field = 0; field < CW_FIELD_COUNT; field++)
        assert_int_equal(cw_field_bits((cw_field)field, true), bits[field]);
}

/* ---- Lengths --------------------------------------------------------------------------------- */

#define PLAIN_MAX 560u
#define STATES 12u /* a run of 1 to 5 bits of either level; 0 and 1 are none */

/* The most stuff bits of all frames that share some bits. */
typedef struct search {
    char free[PLAIN_MAX]; /* '0', '1', or 'x' for either */
    unsigned count;
    int most[PLAIN_MAX][STATES]; /* stuff bits before the bit that makes this state; -1: never */
    unsigned from[PLAIN_MAX][STATES];
} search;

static void add(search *s, const char *bits)
{
    while (*bits)
        s->free[s->count++] = *bits++;
}

static void add_free(search *s, unsigned count)
{
    while (count--)
        add(s, "x");
}

/* Names all bits that can have stuff bits before them; identifier, BRS, ESI and data are free. */
static void begin_search(search *s, bool extended, unsigned dlc)
{
    memset(s, 0, sizeof *s);
    add(s, "0");
    add_free(s, 11);
    if (extended) {
        add(s, "11");
        add_free(s, 18);
        add(s, "0");
    } else {
        add(s, "00");
    }
    add(s, "10");
    add_free(s, 2);
    for (unsigned i = 0; i < 4; i++)
        add(s, dlc >> (3 - i) & 1u ? "1" : "0");
    add_free(s, 8u * lengths[dlc]);
}

/* Goes on from a state by one bit. */
static void search_bit(search *s, unsigned n, unsigned state, unsigned bit)
{
    unsigned level = state % 2, run = state / 2;
    int stuff = s->most[n - 1][state];
    if (stuff < 0 || (s->free[n] != 'x' && s->free[n] != (bit ? '1' : '0')))
        return;
    if (run == 5) {
        stuff++;
        level = !level;
        run = 1;
    }
    const unsigned next = 2 * (bit == level ? run + 1 : 1) + bit;
    if (stuff > s->most[n][next]) {
        s->most[n][next] = stuff;
        s->from[n][next] = state;
    }
}

/* Returns the state at the end with the most stuff bits. */
static unsigned search_most(search *s)
{
    unsigned best = 0;
    memset(s->most, -1, sizeof s->most);
    s->most[0][2] = 0; /* SOF */
    for (unsigned n = 1; n < s->count; n++)
        for (unsigned state = 2; state < STATES; state++)
            for (unsigned bit = 0; bit < 2; bit++)
                search_bit(s, n, state, bit);
    for (unsigned state = 2; state < STATES; state++)
        if (s->most[s->count - 1][state] > s->most[s->count - 1][best])
            best = state;
    return best;
}

static uint32_t number_of(const bool *plain, unsigned from, unsigned bits)
{
    uint32_t number = 0;
    while (bits--)
        number = number << 1 | plain[from++];
    return number;
}

/* Returns the frame that ends in a state. */
static cw_frame frame_to(const search *s, unsigned state, bool extended, unsigned dlc)
{
    bool plain[PLAIN_MAX];
    cw_frame f = {.flags = CW_FRAME_FD, .dlc = (uint8_t)dlc};
    for (unsigned n = s->count; n-- > 0; state = s->from[n][state])
        plain[n] = state % 2;
    f.id = number_of(plain, 1, 11);
    if (extended) {
        f.id = f.id << 18 | number_of(plain, 14, 18);
        f.flags |= CW_FRAME_EXTENDED;
    }
    const unsigned data = s->count - 8u * lengths[dlc];
    f.flags |= (uint8_t)(plain[data - 6] ? CW_FRAME_BRS : 0);
    f.flags |= (uint8_t)(plain[data - 5] ? CW_FRAME_ESI : 0);
    for (unsigned i = 0; i < lengths[dlc]; i++)
        f.data[i] = (uint8_t)number_of(plain, data + 8 * i, 8);
    return f;
}

/* Finds the longest frame of each kind, and encodes it. That of 64 bytes has two stuff bits less
 * than 552 bits after SOF could have, since the bits from RRS to res are fixed. */
TEST(no_frame_is_longer_than_the_longest)
{
    static search s;
    unsigned longest = 0;
    for (unsigned i = 0; i < 2 * 16; i++) {
        wire w;
        const unsigned dlc = i % 16, crc = lengths[dlc] <= 16 ? 27 : 32;
        begin_search(&s, i / 16, dlc);
        const unsigned end = search_most(&s);
        cw_frame f = frame_to(&s, end, i / 16, dlc);
        check_encoding(&w, &f, 0);
        assert_int_equal(w.length,
                         s.count + (unsigned)s.most[s.count - 1][end] + crc + TAIL_BITS);
        longest = w.length > longest ? w.length : longest;
        f.flags |= CW_FRAME_NON_ISO;
        check_encoding(&w, &f, 0);
    }
    assert_int_equal(longest, LONGEST);
    assert_in_range(CW_FRAME_BITS_MAX, longest, CW_BITS_MAX);
}

/* The search is right where all frames can be tried. */
TEST(the_search_finds_what_trying_finds)
{
    static search s;
    for (unsigned dlc = 0; dlc < 2; dlc++) {
        unsigned longest = 0;
        for (unsigned i = 0; i < 0x800 * 4 * (dlc ? 256 : 1); i++) {
            cw_frame f = {.flags = CW_FRAME_FD, .id = i % 0x800, .dlc = (uint8_t)dlc};
            f.flags |= (i & 0x800 ? CW_FRAME_BRS : 0) | (i & 0x1000 ? CW_FRAME_ESI : 0);
            f.data[0] = (uint8_t)(i / 0x2000);
            const unsigned length = cw_frame_wire_bits(&f);
            longest = length > longest ? length : longest;
        }
        begin_search(&s, false, dlc);
        const unsigned end = search_most(&s);
        assert_int_equal(longest, s.count + (unsigned)s.most[s.count - 1][end] + 27 + TAIL_BITS);
    }
}

/* linux/can/length.h counts 579 bits for a base frame of 64 bytes without stuff bits, and 598 for
 * an extended one. With them it has 712 and 736 at most. The intermission is in these, and the ACK
 * slot has one bit. */
TEST(lengths_are_those_of_linux)
{
    rig_random random = {SEED + 4};
    for (unsigned i = 0; i < FRAMES; i++) {
        wire w;
        cw_frame f = random_frame(&random);
        f.flags &= (uint8_t)~CW_FRAME_NON_ISO;
        encode_by_rules(&w, &f, 0);
        const bool extended = f.flags & CW_FRAME_EXTENDED;
        const unsigned shorter = 8 * (64u - lengths[f.dlc]) + (lengths[f.dlc] <= 16 ? 5 : 0);
        const unsigned plain = cw_frame_wire_bits(&f) - w.dynamic + 3 - 1;
        assert_int_equal(plain, (extended ? 598u : 579u) - shorter);
        assert_in_range(cw_frame_wire_bits(&f) + 3 - 1, plain, extended ? 736 : 712);
    }
}

TEST(lengths_follow_dlc)
{
    for (unsigned dlc = 0, bytes = 0; dlc < 16; dlc++) {
        const cw_frame f = {.flags = CW_FRAME_FD, .dlc = (uint8_t)dlc};
        assert_int_equal(cw_frame_length(&f), lengths[dlc]);
        for (; bytes <= lengths[dlc]; bytes++)
            assert_int_equal(cw_fd_dlc(bytes), dlc);
    }
}

/* ---- Known numbers --------------------------------------------------------------------------- */

/* The catalogue of CRC algorithms has these for "123456789", beginning with 0. */
TEST(crcs_are_those_of_the_catalogue)
{
    static const char text[] = "123456789";
    bool row[72];
    uint32_t crc17 = 0, crc21 = 0;
    for (unsigned i = 0; i < 72; i++) {
        row[i] = text[i / 8] >> (7 - i % 8) & 1;
        crc17 = cw_crc17_next(crc17, row[i]);
        crc21 = cw_crc21_next(crc21, row[i]);
    }
    assert_int_equal(divide(row, 72, 17, 0x1685B, 0), 0x04F03);
    assert_int_equal(divide(row, 72, 21, 0x102899, 0), 0x0ED841);
    assert_int_equal(crc17, 0x04F03);
    assert_int_equal(crc21, 0x0ED841);
}

/* D5 */
TEST(stuff_counts_are_gray_codes_with_even_parity)
{
    static const uint8_t counts[8] = {0x0, 0x3, 0x6, 0x5, 0xC, 0xF, 0xA, 0x9};
    for (unsigned i = 0; i < 140; i++)
        assert_int_equal(cw_stuff_count(i), counts[i % 8]);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

static bool is_valid(unsigned flags)
{
    const unsigned fd_only = CW_FRAME_BRS | CW_FRAME_ESI | CW_FRAME_NON_ISO;
    if (flags & ~(OF_FD | CW_FRAME_FD | CW_FRAME_REMOTE))
        return false;
    return flags & CW_FRAME_FD ? !(flags & CW_FRAME_REMOTE) : !(flags & fd_only);
}

/* D2: there is no FD remote frame. */
TEST(flags_of_fd_frames_go_together)
{
    for (unsigned flags = 0; flags < 0x100; flags++) {
        cw_bits bits;
        cw_frame f = {.id = 0x7FF, .flags = (uint8_t)flags, .dlc = 15};
        const bool valid = is_valid(flags);
        assert_int_equal(cw_frame_valid(&f), valid);
        assert_int_equal(cw_bits_encode(&bits, &f), valid ? CW_OK : CW_INVALID);
        assert_int_equal(cw_frame_wire_bits(&f), valid ? bits.length : 0);
        f.dlc = 16;
        assert_false(cw_frame_valid(&f));
        f.dlc = 15;
        f.id = (flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu) + 1;
        assert_false(cw_frame_valid(&f));
    }
}

TEST(frames_are_equal_as_they_are_on_the_wire)
{
    for (unsigned dlc = 0; dlc < 16; dlc++)
        for (unsigned byte = 0; byte < CW_FRAME_DATA_MAX; byte++) {
            cw_frame a = {.id = 1, .flags = CW_FRAME_FD, .dlc = (uint8_t)dlc}, b = a;
            b.data[byte] = 1;
            assert_int_equal(cw_frame_equal(&a, &b), byte >= lengths[dlc]);
            b = a;
            b.flags |= CW_FRAME_BRS;
            assert_false(cw_frame_equal(&a, &b));
        }
}

/* ---- Single frames --------------------------------------------------------------------------- */

/* ESI and DLC are five dominant bits, after which the first fixed stuff bit comes (D3). */
TEST(frames_without_data_have_a_stuff_count)
{
    cw_bits bits;
    const cw_frame f = {.id = 0x2AA, .flags = CW_FRAME_FD | CW_FRAME_BRS};
    assert_int_equal(cw_bits_encode(&bits, &f), CW_OK);
    assert_int_equal(bits.length, 22 + 27 + 11);
    assert_int_equal(cw_bits_place(&bits, 21).field, CW_FIELD_DLC);
    assert_int_equal(cw_bits_place(&bits, 22).field, CW_FIELD_FIXED_STUFF);
}

TEST(an_inverted_crc_bit_is_on_the_wire)
{
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
