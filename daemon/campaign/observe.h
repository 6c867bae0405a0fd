/* SPDX-License-Identifier: MIT
 *
 * observe.h - what the events of a run tell beside the counters of its end.
 */
#ifndef CANWIRE_CAMPAIGN_OBSERVE_H
#define CANWIRE_CAMPAIGN_OBSERVE_H

#include "canwire.h"

/* The kinds of events that it needs. */
#define OBSERVED_KINDS (1u << CW_EVENT_ERROR | 1u << CW_EVENT_STATE | 1u << CW_EVENT_FAULT)

/* All zeros has seen nothing. */
typedef struct observation {
    bool has_error;
    bool has_fault;
    uint64_t error_tick; /* of the first error */
    uint64_t error_nodes;
    cw_error error;
    uint64_t fault_tick;           /* of the first hit of a rule */
    uint64_t before_tick;          /* of the last error before this hit */
    bool has_later;
    /* Of the first error that may come from this hit. It is at or after the hit, or at it for one
     * in the bit before it off the grid. */
    uint64_t later_tick;
    uint64_t unwell;                /* nodes that are not error-active, as a set */
    uint64_t left_tick[CW_NODES_MAX]; /* when each has last ceased to be error-active */
    uint64_t back_tick[CW_NODES_MAX]; /* ... and when it has last become so again */
    uint16_t tec_max[CW_NODES_MAX]; /* of events; see observe_end() */
    uint16_t rec_max[CW_NODES_MAX];
} observation;

/* Takes an event of a bus with such bits, in order. */
void observe_event(observation *seen, const cw_event *event, const cw_bus *bus, cw_rate rate);

/* Takes the counters at the end of a run. */
void observe_end(observation *seen, const cw_bus *bus, unsigned node_count);

#endif
