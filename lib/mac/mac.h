/* SPDX-License-Identifier: MIT
 *
 * mac.h - the functions of a controller that the bus needs beyond the public test-bench interface.
 */
#ifndef CANWIRE_MAC_H
#define CANWIRE_MAC_H

#include "format/bits.h"
#include "format/frame.h"
#include "format/parts.h"
#include "time/rate.h"

#define CW_INTEGRATION_BITS 11u
#define CW_RECOVERY_GROUPS 128u
#define CW_FLAG_BITS 6u
#define CW_DELIMITER_BITS 8u
#define CW_QUIET_FOREVER CW_BITS_FOREVER

/* Modes in which a frame is tried once (M13, L1). */
#define CW_MODES_SINGLE (CW_MODE_ONE_SHOT | CW_MODE_TIME_TRIGGERED)

/* Modes in which a controller does something else than others do at the same levels. */
#define CW_MODES_APART                                                                             \
    (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK | CW_MODE_RESTRICTED | CW_MODE_TIME_TRIGGERED)

/* A report for the bus, of controllers with `tells_won`: the own frame has won the arbitration, all
 * bits of which have passed. */
#define CW_REPORT_ARBITRATION_WON 0x400u

/* Returns true when the controller is neither taken off the bus nor bus-off. */
bool cw_mac_is_on_bus(const cw_mac *mac);

/* Sends an error flag now, as if an error had been detected; the counters move by R1 and R3.
 * Nothing happens when the controller is not on the bus. Returns true when the frame being sent was
 * given up (one-shot); bus-off takes an offer back without a report. */
bool cw_mac_force_error(cw_mac *mac);

/* Returns a lower limit of the bits in which the controller reports nothing, and keeps its level
 * but for the end of a flag. The wire has the given level in all of them. Returns 0 when the next
 * bit must be simulated, and CW_QUIET_FOREVER for any number of bits. */
uint64_t cw_mac_steady_bits(const cw_mac *mac, bool level);

/* Takes that many bits at once; at most cw_mac_steady_bits(). */
void cw_mac_skip(cw_mac *mac, uint64_t bits, bool level);

/* Returns true when an edge now, before the next sample, synchronises hard (T4, D12). */
bool cw_mac_synchronises_hard(const cw_mac *mac);

/* Returns true when the controller is at the data rate: from the sample point of BRS to that of the
 * CRC delimiter (D10). */
static inline bool cw_mac_is_fast(const cw_mac *mac)
{
    return mac->fd && mac->fd->fast;
}

/* Return true when the bit in progress is the one at whose sample point the data phase begins, or
 * ends, if no fault comes (D10). */
static inline bool cw_mac_begins_data_phase(const cw_mac *mac)
{
    return mac->fd && mac->phase == CW_MAC_FRAME && mac->part == CW_PART_BRS;
}

static inline bool cw_mac_ends_data_phase(const cw_mac *mac)
{
    return mac->phase == CW_MAC_FRAME && mac->part == CW_PART_CRC_DELIMITER;
}

/* Returns true in res and BRS. A transmitter measures its delay in res (D13). */
static inline bool cw_mac_comes_to_data_phase(const cw_mac *mac)
{
    return mac->fd && mac->phase == CW_MAC_FRAME &&
           (mac->part == CW_PART_RES || mac->part == CW_PART_BRS);
}

#define CW_VARIANTS_ALL                                                                            \
    (CW_VARIANT_NO_HIGH_IDS | CW_VARIANT_NO_LONG_DLC | CW_VARIANT_REC_HOLDS |                      \
     CW_VARIANT_SILENT_PASSIVE)

/* Returns those that the controller itself knows. */
static inline unsigned cw_mac_variants(const cw_mac *mac)
{
    return (mac->no_high_ids ? CW_VARIANT_NO_HIGH_IDS : 0) |
           (mac->no_long_dlc ? CW_VARIANT_NO_LONG_DLC : 0) |
           (mac->confinement.holds_rec ? CW_VARIANT_REC_HOLDS : 0);
}

/* Returns true when the controller and another one are of the same variant on the wire. */
static inline bool cw_mac_same_variant(const cw_mac *a, const cw_mac *b)
{
    return a->no_high_ids == b->no_high_ids && a->no_long_dlc == b->no_long_dlc;
}

/* Returns true when a frame is valid, and one that the controller can send (D17). */
static inline bool cw_mac_knows(const cw_mac *mac, const cw_frame *frame)
{
    if ((mac->no_high_ids || mac->no_long_dlc) &&
        cw_frame_is_refused(frame, cw_mac_variants(mac)))
        return false;
    if (!(frame->flags & (CW_FRAME_FD | CW_FRAME_EXTENDED)))
        return cw_frame_valid(frame);
    const bool old = mac->protocol & (CW_PROTOCOL_2_0A | CW_PROTOCOL_2_0B_PASSIVE);
    return cw_frame_valid(frame) && (!cw_frame_is_fd(frame) || mac->fd) &&
           !(old && cw_frame_is_extended(frame));
}

/* Returns true when a cw_protocol goes together with these CW_PROTOCOL_*. */
bool cw_protocol_valid(unsigned protocol);

/* Returns true when an edge makes the controller count anew, see cw_mac_note_edge(). */
bool cw_mac_counts_edges(const cw_mac *mac);

/* Returns false when edges do not move the controller: it is transmitter, in the data phase
 * (D12). */
static inline bool cw_mac_synchronises(const cw_mac *mac)
{
    return !cw_mac_is_fast(mac) || mac->role != CW_ROLE_TRANSMITTER;
}

/* Notes an edge that synchronises: a controller that waits for 11 recessive bits counts anew
 * (D16, D20). A classical controller does not look at edges there. */
void cw_mac_note_edge(cw_mac *mac);

/* Returns true when the transmitter compares the bit in progress later, and not at its sample point
 * (D13). */
bool cw_mac_compares_late(const cw_mac *mac);

/* Notes that a comparison has found an error. The controller acts on the first one at its next
 * sample point, as long as the data phase lasts (D13). */
void cw_mac_note_late_error(cw_mac *mac, cw_error_type error);

/* Returns true when the controller sends no frames of its own (M11, D19). */
static inline bool cw_mac_only_receives(const cw_mac *mac)
{
    return mac->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED);
}

/* Does the same as cw_mac_can_start(). */
static inline bool cw_mac_may_start(const cw_mac *mac)
{
    const bool free = mac->phase == CW_MAC_IDLE || (mac->phase == CW_MAC_FRAME && mac->may_join);
    return free && !cw_mac_only_receives(mac);
}

/* Returns the wire bits of the offered frame. */
static inline const cw_bits *cw_mac_tx(const cw_mac *mac)
{
    return mac->fd ? &mac->fd->tx : (const cw_bits *)(const void *)&mac->tx;
}

/* Returns the CW_FRAME_* with which the controller would send an FD frame of these flags now. ESI
 * is its error state (D8). */
unsigned cw_mac_fd_flags(const cw_mac *mac, unsigned flags);

/* Returns the frame of the bits of cw_mac_tx(), as far as the controller keeps it: NULL if it knows
 * no FD frames. */
static inline const cw_frame *cw_mac_offered(const cw_mac *mac)
{
    return mac->fd ? &mac->fd->offer : NULL;
}

/* Encodes the offered frame, see cw_bits_encode_crc(). */
void cw_mac_encode(cw_mac *mac, const cw_frame *frame, unsigned inverted);

/* Returns the level that the controller drives in the next bit, if it begins no frame. */
bool cw_mac_level(const cw_mac *mac);

/* Returns true when the controller drives this level in the next bit, whatever its host hands in
 * before that. Then it drives it from now on. */
bool cw_mac_drives_on(cw_mac *mac, bool level);

/* Returns the bits in which a flag of the controller keeps the wire dominant, from the next one on;
 * 0: none does. */
static inline unsigned cw_mac_holds_wire(const cw_mac *mac)
{
    const bool flag = mac->phase == CW_MAC_ERROR_ACTIVE || mac->phase == CW_MAC_OVERLOAD_FLAG;
    return flag && !(mac->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK))
               ? CW_FLAG_BITS - mac->count : 0;
}

/* Returns a lower limit of the bits until this controller ends something that a host sees (a frame,
 * a recovery), if no frame comes in. Returns CW_QUIET_FOREVER when the end does not depend on this
 * controller. waiting: a frame waits to be sent. */
uint64_t cw_mac_horizon(const cw_mac *mac, bool waiting);

/* Returns true when both controllers are at the same point of the same frame or between frames, and
 * neither is the transmitter. Equal levels then have equal effects on both, except for counters,
 * modes and the frames that they want to send. */
bool cw_mac_same_point(const cw_mac *a, const cw_mac *b);

/* Returns true when both controllers are in a frame and have read the same bits of it, whether they
 * send it or not. */
bool cw_mac_reads_the_same(const cw_mac *a, const cw_mac *b);

/* Moves a controller to the point of another one, which is not a transmitter. Counters, modes and
 * the offered frame stay. */
void cw_mac_go_to_point(cw_mac *mac, const cw_mac *there);

/* Moves a controller to the point of an idle receiver after n wire bits of a frame without errors,
 * n at least 1. After the frame comes its intermission. The ACK slot was dominant. */
void cw_mac_go_into_frame(cw_mac *mac, const cw_frame *frame, const cw_bits *bits,
                          const cw_stuffing *stuffing, unsigned n);

/* Moves an idle controller, or one in the intermission, to the intermission of the next frame. The
 * frame had no errors. That many bits of its intermission have passed. */
void cw_mac_go_behind_frame(cw_mac *mac, cw_role role, unsigned bits);

/* Makes a receiver at a point of its own offered frame the transmitter of that frame. That many
 * bits of it are on the wire. */
void cw_mac_become_transmitter(cw_mac *mac, unsigned bits);

/* Returns true when the bit before the next one was a SOF that the controller has sampled. */
static inline bool cw_mac_has_seen_sof(const cw_mac *mac)
{
    return mac->phase == CW_MAC_FRAME && mac->part == CW_PART_BASE_ID && mac->index == 0;
}

/* Returns true when the next bit belongs to a frame, its intermission or to error signalling. */
bool cw_mac_is_busy(const cw_mac *mac);

/* Returns the level that the controller takes when the wire carries this one. Bus monitoring routes
 * its own dominant bits back (M11); loopback takes nothing but its own bits (M15). */
bool cw_mac_visible(const cw_mac *mac, bool level);

/* Returns true when the own frame is on the wire; *n is then its next wire bit. */
bool cw_mac_own_bit(const cw_mac *mac, unsigned *n);

#endif
