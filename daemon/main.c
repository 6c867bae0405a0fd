/* SPDX-License-Identifier: MIT
 *
 * main.c - canwired: one bus in the foreground.
 */
#include "config.h"
#include "control.h"
#include "engine.h"
#include "log.h"
#include "losses.h"
#include "publish.h"

#include <ev.h>
#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <systemd/sd-daemon.h>
#include <time.h>

#define STATUS_PERIOD_S 1.0 /* of the line in `systemctl status` */

typedef struct service {
    live *live;
    const cfg *config; /* what is in effect */
    publisher *publisher;
    engine *engine;
    control *control;
    losses losses;
    ev_signal terminate;
    ev_signal interrupt;
    ev_signal hangup;
    ev_timer statistics;
    ev_timer status;
    struct ev_loop *loop;
} service;

static const char usage[] = "usage: canwired -c FILE\n";

static const char help[] =
    "\n"
    "Runs the CAN bus that FILE describes, in the foreground, until SIGTERM or SIGINT. SIGHUP reads\n"
    "FILE again.\n"
    "\n"
    "  -c, --config FILE   configuration (see canwire check)\n"
    "  -h, --help          this text\n"
    "      --version       the version\n"
    "\n"
    "Exit status: 0, 1 bad configuration or a port that cannot be opened, 2 wrong usage.\n";

static void on_signal(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    service *s = watcher->data;
    (void)sd_notify(0, "STOPPING=1\nSTATUS=Letting the frame on the wire end");
    engine_stop(s->engine);
}

/* One log line per line of the errors. */
static void log_lines(char *text)
{
    char *rest = text;
    for (char *line = strtok_r(rest, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest))
        log_error("%s", line);
}

static uint64_t monotonic_us(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000 + (uint64_t)t.tv_nsec / 1000;
}

static void on_hangup(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    service *s = watcher->data;
    char *text = NULL;
    size_t size = 0;
    (void)sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%" PRIu64, monotonic_us());
    FILE *errors = open_memstream(&text, &size);
    bool good = errors && engine_reload(s->engine, errors);
    if (errors)
        (void)fclose(errors);
    if (!good && text)
        log_lines(text);
    if (!good) {
        log_error("reload: nothing was changed");
        (void)sd_notify(0, "READY=1"); /* else when the bus has gone over */
    }
    free(text);
}

static double seconds(cfg_time time, uint32_t bit_ticks)
{
    return (double)text_time_ticks(time, bit_ticks) / CW_CLOCK_HZ;
}

/* The bus has gone over to another configuration. */
static void on_change(void *user, const uint8_t from[CW_NODES_MAX])
{
    service *s = user;
    losses_remap(&s->losses, from);
    if (s->control)
        control_remap(s->control, from);
    if (s->publisher) {
        publisher_remap(s->publisher, from);
        s->statistics.repeat = seconds(s->config->lcm.period, s->config->bit_ticks);
        ev_timer_again(s->loop, &s->statistics);
    }
    (void)sd_notify(0, "READY=1");
}

static void on_statistics(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    service *s = timer->data;
    engine_update(s->engine);
    report beyond;
    engine_report(s->engine, &beyond);
    publisher_stats(s->publisher, engine_bus(s->engine), &beyond);
}

static void on_status(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    service *s = timer->data;
    engine_update(s->engine);
    report beyond;
    engine_report(s->engine, &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond);
    cw_bus_stats stats;
    cw_bus_get_stats(engine_bus(s->engine), &stats);
    (void)sd_notifyf(0,
                     "STATUS=%s: %zu nodes at %u bit/s, load %u.%u %%, %" PRIu64
                     " frames, %" PRIu64 " error frames",
                     s->config->bus_name, s->config->node_count, s->config->bitrate_bps,
                     stats.load_permille / 10u, stats.load_permille % 10u, stats.frames,
                     stats.error_frames);
}

static void start_watchers(service *s, struct ev_loop *loop)
{
    ev_signal_init(&s->terminate, on_signal, SIGTERM);
    ev_signal_init(&s->interrupt, on_signal, SIGINT);
    s->terminate.data = s;
    s->interrupt.data = s;
    ev_signal_start(loop, &s->terminate);
    ev_signal_start(loop, &s->interrupt);
    ev_signal_init(&s->hangup, on_hangup, SIGHUP);
    s->hangup.data = s;
    ev_signal_start(loop, &s->hangup);
    ev_timer_init(&s->status, on_status, STATUS_PERIOD_S, STATUS_PERIOD_S);
    s->status.data = s;
    ev_timer_start(loop, &s->status);
    if (!s->publisher)
        return;
    double period = seconds(s->config->lcm.period, s->config->bit_ticks);
    ev_timer_init(&s->statistics, on_statistics, period, period);
    s->statistics.data = s;
    ev_timer_start(loop, &s->statistics);
}

static void report_end(const service *s)
{
    cw_bus_stats stats;
    cw_bus_get_stats(engine_bus(s->engine), &stats);
    log_info("stopped: %" PRIu64 " frames, %" PRIu64 " error frames, %" PRIu32 " frames not sent",
             stats.frames, stats.error_frames, stats.pending);
}

static bool start(service *s, struct ev_loop *loop)
{
    if (s->config->lcm.enabled) {
        s->publisher = publisher_start(s->config);
        if (!s->publisher) {
            log_error("out of memory");
            return false;
        }
    }
    s->engine = engine_start(loop, s->live, s->publisher);
    if (!s->engine)
        return false;
    s->loop = loop;
    engine_on_change(s->engine, on_change, s);
    if (s->config->control) {
        s->control = control_start(loop, s->live, s->engine);
        if (!s->control)
            return false;
        engine_observe(s->engine, control_event, s->control);
    }
    return true;
}

static bool run(service *s, struct ev_loop *loop)
{
    if (!start(s, loop))
        return false;
    start_watchers(s, loop);
    log_info("%s: %zu nodes at %u bit/s", s->config->bus_name, s->config->node_count,
             s->config->bitrate_bps);
    (void)sd_notify(0, "READY=1");
    ev_run(loop, 0);
    report beyond;
    engine_report(s->engine, &beyond);
    if (s->publisher)
        publisher_stats(s->publisher, engine_bus(s->engine), &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond);
    (void)engine_check_books(s->engine);
    report_end(s);
    return true;
}

/* Returns -1 to go on, else the exit status. */
static int parse_options(const char **file, int argc, char **argv)
{
    static const struct option options[] = {{"config", required_argument, NULL, 'c'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"version", no_argument, NULL, 'v'},
                                            {NULL, 0, NULL, 0}};
    int c;
    while ((c = getopt_long(argc, argv, "c:h", options, NULL)) != -1) {
        switch (c) {
        case 'c':
            *file = optarg;
            break;
        case 'h':
            fputs(usage, stdout);
            fputs(help, stdout);
            return 0;
        case 'v':
            puts("canwired " CANWIRE_VERSION);
            return 0;
        default:
            fputs(usage, stderr);
            return 2;
        }
    }
    if (!*file || optind != argc) {
        fputs(usage, stderr);
        return 2;
    }
    return -1;
}

static live *load(const char *file)
{
    cfg *config = cfg_load(file, stderr);
    if (!config)
        return NULL;
    live *l = live_new(config);
    if (l)
        return l;
    log_error("out of memory");
    cfg_free(config);
    return NULL;
}

int main(int argc, char **argv)
{
    const char *file = NULL;
    int status = parse_options(&file, argc, argv);
    if (status >= 0)
        return status;
    service s = {.live = load(file)};
    if (!s.live)
        return 1;
    s.config = live_config(s.live);
    struct ev_loop *loop = ev_default_loop(0);
    bool good = run(&s, loop);
    control_stop(s.control);
    engine_free(s.engine);
    publisher_stop(s.publisher);
    live_free(s.live);
    ev_loop_destroy(loop);
    return good ? 0 : 1;
}
