/* SPDX-License-Identifier: MIT
 *
 * main.c - canwired: one bus, or the buses of a rig, in the foreground.
 */
#include "base/log.h"
#include "base/options.h"
#include "base/standardfds.h"
#include "base/text/chars.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/text/memo.h"
#include "base/text/plain.h"
#include "base/thread.h"
#include "base/unit.h"
#include "base/version.h"
#include "config/files.h"
#include "engine/engine.h"
#include "engine/group.h"
#include "run/journal.h"
#include "run/journal_keep.h"
#include "serve/notify.h"
#include "serve/recordings.h"
#include "serve/service.h"
#include "serve/start.h"
#include "serve/watchdog.h"

#include <errno.h>
#include <ev.h>
#include <fcntl.h>
#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define STATUS_PERIOD_S 1.0 /* period of the line in `systemctl status` */
#define STATUS_BYTES 1000   /* of that line */
#define REFUSED "; reload refused: "
#define EXPECTATION_FAILED 3 /* the exit status, also of canwire sim */
#define SINKS_BYTES 600     /* of what it says of sinks, those of all buses together */

typedef struct process {
    host host;
    engine *single; /* the engine of one bus; the group owns others */
    watchdog watchdog;
    uint64_t lost[RIG_GATEWAYS_MAX][2]; /* frames of gateways, as the log has told */
    ev_signal terminate;
    ev_signal interrupt;
    ev_signal hangup;
    ev_timer status;
    ev_timer told; /* of the host; it never runs */
    ev_async nudge; /* see check_nudges() */
    unsigned seconds; /* seconds without it */
    int ready;        /* for background_ready(), or -1 */
    bool failed;
    int activated; /* the socket of the service manager, until the bus has started; or -1 */
} process;

typedef struct options {
    const char *config;
    const char *journal; /* or NULL */
    unsigned journal_files;
    bool background;
} options;

static const char usage[] =
    "usage: canwired -c FILE [--background] [--journal F [--journal-files N]] [--verbose]\n";

static const char help[] =
    "Runs the CAN bus that FILE describes, in the foreground, until SIGTERM or SIGINT. FILE may be "
    "a\n"
    "rig of several buses. SIGHUP reads FILE again, or the files of all buses.\n"
    "\n"
    "  -c, --config FILE       configuration (see canwire check)\n"
    "      --background        comes back when the bus is ready, with status 0 and the number of\n"
    "                          its process, or when it cannot start; messages still go to\n"
    "                          standard error\n"
    "      --journal F         write down all that is done to the bus, for canwire sim --journal\n"
    "      --journal-files N   how many journals are kept, F, F.1 ...: 2 to 1000, default 5\n"
    "      --verbose           log more: each client, and how much room the kernel grants\n"
    "  -h, --help              this text\n"
    "      --version           the version\n"
    "\n"
    "Exit status: 0, 1 bad configuration or a port that cannot be opened, 2 wrong usage, 3 an\n"
    "expectation failed. As the service, 1 is a bad configuration, and 75 all else, after which\n"
    "systemd starts it again.\n";

/* ---- Signals --------------------------------------------------------------------------------- */

/* A signal asks canwired to end. The buses first let the frame on the wire end. */
static void daemon_on_signal(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    process *p = watcher->data;
    p->host.stopping = true;
    notify_stopping(p->host.notifier);
    notify_status(p->host.notifier, "Letting the frame on the wire end");
    for (size_t i = 0; i < p->host.count; i++)
        engine_stop(service_engine(p->host.buses[i]));
}

/* SIGHUP: all buses read their files again. */
static void on_hangup(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    process *p = watcher->data;
    for (size_t i = 0; i < p->host.count; i++)
        service_hang_up(p->host.buses[i]);
}

/* ---- Status ---------------------------------------------------------------------------------- */

/* Logs frames that gateways have lost since the last call. */
static void log_gateways(process *p)
{
    for (size_t g = 0; p->host.rig && g < p->host.rig->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++) {
            const rig_gateway *gateway = &p->host.rig->gateways[g];
            const rig_end *from = &gateway->ends[end];
            uint64_t lost = gateways_lost(engine_group_gateways(p->host.group), g, end);
            if (lost > p->lost[g][end])
                log_warning("gateway %s: %s from %s:%s lost, the queue of their rule is full",
                            gateway->name, counted(lost - p->lost[g][end], "frame").text,
                            from->bus_name, from->name);
            p->lost[g][end] = lost;
        }
}

/* Returns the length of the line with a bus in addition. */
static size_t add_bus(char line[STATUS_BYTES], size_t used, const cfg *config,
                      const service_status *status, size_t buses)
{
    const cw_bus_stats *bus = &status->bus;
    char files[SINKS_BYTES];
    (void)sinks_print(files, sizeof files / buses, &status->sinks);
    if (buses == 1)
        return chars_print(line, STATUS_BYTES, used,
                           "%s: %s at %u bit/s, load %u.%u %%, %s, %s%s%s%s%s", config->bus_name,
                           counted(config->node_count, "node").text, config->bitrate_bps,
                           bus->load_permille / 10u, bus->load_permille % 10u,
                           counted(bus->frames, "frame").text,
                           counted(bus->error_frames, "error frame").text, status->trouble, files,
                           *status->rules ? "; " : "", status->rules);
    return chars_print(line, STATUS_BYTES, used, "%s%s: load %u.%u %%%s%s%s%s%s%s",
                       used > 0 ? "; " : "", config->bus_name, bus->load_permille / 10u,
                       bus->load_permille % 10u, status->trouble, files,
                       *status->rules ? ", " : "", status->rules,
                       *status->refused ? REFUSED : "", status->refused);
}

/* Tells systemd how the buses are. */
static void report_status(process *p)
{
    char line[STATUS_BYTES] = "", journals[SINKS_BYTES] = "";
    size_t used = 0;
    service_status status = {.refused = ""};
    sink_list shared = {.count = 0};
    for (size_t i = 0; i < p->host.count; i++) {
        service_tell(p->host.buses[i], &status);
        used = add_bus(line, used, service_config(p->host.buses[i]), &status,
                       p->host.count);
    }
    if (p->host.journal)
        journal_sink(p->host.journal, &shared);
    (void)sinks_print(journals, sizeof journals, &shared);
    const bool refused = !p->host.rig && *status.refused;
    notify_status(p->host.notifier, "%s%s%s%s", line, journals, refused ? REFUSED : "",
                  refused ? status.refused : "");
}

/* Does the work of each second: also a mark in the journal. */
static void update_all(process *p)
{
    for (size_t i = 0; i < p->host.count; i++)
        service_update(p->host.buses[i]);
    log_gateways(p);
    /* in virtual time a mark each second would make no run like the other */
    const bool marks = service_config(p->host.buses[0])->pacing != CFG_PACING_VIRTUAL;
    if (p->host.journal && marks)
        journal_mark(p->host.journal, engine_inputs(service_engine(p->host.buses[0])));
    report_status(p);
}

/* A reload is over: systemd knows the state before that. */
static void on_told(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    process *p = timer->data;
    report_status(p);
    if (p->host.owes_ready)
        notify_ready(p->host.notifier);
    p->host.owes_ready = false;
}

/* Ends canwired when signals cannot arrive. Signals and reports of other threads use a pipe of
 * libev. When the kernel refuses to watch it, for instance when the user's watches are used up,
 * libev reports nothing and SIGTERM has no effect. */
static void check_nudges(process *p)
{
    if (!ev_is_active(&p->nudge))
        return;
    if (p->seconds++ == 0) { /* this may be the first round of the loop */
        ev_async_send(p->host.loop, &p->nudge);
        return;
    }
    log_error("the event loop cannot watch for signals");
    p->failed = true;
    ev_break(p->host.loop, EVBREAK_ALL);
}

/* Stops after the first call, since the pipe is watched from then on. */
static void on_nudge(struct ev_loop *loop, ev_async *watcher, int events)
{
    (void)events;
    ev_async_stop(loop, watcher);
}

/* Each second: the line for systemd, and a check that signals can still arrive. */
static void on_status(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    update_all(timer->data);
    check_nudges(timer->data);
}

/* ---- Start and end --------------------------------------------------------------------------- */

/* Handles signals before anything is made that must be removed again. The loop handles earlier
 * signals when it runs. */
static void start_signals(process *p)
{
    ev_signal_init(&p->terminate, daemon_on_signal, SIGTERM);
    ev_signal_init(&p->interrupt, daemon_on_signal, SIGINT);
    ev_signal_init(&p->hangup, on_hangup, SIGHUP);
    p->terminate.data = p;
    p->interrupt.data = p;
    p->hangup.data = p;
    ev_signal_start(p->host.loop, &p->terminate);
    ev_signal_start(p->host.loop, &p->interrupt);
    ev_signal_start(p->host.loop, &p->hangup);
}

/* Starts what runs beside the buses: the status each second, and the services of each bus. */
static void start_watchers(process *p)
{
    ev_async_init(&p->nudge, on_nudge);
    ev_async_start(p->host.loop, &p->nudge);
    ev_async_send(p->host.loop, &p->nudge);
    ev_timer_init(&p->status, on_status, STATUS_PERIOD_S, STATUS_PERIOD_S);
    p->status.data = p;
    ev_timer_start(p->host.loop, &p->status);
    for (size_t i = 0; i < p->host.count; i++)
        service_run(p->host.buses[i]);
}

/* Starts the journal, and lets it observe the inputs of all buses. */
static bool start_journal(process *p, const options *o)
{
    char error[JOURNAL_ERROR_MAX];
    inputs *all[RIG_BUSES_MAX];
    host *h = &p->host;
    for (size_t i = 0; i < h->count; i++)
        all[i] = engine_inputs(service_engine(h->buses[i]));
    h->journal = p->host.rig ? journal_start_rig(o->journal, o->journal_files,
                                            (const inputs *const *)all, h->count, error)
                        : journal_start(o->journal, o->journal_files,
                                        service_config(h->buses[0]), error);
    if (!h->journal) {
        log_error("%s", error);
        return false;
    }
    if (!p->host.rig)
        inputs_observe(all[0], journal_input, h->journal);
    for (size_t i = 0; p->host.rig && i < h->count; i++)
        inputs_observe(all[i], journal_part_input, journal_part_at(h->journal, i));
    return true;
}

/* Takes the inherited socket before ports are opened, which may be inherited as well. */
static bool take_inherited(int *inherited)
{
    char error[ACTIVATION_ERROR_MAX];
    if (activation_take(inherited, "control", error))
        return true;
    log_error("%s", error);
    return false;
}

/* Returns the bus that the inherited socket is for: of a rig, the one with its path. Returns
 * RIG_BUSES_MAX when there is none. */
static size_t find_inherited(const process *p, int inherited)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    socklen_t size = sizeof address - 1;
    if (inherited < 0 || !p->host.rig)
        return 0;
    (void)getsockname(inherited, (struct sockaddr *)&address, &size);
    for (size_t i = 0; i < p->host.count; i++) {
        const char *control = service_config(p->host.buses[i])->control;
        if (control && strcmp(control, address.sun_path) == 0)
            return i;
    }
    log_error("control that was passed: no bus of the rig has %s", address.sun_path);
    return RIG_BUSES_MAX;
}

/* Starts the bus, or the buses of a rig. */
static bool start_engines(process *p)
{
    live *lives[RIG_BUSES_MAX] = {NULL};
    for (size_t i = 0; i < p->host.count; i++)
        lives[i] = service_live(p->host.buses[i]);
    if (p->host.rig)
        p->host.group = engine_group_start(p->host.loop, p->host.rig, lives);
    else
        p->single = engine_start(p->host.loop, lives[0]);
    return p->host.group || p->single;
}

/* Starts all that can fail, in an order in which a refused start changes nothing. */
static bool daemon_start(process *p, const options *o)
{
    int inherited;
    if (!take_inherited(&inherited))
        return false;
    p->activated = inherited < 0 ? -1 : fcntl(inherited, F_DUPFD_CLOEXEC, 0);
    if (!start_engines(p))
        return false;
    size_t owner = find_inherited(p, inherited);
    if (owner == RIG_BUSES_MAX)
        return false;
    for (size_t i = 0; i < p->host.count; i++) {
        engine *bus = p->single ? p->single : engine_group_bus(p->host.group, i);
        if (!service_start(p->host.buses[i], bus, i == owner ? inherited : -1))
            return false;
    }
    (void)log_enter(NULL);
    /* The journal starts last, since it replaces an existing file. This must not happen when the
     * same bus is running and this one is refused. The bus has had no inputs up to here. */
    return !o->journal || start_journal(p, o);
}

/* One bus that fails ends all of a rig, which would be another one without it. */
static bool engines_have_failed(const process *p)
{
    bool failed = false;
    for (size_t i = 0; i < p->host.count; i++)
        failed = failed || engine_has_failed(service_engine(p->host.buses[i]));
    return failed;
}

/* Tells what runs now. */
static void log_start(const process *p)
{
    for (size_t i = 0; i < p->host.count; i++) {
        const cfg *config = service_config(p->host.buses[i]);
        log_info("%s: %s at %u bit/s, %s", config->bus_name,
                 counted(config->node_count, "node").text, config->bitrate_bps,
                 cfg_has_fd(config) ? "CAN FD" : "classical CAN");
    }
    if (p->host.rig)
        log_info("%s: %s, %s", p->host.rig->file, counted(p->host.rig->bus_count, "bus").text,
                 counted(p->host.rig->gateway_count, "gateway").text);
}

/* Runs the buses until they are to end. False: one of them has failed. */
static bool daemon_run(process *p, const options *o)
{
    engine *engines[RIG_BUSES_MAX];
    ev_init(&p->told, on_told);
    p->told.data = p;
    p->host.told = &p->told;
    start_signals(p);
    if (!daemon_start(p, o))
        return false;
    for (size_t i = 0; i < p->host.count; i++)
        engines[i] = service_engine(p->host.buses[i]);
    unit_started();
    if (p->activated >= 0)
        (void)close(p->activated);
    p->activated = -1;
    start_watchers(p);
    log_start(p);
    update_all(p);
    notify_ready(p->host.notifier);
    watchdog_start(&p->watchdog, p->host.loop, engines, p->host.count, p->host.notifier);
    if (!engines_have_failed(p)) { /* ev_break() has no effect on a loop that has not started */
        background_ready(p->ready);
        ev_run(p->host.loop, 0);
    }
    log_gateways(p);
    for (size_t i = 0; i < p->host.count; i++)
        service_report_end(p->host.buses[i]);
    return !p->failed && !engines_have_failed(p);
}

/* Tells the service manager the error that fails a unit which was stopped in order. */
static void tell_why_failed(notifier *to)
{
    char why[LOG_LAST_BYTES];
    log_last_error(why);
    notify_status(to, "%s", why);
}

/* Ends all in the order in which nobody misses the last events. */
static void daemon_end(process *p)
{
    host *h = &p->host;
    h->stopping = true;
    const struct timespec until = thread_in_seconds(RECORDINGS_PATIENCE_S);
    for (size_t i = 0; i < h->count; i++)
        service_finish(h->buses[i]);
    for (size_t i = 0; i < h->count; i++)
        service_stop(h->buses[i], &until);
    if (h->told)
        ev_timer_stop(h->loop, h->told);
    if (h->journal)
        journal_stop(h->journal, engine_inputs(service_engine(h->buses[0])));
    engine_free(p->single);
    engine_group_free(h->group);
    for (size_t i = 0; i < h->count; i++)
        service_free(h->buses[i]);
    rig_free(p->host.rig);
    fileuses_free(&h->files);
    if (h->expectation_failed || h->report_missing)
        tell_why_failed(h->notifier);
    notify_close(h->notifier);
    if (h->loop)
        ev_loop_destroy(h->loop);
}

/* ---- Options --------------------------------------------------------------------------------- */

/* Reads the number of journals to keep. */
static bool read_journal_files(void *out, const char *option, const char *text)
{
    uint64_t number;
    if (!text_parse_uint(&number, text) && number >= JOURNAL_FILES_MIN &&
        number <= JOURNAL_FILES_MAX) {
        *(unsigned *)out = (unsigned)number;
        return true;
    }
    plain_print(stderr, "canwired: %s %s: expected a number from %u to %u\n", option, text,
                JOURNAL_FILES_MIN, JOURNAL_FILES_MAX);
    return false;
}

/* Reads the options. Returns -1 to go on, otherwise the exit status. */
static int daemon_parse_options(options *o, int argc, char **argv)
{
    bool version = false, verbose = false, files = false;
    const option_row rows[] = {
        {"config", .text = &o->config, .letter = 'c'},
        {"background", .flag = &o->background},
        {"journal", .text = &o->journal},
        {"journal-files", .read = read_journal_files, .out = &o->journal_files, .flag = &files},
        {"verbose", .flag = &verbose},
        {"version", .flag = &version},
        {.name = NULL},
    };
    const option_table table = {.usage = usage, .help = help, .rows = rows};
    *o = (options){.journal_files = JOURNAL_FILES_DEFAULT};
    const int status = options_read(&table, argc, argv);
    if (status >= 0)
        return status == OPTIONS_BAD_VALUE ? OPTIONS_WRONG_USAGE : status;
    if (version) {
        puts("canwired " CANWIRE_VERSION);
        return 0;
    }
    if (verbose)
        log_set_verbose();
    return !o->config || optind != argc || (files && !o->journal) ? options_refuse(&table) : -1;
}

/* ---- Configuration --------------------------------------------------------------------------- */

/* Loads the configuration, or the rig. No file is opened for writing before it is known to have no
 * other use. */
static bool load_checked(process *p, cfg **config, const char *file, FILE *errors)
{
    if (!rig_is_rig(file)) {
        *config = cfg_load_regular(file, errors);
        return *config && cfg_check_files(*config, &p->host.files, "canwired", errors);
    }
    const rig *all = p->host.rig = rig_load(file, errors);
    return all && cfg_check_all_files((const cfg *const *)all->buses, all->bus_count,
                                      &p->host.files, "canwired", errors);
}

/* Loads the configuration, and puts its errors into the log. */
static bool load_config(process *p, cfg **config, const char *file)
{
    memo errors;
    bool good = memo_begin(&errors) && load_checked(p, config, file, errors.out);
    if (memo_text(&errors))
        log_as_is(errors.text);
    else
        log_error("out of memory");
    memo_end(&errors);
    return good;
}

/* Takes a configuration over. Returns false after logging the reason. */
static bool add_service(process *p, cfg *config)
{
    log_warnings(config->warnings);
    live *l = live_new(config);
    if (!l) {
        log_error("out of memory");
        cfg_free(config);
        return false;
    }
    service *s = service_new(&p->host, l);
    if (s)
        p->host.buses[p->host.count++] = s;
    else
        live_free(l);
    return s;
}

/* Adds a service for each bus. They own the configurations from then on. */
static bool add_services(process *p, cfg *config)
{
    if (config) {
        log_set_bus(config->bus_name);
        return add_service(p, config);
    }
    log_set_rig();
    for (size_t i = 0; i < p->host.rig->bus_count; i++) {
        cfg *bus = p->host.rig->buses[i];
        p->host.rig->buses[i] = NULL;
        if (!add_service(p, bus))
            return false;
    }
    return true;
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
    exit(unit_failure());
}

static void on_system_error(const char *what)
{
    log_error("%s: %s", what, strerror(errno));
    exit(unit_failure());
}

/* Makes the event loop, which ends the program when it has no memory. */
static struct ev_loop *make_loop(void)
{
    ev_set_allocator(allocate);
    ev_set_syserr_cb(on_system_error);
    struct ev_loop *loop = ev_default_loop(0);
    if (!loop)
        log_error("the event loop cannot be made: %s", strerror(errno));
    return loop;
}

/* Ends a start that has failed; the service manager shows the reason. */
static int daemon_give_up(process *p, cfg *config, int status)
{
    char why[LOG_LAST_BYTES];
    log_last_error(why);
    notify_status(p->host.notifier, "%s", why);
    if (status != 1)
        unit_failed(why);
    cfg_free(config);
    daemon_end(p);
    return status;
}

/* Waiting clients of the service manager's socket would have it start a bad configuration again at
 * once. */
static int refuse_config(process *p, cfg *config)
{
    char why[LOG_LAST_BYTES];
    log_last_error(why);
    activation_refuse("control", why);
    return daemon_give_up(p, config, 1);
}

/* The same for a configuration whose paths cannot be. */
static int refuse_start(process *p)
{
    char why[LOG_LAST_BYTES];
    log_last_error(why);
    if (unit_failure() == 1)
        activation_answer(p->activated, why);
    return daemon_give_up(p, NULL, unit_failure());
}

/* Loads the configuration before it opens ports, sockets or outputs, so that a bad one changes
 * nothing. */
int main(int argc, char **argv)
{
    static process p = {.ready = -1, .activated = -1};
    options o;
    cfg *config = NULL;
    standardfds_hold();
    json_must_have_memory();
    plain_options(argc, argv);
    int status = daemon_parse_options(&o, argc, argv);
    if (status >= 0)
        return status;
    /* A log without a reader, or a lost LCM server, must not end the program. */
    (void)signal(SIGPIPE, SIG_IGN);
    if (o.background && (status = background_start(&p.ready)) >= 0)
        return status;
    if (o.journal) /* the keeper examines all of these, however many it keeps */
        fileuses_add(&p.host.files, &(fileuse){.what = "--journal", .path = o.journal,
                                               .written = true, .older = JOURNAL_FILES_MAX});
    if (!(p.host.loop = make_loop()))
        return daemon_give_up(&p, config, unit_failure());
    p.host.notifier = notify_open(p.host.loop);
    if (!load_config(&p, &config, o.config))
        return refuse_config(&p, config);
    if (!add_services(&p, config) || !daemon_run(&p, &o))
        return refuse_start(&p);
    daemon_end(&p);
    return p.host.expectation_failed ? EXPECTATION_FAILED : p.host.report_missing;
}
