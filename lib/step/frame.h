/* SPDX-License-Identifier: MIT
 *
 * frame.h - declarations that the parts of the frame step share.
 *
 *   frame.c         goes on from one moment to the next
 *   frame_begin.c   begins with the next frame; frame_whole.c takes it at once
 *   frame_moment.c  acts at the end of single bits; losses.c finds lost arbitrations
 *   frame_look.c    finds the bits that rules look at; frame_read.c answers functions that read
 *   frame_end.c     ends a step before its frame ends
 *   frame_fast.c    frames with a part at the data rate; frame_seen.c frames that traces look at
 */
#ifndef CANWIRE_STEP_FRAME_H
#define CANWIRE_STEP_FRAME_H

#include "step/step.h"

#include "format/layout.h"
#include "format/parts.h"

/* Begins a step with the next frame, or takes the frame at once (cw_frame_step_whole()). Returns
 * false, with nothing done, when that is impossible. */
bool cw_frame_step_begin(cw_bus *bus, uint64_t tick);

/* Takes a node's frame with its intermission at once, without its bits, when only its end can be
 * seen. Returns false, with nothing done, when that is impossible. */
bool cw_frame_step_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick);

/* Prepares a step with the frame of a node. The caller sets the frame and the position in it. */
void cw_frame_step_prepare(cw_bus *bus, unsigned winner, uint64_t contenders);

/* Returns the number of wire bits after which every arbitration is finished: the arbitration field
 * with SOF and stuff bits. */
static inline unsigned cw_frame_step_arbitration_bits(const cw_bus *bus)
{
    bool extended = bus->frame_step.frame.flags & CW_FRAME_EXTENDED;
    return CW_STUFFED_BITS_MAX(extended ? CW_EXTENDED_ARBITRATION_END : CW_BASE_ARBITRATION_END);
}

/* Returns the number of bits, SOF to the ACK slot, after which it is acknowledged. */
static inline unsigned cw_frame_step_acknowledged(const cw_frame_step *step)
{
    return step->length - step->after_ack;
}

/* Notes the bits of the frame. */
static inline void cw_frame_step_know(cw_frame_step *step, const cw_bits *bits)
{
    step->bits = bits;
    step->stuffing = cw_bits_stuffing(bits);
}

/* Returns the bits of the frame on the wire. Encodes them into *room when the step does not have
 * them. */
static inline const cw_bits *cw_frame_step_bits(const cw_bus *bus, cw_bits *room)
{
    if (bus->frame_step.bits)
        return bus->frame_step.bits;
    (void)cw_bits_encode(room, &bus->frame_step.frame);
    return room;
}

/* Returns their stuff bits. Finds them into *room when the step does not have them. */
static inline const cw_stuffing *cw_frame_step_stuffing(const cw_bus *bus, cw_stuffing *room)
{
    cw_bits bits;
    if (bus->frame_step.bits)
        return &bus->frame_step.stuffing;
    *room = cw_bits_stuffing(cw_frame_step_bits(bus, &bits));
    return room;
}

/* Returns the first frame of a node's queue. */
static inline const cw_frame *cw_next_frame(const cw_bus *bus, unsigned node)
{
    const cw_queue *q = &bus->nodes[node].queue;
    return cw_queue_at(q, cw_queue_first(q))->frame;
}

/* Compares the next frames of some nodes with the rules, where that has not been done. */
void cw_watch_frames(cw_bus *bus, uint64_t nodes);

/* Returns the subset of nodes for whose next frame a rule waits, see cw_rules_watched(). */
static inline uint64_t cw_find_watched(cw_bus *bus, uint64_t nodes, unsigned winner)
{
    if (!cw_rules_know(&bus->rules, nodes))
        cw_watch_frames(bus, nodes);
    return cw_rules_watched(&bus->rules, nodes, winner);
}

/* Returns true when a rule may act at or before the SOF of the next frames of watched nodes. */
bool cw_rules_act_first(const cw_bus *bus, uint64_t nodes);

/* Returns the next bit of the frame on its way, from one on, at which a rule looks. */
cw_look cw_frame_step_next_look(const cw_bus *bus, unsigned from);

/* Returns the frame on its way, as rules look at it. */
static inline cw_frame_view cw_frame_step_view(const cw_frame_step *step)
{
    return (cw_frame_view){.frame = &step->frame, .bits = step->bits,
                           .stuffing = &step->stuffing, .node = step->node, .at = step->at,
                           .length = step->length, .last = CW_NOT_LOST};
}

/* Decides the look of the step. Returns true when the match is counted and is not a hit. */
static inline bool cw_frame_step_consume_look(cw_bus *bus)
{
    const cw_frame_view view = cw_frame_step_view(&bus->frame_step);
    return cw_rules_consume(&bus->rules, 0, &bus->frame_step.look, &view);
}

/* Returns true when noise flips none of the bits to come. */
static inline bool cw_frame_step_is_noise_free(const cw_bus *bus, unsigned bits)
{
    return bus->rules.awake_count == 0 || cw_rules_keep_quiet(&bus->rules, bits, true) == bits;
}

/* Returns the nodes that drive the next bit, if it is dominant. */
uint64_t cw_frame_step_drivers(const cw_bus *bus);

/* ---- Conditions ------------------------------------------------------------------------------ */

/* Returns true when only frames for the queues come before that tick. A node in loopback sends its
 * frames at once (M15), so a frame for such a node counts as a disturbance. */
static inline bool cw_frame_step_is_undisturbed_until(const cw_bus *bus, uint64_t tick)
{
    bool loopback = (bus->frame_step.listeners | bus->outlook.away) != bus->all;
    return bus->node_due >= tick && bus->rules.next_due >= tick &&
           (!loopback || cw_inbox_first(bus) >= tick);
}

/* Returns true when a frame has come that ends the step. A node in loopback sends it at once (M15).
 * An idle node may join a frame that has only just begun (M6). */
static inline bool cw_frame_step_is_broken(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t starters = ~(step->listeners | bus->outlook.away);
    if (step->at == 1)
        starters |= bus->outlook.senders & ~step->contenders;
    return bus->waiting & starters;
}

/* ---- frame_moment.c -------------------------------------------------------------------------- */

/* Returns the next bit at whose end something happens: that many bits have passed then. */
unsigned cw_frame_step_next_moment(const cw_bus *bus);

/* Lowers the receivers' REC at the ACK slot (R8). */
void cw_frame_step_lower_counters(cw_bus *bus);

/* Carries out the moment at the end of the bit that has just passed. */
void cw_frame_step_run_moment(cw_bus *bus);

/* Ends the step with the intermission of its frame. */
void cw_frame_step_end_slot(cw_bus *bus);

/* Carries out the moments after arbitration, from a bit on. The caller counts the bits. */
void cw_frame_step_go_to_end(cw_bus *bus, unsigned at);

/* Goes from a bit to a later one, which it returns. Frames that come before the end of that time go
 * to their queues. */
static inline unsigned cw_frame_step_pass_to(cw_bus *bus, unsigned from, unsigned to)
{
    cw_wire_pass(&bus->time, to - from);
    cw_take_inbox_before(bus, cw_now(bus));
    return to;
}

/* Adds bits of the frame to the statistics. */
static inline void cw_frame_step_count_bits(cw_bus *bus, unsigned bits)
{
    assert(bus->frame_step.fast.to == 0);
    cw_count_clean_bits(bus);
    bus->stats.bits += bits;
    bus->stats.busy_bits += bits;
    cw_load_add(&bus->load, bits * bus->load.unit, true);
}

/* ---- frame_fast.c, for frames with a part at the data rate ----------------------------------- */

/* Returns the bits to go at once, at least 1 and at most `most`, see bits_to_go(). */
unsigned cw_frame_step_fast_bits(const cw_bus *bus, uint64_t tick, unsigned most);

/* Adds the next bits of the frame to the statistics. */
void cw_frame_step_count_fast(cw_bus *bus, unsigned bits);

/* Does this for a whole frame, which has that many bits with its intermission. */
void cw_frame_step_count_whole_fast(cw_bus *bus, unsigned bits);

/* Passes some bits. */
void cw_frame_step_pass_fast(cw_bus *bus, unsigned bits);

/* Takes off the time that the rest of the frame saves, all at once. From then on its bits are as
 * long as others. The step goes to its end, and no moment lies before the end of the data phase. */
void cw_frame_step_save_time(cw_bus *bus);

/* ---- losses.c -------------------------------------------------------------------------------- */

/* Lets all contenders begin to transmit; each loss is reported when its bit has passed. */
void cw_losses_begin(cw_bus *bus);

/* Does the same, but counts all losses at once, since the single ones cannot be seen. shares.c
 * later shares out the additions to the statistics of single nodes. */
void cw_losses_hide(cw_bus *bus);

/* Takes back the counts of hidden losses that lie ahead. */
void cw_losses_show(cw_bus *bus);

/* Reports the losses of the bit that has passed, if there are any. */
void cw_losses_report(cw_bus *bus);

#endif
