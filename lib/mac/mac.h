/* SPDX-License-Identifier: MIT
 *
 * mac.h - what the bus needs of a controller beyond the public test-bench interface.
 */
#ifndef CANWIRE_MAC_H
#define CANWIRE_MAC_H

#include "time/rate.h"

#define CW_INTEGRATION_BITS 11u
#define CW_RECOVERY_GROUPS 128u
#define CW_FLAG_BITS 6u
#define CW_DELIMITER_BITS 8u
#define CW_QUIET_FOREVER CW_BITS_FOREVER

/* Neither taken off the bus nor bus-off. */
bool cw_mac_is_on_bus(const cw_mac *mac);

/* Sends an error flag now, as if an error had been detected; the counters move as by R1 and R3.
 * Nothing happens when the controller is not on the bus. Returns whether the frame being sent
 * was given up (one-shot); bus-off takes an offer back without a word. */
bool cw_mac_force_error(cw_mac *mac);

/* Bits, at least, in which the controller goes on driving what it drives, with nothing to report,
 * when the wire has this level in all of them; 0 when the next bit must be simulated.
 * CW_QUIET_FOREVER: any number. */
uint64_t cw_mac_steady_bits(const cw_mac *mac, bool level);

/* Takes that many bits at once, bits <= cw_mac_steady_bits(). */
void cw_mac_skip(cw_mac *mac, uint64_t bits, bool level);

/* Whether its flag keeps the wire dominant. */
bool cw_mac_holds_wire(const cw_mac *mac);

/* Bits, at least, until this controller ends something that a host sees (a frame, a recovery),
 * if nothing is put in; CW_QUIET_FOREVER when it is not up to it. waiting: a frame waits to be
 * sent. */
uint64_t cw_mac_horizon(const cw_mac *mac, bool waiting);

/* Whether both are at the same point of the same frame or between frames, both not as
 * transmitters, so that the same levels take them the same way but for counters, modes and what
 * they want to send. */
bool cw_mac_same_point(const cw_mac *a, const cw_mac *b);

/* Whether it receives what another one sends, and has read the same bits of it. */
bool cw_mac_reads_along(const cw_mac *mac, const cw_mac *sender);

/* Idle from now on, as a receiver is after the intermission. */
void cw_mac_rest(cw_mac *mac);

/* Goes to the point where another controller is, which is no transmitter. Counters, modes and the
 * offered frame stay. */
void cw_mac_go_to_point(cw_mac *mac, const cw_mac *there);

/* Goes to where an idle receiver is after n wire bits of a frame, n at least 1, without errors;
 * then its intermission. The ACK slot was dominant. */
void cw_mac_go_into_frame(cw_mac *mac, const cw_frame *frame, const cw_bits *bits, unsigned n);

/* A controller at a point as a receiver turns out to be the transmitter of its offered frame, of
 * which so many bits are on the wire. */
void cw_mac_become_transmitter(cw_mac *mac, unsigned bits);

/* Whether the bit that comes next belongs to a frame, its intermission or to error signalling. */
bool cw_mac_is_busy(const cw_mac *mac);

/* The level that the controller takes when the wire carries this one: bus monitoring routes its own
 * dominant bits back (M11), loopback nothing but its own bits (M15). */
bool cw_mac_visible(const cw_mac *mac, bool level);

/* Whether the own frame on the wire has bits left; then the wire bit that comes next in it. */
bool cw_mac_own_bit(const cw_mac *mac, unsigned *n);

#endif
