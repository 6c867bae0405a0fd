/* SPDX-License-Identifier: MIT
 *
 * recordings.h - the recordings of a running bus, as `record` in its configuration says.
 */
#ifndef CANWIRE_SERVE_RECORDINGS_H
#define CANWIRE_SERVE_RECORDINGS_H

#include "record/recorder.h"

#include <ev.h>
#include <jansson.h>

typedef struct recordings recordings;

/* Is told when a recording has ended because it cannot go on, and when one begins after the start;
 * why is NULL then. */
typedef void recordings_told(void *user, const char *file, const char *why);

/* Begins the recordings of a configuration, which must stay where it is, also when it changes. NULL
 * after logging what is wrong; a full disk is no reason not to start. */
recordings *recordings_start(struct ev_loop *loop, const cfg *config, const cw_bus *bus,
                             recordings_told *told, void *user);

/* Waits a few seconds for what is still to be written. NULL is fine. */
void recordings_stop(recordings *all);

/* Each event with its time in nanoseconds since 1970, and each bit, if they are wanted. */
void recordings_event(recordings *all, const cw_event *event, uint64_t time_ns);
void recordings_bit(recordings *all, const cw_bus *bus);
bool recordings_want_bits(const recordings *all);

/* The configuration has changed: entries that are gone end, new ones begin, those that have ended
 * because of an error are tried again; the others go on. */
void recordings_reload(recordings *all, const cw_bus *bus);

/* Begins what has waited for its file, logs what has been left out since the last time; to be
 * called once a second or so. */
void recordings_update(recordings *all, const cw_bus *bus);

/* As config/control.md tells. To be released by the caller. */
json_t *recordings_json(const recordings *all);

#endif
