/* SPDX-License-Identifier: MIT
 *
 * doubts.h - what a valid configuration can be seen to miss before it runs.
 *
 * Nothing is in doubt where somebody outside may send: programs at ports, guests, files, gateways.
 */
#ifndef CANWIRE_CONFIG_DOUBTS_H
#define CANWIRE_CONFIG_DOUBTS_H

#include "config/rig.h"

/* Returns the nodes of a bus that gateways of a rig feed; 0 for NULL. */
uint64_t doubts_fed(const rig *config, size_t bus);

/* Returns true when no node sends a frame that a rule waits for. fed: see doubts_fed(). */
bool doubts_no_frame(const cfg *config, const cw_rule *rule, uint64_t fed);

/* Returns true when only programs at ports may send a frame that a rule waits for. */
bool doubts_only_ports(const cfg *config, const cw_rule *rule, uint64_t fed);

/* Returns true when a rule comes after others in a circle, or after such a rule, and nobody can arm
 * one of them by hand. */
bool doubts_never_armed(const cfg *config, const cw_rule *rule);

/* Returns true when somebody can arm a rule, or one that it comes after, by hand. */
bool doubts_by_hand(const cfg *config, const cw_rule *rule);

/* Returns the most releases of `send` entries of a node that come at one tick, which goes to *tick.
 * Entries with jitter are left out. After many ticks it stops looking. */
unsigned doubts_at_once(const cfg *config, size_t node, uint64_t *tick);

/* Returns true when a node has frames to send and no other one acknowledges any. */
bool doubts_no_acknowledgement(const cfg *config, size_t node);

#endif
