/* SPDX-License-Identifier: MIT
 *
 * sim_progress.c - one line on a terminal that tells how far a long run has come.
 */
#include "sim_progress.h"

#include <inttypes.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

#define LOOK_TICKS (CW_CLOCK_HZ / 100u) /* bus time between two looks at the clock */
#define FIRST_NS INT64_C(1000000000)
#define PERIOD_NS INT64_C(250000000)
#define LINE_MAX_BYTES 192
#define AWAITED_MAX 32 /* letters of the event that the run waits for */

static int64_t wall_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

void sim_progress_start(sim_progress *p, bool wanted, const char *awaited)
{
    *p = (sim_progress){.on = wanted && isatty(STDERR_FILENO), .awaited = awaited};
    if (!p->on)
        return;
    p->start_ns = wall_ns();
    p->next_ns = p->start_ns + FIRST_NS;
}

bool sim_progress_is_due(sim_progress *p, uint64_t now)
{
    if (!p->on || now - p->looked < LOOK_TICKS)
        return false;
    p->looked = now;
    return wall_ns() >= p->next_ns;
}

/* "1:02:03" or "2:03" */
static int print_clock(char *out, size_t size, double seconds)
{
    uint64_t s = (uint64_t)seconds;
    if (s >= 3600)
        return snprintf(out, size, "%" PRIu64 ":%02u:%02u", s / 3600, (unsigned)(s / 60 % 60),
                        (unsigned)(s % 60));
    return snprintf(out, size, "%u:%02u", (unsigned)(s / 60), (unsigned)(s % 60));
}

void sim_progress_write(sim_progress *p, const cw_bus *bus, uint64_t end)
{
    char line[LINE_MAX_BYTES];
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    int64_t now_ns = wall_ns();
    double wall = (double)(now_ns - p->start_ns) / 1e9;
    double done = (double)stats.ticks / CW_CLOCK_HZ;
    bool known = end != CW_NEVER && end > stats.ticks && stats.ticks > 0;
    int used = snprintf(line, sizeof line, "%.1f s", done);
    if (known)
        used += snprintf(line + used, sizeof line - (size_t)used, " of %.1f s",
                         (double)end / CW_CLOCK_HZ);
    used += snprintf(line + used, sizeof line - (size_t)used,
                     " bus time, %" PRIu64 " frames, %.3g x real time", stats.frames, done / wall);
    if (known) {
        used += snprintf(line + used, sizeof line - (size_t)used, ", ");
        used += print_clock(line + used, sizeof line - (size_t)used,
                            wall * (double)(end - stats.ticks) / (double)stats.ticks);
        used += snprintf(line + used, sizeof line - (size_t)used, " left");
    }
    if (p->awaited)
        used += snprintf(line + used, sizeof line - (size_t)used, ", waits for %.*s", AWAITED_MAX,
                         p->awaited);
    unsigned before = p->width;
    p->width = (unsigned)used;
    p->next_ns = now_ns + PERIOD_NS;
    fprintf(stderr, "\r%s%*s", line, before > p->width ? (int)(before - p->width) : 0, "");
    (void)fflush(stderr);
}

void sim_progress_wipe(sim_progress *p)
{
    if (p->width == 0)
        return;
    fprintf(stderr, "\r%*s\r", (int)p->width, "");
    (void)fflush(stderr);
    p->width = 0;
}
