/* SPDX-License-Identifier: MIT
 *
 * sim_progress.c - shows the progress of a long run in one line on a terminal.
 */
#include "cli/sim/sim_progress.h"

#include "base/text/counted.h"
#include "base/text/memo.h"
#include "base/wall.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define LOOK_TICKS (CW_CLOCK_HZ / 100u) /* bus time between two readings of the clock */
#define FIRST_NS INT64_C(1000000000)
#define PERIOD_NS INT64_C(250000000)
#define LINE_MAX_BYTES 192
#define COLUMNS_DEFAULT 80 /* of a terminal of unknown width */
#define CLOCK_MAX 32
#define AWAITED_MAX 32 /* letters of an awaited event */

/* Returns true when a new line is due. It is cheap, for frequent calls. */
static bool is_due(sim_progress *p, uint64_t now)
{
    if (!p->on || now - p->looked < LOOK_TICKS)
        return false;
    p->looked = now;
    return wall_ns() >= p->next_ns;
}

/* Prints "1:02:03" or "2:03". */
static void print_clock(char *out, size_t size, double seconds)
{
    uint64_t s = (uint64_t)seconds;
    if (s >= 3600)
        snprintf(out, size, "%" PRIu64 ":%02u:%02u", s / 3600, (unsigned)(s / 60 % 60),
                 (unsigned)(s % 60));
    else
        snprintf(out, size, "%u:%02u", (unsigned)(s / 60), (unsigned)(s % 60));
}

/* Prints three significant digits without an exponent. */
static void print_factor(FILE *out, double factor)
{
    double unit = 1;
    while (factor / unit >= 999.5)
        unit *= 10;
    if (unit > 1)
        fprintf(out, "%.0f", (double)(uint64_t)(factor / unit + 0.5) * unit);
    else if (factor < 0.001)
        fputs("0.001", out);
    else
        fprintf(out, "%.3g", factor);
}

/* The details of a line, least important first. On a narrow terminal they are left out in turn, the
 * bus time last. */
typedef enum detail {
    DETAIL_AWAITED = 0,
    DETAIL_FRAMES,
    DETAIL_SPEED,
    DETAIL_UNIT, /* the unit of the first number */
    DETAIL_LEFT,
    DETAIL_END,
    DETAIL_COUNT
} detail;

/* The data of a line. */
typedef struct progress_line {
    const cw_bus_stats *stats;
    uint64_t end;  /* CW_NEVER: unknown */
    double wall_s; /* since the start */
    const char *awaited;
} progress_line;

/* Prints the time that is left, if the bus goes on as fast as up to now. */
static void print_left(FILE *out, const progress_line *n)
{
    const double per_tick = n->wall_s / (double)n->stats->ticks;
    char clock[CLOCK_MAX];
    print_clock(clock, sizeof clock, per_tick * (double)(n->end - n->stats->ticks));
    fprintf(out, ", %s left", clock);
}

static void print_awaited(FILE *out, const char *awaited)
{
    fprintf(out, ", waits for %.*s%s", AWAITED_MAX, awaited,
            strlen(awaited) > AWAITED_MAX ? "..." : "");
}

/* Prints the details from `first` on. */
static void print_details(FILE *out, const progress_line *n, detail first)
{
    const double done = (double)n->stats->ticks / CW_CLOCK_HZ;
    const bool known = n->end != CW_NEVER && n->end > n->stats->ticks && n->stats->ticks > 0;
    fprintf(out, "%.1f s", done);
    if (known && first <= DETAIL_END)
        fprintf(out, " of %.1f s", (double)n->end / CW_CLOCK_HZ);
    if (first <= DETAIL_UNIT)
        fputs(" bus time", out);
    if (first <= DETAIL_FRAMES)
        fprintf(out, ", %s", counted(n->stats->frames, "frame").text);
    if (first <= DETAIL_SPEED) {
        fputs(", ", out);
        print_factor(out, done / n->wall_s);
        fputs(" x real time", out);
    }
    if (known && first <= DETAIL_LEFT)
        print_left(out, n);
    if (n->awaited && first <= DETAIL_AWAITED)
        print_awaited(out, n->awaited);
}

/* Prints a line. Returns true when all of it fits; only whole lines are used. */
static bool sim_progress_print_line(char line[LINE_MAX_BYTES], size_t room, const progress_line *n,
                                    detail first)
{
    memo whole;
    if (memo_begin(&whole))
        print_details(whole.out, n, first);
    const bool good = memo_text(&whole) && whole.size <= room;
    if (good)
        memcpy(line, whole.text, whole.size + 1);
    memo_end(&whole);
    return good;
}

/* Returns the number of characters of a line that does not wrap. */
static size_t terminal_room(void)
{
    struct winsize window;
    size_t columns = COLUMNS_DEFAULT;
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 0)
        columns = window.ws_col;
    return columns < LINE_MAX_BYTES ? columns - 1 : LINE_MAX_BYTES - 1;
}

/* Ends the line, so that later output begins below it. SA_RESETHAND makes the next signal end the
 * program. */
static void end_line(int signal)
{
    ssize_t written = write(STDERR_FILENO, "\n", 1);
    (void)written;
    (void)raise(signal);
}

/* Sees to it that an interrupt wipes the line first, where nobody else handles interrupts. */
static void watch_interrupt(sim_progress *p)
{
    struct sigaction ending = {.sa_flags = (int)SA_RESETHAND};
    ending.sa_handler = end_line;
    (void)sigemptyset(&ending.sa_mask);
    (void)sigaction(SIGINT, NULL, &p->before);
    if (p->before.sa_handler == SIG_DFL)
        (void)sigaction(SIGINT, &ending, NULL);
}

/* Writes the line; `end` is the expected end of the run, CW_NEVER: unknown. */
static void write_progress(sim_progress *p, const cw_bus *bus, uint64_t end)
{
    char line[LINE_MAX_BYTES];
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    const int64_t now_ns = wall_ns();
    const progress_line n = {.stats = &stats,
                    .end = end,
                    .wall_s = (double)(now_ns - p->start_ns) / 1e9,
                    .awaited = p->awaited};
    const size_t room = terminal_room();
    bool fits = false;
    for (unsigned first = 0; first <= DETAIL_COUNT && !fits; first++)
        fits = sim_progress_print_line(line, room, &n, (detail)first);
    const unsigned before = p->width;
    p->next_ns = now_ns + PERIOD_NS;
    if (!fits)
        return;
    if (before == 0)
        watch_interrupt(p);
    p->width = (unsigned)strlen(line);
    fprintf(stderr, "\r%s%*s", line, before > p->width ? (int)(before - p->width) : 0, "");
    (void)fflush(stderr);
}

/* Wipes the line for other output. */
static void wipe(void *user)
{
    sim_progress *p = user;
    if (p->width == 0)
        return;
    fprintf(stderr, "\r%*s\r", (int)p->width, "");
    (void)fflush(stderr);
    p->width = 0;
    (void)sigaction(SIGINT, &p->before, NULL);
}

static void sim_progress_look(void *user, const sim_run *run)
{
    sim_progress *p = user;
    if (is_due(p, cw_bus_now(run->bus)))
        write_progress(p, run->bus, sim_guess_end(run));
}

void sim_progress_start(sim_progress *p, sim_run *run, bool wanted, const char *awaited)
{
    *p = (sim_progress){.on = wanted && isatty(STDERR_FILENO), .awaited = awaited};
    if (!p->on)
        return;
    p->start_ns = wall_ns();
    p->next_ns = p->start_ns + FIRST_NS;
    run->show = (sim_show){.user = p, .look = sim_progress_look, .wipe = wipe};
}
