/* SPDX-License-Identifier: MIT
 *
 * frame.h - what the parts of the frame step share: frame_begin.c, frame_resume.c, frame.c (on the
 *           way), frame_end.c.
 */
#ifndef CANWIRE_STEP_FRAME_H
#define CANWIRE_STEP_FRAME_H

#include "bus/bus_private.h"

#include "format/layout.h"
#include "format/parts.h"

/* Begins with the frame that comes next, or takes it in one go (cw_frame_step_whole()). False, with
 * nothing done: it cannot be. */
bool cw_frame_step_begin(cw_bus *bus, uint64_t tick);

/* Begins amid a frame that has begun bit by bit. False, with nothing done: it cannot be. */
bool cw_frame_step_resume(cw_bus *bus);

/* A node's frame with its intermission in one go, without its bits; nobody sees more of it than its
 * end. False, with nothing done: it cannot be. */
bool cw_frame_step_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick);

/* A step that begins with the frame of a node; the caller says which one, and where in it. */
void cw_frame_step_prepare(cw_bus *bus, unsigned winner, uint64_t contenders);

/* Every arbitration is over after so many wire bits: the field with its SOF and stuff bits. */
static inline unsigned cw_frame_step_arbitration_bits(const cw_bus *bus)
{
    bool extended = bus->frame_step.frame.flags & CW_FRAME_EXTENDED;
    return CW_STUFFED_BITS_MAX(extended ? CW_EXTENDED_ARBITRATION_END : CW_BASE_ARBITRATION_END);
}

/* The frame on the wire in bits. Mostly nobody asks for them: then it is encoded into *room. */
static inline const cw_bits *cw_frame_step_bits(const cw_bus *bus, cw_bits *room)
{
    if (bus->frame_step.bits)
        return bus->frame_step.bits;
    (void)cw_bits_encode(room, &bus->frame_step.frame);
    return room;
}

/* Those of some nodes for whose next frame a rule waits, see cw_rules_watched(). */
uint64_t cw_find_watched(cw_bus *bus, uint64_t nodes, unsigned winner);

/* Whether some rule may act at or before the SOF of the next frames of watched nodes. */
bool cw_rules_act_first(const cw_bus *bus, uint64_t nodes);

/* The next bit of the frame on its way, from one on, at which a rule looks. */
cw_look cw_frame_step_next_look(const cw_bus *bus, unsigned from);

/* The frame on its way, as rules look at it. */
static inline cw_frame_view cw_frame_step_view(const cw_frame_step *step)
{
    return (cw_frame_view){.frame = &step->frame, .bits = step->bits, .node = step->node,
                           .at = step->at, .length = step->length, .last = CW_NOT_LOST};
}

/* Whether rules let its look pass: it is no hit, and the match is counted. */
static inline bool cw_frame_step_consume_look(cw_bus *bus)
{
    const cw_frame_view view = cw_frame_step_view(&bus->frame_step);
    return cw_rules_consume(&bus->rules, 0, &bus->frame_step.look, &view);
}

/* Whether noise leaves so many bits to come alone. */
static inline bool cw_frame_step_is_noise_free(const cw_bus *bus, unsigned bits)
{
    return bus->rules.awake_count == 0 || cw_rules_keep_quiet(&bus->rules, bits, true) == bits;
}

/* ---- losses.c -------------------------------------------------------------------------------- */

/* Keeps the frame that a node has begun with, whatever comes to its queue meanwhile. */
void cw_losses_pin_frame(bus_node *node);

/* All contenders begin to transmit; each loss is reported when its bit has passed. */
void cw_losses_begin(cw_bus *bus);

/* The same, with all losses counted at once: nobody sees the single ones. arbiter.c shares out
 * later what they add to the statistics of single nodes. */
void cw_losses_hide(cw_bus *bus);

/* Takes back what was counted at once for some of the hidden losers and lies ahead. */
void cw_losses_show(cw_bus *bus, uint64_t nodes);

/* Reports the losses of the bit that has passed, if it has some. */
void cw_losses_tell(cw_bus *bus);

#endif
