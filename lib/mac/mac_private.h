/* SPDX-License-Identifier: MIT
 *
 * mac_private.h - declarations that the parts of the controller share.
 *
 *   mac.c    bit by bit
 *   fd.c     additions for FD frames
 *   late.c   transmitter delay compensation
 *   skip.c   several bits at once
 *   point.c  moved to the point of others
 */
#ifndef CANWIRE_MAC_PRIVATE_H
#define CANWIRE_MAC_PRIVATE_H

#include "format/frame.h"
#include "format/parts.h"
#include "mac/mac.h"

static inline bool cw_mac_is_transmitter(const cw_mac *mac)
{
    return mac->role == CW_ROLE_TRANSMITTER;
}

/* Enters a phase. All but frames are at the nominal rate, and a frame begins so (D10). */
static inline void cw_mac_enter(cw_mac *mac, cw_mac_phase phase)
{
    mac->phase = (uint8_t)phase;
    mac->count = 0;
    if (mac->fd)
        mac->fd->fast = false;
}

/* Returns the frame being received. */
static inline cw_frame *cw_mac_rx(cw_mac *mac)
{
    return mac->fd ? &mac->fd->rx : (cw_frame *)(void *)&mac->rx;
}

/* Returns true once the present frame is known to be an FD frame. */
static inline bool cw_mac_in_fd_frame(const cw_mac *mac)
{
    return mac->fd && (mac->fd->rx.flags & CW_FRAME_FD);
}

/* Enters idle: the role ends. A controller that is to sleep falls asleep instead. */
void cw_mac_become_idle(cw_mac *mac);

/* Enters a frame at its SOF, in a role. Nothing is left of the frame before. */
void cw_mac_begin_frame(cw_mac *mac, cw_role role);

/* Takes a bit of a frame that is not a stuff bit; the caller increments the index. */
void cw_mac_take_bit(cw_mac *mac, bool level);

/* Returns the bits of the present part of the frame. */
static inline unsigned cw_mac_part_bits(const cw_mac *mac)
{
    return mac->part_bits;
}

/* Returns true when the present part has fixed stuff bits (D4). */
static inline bool cw_mac_has_fixed_stuffing(const cw_mac *mac)
{
    return cw_part_is((cw_part)mac->part, CW_PART_FIXED_STUFFED) && cw_mac_in_fd_frame(mac);
}

/* Returns whether the present part of the frame has a flag, CW_PART_STUFFED etc. */
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

/* Returns true when the next bit is a stuff bit (F7), also after the last CRC bit. After that, run
 * stays as it is, below the limit. */
static inline bool cw_mac_stuff_bit_due(const cw_mac *mac)
{
    return mac->run == CW_STUFF_RUN;
}

/* Returns true while the own frame is on the wire. */
static inline bool cw_mac_sends(const cw_mac *mac)
{
    return mac->phase == CW_MAC_FRAME && cw_mac_is_transmitter(mac);
}

/* Returns true while the controller sends an active error flag or an overload flag. */
static inline bool cw_mac_in_dominant_flag(const cw_mac *mac)
{
    return mac->phase == CW_MAC_ERROR_ACTIVE || mac->phase == CW_MAC_OVERLOAD_FLAG;
}

/* Returns true when the bus does not see the own level (M11, M15). */
static inline bool cw_mac_is_hidden(const cw_mac *mac)
{
    return mac->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK);
}

/* Leaves the bus as after cw_mac_init(), until it has been idle for long enough (M10). */
void cw_mac_integrate(cw_mac *mac);

/* Ends a group of 11 recessive bits of a controller that integrates. */
void cw_mac_end_integration(cw_mac *mac);

/* ---- fd.c, for controllers with a part for FD ------------------------------------------------ */

/* Begins a frame. */
void cw_mac_fd_begin(cw_mac *mac);

/* Adds a level to the check sequences, with stuff bits (D6). */
void cw_mac_fd_add_to_crc(cw_fd_part *fd, bool level);

/* The effects of the ends of parts. */
void cw_mac_fd_take_fdf(cw_mac *mac);
void cw_mac_fd_take_brs(cw_mac *mac);
void cw_mac_fd_take_esi(cw_mac *mac);
bool cw_mac_fd_crc_error(const cw_mac *mac);

/* Gives the offer, of which no bit after ESI is on the wire, the error state as it is now (D8). */
void cw_mac_fd_renew_esi(cw_mac *mac);

/* Does this when ESI is the next bit. */
void cw_mac_fd_update_esi(cw_mac *mac);

/* Returns true when a transmitter that compares late does not look at the CRC delimiter (D13). */
bool cw_mac_passes_delimiter(const cw_mac *mac);

/* Returns the number of the fixed stuff bit that is due. */
unsigned cw_mac_fd_fixed_number(const cw_mac *mac);

/* Encodes the offer, with the error state as it is now, and with some bits of the CRC inverted. */
void cw_mac_fd_encode(cw_mac *mac, const cw_frame *frame, unsigned inverted);

/* End a flag and the intermission after their last bits. */
void cw_mac_end_flag(cw_mac *mac);
void cw_mac_end_intermission(cw_mac *mac);

#endif
