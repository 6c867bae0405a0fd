/* SPDX-License-Identifier: MIT
 *
 * recordings.h - the recordings of a running bus, by `record` in its configuration.
 */
#ifndef CANWIRE_SERVE_RECORDINGS_H
#define CANWIRE_SERVE_RECORDINGS_H

#include "base/file/sink.h"
#include "record/recorder.h"

#include <ev.h>
#include <jansson.h>
#include <time.h>

typedef struct recordings recordings;

/* Reports a recording that cannot go on, with the reason, and one that begins after the start;
 * `why` is then NULL. */
typedef void recordings_reported(void *user, const char *file, const char *why);

/* Begins the recordings of a configuration, which must stay in place, also when it changes. Returns
 * NULL after logging the problem; a full disk does not prevent the start. */
recordings *recordings_start(struct ev_loop *loop, const cfg *config, const cw_bus *bus,
                             recordings_reported *reported, void *user);

/* The time at the end for a slow disk, for the recordings and reports of all buses together. With
 * CLOSE_S of journal.c and GIVE_UP_S of publish.c it is less than TimeoutStopSec of
 * canwired@.service. */
#define RECORDINGS_PATIENCE_S 4

/* Ends the recordings without waiting, so that none waits for another. They take no more events.
 * NULL is allowed. */
void recordings_finish(recordings *all);

/* Finishes them, and waits up to that moment (thread.h) for what is still to be written. NULL is
 * allowed. */
void recordings_stop(recordings *all, const struct timespec *until);

/* Take each event with its time in nanoseconds since 1970, and each bit, if they are wanted. */
void recordings_event(recordings *all, const cw_event *event, uint64_t time_ns);
void recordings_bit(recordings *all, const cw_bus *bus);
bool recordings_want_bits(const recordings *all);

/* Adapts to a changed configuration. Removed entries end, new ones begin, and those that ended with
 * an error are tried again. The others go on. */
void recordings_reload(recordings *all, const cw_bus *bus);

/* Begins entries whose file has become free, and logs entries that were left out since the last
 * call; call it about once a second. */
void recordings_update(recordings *all, const cw_bus *bus);

/* Returns the object of canwire-control(7), to be released by the caller. */
json_t *recordings_json(const recordings *all);

/* Adds each recording. */
void recordings_sinks(const recordings *all, sink_list *out);

#endif
