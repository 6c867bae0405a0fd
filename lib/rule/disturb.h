/* SPDX-License-Identifier: MIT
 *
 * disturb.h - what rules do to levels where nodes have clocks of their own: from one moment to
 * another, not in bits that all nodes share.
 */
#ifndef CANWIRE_RULE_DISTURB_H
#define CANWIRE_RULE_DISTURB_H

#include "time/cable.h"

typedef enum cw_disturb_effect {
    CW_DISTURB_NOTHING = 0,
    CW_DISTURB_DOMINANT,
    CW_DISTURB_RECESSIVE,
    CW_DISTURB_INVERT,
} cw_disturb_effect;

typedef struct cw_disturbance {
    cw_span begin;    /* it acts on looks after this moment ... */
    cw_span end;      /* ... up to this one; CW_SPAN_MAX: not known yet */
    uint64_t lines;   /* the nodes whose lines to the wire it changes, ... */
    uint64_t wires;   /* ... whose wires, ... */
    uint64_t samples; /* ... and whose samples */
    uint8_t source;   /* it comes to a node as late as the edges of this one; CW_NO_NODE: at once */
    uint8_t effect;   /* cw_disturb_effect */
    uint16_t rule;
    uint16_t ways;    /* the delays that it has, by cw_disturb() */
} cw_disturbance;

/* Sorted by rule. */
typedef struct cw_disturbances {
    cw_disturbance *list;
    unsigned capacity;
    unsigned count;
    uint16_t ways; /* the present ones of the cable, see cw_cable_delay_then() */
} cw_disturbances;

/* Adds one. The place of one that has ended is used when there is no room. */
void cw_disturb(cw_disturbances *all, const cw_disturbance *added);

/* Returns true when one has those delays. */
bool cw_disturbs_by(const cw_disturbances *all, uint16_t ways);

/* Ends the disturbance of a rule that has no end yet. */
void cw_disturb_end(cw_disturbances *all, unsigned rule, cw_span moment);

/* Forgets those that no look after a moment can meet. */
void cw_disturb_forget(cw_disturbances *all, cw_span moment);

/* Moves the epoch forward. */
void cw_disturb_rebase(cw_disturbances *all, cw_span by);

/* Returns the levels of lines, or of wires, as rules have changed them right after a moment: at
 * their source, so without delays. */
uint64_t cw_disturbed_lines_at_source(const cw_disturbances *all, cw_span moment, uint64_t levels);
uint64_t cw_disturbed_wires_at_source(const cw_disturbances *all, cw_span moment, uint64_t levels);

/* Returns the first begin or end of a disturbance after a moment. CW_SPAN_MAX: there is none. */
cw_span cw_disturb_next_change(const cw_disturbances *all, cw_span moment);

/* Returns the nodes whose dominant level comes to a node, after what rules do to their lines. */
uint64_t cw_disturbed_lines(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                            cw_span moment, uint64_t seen);

/* Returns the level of a node's wire at a moment, as it comes to the node. seen: the nodes whose
 * dominant level comes to it then. wire: the nodes on its wire. */
bool cw_disturbed_wire(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                       cw_span moment, uint64_t seen, uint64_t wire);

/* Returns the level that the node takes, from that of its wire. */
bool cw_disturbed_sample(const cw_disturbances *all, const cw_cable *cable, unsigned node,
                         cw_span moment, bool level);

#endif
