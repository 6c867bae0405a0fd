/* SPDX-License-Identifier: MIT
 *
 * arbiter.h - the winner of the bus, and the statistics of the nodes that take part.
 */
#ifndef CANWIRE_ARBITER_H
#define CANWIRE_ARBITER_H

#include "canwire.h"

/* Zeroed by cw_arbiter_init(). */
typedef struct cw_arbiter {
    uint64_t entries[2 * CW_NODES_MAX]; /* a heap of matches: 1 is the final, leaves are nodes */
    unsigned leaves;
    uint64_t stale; /* nodes whose first frame may differ from that of their leaf */
    uint64_t contenders; /* nodes that have lost `lost` arbitrations since their lost_before */
    unsigned contender_count;
    uint64_t lost;
    uint64_t listeners;  /* nodes that receive all frames counted below, from when they began to
                            listen */
    uint64_t rx_frames;
    uint64_t rx_bytes;
} cw_arbiter;

void cw_arbiter_init(cw_arbiter *arbiter, unsigned nodes);

/* Repeats the matches of nodes whose first frame may have changed. */
void cw_arbiter_update(cw_bus *bus);

/* Asserts that the tournament is that of the frames that wait. */
void cw_assert_arbiter(const cw_bus *bus);

/* Finds the winner among these nodes, all of which have a frame. Call cw_arbiter_update() before.
 * Returns false when two frames are equal up to the end of the arbitration field. */
bool cw_arbiter_winner(const cw_bus *bus, uint64_t nodes, unsigned *winner);

/* Adds a node's share that is not in its statistics yet to a copy of them. */
void cw_share_stats(const cw_bus *bus, unsigned node, cw_node_stats *stats);

/* Set the nodes that take part from now on. */
void cw_set_contenders(cw_bus *bus, uint64_t nodes);
void cw_set_listeners(cw_bus *bus, uint64_t nodes);

/* Counts a frame that all listeners but its sender, itself a listener, have received. */
void cw_count_received(cw_bus *bus, unsigned sender, unsigned bytes);

#endif
