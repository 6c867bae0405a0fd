/* SPDX-License-Identifier: MIT
 *
 * service.h - a running bus with all that serves it: control socket, LCM, recordings, reload.
 */
#ifndef CANWIRE_SERVE_SERVICE_H
#define CANWIRE_SERVE_SERVICE_H

#include "config/rig.h"
#include "engine/engine.h"
#include "engine/group.h"
#include "run/journal.h"
#include "serve/notify.h"

#define SERVICE_TROUBLE_BYTES 300 /* of texts about nodes and about a refused reload, each */

typedef struct service service;

/* The parts of a process that its buses share. */
typedef struct host {
    struct ev_loop *loop;
    notifier *notifier;
    journal *journal;    /* or NULL */
    fileuses files;      /* besides those that the configurations name */
    rig *rig;            /* NULL: there is one bus, of its own */
    engine_group *group; /* of the rig */
    size_t count;
    service *buses[RIG_BUSES_MAX];
    bool expectation_failed; /* of a bus that has ended */
    bool report_missing;     /* that could not be written */
    bool stopping;
    bool stopping_reported; /* to senders of SIGHUP */
    ev_timer *told;  /* an event for it tells the state to the service manager at once ... */
    bool owes_ready; /* ... and then that a reload is over */
} host;

/* Makes the service of a bus, which it takes over. Returns NULL after logging the reason; the
 * caller then keeps the configuration. */
service *service_new(host *h, live *config);

/* Starts all but the bus, which runs already. inherited: a control socket that listens, or -1.
 * Returns false after logging the reason. */
bool service_start(service *s, engine *bus, int inherited);

/* Injects the rules that are kept, and starts the timer of the statistics. */
void service_run(service *s);

const cfg *service_config(const service *s);
live *service_live(const service *s);
engine *service_engine(const service *s);

/* Requests a reload for SIGHUP; there are two rounds at most, see reloader.h. */
void service_hang_up(service *s);

/* Does the work of each second. */
void service_update(service *s);

/* Fills in the bus's part of the status. */
typedef struct service_status {
    cw_bus_stats bus;
    char trouble[SERVICE_TROUBLE_BYTES]; /* ", engine bus-off" and so on, or empty */
    const char *rules;                   /* see kept_trouble() */
    const char *refused;                 /* the reason of a reload, or empty */
    sink_list sinks;                         /* of the bus: all but the journal */
} service_status;
void service_tell(service *s, service_status *out);

/* Reports the end of the bus, and judges it. */
void service_report_end(service *s);

/* Ends the recordings without waiting for a disk: first those of all buses. */
void service_finish(service *s);

/* Ends the control socket and all else but LCM, and waits up to that moment (thread.h) for the
 * disk. The engine still exists. */
void service_stop(service *s, const struct timespec *until);

/* Ends LCM and frees the service with its configuration. NULL is allowed. */
void service_free(service *s);

#endif
