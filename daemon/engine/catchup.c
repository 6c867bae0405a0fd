/* SPDX-License-Identifier: MIT
 *
 * catchup.c - limits the time that a bus behind real time has to catch up with.
 */
#include "engine/catchup.h"

#include "base/log.h"
#include "canwire.h"

#include <inttypes.h>

/* The clocks are read one after the other: a smaller difference is not a suspension. */
#define SUSPENDED_MIN_NS 10000000

uint64_t catchup_excess(uint64_t due, uint64_t now, uint64_t limit)
{
    if (due >= now || now - due <= limit)
        return 0;
    return (now - due) & ~UINT64_C(1); /* two ticks are 25 ns */
}

void catchup_begin(catchup *c, int64_t boot_ns, int64_t monotonic_ns)
{
    c->suspended_ns = boot_ns - monotonic_ns;
}

uint64_t catchup_suspended(catchup *c, int64_t boot_ns, int64_t monotonic_ns)
{
    int64_t more_ns = boot_ns - monotonic_ns - c->suspended_ns;
    if (more_ns < SUSPENDED_MIN_NS)
        return 0;
    c->suspended_ns += more_ns;
    return (uint64_t)more_ns;
}

void catchup_note(catchup *c, uint64_t skipped_ns)
{
    c->skips++;
    c->skipped_ns += skipped_ns;
}

void catchup_log(catchup *c, int64_t monotonic_ns)
{
    uint64_t added_ns = c->skipped_ns - c->logged_ns;
    bool early = c->logged && monotonic_ns - c->last_log_ns < CATCHUP_LOG_NS;
    if (added_ns == 0 || early)
        return;
    log_warning("the bus fell behind real time and has skipped %" PRIu64 ".%03" PRIu64
                " s (stopped, suspended or too slow)",
                added_ns / 1000000000u, added_ns / 1000000u % 1000u);
    c->logged = true;
    c->logged_ns = c->skipped_ns;
    c->last_log_ns = monotonic_ns;
}
