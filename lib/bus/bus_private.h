/* SPDX-License-Identifier: MIT
 *
 * bus_private.h - declarations that the parts of the bus share.
 *
 *   bus.c         time: what is due, which step comes next; memory.c the caller's memory
 *   host.c        nodes on and off the bus, their restarts and settings
 *   rules.c       what rules see of the bus and have it do; control.c what they do to controllers
 *   status.c      what can be read; view.c the last bit, for traces
 *   takeover.c    a bus goes on as another one
 *   invariants.c  what must hold between any two steps
 */
#ifndef CANWIRE_BUS_PRIVATE_H
#define CANWIRE_BUS_PRIVATE_H

#include "step/step.h"

/* ---- rules.c, control.c ---------------------------------------------------------------------- */

/* Links the rules to the bus, whose nodes must exist. */
void cw_link_rules(cw_bus *bus, uint64_t seed);

/* Does the action of a rule to the controllers that it names, at once. */
void cw_control_nodes(cw_bus *bus, const cw_rule *rule);

/* ---- host.c ---------------------------------------------------------------------------------- */

/* Runs everything that is due for a node now: frames from the inbox, a restart. */
void cw_run_due_node(cw_bus *bus, unsigned node);

bool cw_settings_valid(const bus_node *node, const cw_settings *settings);

#endif
