/* SPDX-License-Identifier: MIT
 *
 * fault.h - fault rules at work: which of them act on the bit in progress, and how.
 *
 * A rule is bound to a transmitter when its transmission begins, stays bound until that node's next
 * one or its next reception, and matches when the named bit is reached. What follows from the
 * changed level is the controllers' affair.
 */
#ifndef CANWIRE_FAULT_H
#define CANWIRE_FAULT_H

#include "canwire.h"
#include "prng.h"

typedef struct cw_fault {
    cw_rule rule;
    cw_prng prng;
    uint64_t bound;     /* nodes whose present transmission the rule looks at */
    uint64_t matches;
    uint64_t hits;
    uint64_t passed;    /* matches since skip was used up */
    uint32_t bits_left; /* of the action under way, the present bit included */
    bool hit_now;       /* hit in the present bit; the bus makes it an event */
} cw_fault;

/* What the faults of one bit do, as sets of nodes whose sampled level is inverted. */
typedef struct cw_disturbance {
    bool wire; /* everybody's */
    uint64_t nodes;
} cw_disturbance;

/* What the bus knows of the bit in progress, after all nodes have driven. */
typedef struct cw_bit_context {
    const cw_mac *const *macs;  /* one a node */
    unsigned node_count;
    uint64_t start_tick;        /* of the bit */
    bool wire;                  /* level without faults */
    uint64_t error_flag_bit;    /* index in the first error flag of this attempt, or CW_NEVER */
    uint64_t overload_flag_bit; /* the same for its first overload flag */
} cw_bit_context;

void cw_fault_init(cw_fault *fault, const cw_rule *rule, uint64_t seed);

/* A node begins to transmit a frame; replaces what the rule was bound to at that node. */
void cw_fault_bind(cw_fault *fault, unsigned node, const cw_frame *frame);

/* The rule in the bit in progress: adds its effect to *out. */
void cw_fault_apply(cw_fault *fault, cw_disturbance *out, const cw_bit_context *context);

/* Whether the rule looks at the bits to come or is acting: they must be simulated one by one. */
static inline bool cw_fault_is_awake(const cw_fault *fault)
{
    return fault->bound != 0 || fault->bits_left != 0;
}

#endif
