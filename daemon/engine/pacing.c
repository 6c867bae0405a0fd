/* SPDX-License-Identifier: MIT
 *
 * pacing.c - decides when the daemon wakes up, and how much processor time `spin` may use.
 */
#include "engine/pacing.h"

bool pacing_may_spin(pacing_duty *d, int64_t now_ns, int64_t cpu_ns)
{
    if (now_ns - d->window_ns >= PACING_WINDOW_NS)
        *d = (pacing_duty){.window_ns = now_ns, .cpu_ns = cpu_ns};
    int64_t allowed_ns = (now_ns - d->window_ns) / 100 * PACING_DUTY_PERCENT + PACING_ADVANCE_NS;
    return cpu_ns - d->cpu_ns + PACING_SPIN_NS <= allowed_ns;
}

static int64_t round_up(int64_t ns)
{
    const int64_t step = CFG_PACING_TICK_NS;
    return (ns + step - 1) / step * step;
}

int64_t pacing_wake_ns(cfg_pacing pacing, int64_t due_ns, bool may_spin)
{
    switch (pacing) {
    case CFG_PACING_PRECISE:
    case CFG_PACING_VIRTUAL: /* it has no timer */
        break;
    case CFG_PACING_TICK:
        return round_up(due_ns);
    case CFG_PACING_SPIN:
        return may_spin ? due_ns - PACING_SPIN_NS : due_ns;
    }
    return due_ns;
}

int64_t pacing_next_tick_ns(int64_t now_ns)
{
    return round_up(now_ns + 1);
}
