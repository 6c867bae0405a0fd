/* SPDX-License-Identifier: MIT
 *
 * sim_until.h - ends a run with an event: [NODE:]KIND[:WHICH].
 */
#ifndef CANWIRE_SIM_SIM_UNTIL_H
#define CANWIRE_SIM_SIM_UNTIL_H

#include "sim/sim_run.h"

typedef struct sim_until {
    const char *text; /* the text of the user, NULL: no event is awaited */
    sim_run *run;
    const char *before;                     /* begins messages; not owned */
    uint64_t nodes;                         /* of any of these */
    uint32_t kinds;                         /* 1u << cw_event_kind */
    uint32_t states;                        /* CW_EVENT_STATE: 1u << cw_state */
    const char *rule;                       /* CW_EVENT_FAULT: its name; NULL: any */
    cw_filter filters[CW_RULE_FILTERS_MAX]; /* of events with a frame */
    unsigned filter_count;
    bool happened;
    uint64_t tick; /* ... at */
    void (*found)(void *user, uint64_t tick); /* called in place of the stop, if it is not NULL */
    void *user;
    FILE *warns;       /* see sim_until_warn(); NULL: it does not, or no more */
} sim_until;

/* Reads the awaited event and adds the sink that stops the run, which is careful from the start. It
 * does nothing for NULL as text. Returns false after a message of the run, which begins with
 * "canwire sim: --until-event". */
bool sim_until_start(sim_until *u, const char *text, sim_run *run);

/* Reads the awaited event alone, for a caller that passes events to sim_until_is(). A message goes
 * to `messages` and begins with `before`. */
bool sim_until_read(sim_until *u, const char *text, sim_run *run, const char *before);

/* Returns true for the awaited event. */
bool sim_until_is(const sim_until *u, const cw_event *event);

/* Warns once when the event has not come after 10 s of bus time. Use it for a run without another
 * end. */
void sim_until_warn(sim_until *u, FILE *out);

/* Adapts to another configuration, in which the text has a new meaning. The event cannot come there
 * without its node or rule. */
void sim_until_change(sim_until *u);

/* Reports that the event did not come. */
void sim_until_finish(const sim_until *u, FILE *out);

#endif
