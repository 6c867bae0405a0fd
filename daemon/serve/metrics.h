/* SPDX-License-Identifier: MIT
 *
 * metrics.h - a small server of HTTP/1 that gives programs a page of all counters, and does
 *             nothing else.
 *
 * Whatever they do, the bus does not wait. There are few connections at a time, and a further one
 * takes the place of the oldest one. Each has one request, of bounded length and time. A page is
 * made in parts between the work of the bus. All who wait for one get the same.
 *
 * There is no library in it: of HTTP it needs a line, one header and a page. The server of a
 * library would bring TLS and threads along, into a process that may not stop.
 */
#ifndef CANWIRE_SERVE_METRICS_H
#define CANWIRE_SERVE_METRICS_H

#include "serve/metrics_page.h"

#include <ev.h>
#include <stdio.h>

#define METRICS_CLIENTS_MAX 16u
#define METRICS_LIMIT_S 10.0 /* for a request and its answer */

typedef struct metrics metrics;

/* Adds all but metrics_page_own() to a page. */
typedef void metrics_fill(void *user, metrics_page *page);

/* Makes it, without a socket. Returns NULL without memory. */
metrics *metrics_new(struct ev_loop *loop, metrics_fill *fill, void *user);

/* Opens what a configuration names, and keeps it beside the present socket until metrics_change().
 * The new one alone listens where both cannot: at 127.0.0.1 and 0.0.0.0. Returns false,
 * with nothing changed, after writing a line with the reason. */
bool metrics_prepare(metrics *m, const cfg *config, FILE *errors);

/* Says whether the bus takes that configuration. Otherwise the socket is closed again, and what was
 * prepared before counts. */
void metrics_settle(metrics *m, bool taken);

/* Goes over to what was prepared. Connections that there are go on to their end. */
void metrics_change(metrics *m);

/* Returns the object of canwire-control(7), to be released by the caller; null without a socket. */
json_t *metrics_json(const metrics *m);

/* Ends all connections. NULL is allowed. */
void metrics_free(metrics *m);

#endif
