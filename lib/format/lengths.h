/* SPDX-License-Identifier: MIT
 *
 * lengths.h - remembers the lengths of classical frames by their content, since most traffic sends
 * the same frames over and over.
 */
#ifndef CANWIRE_FORMAT_LENGTHS_H
#define CANWIRE_FORMAT_LENGTHS_H

#include "format/frame.h"

#include <string.h>

#define CW_LENGTHS 1024u /* frames at most: pairs of them, by a hash of their contents */
#define CW_LENGTHS_SHIFT 55u /* leaves the number of a pair of a hash */
#define CW_LENGTH_AT 48u /* place of the length above the rest of the head */

_Static_assert(CW_LENGTHS == UINT64_C(2) << (64 - CW_LENGTHS_SHIFT), "pairs");

typedef struct cw_known_length {
    uint64_t head; /* identifier, flags, DLC and length; all bits are set where there is none */
    uint64_t data; /* with bytes that are not sent, which make another frame */
} cw_known_length;

typedef struct cw_lengths {
    cw_known_length known[CW_LENGTHS];
} cw_lengths;

/* Forgets all frames. */
static inline void cw_lengths_clear(cw_lengths *lengths)
{
    memset(lengths, 0xFF, sizeof *lengths);
}

/* Measures a frame that is not known, and remembers it in the place of one of a pair. Returns its
 * length. */
unsigned cw_lengths_learn(cw_known_length pair[2], const cw_frame *frame, uint64_t head,
                          uint64_t data);

/* Does the same as cw_bits_measure_classical(). */
static inline unsigned cw_lengths_of(cw_lengths *lengths, const cw_frame *frame)
{
    const uint64_t head = frame->id | (uint64_t)(frame->flags | (unsigned)frame->dlc << 8) << 32;
    uint64_t data;
    memcpy(&data, frame->data, sizeof data);
    const uint64_t hash = (head ^ data) * UINT64_C(0x9E3779B97F4A7C15);
    cw_known_length *pair = &lengths->known[hash >> CW_LENGTHS_SHIFT << 1];
    for (unsigned i = 0; i < 2; i++)
        if (pair[i].data == data && (pair[i].head ^ head) << (64 - CW_LENGTH_AT) == 0)
            return (unsigned)(pair[i].head >> CW_LENGTH_AT);
    return cw_lengths_learn(pair, frame, head, data);
}

#endif
