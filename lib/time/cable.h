/* SPDX-License-Identifier: MIT
 *
 * cable.h - the line between nodes: the edges that they have driven, and the levels that each of
 * them sees (T2, T12).
 */
#ifndef CANWIRE_TIME_CABLE_H
#define CANWIRE_TIME_CABLE_H

#include "time/moment.h"

#define CW_WAYS_KEPT 16u /* a power of two */

/* The parts of the ways to and from a node, see cw_node_timing. */
typedef struct cw_way {
    cw_span tx_delay[2];
    cw_span rx_delay[2];
    cw_span place;
    cw_span stub;
} cw_way;

/* A node puts another level onto its wire. */
typedef struct cw_edge {
    cw_span moment; /* the start of the node's bit */
    cw_span late;   /* it comes that much later than delays say (jitter) */
    uint8_t node;
    bool level;
    uint16_t ways; /* the delays that it has, see cw_cable_delay_then() */
} cw_edge;

typedef struct cw_cable {
    cw_edge *edges;      /* a ring, in the order of moments */
    unsigned capacity;   /* a power of two */
    uint64_t count;      /* edges so far; the last `capacity` of them are kept */
    unsigned node_count;
    uint64_t dominant;   /* nodes whose last edge is dominant */
    cw_span newest;      /* moment of the last edge, */
    cw_span to_dominant; /* ... and of the last dominant one; long ago: there is none */
    cw_span rise_from;   /* while no edge comes but dominant ones, after all nodes were recessive:
                            after this moment no other one is under way. Otherwise CW_SPAN_MAX */
    cw_span longest;     /* no edge is under way for longer */
    cw_span *delays;     /* see cw_cable_delay() */
    cw_way *way;         /* of each node, CW_WAYS_KEPT times: now, and before the last changes */
    uint16_t ways;       /* number of the present ones; number n is at n % CW_WAYS_KEPT */
    uint64_t counted;    /* edges that had been put when these came */
    cw_span replaced[CW_WAYS_KEPT]; /* moments at which others have taken their place */
} cw_cable;

/* Returns the delay of an edge from one node to what another one, or the same, sees. */
static inline cw_span cw_cable_delay(const cw_cable *cable, unsigned from, unsigned to, bool level)
{
    return cable->delays[(from * cable->node_count + to) * 2 + level];
}

/* Returns the delay between two nodes, or from one to itself. */
cw_span cw_way_delay(const cw_way *from, const cw_way *to, bool level);

/* Returns the delay of edges that were driven when the ways had that number. */
cw_span cw_cable_former_delay(const cw_cable *cable, uint16_t ways, unsigned from, unsigned to,
                              bool level);

/* Returns the delay between two nodes as it was when the ways had that number. */
static inline cw_span cw_cable_delay_then(const cw_cable *cable, uint16_t ways, unsigned from,
                                          unsigned to, bool level)
{
    return ways == cable->ways ? cw_cable_delay(cable, from, to, level)
                               : cw_cable_former_delay(cable, ways, from, to, level);
}

/* Returns the moment at which an edge arrives at a node. */
static inline cw_span cw_cable_arrival(const cw_cable *cable, const cw_edge *edge, unsigned node)
{
    return edge->moment + edge->late +
           cw_cable_delay_then(cable, edge->ways, edge->node, node, edge->level);
}

/* Returns the ways of the present. */
static inline cw_way *cw_cable_ways(const cw_cable *cable)
{
    return &cable->way[(cable->ways % CW_WAYS_KEPT) * cable->node_count];
}

/* Returns true when a way can be changed. It cannot when the oldest ones are still needed for looks
 * that far back from now. carries: something else than edges has come by the present ways, such as
 * a pulse. */
bool cw_cable_takes_way(const cw_cable *cable, bool carries, cw_span now, cw_span back);

/* Changes the way of a node, for edges that come from now on. */
void cw_cable_set_way(cw_cable *cable, unsigned node, const cw_way *way, bool carries,
                      cw_span now);

/* Finds the delays by the ways. Returns the longest one. */
cw_span cw_cable_find_delays(cw_cable *cable);

/* Forgets all edges: all nodes are recessive. */
void cw_cable_clear(cw_cable *cable);

/* Adds an edge, not before the last one. */
void cw_cable_put(cw_cable *cable, const cw_edge *edge);

/* Returns the nodes whose dominant level a node sees when it looks at a moment. An edge is seen
 * after it has arrived, not when it arrives (T12). No edge must have come later than the moment. */
uint64_t cw_cable_seen_now(const cw_cable *cable, unsigned node, cw_span moment);

/* Returns the nodes whose dominant level a node sees at a moment. When all edges have arrived,
 * these are the dominant ones. */
static inline uint64_t cw_cable_seen(const cw_cable *cable, unsigned node, cw_span moment)
{
    return cable->newest + cable->longest < moment ? cable->dominant
                                                 : cw_cable_seen_now(cable, node, moment);
}

/* Returns the moment up to which the last dominant edge has arrived everywhere. */
static inline cw_span cw_cable_last_arrival(const cw_cable *cable)
{
    return cable->to_dominant + cable->longest;
}

/* Returns the first moment, at or after another, at which a dominant edge arrives at a node. from:
 * the nodes whose edges count. CW_SPAN_MAX: none is under way. */
cw_span cw_cable_next_arrival(const cw_cable *cable, unsigned node, cw_span moment, uint64_t from);

/* Returns the arrival at a node of the first dominant edge, or the last recessive one, at or after
 * one moment and before another. from: the nodes whose edges count. CW_SPAN_MAX: there is none. */
cw_span cw_cable_change(const cw_cable *cable, unsigned node, bool level, cw_span after,
                        cw_span before, uint64_t from);

/* Moves the epoch forward. */
void cw_cable_rebase(cw_cable *cable, cw_span by);

#endif
