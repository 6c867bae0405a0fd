/* SPDX-License-Identifier: MIT
 *
 * sources.h - the periodic messages of a configuration, with the lengths of their frames.
 */
#ifndef CANWIRE_CLI_ANALYSE_SOURCES_H
#define CANWIRE_CLI_ANALYSE_SOURCES_H

#include "cli/analyse/response.h"
#include "config/config.h"

typedef struct source {
    const cfg_node *node;
    const cw_frame *frame;
    const cfg_traffic *traffic; /* NULL: a trigger of its schedule sends it */
    unsigned trigger;     /* 1 + its number, as events have it; 0: traffic */
    bool arbitrating;     /* other nodes may send at the same time as the trigger */
    uint64_t every;       /* its usual period; CW_NEVER: it comes once */
    unsigned bits;        /* of the longest frame of this length of data, with the intermission */
    uint64_t length;      /* ticks of the frame as it is configured, with the intermission */
    uint64_t mean;        /* ... and with random data: what it has on average */
    unsigned id_stuff;    /* stuff bits that its identifier needs */
    uint64_t seen;        /* longest time from hand-in to the end of the frame, in a simulation */
    uint64_t seen_count;
    uint64_t given_up;    /* frames of a trigger that were not sent in their slots */
} source;

/* All messages of a configuration. */
typedef struct sources {
    const cfg *config;
    size_t count;
    source *list;               /* sorted by priority, like ... */
    response_message *messages; /* ... these */
    uint64_t slowness; /* of the slowest clock: the part of a bit that it needs more, in 2^-32 */
    bool overloads;    /* some node asks for time by overload frames */
    bool incomplete;   /* frames of ports, replays or replies are unknown */
    bool strangers;    /* triggers whose reference message comes from no schedule are unknown */
    bool sleepers;     /* nodes sleep at the start: the time of their wake-up is unknown */
} sources;

/* Finds all messages. Returns false without memory. sources_free() in either case. */
bool sources_find(sources *s, const cfg *config);

void sources_free(sources *s);

#endif
