/* SPDX-License-Identifier: MIT
 *
 * verdicts.h - judges a running bus by `expect` in its configuration, and reports at its end.
 *
 * It only takes events, so the bus is the same with and without it.
 */
#ifndef CANWIRE_SERVE_VERDICTS_H
#define CANWIRE_SERVE_VERDICTS_H

#include "base/file/sink.h"
#include "config/config.h"

#include <jansson.h>
#include <time.h>

#define VERDICTS_GONE_MAX 1000u /* failed expectations that reloads have taken away */

typedef struct verdicts verdicts;

/* An expectation, and how it has failed. */
typedef struct verdict {
    char *name;   /* owned, as are the other texts */
    char *wanted;
    char *got;    /* when it failed, else NULL */
    char *event;  /* that it failed by; "": by the time alone; NULL: it has not failed */
    uint64_t tick;          /* at which it failed */
    unsigned configuration; /* the last one that had it, counted from 1 */
    bool failed;
    bool gone; /* a reload has taken it away */
} verdict;

/* Begins to judge. The configuration must stay in place, also when it changes. label: the name of
 * the bus in the log, or NULL. Returns NULL after logging why its report could not be made; a full
 * disk does not prevent the start. */
verdicts *verdicts_start(const cfg *config, const cw_bus *bus, const char *label);

/* Removes the report of an earlier run, which must not be taken for that of this one. To be called
 * when nothing can refuse the start any more; a reload does it for another file. */
void verdicts_begin(verdicts *v);

/* Takes each event, in order. */
void verdicts_event(verdicts *v, const cw_event *event);

/* Adapts to a changed configuration; `from` as in engine_changed. Expectations with equal names and
 * conditions go on. Of those that are gone the failed ones stay. */
void verdicts_reload(verdicts *v, const cw_bus *bus, const uint8_t from[CW_NODES_MAX]);

/* Adapts to other names of guests. */
void verdicts_rename(verdicts *v, const cw_bus *bus);

/* Finds what has failed because nothing has happened; call it about once a second. */
void verdicts_update(verdicts *v, const cw_bus *bus);

/* Counts the expectations, those that are gone included; and those of them that have failed. */
size_t verdicts_count(const verdicts *v);
uint64_t verdicts_failed(const verdicts *v);

/* Returns one of them: first those that are gone. */
const verdict *verdicts_at(const verdicts *v, size_t i);

/* Puts `expectations` of canwire-control(7), if there are any, as many as a reply takes. Those that
 * have failed come before others, then. */
void verdicts_put(const verdicts *v, const cw_bus *bus, json_t *status);

/* Adds the report, if there is to be one. */
void verdicts_sink(const verdicts *v, sink_list *out);

/* Judges by the end of the run, logs, and begins to write the report. */
void verdicts_conclude(verdicts *v, const cw_bus *bus);

/* Waits up to that moment (thread.h) for the report, and frees the verdicts. Returns false, after
 * logging why, when it could not be written. NULL is allowed. */
bool verdicts_stop(verdicts *v, const struct timespec *until);

#endif
