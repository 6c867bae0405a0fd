/* SPDX-License-Identifier: MIT
 *
 * watchdog.h - feeds the service manager's watchdog as long as all buses advance.
 *
 * A running event loop is not enough: the bus is advanced to the present and must have moved since
 * the last feeding. A resting bus moves; one that hangs, or whose clock stands still, does not.
 */
#ifndef CANWIRE_SERVE_WATCHDOG_H
#define CANWIRE_SERVE_WATCHDOG_H

#include "engine/engine.h"
#include "serve/notify.h"

typedef struct watchdog {
    ev_timer timer;
    engine *const *buses;
    size_t count;
    notifier *notifier;
    uint64_t fed_tick; /* bus time at the last feeding, of the bus that was furthest behind */
} watchdog;

/* Starts when the service manager asks for it ($WATCHDOG_USEC), and does nothing otherwise. The
 * arguments must live longer. */
void watchdog_start(watchdog *w, struct ev_loop *loop, engine *const *buses, size_t count,
                    notifier *manager);

/* Returns true when the bus time has advanced since the last time that it did. */
bool watchdog_advanced(watchdog *w, uint64_t tick);

#endif
