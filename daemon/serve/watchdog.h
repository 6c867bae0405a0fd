/* SPDX-License-Identifier: MIT
 *
 * watchdog.h - feeds the service manager's watchdog as long as the bus advances.
 *
 * That the event loop turns is not enough: the bus is brought up to now and must have got further
 * since the last feeding. A bus that rests does, one that hangs or whose clock stands does not.
 */
#ifndef CANWIRE_SERVE_WATCHDOG_H
#define CANWIRE_SERVE_WATCHDOG_H

#include "engine/engine.h"
#include "serve/notify.h"

typedef struct watchdog {
    ev_timer timer;
    engine *engine;
    notifier *notifier;
    uint64_t fed_tick; /* bus time when it was fed last */
} watchdog;

/* Starts when the service manager asks for it ($WATCHDOG_USEC); what is given must live longer.
 * Called in vain otherwise. */
void watchdog_start(watchdog *w, struct ev_loop *loop, engine *bus, notifier *manager);

/* Whether a bus at this bus time has advanced since the last time that it had. */
bool watchdog_advanced(watchdog *w, uint64_t tick);

#endif
