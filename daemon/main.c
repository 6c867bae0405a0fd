/* SPDX-License-Identifier: MIT
 *
 * main.c - canwired: one bus in the foreground.
 */
#include "base/jsonput.h"
#include "base/log.h"
#include "base/plain.h"
#include "config/files.h"
#include "engine/engine.h"
#include "engine/reloader.h"
#include "run/journal.h"
#include "run/journal_keep.h"
#include "serve/activation.h"
#include "serve/control.h"
#include "serve/losses.h"
#include "serve/notify.h"
#include "serve/publish.h"
#include "serve/recordings.h"
#include "serve/watchdog.h"

#include <errno.h>
#include <ev.h>
#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#define STATUS_PERIOD_S 1.0 /* period of the line in `systemctl status` */
#define TROUBLE_BYTES 300   /* of its texts about nodes and about a refused reload, each */

typedef struct service {
    live *live;
    const cfg *config; /* the configuration in effect */
    publisher *publisher;
    engine *engine;
    control *control;
    recordings *recordings;
    journal *journal;
    int inherited;  /* the control socket of the service manager, or -1 */
    fileuses files; /* besides those that the configuration names */
    notifier *notifier;
    watchdog watchdog;
    losses losses;
    reloader *reloader;
    uint64_t hangups[2];         /* rounds of reloads that SIGHUP has requested */
    char refused[TROUBLE_BYTES]; /* reason of the last refused reload, or empty */
    bool stopping;
    bool stopping_reported; /* to senders of SIGHUP */
    ev_signal terminate;
    ev_signal interrupt;
    ev_signal hangup;
    ev_timer statistics;
    ev_timer status;
    ev_async nudge; /* see check_nudges() */
    unsigned seconds; /* seconds without it */
    bool failed;
    struct ev_loop *loop;
} service;

typedef struct options {
    const char *config;
    const char *journal; /* or NULL */
    unsigned journal_files;
} options;

static const char usage[] = "usage: canwired -c FILE [--journal F [--journal-files N]]\n";

static const char help[] =
    "\n"
    "Runs the CAN bus that FILE describes, in the foreground, until SIGTERM or SIGINT. SIGHUP "
    "reads\n"
    "FILE again.\n"
    "\n"
    "  -c, --config FILE       configuration (see canwire check)\n"
    "      --journal F         write down all that is done to the bus, for canwire sim --journal\n"
    "      --journal-files N   how many journals are kept, F, F.1 ...: 2 to 1000, default 5\n"
    "  -h, --help              this text\n"
    "      --version           the version\n"
    "\n"
    "Exit status: 0, 1 bad configuration or a port that cannot be opened, 2 wrong usage.\n";

static void on_signal(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    service *s = watcher->data;
    s->stopping = true;
    notify_stopping(s->notifier);
    notify_status(s->notifier, "Letting the frame on the wire end");
    engine_stop(s->engine);
}

/* ---- Events and bits ------------------------------------------------------------------------- */

static void on_event(void *user, const cw_event *event)
{
    service *s = user;
    if (s->publisher)
        publisher_event(s->publisher, event);
    if (s->recordings)
        recordings_event(s->recordings, event, engine_realtime_ns(s->engine, event->tick));
    if (s->control)
        control_event(s->control, event);
}

static void on_bit(void *user, const cw_bus *bus)
{
    const service *s = user;
    recordings_bit(s->recordings, bus);
}

/* Observes bits only while a recording wants them. */
static void observe_bits(service *s)
{
    engine_observe_bits(s->engine, recordings_want_bits(s->recordings) ? on_bit : NULL, s);
}

/* Reports a recording that has begun or ended, see recordings_reported. */
static void on_recording(void *user, const char *file, const char *why)
{
    service *s = user;
    if (!s->recordings)
        return;
    observe_bits(s);
    if (s->control)
        control_report_recording(s->control, file, why);
}

static json_t *show_recordings(void *user)
{
    const service *s = user;
    return recordings_json(s->recordings);
}

static json_t *show_journal(void *user)
{
    const service *s = user;
    return s->journal ? journal_to_json(s->journal) : NULL;
}

/* ---- Reload ---------------------------------------------------------------------------------- */

/* Logs each line of the errors. */
static void log_lines(char *text)
{
    char *rest = text;
    for (char *line = strtok_r(rest, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest))
        log_error("%s", line);
}

/* Notifies the service manager. on_change(), or the refusal of the reload, ends this state. */
static void on_reading(void *user)
{
    service *s = user;
    notify_reloading(s->notifier);
    s->refused[0] = '\0';
}

static bool take_reload(void *user, reload *r, FILE *errors)
{
    const service *s = user;
    return engine_reload(s->engine, r, errors);
}

static void note_refusal(service *s, const char *why)
{
    (void)snprintf(s->refused, sizeof s->refused, "; reload refused: %.*s", (int)strcspn(why, "\n"),
                   why);
}

/* Ends a refusal after all its messages: a program that waits for the end finds them in the
 * journal. */
static void end_refusal(service *s)
{
    if (!reloader_is_busy(s->reloader) && !s->stopping)
        notify_ready(s->notifier);
}

/* Logs a refusal. One because canwired is stopping is no error, and is logged once. */
static void log_refusal(service *s, char *errors)
{
    if (s->stopping) {
        if (!s->stopping_reported)
            log_info("reload: canwired is stopping, nothing was changed");
        s->stopping_reported = true;
        return;
    }
    log_lines(errors);
    log_error("reload: nothing was changed");
}

/* Reports the end of a round of reloads to all that have requested it. */
static void on_round(void *user, uint64_t round, char *errors)
{
    service *s = user;
    if (errors)
        note_refusal(s, errors);
    if (s->control)
        control_reloaded(s->control, round, errors);
    if (errors && s->hangups[round % 2] == round)
        log_refusal(s, errors);
    if (errors)
        end_refusal(s);
}

static const reloader_calls reload_calls = {
    .begins = on_reading, .take = take_reload, .over = on_round};

/* Returns the round, or 0 after writing the reason. */
static uint64_t ask_for_reload(void *user, FILE *errors)
{
    service *s = user;
    return reloader_ask(s->reloader, s->config->file, errors);
}

/* Requests a reload; there are two rounds at most, see reloader.h. */
static void on_hangup(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    service *s = watcher->data;
    char *text = NULL;
    size_t size = 0;
    FILE *errors = open_memstream(&text, &size);
    uint64_t round = errors ? ask_for_reload(s, errors) : 0;
    if (errors)
        (void)fclose(errors);
    char none[] = "out of memory";
    if (round == 0) {
        note_refusal(s, errors && text ? text : none);
        log_refusal(s, errors && text ? text : none);
        end_refusal(s);
    }
    s->hangups[round % 2] = round;
    free(text);
}

/* Handles a request at the control socket, whose client gets the errors. */
static uint64_t on_reload_request(void *user, FILE *errors)
{
    service *s = user;
    uint64_t round = ask_for_reload(s, errors);
    if (round == 0) {
        note_refusal(s, "it cannot be begun");
        end_refusal(s);
    }
    return round;
}

static double seconds(cfg_time time, cw_rate rate)
{
    return (double)text_time_ticks(time, rate) / CW_CLOCK_HZ;
}

/* Adapts to another configuration of the bus. */
static void on_change(void *user, const uint8_t from[CW_NODES_MAX])
{
    service *s = user;
    losses_remap(&s->losses, from);
    recordings_reload(s->recordings, engine_bus(s->engine));
    if (s->journal)
        journal_retry(s->journal, engine_inputs(s->engine));
    observe_bits(s);
    if (s->control)
        control_remap(s->control, from);
    if (s->publisher) {
        publisher_remap(s->publisher, from);
        s->statistics.repeat = seconds(s->config->lcm.period, s->config->rate);
        ev_timer_again(s->loop, &s->statistics);
    }
    if (!reloader_is_busy(s->reloader))
        notify_ready(s->notifier);
}

/* ---- Statistics and status ------------------------------------------------------------------- */

static void publish_files(service *s)
{
    json_t *recorded = recordings_json(s->recordings);
    json_t *written = show_journal(s);
    publisher_files(s->publisher, "record", recorded);
    if (written)
        publisher_files(s->publisher, "journal", written);
    json_decref(recorded);
    json_decref(written);
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
    publish_files(s);
}

/* Returns the problem of a node, or NULL. */
static const char *trouble_of(const service *s, unsigned node, report_link link)
{
    cw_node_stats stats;
    if (link == REPORT_LINK_DOWN)
        return "link down";
    if (link == REPORT_LINK_MISSING)
        return "link missing";
    if (cw_node_get_stats(engine_bus(s->engine), node, &stats) != CW_OK ||
        stats.state == CW_STATE_ERROR_ACTIVE)
        return NULL;
    return cw_state_name(stats.state);
}

/* Prints ", engine bus-off" and so on, as far as there is room. */
static void print_trouble(char out[TROUBLE_BYTES], const service *s, const report *beyond)
{
    size_t used = 0;
    out[0] = '\0';
    for (unsigned i = 0; i < s->config->node_count && used < TROUBLE_BYTES; i++) {
        const char *trouble = trouble_of(s, i, beyond->nodes[i].link);
        if (!trouble)
            continue;
        int length = snprintf(out + used, TROUBLE_BYTES - used, ", %s %s", s->config->nodes[i].name,
                              trouble);
        used += length > 0 ? (size_t)length : 0;
    }
}

static void report_status(service *s)
{
    char trouble[TROUBLE_BYTES];
    cw_bus_stats stats;
    engine_update(s->engine);
    engine_count_loopless(s->engine);
    report beyond;
    engine_report(s->engine, &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond);
    recordings_update(s->recordings, engine_bus(s->engine));
    observe_bits(s);
    if (s->journal)
        journal_mark(s->journal, engine_inputs(s->engine));
    cw_bus_get_stats(engine_bus(s->engine), &stats);
    print_trouble(trouble, s, &beyond);
    notify_status(s->notifier,
                  "%s: %zu nodes at %u bit/s, load %u.%u %%, %" PRIu64 " frames, %" PRIu64
                  " error frames%s%s%s",
                  s->config->bus_name, s->config->node_count, s->config->bitrate_bps,
                  stats.load_permille / 10u, stats.load_permille % 10u, stats.frames,
                  stats.error_frames, trouble,
                  journal_is_broken(s->journal) ? ", journal broken" : "", s->refused);
}

/* Ends canwired when signals cannot arrive. Signals and reports of other threads use a pipe of
 * libev. When the kernel refuses to watch it, for instance when the user's watches are used up,
 * libev reports nothing and SIGTERM has no effect. */
static void check_nudges(service *s)
{
    if (!ev_is_active(&s->nudge))
        return;
    if (s->seconds++ == 0) { /* this may be the first round of the loop */
        ev_async_send(s->loop, &s->nudge);
        return;
    }
    log_error("the event loop cannot watch for signals");
    s->failed = true;
    ev_break(s->loop, EVBREAK_ALL);
}

/* Stops after the first call, since the pipe is watched from then on. */
static void on_nudge(struct ev_loop *loop, ev_async *watcher, int events)
{
    (void)events;
    ev_async_stop(loop, watcher);
}

static void on_status(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    report_status(timer->data);
    check_nudges(timer->data);
}

/* ---- Start and end --------------------------------------------------------------------------- */

/* Handles signals before anything is made that must be removed again. The loop handles earlier
 * signals when it runs. */
static void start_signals(service *s, struct ev_loop *loop)
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
}

static void start_watchers(service *s, struct ev_loop *loop)
{
    ev_async_init(&s->nudge, on_nudge);
    ev_async_start(loop, &s->nudge);
    ev_async_send(loop, &s->nudge);
    ev_timer_init(&s->status, on_status, STATUS_PERIOD_S, STATUS_PERIOD_S);
    s->status.data = s;
    ev_timer_start(loop, &s->status);
    if (!s->publisher)
        return;
    double period = seconds(s->config->lcm.period, s->config->rate);
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

static bool start_journal(service *s, const options *o)
{
    char error[JOURNAL_ERROR_MAX];
    s->journal = journal_start(o->journal, o->journal_files, s->config, error);
    if (!s->journal) {
        log_error("%s", error);
        return false;
    }
    inputs_observe(engine_inputs(s->engine), journal_input, s->journal);
    return true;
}

/* Takes the inherited socket before ports are opened, which may be inherited as well. */
static bool take_inherited(service *s)
{
    char error[ACTIVATION_ERROR_MAX];
    if (activation_take(&s->inherited, "control", error))
        return true;
    log_error("%s", error);
    return false;
}

/* Starts the control socket at the configured path, or at the socket of the service manager. */
static bool start_control(service *s, struct ev_loop *loop)
{
    if (!s->config->control && s->inherited < 0)
        return true;
    s->control = control_start(loop, s->live, s->engine, s->inherited);
    if (!s->control)
        return false;
    control_on_reload(s->control, on_reload_request, s);
    control_show_files(s->control, show_recordings, show_journal, s);
    return true;
}

static bool start(service *s, struct ev_loop *loop, const options *o)
{
    if (!take_inherited(s))
        return false;
    if (s->config->lcm.enabled) {
        s->publisher = publisher_start(s->config);
        if (!s->publisher) {
            log_error("out of memory");
            return false;
        }
    }
    s->engine = engine_start(loop, s->live);
    if (!s->engine)
        return false;
    s->loop = loop;
    s->reloader = reloader_new(loop, &s->files, &reload_calls, s);
    if (!s->reloader) {
        log_error("out of memory");
        return false;
    }
    engine_on_change(s->engine, on_change, s);
    if (!start_control(s, loop))
        return false;
    s->recordings =
        recordings_start(loop, s->config, engine_bus(s->engine), on_recording, s);
    if (!s->recordings)
        return false;
    engine_observe(s->engine, on_event, s);
    observe_bits(s);
    /* The journal starts last, since it replaces an existing file. This must not happen when the
     * same bus is running and this one is refused. The bus has had no inputs up to here. */
    return !o->journal || start_journal(s, o);
}

static bool run(service *s, struct ev_loop *loop, const options *o)
{
    start_signals(s, loop);
    if (!start(s, loop, o))
        return false;
    start_watchers(s, loop);
    log_info("%s: %zu nodes at %u bit/s, %s", s->config->bus_name, s->config->node_count,
             s->config->bitrate_bps, cfg_has_fd(s->config) ? "CAN FD" : "classical CAN");
    report_status(s);
    notify_ready(s->notifier);
    watchdog_start(&s->watchdog, loop, s->engine, s->notifier);
    if (!engine_has_failed(s->engine)) /* ev_break() has no effect on a loop that has not started */
        ev_run(loop, 0);
    engine_count_loopless(s->engine);
    report beyond;
    engine_report(s->engine, &beyond);
    if (s->publisher)
        publisher_stats(s->publisher, engine_bus(s->engine), &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond);
    (void)engine_check_books(s->engine);
    report_end(s);
    return !s->failed && !engine_has_failed(s->engine);
}

static int refuse_usage(void)
{
    fputs(usage, stderr);
    return 2;
}

static bool read_journal_files(options *o, const char *text)
{
    uint64_t number;
    if (!text_parse_uint(&number, text) && number >= JOURNAL_FILES_MIN &&
        number <= JOURNAL_FILES_MAX) {
        o->journal_files = (unsigned)number;
        return true;
    }
    plain_print(stderr, "canwired: --journal-files %s: expected a number from %u to %u\n", text,
                JOURNAL_FILES_MIN, JOURNAL_FILES_MAX);
    return false;
}

/* Reads the options. Returns -1 to go on, else the exit status. */
static int parse_options(options *o, int argc, char **argv)
{
    static const struct option known[] = {{"config", required_argument, NULL, 'c'},
                                          {"journal", required_argument, NULL, 'j'},
                                          {"journal-files", required_argument, NULL, 'k'},
                                          {"help", no_argument, NULL, 'h'},
                                          {"version", no_argument, NULL, 'v'},
                                          {NULL, 0, NULL, 0}};
    int c;
    bool files = false;
    *o = (options){.journal_files = JOURNAL_FILES_DEFAULT};
    while ((c = getopt_long(argc, argv, "c:h", known, NULL)) != -1) {
        switch (c) {
        case 'c':
            o->config = optarg;
            break;
        case 'j':
            o->journal = optarg;
            break;
        case 'k':
            files = true;
            if (!read_journal_files(o, optarg))
                return 2;
            break;
        case 'h':
            fputs(usage, stdout);
            fputs(help, stdout);
            return 0;
        case 'v':
            puts("canwired " CANWIRE_VERSION);
            return 0;
        default:
            return refuse_usage();
        }
    }
    return !o->config || optind != argc || (files && !o->journal) ? refuse_usage() : -1;
}

/* Loads the configuration. No file is opened for writing before it is known to have no other
 * use. */
static cfg *load_checked(const char *file, const fileuses *others, FILE *errors)
{
    cfg *config = cfg_load_regular(file, errors);
    if (!config || cfg_check_files(config, others, "canwired", errors))
        return config;
    cfg_free(config);
    return NULL;
}

static cfg *load_config(const char *file, const fileuses *others)
{
    char *text = NULL;
    size_t size = 0;
    FILE *errors = open_memstream(&text, &size);
    cfg *config = errors ? load_checked(file, others, errors) : NULL;
    if (errors)
        (void)fclose(errors);
    if (text)
        log_as_is(text);
    else
        log_error("out of memory");
    free(text);
    return config;
}

static live *load(const char *file, const fileuses *others)
{
    cfg *config = load_config(file, others);
    if (!config)
        return NULL;
    log_set_bus(config->bus_name);
    log_warnings(config->warnings);
    live *l = live_new(config);
    if (l)
        return l;
    log_error("out of memory");
    cfg_free(config);
    return NULL;
}

/* Ends the program without memory; libev would call abort(). */
static void *allocate(void *memory, long size)
{
    if (size == 0) {
        free(memory);
        return NULL;
    }
    void *now = realloc(memory, (size_t)size);
    if (now)
        return now;
    log_error("out of memory");
    exit(1);
}

static void on_system_error(const char *what)
{
    log_error("%s: %s", what, strerror(errno));
    exit(1);
}

static struct ev_loop *make_loop(void)
{
    ev_set_allocator(allocate);
    ev_set_syserr_cb(on_system_error);
    struct ev_loop *loop = ev_default_loop(0);
    if (!loop)
        log_error("the event loop cannot be made: %s", strerror(errno));
    return loop;
}

int main(int argc, char **argv)
{
    options o;
    json_must_have_memory();
    plain_options(argc, argv);
    int status = parse_options(&o, argc, argv);
    if (status >= 0)
        return status;
    /* A log without a reader, or a lost LCM server, must not end the program. */
    (void)signal(SIGPIPE, SIG_IGN);
    service s = {.live = NULL};
    if (o.journal) /* the keeper examines all of these, however many it keeps */
        fileuses_add(&s.files, &(fileuse){.what = "--journal", .path = o.journal, .written = true,
                                          .older = JOURNAL_FILES_MAX});
    s.live = load(o.config, &s.files);
    if (!s.live) {
        fileuses_free(&s.files);
        return 1;
    }
    s.config = live_config(s.live);
    struct ev_loop *loop = make_loop();
    if (!loop) {
        fileuses_free(&s.files);
        live_free(s.live);
        return 1;
    }
    s.notifier = notify_open(loop);
    bool good = run(&s, loop, &o);
    s.stopping = true;
    reloader_free(s.reloader);
    s.reloader = NULL;
    control_stop(s.control);
    recordings_stop(s.recordings);
    if (s.journal)
        journal_stop(s.journal, engine_inputs(s.engine));
    engine_free(s.engine);
    publisher_stop(s.publisher);
    live_free(s.live);
    fileuses_free(&s.files);
    notify_close(s.notifier);
    ev_loop_destroy(loop);
    return good ? 0 : 1;
}
