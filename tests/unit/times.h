/* SPDX-License-Identifier: MIT
 *
 * times.h - when something is on the wire, for unit tests: lengths in bits, ends of bits.
 */
#ifndef CANWIRE_TEST_TIMES_H
#define CANWIRE_TEST_TIMES_H

#include "rig.h"

#define EXTENDED CW_FRAME_EXTENDED
#define ACK_FROM_END 9u        /* the ACK slot is the ninth wire bit from the end */
#define ERROR_FRAME_BITS 14u   /* flag 6, delimiter 8 */
#define INTERMISSION_BITS 3u
#define RECOVERY_BITS (128u * 11u)

/* Returns the end of wire bit n of a frame whose SOF is the given bit. */
static inline uint64_t end_of(uint64_t sof, uint64_t n)
{
    return (sof + n + 1) * BIT;
}

#endif
