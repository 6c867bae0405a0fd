/* SPDX-License-Identifier: MIT
 *
 * lengths.c - the most bits that a frame can have, and the time that they need.
 *
 * The most stuff bits come with five equal bits, and then with four behind each stuff bit. So there
 * is one for each four bits behind the first one.
 */
#include "cli/analyse/lengths.h"

#define STUFF_EVERY 4u
/* Bits from SOF to the last one of the CRC: without data, of base and extended frames. */
#define BASE_STUFFED 34u
#define EXTENDED_STUFFED 54u
#define CLASSICAL_TAIL 10u /* CRC delimiter, ACK slot and delimiter, EOF */
/* CAN FD: SOF to BRS, of base and extended frames; ESI and DLC; behind the CRC. */
#define FD_BASE_HEAD 17u
#define FD_EXTENDED_HEAD 36u
#define FD_ESI_DLC 5u
#define FD_TAIL 11u /* CRC delimiter, ACK slot of two bits, ACK delimiter, EOF */
#define FD_SHORT_CRC 27u /* with stuff count and fixed stuff bits, up to 16 bytes */
#define FD_LONG_CRC 32u
#define FD_SHORT_CRC_NON_ISO 22u
#define FD_LONG_CRC_NON_ISO 27u
#define FD_SHORT_BYTES 16u

static unsigned most_stuff_bits(unsigned bits)
{
    return (bits - 1) / STUFF_EVERY;
}

/* Returns the bits of a classical frame with as many stuff bits as any data can cause. */
static unsigned longest_classical(const cw_frame *frame)
{
    const unsigned head =
        frame->flags & CW_FRAME_EXTENDED ? EXTENDED_STUFFED : BASE_STUFFED;
    const unsigned stuffed = head + 8 * cw_frame_length(frame);
    return stuffed + most_stuff_bits(stuffed) + CLASSICAL_TAIL + LENGTHS_INTERMISSION_BITS;
}

/* Returns the bits from stuff count to CRC, with their fixed stuff bits; without ISO there is no
 * count. */
static unsigned fd_crc_bits(const cw_frame *frame)
{
    const bool is_short = cw_frame_length(frame) <= FD_SHORT_BYTES;
    if (frame->flags & CW_FRAME_NON_ISO)
        return is_short ? FD_SHORT_CRC_NON_ISO : FD_LONG_CRC_NON_ISO;
    return is_short ? FD_SHORT_CRC : FD_LONG_CRC;
}

/* A stuff bit before ESI is a nominal one, and there may be as many as the head allows. */
static unsigned longest_fd(const cw_frame *frame, unsigned *fast)
{
    const unsigned head = frame->flags & CW_FRAME_EXTENDED ? FD_EXTENDED_HEAD : FD_BASE_HEAD;
    const unsigned stuffed = head + FD_ESI_DLC + 8 * cw_frame_length(frame);
    const unsigned bits = stuffed + most_stuff_bits(stuffed) + fd_crc_bits(frame) + FD_TAIL +
                          LENGTHS_INTERMISSION_BITS;
    const unsigned nominal = head + most_stuff_bits(head) + FD_TAIL + LENGTHS_INTERMISSION_BITS;
    *fast = frame->flags & CW_FRAME_BRS ? bits - nominal : 0;
    return bits;
}

unsigned lengths_longest_bits(const cw_frame *frame, unsigned *fast)
{
    *fast = 0;
    return frame->flags & CW_FRAME_FD ? longest_fd(frame, fast) : longest_classical(frame);
}

uint64_t lengths_time(const cfg *config, unsigned bits, unsigned fast)
{
    const uint64_t nominal = cw_rate_ticks(config->rate, bits - (config->dbitrate_bps ? fast : 0));
    if (config->dbitrate_bps == 0)
        return nominal;
    return nominal + ((uint64_t)fast * CW_CLOCK_HZ + config->dbitrate_bps - 1) /
                         config->dbitrate_bps;
}
