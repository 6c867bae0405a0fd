/* SPDX-License-Identifier: MIT
 *
 * bus_private.h - declarations that the parts of the bus share.
 *
 *   bus.c         runs what is due and chooses the next step; memory.c lays out the caller's memory
 *   host.c        takes nodes on and off the bus; restarts and settings of nodes
 *   rules.c       adds and removes rules; control.c acts on controllers for them
 *   status.c      reads time and statistics; view.c reads the last bit, for traces
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

/* ---- host.c ---------------------------------------------------------------------------------- */

/* Runs everything that is due for a node now: frames from the inbox, a restart. */
void cw_run_due_node(cw_bus *bus, unsigned node);

bool cw_settings_valid(const bus_node *node, const cw_settings *settings);

#endif
