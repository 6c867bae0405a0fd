/* SPDX-License-Identifier: MIT
 *
 * lengths.c - learns the lengths of frames.
 */
#include "format/lengths.h"

#include "format/bits.h"

unsigned cw_lengths_learn(cw_known_length pair[2], const cw_frame *frame, uint64_t head,
                          uint64_t data)
{
    const unsigned bits = cw_bits_measure_classical(frame);
    pair[1] = pair[0];
    pair[0] = (cw_known_length){.head = head | (uint64_t)bits << CW_LENGTH_AT, .data = data};
    return bits;
}
