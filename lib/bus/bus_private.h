/* SPDX-License-Identifier: MIT
 *
 * bus_private.h - declarations that the parts of the bus share.
 *
 *   bus.c         runs what is due and chooses the next step; memory.c lays out the caller's memory
 *   valid.c       checks configurations
 *   host.c        takes nodes on and off the bus; restarts and settings of nodes
 *   rules.c       adds and removes rules; control.c acts on controllers for them
 *   status.c      reads time and statistics; view.c reads the last bit, for traces
 *   timing.c      clocks of the nodes and delays between them
 *   takeover.c    continues a bus as another one
 *   invariants.c  asserts what must hold between any two steps
 */
#ifndef CANWIRE_BUS_PRIVATE_H
#define CANWIRE_BUS_PRIVATE_H

#include "step/step.h"

/* ---- rules.c, control.c ---------------------------------------------------------------------- */

/* Links the rules to the bus, whose nodes must exist. */
void cw_link_rules(cw_bus *bus, uint64_t seed);

/* Does the action of a rule at once to all controllers that the rule names. */
void cw_control_nodes(cw_bus *bus, const cw_rule *rule);

/* ---- valid.c --------------------------------------------------------------------------------- */

/* Returns true when cw_bus_check() finds nothing. */
bool cw_bus_is_valid(const cw_bus_config *config);

/* ---- timing.c -------------------------------------------------------------------------------- */

#define CW_DIVIDED_BIT_MAX (1u << 27) /* ticks, 1.7 s; longer bits are not divided, so that moments
                                         fit into 64 bits */

/* Returns which clock or delay of a node is not valid (see CW_*_MAX, canwire.h), or nothing. */
cw_bus_finding cw_check_timing(const cw_bus_config *config);

/* Returns the bit timing of a node. */
cw_bit_timing cw_bit_timing_of(const cw_bus_config *config, unsigned node);

/* Return the longest ringing at a node, and the shortest bit of one. */
cw_span cw_longest_ringing(const cw_bus_config *config);
cw_span cw_shortest_bit(const cw_bus_config *config);

/* Returns the most bits of a node that end in a bit time of the bus. */
unsigned cw_bits_of_bit_time(const cw_bus_config *config);

/* Notes how late rules on jitter let edges come. */
void cw_find_longest(cw_bus *bus);

/* Returns true when a node of the running bus can have that bit timing. data: NULL is the data
 * phase that it has. */
bool cw_new_timing_valid(const cw_bus *bus, unsigned node, const cw_bit_timing *timing,
                         const cw_data_timing *data);

/* Returns a bit timing with the parts that settings change. */
cw_bit_timing cw_timing_with(const cw_bit_timing *now, const cw_settings *settings);

/* Gives a node another bit timing, which must be valid, from its next bit on. */
void cw_retime(cw_bus *bus, unsigned node, const cw_bit_timing *timing,
               const cw_data_timing *data);

/* Does the same with the quantum alone of some nodes, for rules. */
void cw_retime_quantum(cw_bus *bus, uint64_t nodes, cw_span quantum);

/* Returns the bit timing of a node from its next bit on. */
cw_bit_timing cw_timing_now(const cw_bus *bus, unsigned node);

/* Returns true when a node of the running bus can have the way and the ringing of settings. */
bool cw_new_way_valid(const cw_bus *bus, unsigned node, const cw_settings *settings);

/* Changes the way of a node, and how long the wire rings there, for edges from now on. */
void cw_set_way(cw_bus *bus, unsigned node, const cw_settings *settings);

/* Puts the way of a node and its ringing into settings. */
void cw_get_way(const cw_bus *bus, unsigned node, cw_settings *settings);

/* Returns true for a bus that keeps its setup, when no node sleeps or has what needs memory off the
 * grid. */
bool cw_is_lean(const cw_bus_config *config);

/* Sets up clocks and delays; the memory must have been laid out. */
void cw_init_timing(cw_bus *bus, const cw_bus_config *config);

/* ---- data_timing.c --------------------------------------------------------------------------- */

bool cw_data_timing_valid(const cw_data_timing *data);

/* Returns true when some node has a data rate. */
bool cw_has_data_rate(const cw_bus_config *config);

/* Returns the length of a bit of a node in the data phase, by its nominal bit timing. */
cw_span cw_data_bit(const cw_bus_config *config, unsigned node, const cw_bit_timing *nominal);

/* Returns the bit timing of the data phase as it would be. data: see cw_new_timing_valid(). */
cw_bit_timing cw_new_data_bit(const cw_bus *bus, unsigned node, const cw_bit_timing *nominal,
                              const cw_data_timing *data);

/* Notes the data phase that comes with the next bit timing. NULL: the one that it has. */
void cw_note_next_data(cw_bus *bus, unsigned node, const cw_data_timing *data);

/* Returns the data phase of a node from its next bit on, as its host has given it. */
cw_data_timing cw_data_timing_now(const cw_bus *bus, unsigned node);

/* Returns true when bits of clean frames are common to all nodes at both rates. All have the
 * nominal bit timing. */
bool cw_rates_agree(cw_bus *bus, const cw_bit_timing *nominal);

/* Sets up the rates of a node. */
void cw_init_rates(cw_bus *bus, unsigned node, const cw_data_timing *data,
                   const cw_bit_timing *nominal);

/* ---- host.c ---------------------------------------------------------------------------------- */

/* Runs everything that is due for a node now: frames from the inbox, a restart. */
void cw_run_due_node(cw_bus *bus, unsigned node);

/* Asks the controller of a node to leave bus-off, and drops what waits (R12). */
void cw_restart_now(cw_bus *bus, unsigned node);

/* Returns true when a node of the running bus can have these settings. */
bool cw_settings_valid(const cw_bus *bus, unsigned node, const cw_settings *settings);

#endif
