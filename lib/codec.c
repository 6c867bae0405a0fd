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

cw_step cw_bits_step(const cw_bits *bits, unsigned u, uint8_t *index)
{
    cw_step step = bits->extended ? find_step(&u, extended_steps, sizeof extended_steps, 0)
                                  : find_step(&u, base_steps, sizeof base_steps, 0);
    if (step == CW_STEP_COUNT)
        step = find_step(&u, tail_steps, sizeof tail_steps, bits->data_bits);
    assert(step != CW_STEP_COUNT);
    *index = (uint8_t)u;
    return step;
}

cw_place cw_bits_place(const cw_bits *bits, unsigned n)
{
    assert(n < bits->length);
    uint8_t index;
    cw_step step = cw_bits_step(bits, n - cw_bitset_count_upto(bits->stuff, n), &index);
    cw_place place = cw_step_place(step, index, bits->extended);
    place.stuff = cw_bitset_get(bits->stuff, n);
    return place;
}

bool cw_bits_is_at(const cw_bits *bits, unsigned n, cw_field field, unsigned index)
{
    unsigned found;
    return cw_bits_find(bits, &found, field, index) && found == n;
}

/* ---- From positions to wire bits ------------------------------------------------------------- */

/* Where a field lies in a frame without stuff bits and data; what is behind the data lies further
 * back by its bits. A field that the frame has not is 0 bits long. */
typedef struct field_span {
    uint8_t first;
    uint8_t length;
} field_span;

static const field_span base_fields[CW_FIELD_COUNT] = {
    [CW_FIELD_SOF] = {0, 1},       [CW_FIELD_ID] = {1, CW_BASE_ID_BITS},
    [CW_FIELD_RTR] = {12, 1},      [CW_FIELD_IDE] = {13, 1},
    [CW_FIELD_R0] = {14, 1},       [CW_FIELD_DLC] = {15, 4},
    [CW_FIELD_DATA] = {19, 0},     [CW_FIELD_CRC] = {19, CW_CRC_BITS},
    [CW_FIELD_CRC_DELIMITER] = {34, 1}, [CW_FIELD_ACK_SLOT] = {35, 1},
    [CW_FIELD_ACK_DELIMITER] = {36, 1}, [CW_FIELD_EOF] = {37, CW_EOF_BITS},
};

static const field_span extended_fields[CW_FIELD_COUNT] = {
    [CW_FIELD_SOF] = {0, 1},       [CW_FIELD_ID] = {1, CW_EXTENDED_ID_BITS},
    [CW_FIELD_SRR] = {12, 1},      [CW_FIELD_IDE] = {13, 1},
    [CW_FIELD_RTR] = {32, 1},      [CW_FIELD_R1] = {33, 1},
    [CW_FIELD_R0] = {34, 1},       [CW_FIELD_DLC] = {35, 4},
    [CW_FIELD_DATA] = {39, 0},     [CW_FIELD_CRC] = {39, CW_CRC_BITS},
    [CW_FIELD_CRC_DELIMITER] = {54, 1}, [CW_FIELD_ACK_SLOT] = {55, 1},
    [CW_FIELD_ACK_DELIMITER] = {56, 1}, [CW_FIELD_EOF] = {57, CW_EOF_BITS},
};

/* Where a position is when stuff bits do not count; false when there is none. */
static inline bool find_unstuffed(unsigned *u, bool extended, unsigned data_bits, cw_field field,
                                  unsigned index)
{
    const field_span *span = extended ? &extended_fields[field] : &base_fields[field];
    if (index >= (field == CW_FIELD_DATA ? data_bits : span->length))
        return false;
    *u = span->first + index;
    if (field == CW_FIELD_ID && index >= CW_BASE_ID_BITS)
        *u += 2; /* SRR and IDE lie in between */
    if (field > CW_FIELD_DATA)
        *u += data_bits;
    return true;
}

bool cw_frame_find(const cw_frame *frame, unsigned *n, cw_field field, unsigned index)
{
    return find_unstuffed(n, frame->flags & CW_FRAME_EXTENDED, 8 * cw_frame_length(frame), field,
                          index);
}

/* Each stuff bit at or before it moves a bit further back. */
unsigned cw_bits_wire_index(const cw_bits *bits, unsigned u)
{
    unsigned n = u;
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = bits->stuff[word]; rest; rest &= rest - 1) {
            if (64 * word + (unsigned)__builtin_ctzll(rest) > n)
                return n;
            n++;
        }
    return n;
}

static bool find_stuff_bit(const cw_bits *bits, unsigned *n, unsigned index)
{
    for (unsigned word = 0; word < CW_BIT_WORDS; word++)
        for (uint64_t rest = bits->stuff[word]; rest; rest &= rest - 1)
            if (index-- == 0) {
                *n = 64 * word + (unsigned)__builtin_ctzll(rest);
                return true;
            }
    return false;
}

bool cw_bits_find(const cw_bits *bits, unsigned *n, cw_field field, unsigned index)
{
    *n = index;
    if (field == CW_FIELD_BIT)
        return index < bits->length;
    if (field == CW_FIELD_STUFF)
        return find_stuff_bit(bits, n, index);
    unsigned u;
    if (!find_unstuffed(&u, bits->extended, bits->data_bits, field, index))
        return false;
    *n = cw_bits_wire_index(bits, u);
    return true;
}
