/* SPDX-License-Identifier: MIT
 *
 * losses.h - what a run has lost: frames that were dropped or never sent, rules that never acted.
 *
 * It takes the events of a run. All zeros, but for the configuration, has lost nothing.
 */
#ifndef CANWIRE_SIM_LOSSES_H
#define CANWIRE_SIM_LOSSES_H

#include "config/config.h"

#define LOSSES_KINDS (1u << CW_EVENT_DROP) /* the kinds of events that it needs */
#define LOSSES_MAX 64u   /* nodes and reasons; more are only counted */
#define LOSS_IDS 3u      /* first identifiers that are told */
#define LOSS_TEXT_MAX 256

/* Frames that a node has lost for one reason. */
typedef struct lost_frames {
    uint8_t node;
    uint8_t why; /* a cw_drop */
    uint8_t id_count;
    uint32_t ids[LOSS_IDS]; /* with CW_FILTER_EXTENDED */
    uint64_t count;
} lost_frames;

typedef struct losses {
    const cfg *config;
    uint64_t fed;  /* nodes that gateways of a rig feed */
    bool of_row;   /* without what takes long to find out, and rules that wait for programs */
    bool programs; /* there are programs, which send frames that the configuration does not name */
    unsigned count;
    uint64_t more; /* frames of nodes and reasons that are not kept */
    lost_frames list[LOSSES_MAX];
} losses;

/* A loss in words. */
typedef struct loss_words {
    bool is_rule;     /* the name is one of a rule, otherwise of a node */
    const char *name; /* with the name of its bus before it, in a rig */
    const char *why;  /* "never matched", "queue-full", "not sent" */
    uint64_t frames;  /* of a node */
    const char *ids;  /* the first identifiers, or "" */
    const char *help; /* an explanation, or a key that avoids it; or "" */
} loss_words;

typedef void losses_teller(void *user, const loss_words *words);

/* Forgets all, for another run of the same configuration. */
void losses_forget(losses *all);

/* Takes each event of such kinds. Drops by fault rules were asked for, so they are not
 * losses. */
void losses_event(losses *all, const cw_event *event);

/* Tells what has been lost when a run has ended with this bus. before: stands before names of nodes
 * and rules, such as "BUS:"; or "". */
void losses_tell(const losses *all, const cw_bus *bus, const char *before, losses_teller *tell,
                 void *user);

/* Does the same in lines on a stream: "dropped: a: 10 frames, queue-full (111, …): queue: 17". */
void losses_print(const losses *all, const cw_bus *bus, const char *before, FILE *out);

#endif
