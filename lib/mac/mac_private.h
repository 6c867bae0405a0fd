/* SPDX-License-Identifier: MIT
 *
 * mac_private.h - what the parts of the controller share: mac.c (bit by bit), skip.c (several
 *                 bits at once), point.c (put to where others are).
 */
#ifndef CANWIRE_MAC_PRIVATE_H
#define CANWIRE_MAC_PRIVATE_H

#include "format/parts.h"
#include "mac/mac.h"

static inline bool cw_mac_is_transmitter(const cw_mac *mac)
{
    return mac->role == CW_ROLE_TRANSMITTER;
}

static inline void cw_mac_enter(cw_mac *mac, cw_mac_phase phase)
{
    mac->phase = (uint8_t)phase;
    mac->count = 0;
}

void cw_mac_become_idle(cw_mac *mac);
void cw_mac_begin_frame(cw_mac *mac, cw_role role);

/* Takes a bit of a frame that is no stuff bit; the caller counts the index on. */
void cw_mac_take_bit(cw_mac *mac, bool level);

/* Bits of the present part of the frame. */
static inline unsigned cw_mac_part_bits(const cw_mac *mac)
{
    if (mac->part == CW_PART_DATA)
        return 8 * cw_frame_length(&mac->rx);
    return cw_parts[mac->part].bits;
}

static inline bool cw_mac_part_is(const cw_mac *mac, unsigned flag)
{
    return cw_part_is((cw_part)mac->part, flag);
}

/* The level of the bit of the present part that was taken last. */
static inline bool cw_mac_last_level(const cw_mac *mac)
{
    return mac->shift & 1u;
}

/* What follows the last bit of a part. */
void cw_mac_end_part(cw_mac *mac, cw_mac_report *report);

/* Whether the bit that comes next is a stuff bit (F7). */
bool cw_mac_stuff_bit_due(const cw_mac *mac);

/* Whether it sends an active error flag or an overload flag. */
bool cw_mac_in_dominant_flag(const cw_mac *mac);

/* What follows the last bit of a flag, and that of the intermission. */
void cw_mac_end_flag(cw_mac *mac);
void cw_mac_end_intermission(cw_mac *mac);

#endif
