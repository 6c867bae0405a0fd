/* SPDX-License-Identifier: MIT
 *
 * mac_private.h - declarations that the parts of the controller share: mac.c (bit by bit), skip.c
 * (several bits at once), point.c (moved to the point of others).
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

/* Takes a bit of a frame that is no stuff bit; the caller increments the index. */
void cw_mac_take_bit(cw_mac *mac, bool level);

/* Returns the bits of the present part of the frame. */
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

/* Returns the level of the last bit taken of the present part. */
static inline bool cw_mac_last_level(const cw_mac *mac)
{
    return mac->shift & 1u;
}

/* Ends a part after its last bit. */
void cw_mac_end_part(cw_mac *mac, cw_mac_report *report);

/* Returns true when the next bit is a stuff bit (F7). */
bool cw_mac_stuff_bit_due(const cw_mac *mac);

/* Returns true while the controller sends an active error flag or an overload flag. */
bool cw_mac_in_dominant_flag(const cw_mac *mac);

/* End a flag and the intermission after their last bits. */
void cw_mac_end_flag(cw_mac *mac);
void cw_mac_end_intermission(cw_mac *mac);

#endif
