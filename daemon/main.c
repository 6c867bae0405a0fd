/* SPDX-License-Identifier: MIT
 *
 * main.c - canwired: one bus in the foreground.
 */
#include "config.h"
#include "engine.h"
#include "log.h"
#include "losses.h"
#include "publish.h"

#include <ev.h>
#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <systemd/sd-daemon.h>

#define STATUS_PERIOD_S 1.0 /* of the line in `systemctl status` */

typedef struct service {
    cfg *config;
    publisher *publisher;
    engine *engine;
    losses losses;
    ev_signal terminate;
    ev_signal interrupt;
    ev_timer statistics;
    ev_timer status;
} service;

static const char usage[] = "usage: canwired -c FILE\n";

static const char help[] =
    "\n"
    "Runs the CAN bus that FILE describes, in the foreground, until SIGTERM or SIGINT.\n"
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

static void on_statistics(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    service *s = timer->data;
    engine_update(s->engine);
    publisher_stats(s->publisher, engine_bus(s->engine), engine_ports(s->engine));
}

static void on_status(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    service *s = timer->data;
    engine_update(s->engine);
    losses_log(&s->losses, s->config, engine_bus(s->engine), engine_ports(s->engine));
    cw_bus_stats stats;
    cw_bus_get_stats(engine_bus(s->engine), &stats);
    (void)sd_notifyf(0,
                     "STATUS=%s: %zu nodes at %u bit/s, load %u.%u %%, %" PRIu64
                     " frames, %" PRIu64 " error frames",
                     s->config->bus_name, s->config->node_count, s->config->bitrate_bps,
                     stats.load_permille / 10u, stats.load_permille % 10u, stats.frames,
                     stats.error_frames);
}

static double seconds(cfg_time time, uint32_t bit_ticks)
{
    return (double)text_time_ticks(time, bit_ticks) / CW_CLOCK_HZ;
}

static void start_watchers(service *s, struct ev_loop *loop)
{
    ev_signal_init(&s->terminate, on_signal, SIGTERM);
    ev_signal_init(&s->interrupt, on_signal, SIGINT);
    s->terminate.data = s;
    s->interrupt.data = s;
    ev_signal_start(loop, &s->terminate);
    ev_signal_start(loop, &s->interrupt);
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

static bool run(service *s, struct ev_loop *loop)
{
    if (s->config->lcm.enabled) {
        s->publisher = publisher_start(s->config);
        if (!s->publisher) {
            log_error("out of memory");
            return false;
        }
    }
    s->engine = engine_start(loop, s->config, s->publisher);
    if (!s->engine)
        return false;
    start_watchers(s, loop);
    log_info("%s: %zu nodes at %u bit/s", s->config->bus_name, s->config->node_count,
             s->config->bitrate_bps);
    (void)sd_notify(0, "READY=1");
    ev_run(loop, 0);
    if (s->publisher)
        publisher_stats(s->publisher, engine_bus(s->engine), engine_ports(s->engine));
    losses_log(&s->losses, s->config, engine_bus(s->engine), engine_ports(s->engine));
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

int main(int argc, char **argv)
{
    const char *file = NULL;
    int status = parse_options(&file, argc, argv);
    if (status >= 0)
        return status;
    service s = {.config = cfg_load(file, stderr)};
    if (!s.config)
        return 1;
    struct ev_loop *loop = ev_default_loop(0);
    bool good = run(&s, loop);
    engine_free(s.engine);
    publisher_stop(s.publisher);
    cfg_free(s.config);
    ev_loop_destroy(loop);
    return good ? 0 : 1;
}
