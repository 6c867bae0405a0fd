/* SPDX-License-Identifier: MIT
 *
 * arbiter.h - who wins the bus, and what taking part costs those who do not.
 */
#ifndef CANWIRE_ARBITER_H
#define CANWIRE_ARBITER_H

#include "canwire.h"

/* Zeroed by cw_arbiter_init(). */
typedef struct cw_arbiter {
    uint64_t entries[2 * CW_NODES_MAX]; /* a heap of matches: 1 is the final, leaves are nodes */
    unsigned leaves;
    uint64_t stale; /* nodes whose first frame may be another one than their leaf says */
    uint64_t contenders; /* nodes that have lost `lost` arbitrations since their lost_before */
    unsigned contender_count;
    uint64_t lost;
    uint64_t listeners;  /* nodes that receive all of these, from when they began to listen */
    uint64_t rx_frames;
    uint64_t rx_bytes;
} cw_arbiter;

void cw_arbiter_init(cw_arbiter *arbiter, unsigned nodes);

/* Nodes whose first frame may be another one play again. */
void cw_arbiter_update(cw_bus *bus);

/* Asserts that the tournament is that of the frames that wait. */
void cw_assert_arbiter(const cw_bus *bus);

/* Behind cw_arbiter_update(): whose frame wins among these nodes, all of which have one. False when
 * two are equal up to the end of the arbitration field. */
bool cw_arbiter_winner(const cw_bus *bus, uint64_t nodes, unsigned *winner);

/* Adds what is still to be shared out to a copy of a node's statistics. */
void cw_share_stats(const cw_bus *bus, unsigned node, cw_node_stats *stats);

/* Who takes part from now on. */
void cw_set_contenders(cw_bus *bus, uint64_t nodes);
void cw_set_listeners(cw_bus *bus, uint64_t nodes);

/* A frame that all listeners but its sender, which is one, have received. */
void cw_count_received(cw_bus *bus, unsigned sender, unsigned bytes);

#endif
