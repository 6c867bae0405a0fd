/* SPDX-License-Identifier: MIT
 *
 * frame.h - what the parts of the frame step share: frame_begin.c, frame_resume.c, frame.c (on the
 *           way), frame_end.c.
 */
#ifndef CANWIRE_LEAP_H
#define CANWIRE_LEAP_H

#include "bus/bus_private.h"

#include "format/layout.h"
#include "format/parts.h"

/* A node's frame with its intermission in one go, without its bits; nobody sees more of it than its
 * end. False, with nothing done: it cannot be. */
bool cw_leap_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick);

/* A leap that begins with the frame of a node; which one and where in it is left to the caller. */
void cw_leap_prepare(cw_bus *bus, unsigned winner, uint64_t contenders);

/* All lost arbitrations at once; what they add to single nodes is shared out later
 * (arbiter.c). */
void cw_leap_count_losses(cw_bus *bus);

/* Every arbitration is over after so many wire bits: the field with its SOF and stuff bits. */
static inline unsigned cw_leap_arbitration_bits(const cw_bus *bus)
{
    bool extended = bus->leap.frame.flags & CW_FRAME_EXTENDED;
    return CW_STUFFED_BITS_MAX(extended ? CW_EXTENDED_ARBITRATION_END : CW_BASE_ARBITRATION_END);
}

/* The frame on the wire in bits. Mostly nobody asks for them: then it is encoded into *room. */
static inline const cw_bits *cw_leap_bits(const cw_bus *bus, cw_bits *room)
{
    if (bus->leap.bits)
        return bus->leap.bits;
    (void)cw_bits_encode(room, &bus->leap.frame);
    return room;
}

/* Where a contender loses to the frame with these bits, and with which frame. */
void cw_leap_find_loss(cw_bus *bus, unsigned node, const cw_bits *bits);

/* Whether noise leaves so many bits to come alone. */
static inline bool cw_leap_is_noise_free(const cw_bus *bus, unsigned bits)
{
    return bus->rules.awake_count == 0 || cw_rules_keep_quiet(bus, bits, true) == bits;
}

#endif
