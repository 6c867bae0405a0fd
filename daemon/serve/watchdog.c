/* SPDX-License-Identifier: MIT
 *
 * watchdog.c - feeds the service manager's watchdog as long as all buses advance.
 */
#include "serve/watchdog.h"

#include <systemd/sd-daemon.h>

#define FEEDS 3.0 /* in the manager's time limit, so that one may fail */

bool watchdog_advanced(watchdog *w, uint64_t tick)
{
    bool advanced = tick > w->fed_tick;
    if (advanced)
        w->fed_tick = tick;
    return advanced;
}

/* Tells systemd that canwired is alive, if the slowest of its buses goes on. */
static void watchdog_on_timer(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    watchdog *w = timer->data;
    uint64_t least = UINT64_MAX;
    for (size_t i = 0; i < w->count; i++) {
        engine_update(w->buses[i]);
        const uint64_t now = cw_bus_now(engine_bus(w->buses[i]));
        least = now < least ? now : least;
    }
    if (watchdog_advanced(w, least))
        notify_alive(w->notifier);
}

void watchdog_start(watchdog *w, struct ev_loop *loop, engine *const *buses, size_t count,
                    notifier *manager)
{
    uint64_t usec = 0;
    if (sd_watchdog_enabled(0, &usec) <= 0)
        return;
    *w = (watchdog){.buses = buses, .count = count, .notifier = manager};
    double period = (double)usec / 1e6 / FEEDS;
    ev_timer_init(&w->timer, watchdog_on_timer, period, period);
    w->timer.data = w;
    ev_timer_start(loop, &w->timer);
}
