/* SPDX-License-Identifier: MIT
 *
 * control.h - the control socket of a bus: requests and live events as lines of JSON.
 *
 * canwire-control(7) describes them.
 */
#ifndef CANWIRE_SERVE_CONTROL_H
#define CANWIRE_SERVE_CONTROL_H

#include "engine/engine.h"
#include "run/live.h"
#include "serve/kept.h"
#include "serve/status.h"

#include <ev.h>
#include <jansson.h>
#include <stdio.h>

typedef struct control control;

/* Listens at the configuration's `control`. errors: those that nodes have detected, for the status.
 * inherited: a socket that listens there already, or -1. The others must live longer. Returns NULL
 * after logging the reason. */
control *control_start(struct ev_loop *loop, live *config, engine *bus,
                       const status_errors *errors, int inherited);

/* Starts a reload for a request. Returns its round, or 0 after writing the reason.
 * control_reloaded() reports the end of a round to its clients; errors: NULL, or a line per
 * error. */
typedef uint64_t control_reload(void *user, FILE *errors);
void control_on_reload(control *c, control_reload *call, void *user);
void control_reloaded(control *c, uint64_t round, const char *errors);

/* Disconnects all clients and removes the socket. NULL is allowed. */
void control_stop(control *c);

/* Remembers injected rules there. control_saved() reports the end of all saves up to a number, as
 * kept_written(). */
void control_keep(control *c, kept *k);
void control_saved(control *c, uint64_t save, int error);

/* Sets who puts the service's part of the status: recordings, journal, sinks, gateways. */
typedef void control_more(void *user, json_t *status);
void control_show_more(control *c, control_more *more, void *user);

/* Reports to watchers that a recording has begun or, with the reason, that it has stopped. */
void control_report_recording(control *c, const char *file, const char *why);

/* Takes each event of the bus, as an engine_observer. */
void control_event(void *self, const cw_event *event);

#endif
