/* SPDX-License-Identifier: MIT
 *
 * class.h - the class of a row: what a scenario has shown, for the statistics of a campaign.
 *
 * canwire-report(7) defines the classes for users.
 */
#ifndef CANWIRE_CAMPAIGN_CLASS_H
#define CANWIRE_CAMPAIGN_CLASS_H

#include "campaign/outcome.h"

/* The first ones make up the rates; the last three are counted separately. */
typedef enum row_class {
    CLASS_NO_EFFECT = 0,
    CLASS_CORRECTED,  /* errors, and all is well in the end */
    CLASS_DEGRADED,   /* passed, with a loss or a node that was not error-active */
    CLASS_DETECTED,   /* failed, and seen */
    CLASS_UNDETECTED, /* failed, and not seen */
    CLASS_TIMEOUT,
    CLASS_CRASHED,
    CLASS_INVALID,
    CLASS_BROKEN,
    CLASS_COUNT
} row_class;

#define CLASS_RATED CLASS_CRASHED /* the number of classes in the rates */

/* Why a row that has passed is degraded, as a set. */
#define DEGRADED_PASSIVE 0x01u    /* a node was error-passive */
#define DEGRADED_BUS_OFF 0x02u    /* ... or bus-off */
#define DEGRADED_STATE 0x04u      /* ... or is not error-active in the end */
#define DEGRADED_DROPPED 0x08u    /* a frame was dropped */
#define DEGRADED_UNDETECTED 0x10u /* ... or accepted with content that nobody sent */
#define DEGRADED_REASONS 5u

/* All that decides about the class. */
typedef struct class_facts {
    outcome outcome;
    bool failed;     /* an expectation that is not a sign of detection is not met */
    bool announced;  /* one that is such a sign is met */
    bool error;      /* a node has detected an error ... */
    bool error_after_hit; /* ... at or after the first hit of a fault rule */
    bool hit;        /* a fault rule has acted */
    unsigned degraded; /* DEGRADED_... as a set */
} class_facts;

row_class class_of(const class_facts *f);

/* Returns the name for people, and in JSON. */
const char *class_name(row_class c);

/* Returns the name of reason 1 << i for it, i < DEGRADED_REASONS. */
const char *class_reason_name(unsigned i);

#endif
