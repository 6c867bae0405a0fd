/* SPDX-License-Identifier: MIT
 *
 * rig_loop.h - finds gateways that send a frame round in a circle.
 */
#ifndef CANWIRE_CONFIG_RIG_LOOP_H
#define CANWIRE_CONFIG_RIG_LOOP_H

#include "config/rig.h"

#define RIG_LOOP_MAX 16u /* gateways of a loop */

/* A frame for ever under way: each gateway of the list hands it to the next one, the last one to
 * the first one. A gateway may be there twice, for two identifiers of the frame. */
typedef struct rig_loop {
    unsigned count;
    const rig_gateway *gateways[RIG_LOOP_MAX];
    const rig_rule *rule; /* of the first gateway */
    cw_frame frame;       /* one that goes round, as the first gateway receives it */
} rig_loop;

/* Returns true when frames go round, and describes one such loop, of at most RIG_LOOP_MAX gateways.
 * It looks at the rules, and at the filters, mailboxes, kind and loopback of the nodes. */
bool rig_find_loop(rig_loop *loop, const rig *self);

#endif
