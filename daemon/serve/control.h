/* SPDX-License-Identifier: MIT
 *
 * control.h - the control socket of a bus: requests and live events as lines of JSON.
 *
 * What is said there is in config/control.md.
 */
#ifndef CANWIRE_SERVE_CONTROL_H
#define CANWIRE_SERVE_CONTROL_H

#include "engine/engine.h"
#include "run/live.h"

#include <ev.h>
#include <jansson.h>
#include <stdio.h>

typedef struct control control;

/* Listens at the configuration's `control`; inherited: a socket that listens there already, or -1.
 * The others must live longer. NULL after logging why. */
control *control_start(struct ev_loop *loop, live *config, engine *bus, int inherited);

/* What requests for a reload call: it returns the round in which that will be, or 0 after writing
 * why there is none. Of a round that is over, control_reloaded() tells those who have asked for it;
 * errors: NULL, or a line per error. */
typedef uint64_t control_reload(void *user, FILE *errors);
void control_on_reload(control *c, control_reload *call, void *user);
void control_reloaded(control *c, uint64_t round, const char *errors);

/* Disconnects everybody and removes the socket. NULL is fine. */
void control_stop(control *c);

/* The configuration has changed: nodes have other places. */
void control_remap(control *c, const uint8_t from[CW_NODES_MAX]);

/* What goes into the status as `recordings` and `journal`; NULL, or a journal of NULL: nothing. */
typedef json_t *control_files(void *user);
void control_show_files(control *c, control_files *recordings, control_files *journal, void *user);

/* Tells watchers that a recording has begun, or, with the reason, that it has stopped. */
void control_tell_recording(control *c, const char *file, const char *why);

/* To be called for each event of the bus; an engine_observer. */
void control_event(void *self, const cw_event *event);

#endif
