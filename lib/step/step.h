/* SPDX-License-Identifier: MIT
 *
 * step.h - the ways in which time moves. All leave the bus as single bits would leave it.
 *
 *   quantum*.c  nodes with clocks of their own: the reference
 *   bit.c      one bit of all nodes: the reference where all clocks agree
 *   run.c      equal bits; shared.c takes a bit for all nodes that do the same
 *   frame*.c   clean frames without controllers; outlook.c and arbiter.c know who sends next
 */
#ifndef CANWIRE_STEP_H
#define CANWIRE_STEP_H

#include "state/state.h"

/* ---- bit.c ----------------------------------------------------------------------------------- */

/* Simulates the next bit. */
void cw_step_bit(cw_bus *bus);

/* Encode the first frame of a node's queue, or the frame in a slot, and make it ready to be
 * sent. */
void cw_offer_first(cw_bus_node *node);
void cw_offer_slot(cw_bus_node *node, uint16_t slot);

/* Binds rules when a node begins to transmit the frame of its offered slot; they may make its CRC
 * wrong. source: of the frame, see cw_queue_frame(). */
void cw_bind_rules(cw_bus *bus, unsigned node, const cw_frame *frame, unsigned source);

/* Notes that a node has begun to transmit. */
void cw_note_start(cw_bus *bus, unsigned node);

/* Finds the levels of the bit in progress from those that are driven. */
void cw_find_levels(cw_bus *bus, cw_levels *levels);

/* Simulates the bit in progress, whose levels have been found. */
void cw_step_with(cw_bus *bus, const cw_levels *levels);

/* Returns what all controllers do to the wire, for cw_watch_view(), as CW_WIRE_*. It changes only
 * when one of them goes into another phase or mode. */
#define CW_WIRE_BUSY 0x1u
#define CW_WIRE_ERROR 0x2u    /* an error flag */
#define CW_WIRE_OVERLOAD 0x4u /* an overload flag */
unsigned cw_view_wire(const cw_bus *bus);

/* Counts load and flags for the next bit, and for as many equal ones as are taken with it. */
void cw_watch_view(cw_bus *bus, unsigned view, uint64_t bits);

static inline void cw_watch_wire(cw_bus *bus, uint64_t bits)
{
    cw_watch_view(bus, cw_view_wire(bus), bits);
}

/* ---- quantum*.c ------------------------------------------------------------------------------ */

/* Returns true when a node is at the data rate, or may be after its next sample point. Some node
 * must have a data rate. */
bool cw_is_data_phase(const cw_bus *bus);

/* Returns the length of the bit that begins now and that all nodes have in common, if no fault
 * comes. Returns 0 where their bits do not end together: the bit is as long as a nominal one. Nodes
 * that are away do not count. Some node must have a data rate. */
cw_span cw_timed_common_bit(const cw_bus *bus);

/* Returns true when nodes go by their own clocks, because those may differ, or for a test. */
static inline bool cw_is_off_grid(const cw_bus *bus)
{
    return bus->timed.active || !bus->timed.uniform ||
           ((bus->timed.requested || bus->rules.timed_rules) && bus->timed.divides) ||
           (bus->timed.rates && cw_is_data_phase(bus));
}

/* Simulates the next bit time of the bus, in which each node goes by its own clock. Goes on with
 * those after it, up to a tick, as long as nothing comes between them. */
void cw_step_bit_times(cw_bus *bus, uint64_t tick);

/* Returns false when the next two functions can do nothing for sure: the first node is in the
 * middle of a frame. */
static inline bool cw_timed_may_leap(const cw_bus *bus)
{
    const uint8_t phase = bus->nodes[0].mac.phase;
    return phase < CW_MAC_FRAME || phase >= CW_MAC_INTERMISSION;
}

/* Gives each node its place in its bit, where they have been parked behind a clean frame. */
void cw_clean_resume(cw_bus *bus);

/* Returns true when such nodes are idle. */
bool cw_clean_is_idle(const cw_bus *bus);

/* Adds the synchronisations of a node that its record does not have yet. */
void cw_clean_add_counts(const cw_bus *bus, unsigned node, cw_sync_stats *stats);

/* Returns the bit times up to a tick in which all nodes rest; 0: not all do. */
uint64_t cw_timed_rest_reach(const cw_bus *bus, uint64_t tick);

/* Goes through bit times up to a tick in which all nodes rest. Returns false, with nothing done,
 * when there are none, or few. */
bool cw_timed_rest_go(cw_bus *bus, uint64_t tick);

/* Takes the next frame at once, with its intermission up to the last bit time, if its course is
 * known. Returns false, with nothing done, when it is not, or when it ends after a tick. */
bool cw_timed_frame_go(cw_bus *bus, uint64_t tick);

/* Returns true when a node has something to report at the end of a bit that it has sampled. */
bool cw_timed_has_report(const cw_bus *bus);

/* Returns the length of the bit of a transmitter that has begun (D10), by a clock that is as exact
 * as that of the bus. Some node must have a data rate. */
cw_span cw_timed_bit_length(const cw_bus *bus, unsigned node);

/* Returns the tick at which the bit of a node will end, if no edge comes. */
uint64_t cw_timed_end_of_bit(const cw_bus *bus, unsigned node);

/* Takes over the nodes of an old bus that is off the grid, in the middle of their bits. from: as in
 * cw_bus_take_over(). */
void cw_timed_take_over(cw_bus *bus, const cw_bus *old, const uint8_t *from);

/* ---- run.c ----------------------------------------------------------------------------------- */

/* The flags on the wire. */
typedef struct cw_held {
    unsigned bits; /* in which flags hold the wire dominant, all of them of the same kind; 0: the
                      wire is recessive as long as no node changes its own level */
    unsigned view; /* cw_view_wire() in all of these, or 0 when it is not known */
} cw_held;

/* Finds them. */
cw_held cw_find_held(const cw_bus *bus);

/* Returns the bits up to tick in which the wire keeps its level, no controller does anything new,
 * and nothing comes in. Returns 0 when the next bit must be simulated. */
uint64_t cw_run_reach(cw_bus *bus, const cw_held *held, uint64_t tick);

/* Takes that many bits at once. */
void cw_run_go(cw_bus *bus, uint64_t bits, const cw_held *held);

/* ---- frame*.c -------------------------------------------------------------------------------- */

/* Returns the tick at which bit n of the frame of a frame step begins, n not before its `at`. Bits
 * of the intermission count on after those of the frame. */
static inline uint64_t cw_frame_step_tick(const cw_bus *bus, unsigned n)
{
    const cw_frame_step *step = &bus->frame_step;
    if (step->fast.to)
        return cw_fast_tick(&bus->time, &bus->timed.fast, &step->fast, step->at, n);
    return cw_wire_tick(&bus->time, (uint64_t)n - step->at);
}

/* Returns the tick at which a frame begins in the next bit, which would end at `end`, or `end`
 * without one. Such a frame comes while all nodes rest on the grid, and no rule acts on bits. */
uint64_t cw_start_in_bit(const cw_bus *bus, uint64_t end);

/* Returns the tick at which the next bit ends, where some node has a data rate. */
uint64_t cw_short_bit_end(const cw_bus *bus);

/* Returns the same for any bus. All steps stop at such ticks, so where a bus stops does not depend
 * on how it came there. */
static inline uint64_t cw_next_bit_end(const cw_bus *bus)
{
    const uint64_t end = bus->timed.rates ? cw_short_bit_end(bus) : cw_wire_tick(&bus->time, 1);
    return bus->start_at_tick ? cw_start_in_bit(bus, end) : end;
}

/* Returns true when the next bit ends at a tick or before it, where it may be a short one. */
bool cw_short_bit_fits(const cw_bus *bus, uint64_t tick);

/* Returns the same for any bus. */
static inline bool cw_next_bit_fits(const cw_bus *bus, uint64_t tick)
{
    return cw_wire_fits_bit(&bus->time, tick) ||
           ((bus->timed.rates || bus->start_at_tick) && cw_short_bit_fits(bus, tick));
}

/* Continues the frame step that is under way, or begins one with the next frame. It goes as far as
 * the end of the frame, the next moment at which something happens, or tick. At least one bit must
 * lie before tick. Returns false, with nothing done, when bits must be simulated singly. */
bool cw_frame_step_go(cw_bus *bus, uint64_t tick);

/* Takes the next bit of a clean frame, for traces, without controllers. Returns false, with nothing
 * done, where they are needed. It may also do no more than to move them to their present points. */
bool cw_frame_seen_go(cw_bus *bus);

/* Returns the next bits that look like the last one that was taken so. The last bit up to a tick,
 * or up to where something is due, is not among them. */
unsigned cw_frame_seen_alike(const cw_bus *bus, uint64_t tick);

/* Ends the frame step that is under way, if there is one: moves all controllers to their present
 * points. Public calls do this before they change a controller, bus.c before due rules and
 * restarts, and frame.c where a step cannot go on. */
void cw_wake_controllers(cw_bus *bus);

/* Returns the nodes whose losses have been counted beforehand and still lie ahead. */
uint64_t cw_losses_ahead(const cw_bus *bus);

/* Returns true when a match of a rule has been counted beforehand and still lies ahead. */
bool cw_match_ahead(const cw_bus *bus, unsigned rule);

/* Return, in a frame step, the recessive bits up to now and the bits until the next event. */
uint64_t cw_frame_step_recessive_bits(const cw_bus *bus);
uint64_t cw_frame_step_horizon(const cw_bus *bus);

/* Returns the bits before which a frame of some wire bits cannot have been received. They count
 * from its hand-in, or from the end of the frame before it. */
uint64_t cw_to_reception(const cw_bus *bus, unsigned wire_bits);

/* Returns, in a frame step, the bits in which no frame that passes a test is received. Those in
 * queues have at least that many bits up to their reception. */
uint64_t cw_frame_step_to_rx(const cw_bus *bus, uint64_t bits, cw_frame_test *test,
                             const void *user);

/* ---- doze.c ---------------------------------------------------------------------------------- */

/* Lets sleeping nodes see their levels for that many bits. Returns those that are woken then. */
uint64_t cw_doze(cw_bus *bus, uint64_t levels, uint64_t bits);

/* Returns how many dominant bits wake no node. */
uint64_t cw_doze_bits(const cw_bus *bus);

/* Does the first for a bit time off the grid, and gives the nodes a report at its end. */
void cw_timed_doze(cw_bus *bus, cw_span end);

/* Notes that the wire has been recessive for some time. */
void cw_doze_forget(cw_bus *bus);

/* ---- shared.c -------------------------------------------------------------------------------- */

/* Makes the node a follower if it is at the point of the others. */
void cw_join(cw_bus *bus, unsigned node);

/* Makes followers leave that sample a level other than that of most followers. */
void cw_split_followers(cw_bus *bus, uint64_t levels);

/* Ends the bit for all followers, which see the same level. Returns true when there is a report to
 * commit. */
bool cw_sample_common(cw_bus *bus, uint64_t levels, cw_mac_report *report);

/* ---- outlook.c ------------------------------------------------------------------------------- */

/* Computes the outlook from all controllers. All must be idle or away, the shared one included. */
void cw_outlook_find(cw_bus *bus);

/* Asserts that the outlook would be the same if it were computed anew. */
void cw_assert_outlook(const cw_bus *bus);

/* ---- arbiter.c ------------------------------------------------------------------------------- */

/* Makes the tournament of that many nodes, none of which has a frame. */
void cw_arbiter_init(cw_arbiter *arbiter, unsigned nodes);

/* Repeats the matches of nodes whose first frame may have changed. */
void cw_arbiter_update(cw_bus *bus);

/* Finds the winner among these nodes, all of which have a frame. Call cw_arbiter_update() before.
 * Returns false when two frames are equal up to the end of the arbitration field. */
bool cw_arbiter_winner(const cw_bus *bus, uint64_t nodes, unsigned *winner);

/* Asserts that the tournament has the waiting frames, and the right winners. */
void cw_assert_arbiter(const cw_bus *bus);

#endif
