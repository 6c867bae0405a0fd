/* SPDX-License-Identifier: MIT
 *
 * quantum.h - declarations that the parts of the timed step share.
 *
 *   quantum_time.c  bit times of the bus, and what comes between them
 *   quantum.c       all that nodes do, in the order of time
 *   quantum_sync.c  counts and reports synchronisations and margins
 *   quantum_marks.c marks moments and levels for traces
 *   quantum_look.c  the levels and edges that they see; quantum_grid.c: off the grid and back
 *   quantum_rate.c  the two rates of FD frames
 *   quantum_wires.c wires that rules cut and join
 *   quantum_ringing.c  the wire swings after edges to recessive
 *   quantum_rest.c  bit times in which all nodes rest
 *   quantum_frame.c clean frames at once, see quantum_clean.h
 */
#ifndef CANWIRE_STEP_QUANTUM_H
#define CANWIRE_STEP_QUANTUM_H

#include "step/step.h"

#include <assert.h>

#define CW_LEAP_TICKS (UINT64_C(1) << 27) /* of a leap: moments stay small, see cw_timed_rebase() */

/* Returns the moment of a tick, and the first tick at or after a moment. So what happens in a bit
 * time has a tick of it. */
static inline cw_span cw_moment_of(const cw_bus *bus, uint64_t tick)
{
    return (cw_span)(tick - bus->timed.epoch) * CW_TICK;
}

/* Returns the tick of a moment, the next one if it lies between two. */
static inline uint64_t cw_tick_of(const cw_bus *bus, cw_span moment)
{
    assert(moment >= 0);
    return bus->timed.epoch + (uint64_t)(moment + CW_TICK - 1) / CW_TICK;
}

/* Makes a node that has not synchronised since its last sample deaf to edges, if its controller is
 * (D12). */
static inline void cw_timed_follow_ears(cw_timed_node *n, const cw_mac *mac)
{
    n->deaf = !cw_mac_synchronises(mac);
    n->pcs.synchronised = n->deaf;
}

/* Takes the new bit timing of a node between two of its bits, if it has been given one. */
static inline void cw_timed_retime(cw_bus *bus, unsigned node)
{
    cw_timed_node *n = &bus->timed.nodes[node];
    if (n->retimed && bus->timed.rates)
        cw_timed_retime_rates(bus, node);
    else if (n->retimed)
        cw_timed_set_timing(n, &bus->timed.next_timings[node]);
    n->retimed = false;
}

/* Returns the quanta of a node that fit into a span. Usually none does: edges come in Sync_Seg. */
static inline cw_span cw_quanta_in(const cw_timed_node *n, cw_span span)
{
    return span < n->timing.quantum ? 0 : span / n->timing.quantum;
}

/* ---- quantum.c ------------------------------------------------------------------------------- */

/* Begins the bits of nodes with which a bit time begins, and returns these nodes. Also lets
 * controllers that have been changed from outside drive anew. */
uint64_t cw_timed_begin_bits(cw_bus *bus, cw_span begin);

/* Lets rules act on levels in a bit time, with which the bits of some nodes begin. */
void cw_timed_let_rules_act(cw_bus *bus, uint64_t nodes, cw_span begin, cw_span end);

/* Does all that nodes do before a moment, and what looks find that they have at it. */
void cw_timed_go_to(cw_bus *bus, cw_span end);

/* Ends the bits that end at a moment. */
void cw_timed_end_bits(cw_bus *bus, cw_span end);

/* ---- quantum.c ------------------------------------------------------------------------------- */

/* Plans anew for nodes after their sample points, since levels to come have changed. */
void cw_timed_alert(cw_bus *bus);

/* ---- quantum_look.c -------------------------------------------------------------------------- */

/* Returns true when levels follow from edges alone, on one wire. */
static inline bool cw_timed_is_plain(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    return t->one_wire && t->disturbances.count == 0 && !t->rings;
}

/* Returns the level that a node sees when it looks at a moment. */
bool cw_timed_level(const cw_bus *bus, unsigned node, cw_span moment);

/* Returns the level of its wire, without what rules do to its own samples. */
bool cw_timed_wire(const cw_bus *bus, unsigned node, cw_span moment);

/* Returns the levels right after a moment where they are made, but not what nodes sample. dominant:
 * the nodes that drive this level then. */
void cw_timed_levels_at_source(const cw_bus *bus, cw_levels *levels, uint64_t dominant,
                               cw_span moment);

/* Returns the levels of the wire right after a moment as they come to the nodes, and what these
 * would sample. */
void cw_timed_levels_at_nodes(const cw_bus *bus, uint64_t *came, uint64_t *sampled,
                              cw_span moment);

/* Returns the level that its controller takes at a sample point (T7). Usually all edges have
 * arrived long before. */
bool cw_timed_find_sample(const cw_bus *bus, unsigned node, cw_span moment);

/* Returns the level that a node samples. In the calm all nodes have seen the last edge. */
static inline bool cw_timed_sample(const cw_bus *bus, unsigned node, cw_span moment)
{
    const cw_cable *cable = &bus->timed.cable;
    if (bus->timed.calm && cable->newest + cable->longest < moment &&
        !bus->timed.nodes[node].timing.triple_sampling)
        return cable->dominant == 0;
    return cw_timed_find_sample(bus, node, moment);
}

/* Returns the next look of a node that finds an edge from recessive to dominant, up to a moment.
 * CW_SPAN_MAX: none does. */
cw_span cw_timed_next_edge(const cw_bus *bus, unsigned node, cw_span until);

/* Returns false when it has none for certain: no dominant edge is under way to it. */
static inline bool cw_timed_edge_may_come(const cw_bus *bus, const cw_timed_node *n)
{
    return n->last_arrival >= n->looked || !bus->timed.calm;
}

/* Notes when a dominant edge arrives at a node. rises: the line was recessive before. */
static inline void cw_timed_note_arrival(cw_timed_node *n, cw_span arrival, bool rises)
{
    if (rises || arrival < n->first_arrival)
        n->first_arrival = arrival;
    if (arrival > n->last_arrival)
        n->last_arrival = arrival;
}

/* Returns true when the next edge comes in the Sync_Seg of the present bit for sure. */
static inline bool cw_timed_edge_is_on_time(const cw_bus *bus, const cw_timed_node *n)
{
    return bus->timed.calm && bus->timed.cable.rise_from < n->looked &&
           n->first_arrival >= n->looked && n->first_arrival < n->begin + n->timing.quantum;
}

/* Returns when the level of its wire changed between two moments, as its nodes drove it;
 * CW_SPAN_MAX: it did not. */
cw_span cw_timed_change(const cw_bus *bus, unsigned node, bool level, cw_span after,
                        cw_span before);

/* ---- quantum_rate.c, where some node has a data rate ----------------------------------------- */

/* Begins with the rate of its controller. */
void cw_timed_enter_rate(cw_bus *bus, unsigned node);

/* Begins in the middle of a bit, at the rate that the node had on the old bus. */
void cw_timed_take_over_rates(cw_bus *bus, unsigned node, const cw_bus *old, unsigned from);

/* Lets a bit begin at the nominal rate when its controller has been taken out of the data phase
 * from outside. */
void cw_timed_begin_at_rate(cw_bus *bus, unsigned node);

/* Changes the rate of a node when its controller has done so at a sample point (D10). */
void cw_timed_follow_rate(cw_bus *bus, unsigned node, cw_span moment);

/* Returns the end of the bit in progress of a node, by its next sample if no fault comes. */
cw_span cw_timed_expected_end(const cw_bus *bus, unsigned node);

/* Compares the bits of a transmitter whose secondary sample points lie before a sample point or at
 * it (D13). */
void cw_timed_compare_late(cw_bus *bus, unsigned node, cw_span until);

/* Returns true when a node compares its bits so now, or will do so in this frame. In loopback it
 * sees nothing but these bits (M15). */
static inline bool cw_timed_compares_late(const cw_bus *bus, unsigned node)
{
    const cw_mac *mac = &bus->nodes[node].mac;
    return bus->timed.rates && bus->timed.rates[node].late.tdc.mode != CW_TDC_OFF &&
           cw_mac_is_sending(mac) && !(mac->modes & CW_MODE_LOOPBACK);
}

/* Returns true when the next bit of a node begins at the nominal rate. Its controller has been
 * taken out of the data phase from outside. */
static inline bool cw_timed_changes_rate(const cw_bus *bus, unsigned node)
{
    return bus->timed.rates && bus->timed.rates[node].fast &&
           !cw_mac_is_fast(&bus->nodes[node].mac);
}

/* Returns the moment at which the next bits of all nodes begin together. Those that are away do not
 * count. CW_SPAN_MAX: there is none. */
cw_span cw_timed_common_begin(const cw_bus *bus);

/* Returns true when bits of all nodes begin with the bit time, but of those that nobody sees. */
bool cw_timed_begins_together(const cw_bus *bus);

/* Lets nodes that neither drive nor sample the wire know its level. The bit time ends, and
 * all nodes have the same bit timings. */
void cw_timed_show_wire(cw_bus *bus);

/* Gives the bit time that begins now that length, see cw_timed_common_bit(). The bits that begin
 * with it must have begun. */
void cw_timed_set_bit(cw_bus *bus, cw_span common);

/* Returns true when all nodes begin a bit at the present tick. Those that are away do so from the
 * first bit time that the others have in common. */
bool cw_timed_all_begin(const cw_bus *bus);

/* Returns true when all bits begin together at the present tick, as far as that can be. */
static inline bool cw_timed_is_straight(const cw_bus *bus)
{
    return !bus->timed.rates || !bus->timed.uniform || cw_timed_all_begin(bus);
}

/* ---- quantum_wires.c ------------------------------------------------------------------------- */

/* Returns the earliest moment that a node looks back to. */
cw_span cw_timed_earliest_look(const cw_bus *bus);

/* Begins with the wires of the bus as they are. */
void cw_timed_begin_wires(cw_bus *bus);

/* Returns true when the nodes are on the wires of the bus. Forgets the old wires when nobody looks
 * back to them. */
bool cw_timed_forget_wires(cw_bus *bus, cw_span moment);

/* Puts the nodes onto the wires of the bus: what they see of times before a moment, they see there.
 */
void cw_timed_take_wires(cw_bus *bus, cw_span moment);

/* Moves the epoch forward. */
void cw_timed_rebase_wires(cw_timed *timed, cw_span by);

/* ---- quantum_ringing.c ----------------------------------------------------------------------- */

/* Forgets former ringing when no node looks back to it. */
void cw_timed_forget_ringing(cw_bus *bus);

/* Moves the epoch forward. */
void cw_timed_rebase_ringing(cw_timed *timed, cw_span by);

/* ---- quantum_sync.c -------------------------------------------------------------------------- */

/* Finds out whether the bit time that begins is one that counts, and whether moments in it are
 * marked. */
void cw_sync_begin_bit_time(cw_bus *bus);

/* Notes what a node does at a moment, if there is room. phase_error: as in cw_mark. */
void cw_mark_put(cw_bus *bus, cw_mark_kind kind, unsigned node, cw_span moment, bool level,
                 int phase_error);

/* Notes the level that a controller takes, and whether a rule has made it differ from that of the
 * wire. */
void cw_mark_sample(cw_bus *bus, unsigned node, cw_span moment, bool level);

/* Notes what nodes drive when the levels at the start of the bit time are noted. */
void cw_marks_note(cw_bus *bus);

/* Adds how these levels change in the bit time. Takes all marks out of one whose bits are
 * common to all nodes, and which no rule touches inside. */
void cw_marks_end(cw_bus *bus, cw_span end);

/* Counts, reports and marks a synchronisation, for those who want that. phase_error: in quanta
 * (T5). moment: of the look that has found the edge. */
void cw_sync_note(cw_bus *bus, unsigned node, bool hard, int phase_error, cw_span moment);

/* Reports the synchronisations of a bit at its end. */
void cw_sync_commit(cw_bus *bus, unsigned node);

/* Counts the margins of a level that the controller has just taken; the last sample is still noted
 * in the node. */
void cw_sync_count_sample(cw_bus *bus, unsigned node, bool level, cw_span moment);

/* ---- quantum_park.c -------------------------------------------------------------------------- */

/* Puts a node into the recessive bit in which it is at a moment; it must have no entry on the
 * agenda. It goes by its own clock from the start of one of its bits on, the first of those that it
 * has not sampled. Returns how many of them it has sampled by then. */
unsigned cw_timed_place(cw_bus *bus, unsigned node, cw_span first, cw_span moment);

/* Moves the epoch forward, which has been done for the bus. */
void cw_clean_rebase(cw_bus *bus, cw_span by);

/* Counts bit times for load and statistics, in which nodes are parked and no frame begins. */
void cw_clean_count_rest(cw_bus *bus, uint64_t bits);

/* ---- quantum_grid.c -------------------------------------------------------------------------- */

/* Ends parking where the bus could go back to the grid, or may have bits of two rates. */
void cw_clean_settle(cw_bus *bus);

/* Leaves the grid: all nodes begin a bit at the present tick. */
void cw_timed_enter(cw_bus *bus);

/* Goes back to the grid when all clocks agree, and nothing keeps the bus off it. */
void cw_timed_leave(cw_bus *bus);

/* Lets moments count from the present tick when they have become large. */
void cw_timed_rebase(cw_bus *bus);

#endif
