/* SPDX-License-Identifier: MIT
 *
 * vtime_wait.c - a program waits in virtual time, and so do its timers and the library's own items.
 */
#include "preload/pump.h"
#include "preload/vtime.h"
#include "preload/vtimer.h"

#include <errno.h>

static unsigned looks; /* in a row */

static int64_t earliest(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

int vtime_wait_for(const vtime_wait *wait)
{
    const vtime_wait own = {.until_ns = earliest(pump_due_ns(), vtimer_due_ns()),
                            .wants = pump_has_items() ? TIMING_MESSAGES : 0};
    bool turned;
    const int error = vtime_turn(wait, &own, &turned);
    if (!turned && error == 0)
        pump_step(); /* the bus has gone, and with it the ports */
    if (!turned)
        return error;
    looks = 0;
    pump_step();
    const bool rang = vtimer_run(vtime_now_ns());
    return error == EINTR || rang ? EINTR : 0;
}

void vtime_look(void)
{
    const vtime_wait wait = {.until_ns = vtime_now_ns() + VTIME_LOOK_NS, .restarts = true};
    if (!vtime_has_turn() || looks++ < VTIME_LOOKS)
        return;
    (void)vtime_wait_for(&wait);
    looks = VTIME_LOOKS;
}

int vtime_sleep(int64_t until_ns)
{
    const vtime_wait wait = {.until_ns = until_ns};
    int error;
    do
        error = vtime_wait_for(&wait);
    while (error == 0 && vtime_now_ns() < until_ns);
    return error;
}
