/* SPDX-License-Identifier: MIT
 *
 * codec.c - frames to annotated wire bits (F1..F8).
 *
 * A bit's place is not stored: it follows from the number of bits before it that are not stuff
 * bits, and from the frame format.
 */
#include "codec.h"

#include "bits.h"

#include <assert.h>
#include <string.h>

const cw_step_info cw_steps[CW_STEP_COUNT] = {
    [CW_STEP_SOF] = {CW_FIELD_SOF, 0, 1, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_BASE_ID] = {CW_FIELD_ID, 0, CW_BASE_ID_BITS,
                         CW_STEP_STUFFED | CW_STEP_IN_CRC | CW_STEP_ARBITRATION},
    [CW_STEP_SRR_RTR] = {CW_FIELD_RTR, 0, 1,
                         CW_STEP_STUFFED | CW_STEP_IN_CRC | CW_STEP_ARBITRATION},
    [CW_STEP_IDE] = {CW_FIELD_IDE, 0, 1, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_EXTENDED_ID] = {CW_FIELD_ID, CW_BASE_ID_BITS, CW_EXTENDED_ID_BITS - CW_BASE_ID_BITS,
                             CW_STEP_STUFFED | CW_STEP_IN_CRC | CW_STEP_ARBITRATION},
    [CW_STEP_RTR] = {CW_FIELD_RTR, 0, 1, CW_STEP_STUFFED | CW_STEP_IN_CRC | CW_STEP_ARBITRATION},
    [CW_STEP_R1] = {CW_FIELD_R1, 0, 1, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_R0] = {CW_FIELD_R0, 0, 1, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_DLC] = {CW_FIELD_DLC, 0, 4, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_DATA] = {CW_FIELD_DATA, 0, 0, CW_STEP_STUFFED | CW_STEP_IN_CRC},
    [CW_STEP_CRC] = {CW_FIELD_CRC, 0, CW_CRC_BITS, CW_STEP_STUFFED},
    [CW_STEP_CRC_DELIMITER] = {CW_FIELD_CRC_DELIMITER, 0, 1, CW_STEP_FIXED_FORM},
    [CW_STEP_ACK_SLOT] = {CW_FIELD_ACK_SLOT, 0, 1, 0},
    [CW_STEP_ACK_DELIMITER] = {CW_FIELD_ACK_DELIMITER, 0, 1, CW_STEP_FIXED_FORM},
    [CW_STEP_EOF] = {CW_FIELD_EOF, 0, CW_EOF_BITS, CW_STEP_FIXED_FORM},
};

cw_place cw_step_place(cw_step step, unsigned index, bool extended)
{
    const cw_step_info *info = &cw_steps[step];
    cw_place place = {.field = (cw_field)info->field,
                      .index = (uint8_t)(info->first_index + index)};
    if (step == CW_STEP_SRR_RTR && extended)
        place.field = CW_FIELD_SRR;
    place.extended = extended;
    return place;
}

unsigned cw_frame_length(const cw_frame *frame)
{
    return cw_dlc_length(frame->dlc, frame->flags & CW_FRAME_REMOTE);
}

bool cw_frame_valid(const cw_frame *frame)
{
    uint32_t id_max = frame->flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu;
    unsigned known = CW_FRAME_EXTENDED | CW_FRAME_REMOTE;
    return frame->id <= id_max && frame->dlc <= 15 && (frame->flags & ~known) == 0;
}

bool cw_frame_equal(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, cw_frame_length(a)) == 0;
}

/* Writes bits one after the other, stuffing and CRC on the way. */
typedef struct writer {
    cw_bits *bits;
    unsigned run;
    bool last;
    uint16_t crc;
} writer;

static void put_raw(writer *w, bool level)
{
    if (level)
        cw_bitset_add(w->bits->level, w->bits->length);
    w->bits->length++;
}

static void put_stuffed(writer *w, bool level)
{
    put_raw(w, level);
    w->run = level == w->last ? w->run + 1 : 1;
    w->last = level;
    if (w->run < CW_STUFF_RUN)
        return;
    cw_bitset_add(w->bits->stuff, w->bits->length);
    put_raw(w, !level);
    w->last = !level;
    w->run = 1;
}

/* A field of the part that the CRC covers, most significant bit first. */
static void put_field(writer *w, uint32_t value, unsigned bits)
{
    while (bits-- > 0) {
        bool level = (value >> bits) & 1u;
        w->crc = cw_crc_next(w->crc, level);
        put_stuffed(w, level);
    }
}

static void put_arbitration(writer *w, const cw_frame *frame)
{
    bool remote = frame->flags & CW_FRAME_REMOTE;
    put_field(w, CW_DOMINANT, 1); /* SOF */
    if (!(frame->flags & CW_FRAME_EXTENDED)) {
        put_field(w, frame->id, CW_BASE_ID_BITS);
        put_field(w, remote, 1);
        put_field(w, CW_DOMINANT, 2); /* IDE, r0 */
        return;
    }
    put_field(w, frame->id >> 18, CW_BASE_ID_BITS);
    put_field(w, 3, 2); /* SRR, IDE */
    put_field(w, frame->id & 0x3FFFFu, CW_EXTENDED_ID_BITS - CW_BASE_ID_BITS);
    put_field(w, remote, 1);
    put_field(w, CW_DOMINANT, 2); /* r1, r0 */
}

/* CRC to EOF. The CRC sequence is stuffed, also behind its last bit (F7). */
static void put_tail(writer *w, uint16_t inverted)
{
    w->bits->crc = w->crc ^ inverted;
    for (unsigned n = CW_CRC_BITS; n-- > 0;)
        put_stuffed(w, ((unsigned)w->bits->crc >> n) & 1u);
    for (unsigned n = 0; n < 3 + CW_EOF_BITS; n++) /* delimiter, ACK slot, delimiter, EOF */
        put_raw(w, CW_RECESSIVE);
}

cw_status cw_bits_encode_crc(cw_bits *bits, const cw_frame *frame, uint16_t inverted)
{
    if (!cw_frame_valid(frame))
        return CW_INVALID;
    memset(bits, 0, sizeof *bits);
    bits->extended = frame->flags & CW_FRAME_EXTENDED;
    bits->data_bits = (uint8_t)(8 * cw_frame_length(frame));
    writer w = {.bits = bits, .run = 0, .last = CW_RECESSIVE, .crc = 0};
    put_arbitration(&w, frame);
    put_field(&w, frame->dlc, 4);
    for (unsigned byte = 0; byte < cw_frame_length(frame); byte++)
        put_field(&w, frame->data[byte], 8);
    put_tail(&w, inverted);
    assert(bits->length <= CW_BITS_MAX);
    return CW_OK;
}

cw_status cw_bits_encode(cw_bits *bits, const cw_frame *frame)
{
    return cw_bits_encode_crc(bits, frame, 0);
}

bool cw_bits_level(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    return cw_bitset_get(bits->level, n);
}

static const uint8_t base_steps[] = {CW_STEP_SOF, CW_STEP_BASE_ID, CW_STEP_SRR_RTR, CW_STEP_IDE,
                                     CW_STEP_R0};
static const uint8_t extended_steps[] = {CW_STEP_SOF, CW_STEP_BASE_ID, CW_STEP_SRR_RTR,
                                         CW_STEP_IDE, CW_STEP_EXTENDED_ID, CW_STEP_RTR,
                                         CW_STEP_R1,  CW_STEP_R0};
static const uint8_t tail_steps[] = {CW_STEP_DLC,           CW_STEP_DATA,     CW_STEP_CRC,
                                     CW_STEP_CRC_DELIMITER, CW_STEP_ACK_SLOT, CW_STEP_ACK_DELIMITER,
                                     CW_STEP_EOF};

/* The step that holds bit *u of a row of steps, where *u counts no stuff bits and becomes the
 * index in that step; CW_STEP_COUNT when the row ends before. */
static cw_step find_step(unsigned *u, const uint8_t *row, size_t steps, unsigned data_bits)
{
    for (size_t i = 0; i < steps; i++) {
        unsigned length = row[i] == CW_STEP_DATA ? data_bits : cw_steps[row[i]].length;
        if (*u < length)
            return (cw_step)row[i];
        *u -= length;
    }
    return CW_STEP_COUNT;
}

cw_place cw_bits_place(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    unsigned u = n - cw_bitset_count_upto(bits->stuff, n);
    cw_step step = bits->extended ? find_step(&u, extended_steps, sizeof extended_steps, 0)
                                  : find_step(&u, base_steps, sizeof base_steps, 0);
    if (step == CW_STEP_COUNT)
        step = find_step(&u, tail_steps, sizeof tail_steps, bits->data_bits);
    assert(step != CW_STEP_COUNT);
    cw_place place = cw_step_place(step, u, bits->extended);
    place.stuff = cw_bitset_get(bits->stuff, n);
    return place;
}

bool cw_bits_is_at(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    if (field == CW_FIELD_BIT)
        return n == index;
    bool stuff = cw_bitset_get(bits->stuff, n);
    if (field == CW_FIELD_STUFF)
        return stuff && cw_bitset_count_upto(bits->stuff, n) == index + 1;
    if (stuff)
        return false;
    cw_place place = cw_bits_place(bits, n);
    return place.field == field && place.index == index;
}

unsigned cw_bits_wire_index(const cw_bits *bits, unsigned u)
{
    unsigned n = u;
    for (unsigned moved; (moved = u + cw_bitset_count_upto(bits->stuff, n)) != n;)
        n = moved;
    return n;
}

static bool find_stuff_bit(const cw_bits *bits, unsigned *n, unsigned index)
{
    for (*n = 0; *n < bits->length; (*n)++)
        if (cw_bitset_get(bits->stuff, *n) && index-- == 0)
            return true;
    return false;
}

/* As find_step(), for a position; *u is moved behind the row when it is not in there. */
static bool find_place(unsigned *u, const cw_bits *bits, const uint8_t *row, size_t steps,
                       cw_field field, unsigned index)
{
    for (size_t i = 0; i < steps; i++) {
        unsigned length = row[i] == CW_STEP_DATA ? bits->data_bits : cw_steps[row[i]].length;
        cw_place first = cw_step_place((cw_step)row[i], 0, bits->extended);
        if (first.field == field && index >= first.index && index < first.index + length) {
            *u += index - first.index;
            return true;
        }
        *u += length;
    }
    return false;
}

bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index)
{
    unsigned u = 0;
    *n = index;
    if (field == CW_FIELD_BIT)
        return index < bits->length;
    if (field == CW_FIELD_STUFF)
        return find_stuff_bit(bits, n, index);
    bool head = bits->extended ? find_place(&u, bits, extended_steps, sizeof extended_steps, field,
                                            index)
                               : find_place(&u, bits, base_steps, sizeof base_steps, field, index);
    if (!head && !find_place(&u, bits, tail_steps, sizeof tail_steps, field, index))
        return false;
    *n = cw_bits_wire_index(bits, u);
    return true;
}
