/* SPDX-License-Identifier: MIT
 *
 * lengths.h - the most bits that a frame can have, and the time that they need.
 */
#ifndef CANWIRE_CLI_ANALYSE_LENGTHS_H
#define CANWIRE_CLI_ANALYSE_LENGTHS_H

#include "config/config.h"

#define LENGTHS_INTERMISSION_BITS 3u

/* Returns the most bits of a frame from SOF to the end of its intermission, whatever its data.
 * *fast are those of them at the data rate. */
unsigned lengths_longest_bits(const cw_frame *frame, unsigned *fast);

/* Returns the time of these bits, of which some are at the data rate: ticks, rounded up. */
uint64_t lengths_time(const cfg *config, unsigned bits, unsigned fast);

#endif
