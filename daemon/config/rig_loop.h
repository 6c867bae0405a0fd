/* SPDX-License-Identifier: MIT
 *
 * rig_loop.h - finds gateways that send a frame round in a circle.
 */
#ifndef CANWIRE_CONFIG_RIG_LOOP_H
#define CANWIRE_CONFIG_RIG_LOOP_H

#include "config/rig.h"

#define RIG_LOOP_MAX 16u /* gateways of a loop */

/* A frame for ever under way: each gateway of the list hands it to the next one, the last one to
 * the first one. */
typedef struct rig_loop {
    unsigned count;
    const rig_gateway *gateways[RIG_LOOP_MAX];
    const rig_rule *rule; /* of the first gateway */
    cw_filter frame;      /* the frames that go round */
} rig_loop;

/* Returns true when frames go round, and describes one such loop, of at most RIG_LOOP_MAX gateways.
 * It takes filters for what they are, but an inverted one lets all pass but what it excludes
 * completely. It does not look at the filters of nodes. */
bool rig_find_loop(rig_loop *loop, const rig *self);

#endif
