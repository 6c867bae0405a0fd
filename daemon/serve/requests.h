/* SPDX-License-Identifier: MIT
 *
 * requests.h - the requests at the control socket.
 */
#ifndef CANWIRE_SERVE_REQUESTS_H
#define CANWIRE_SERVE_REQUESTS_H

#include "engine/engine.h"
#include "run/live.h"
#include "serve/kept.h"
#include "serve/status.h"

#include <jansson.h>

#define REQUEST_BYTES_MAX (1u << 16) /* of all requests but inject, which has the whole line */
#define REQUEST_DEPTH_MAX 8          /* nested lists and maps */
#define REQUEST_WATCH_RECORD (1u << 31) /* a kind of event besides those of the bus: record */
#define REQUEST_VALUES_MAX 256       /* values and keys, so that parsing is cheap */

/* Begins a reload, whose end is reported by request_reloaded(). Returns its round, or 0 after
 * writing the reason. */
typedef uint64_t request_reload(void *user, FILE *errors);

/* The objects that requests act on. */
typedef struct request_world {
    live *config;
    engine *engine;
    const status_errors *errors;
    request_reload *reload; /* or NULL */
    void *reload_user;
    kept *kept;           /* or NULL */
    void (*more)(void *user, json_t *status); /* puts the service's part of a status; or NULL */
    void *more_user;
} request_world;

/* The effects of a request beyond its reply. */
typedef struct request_result {
    bool watch_changed;
    /* 1u << cw_event_kind, or REQUEST_WATCH_*, for each kind that the client wants from now on */
    uint32_t watch;
    uint64_t round; /* of a reload; not 0: the reply is complete when the round has ended */
    uint64_t save;  /* of rules, see kept_save(); not 0: the reply is complete when it is over */
    bool keep;      /* the rules go again when it fails */
    bool clears;    /* they may come back with the next start when it fails */
} request_result;

/* Carries out a request, a line of JSON. Returns the reply, to be released by the caller. *result
 * starts all zero. */
json_t *request_answer(const request_world *world, request_result *result, const char *line,
                       size_t length);

/* Completes the reply to a reload. errors: NULL, or a line per error. */
void request_reloaded(json_t *reply, const char *errors);

/* Completes the reply to a request whose rules are to be kept, and could not be saved: they go. */
void request_not_kept(const request_world *world, json_t *reply, int error);

/* The same of a request that has cleared rules, which may come back. */
void request_not_cleared(json_t *reply, int error);

#endif
