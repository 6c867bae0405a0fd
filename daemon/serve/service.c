/* SPDX-License-Identifier: MIT
 *
 * service.c - a running bus with all that serves it: control socket, LCM, recordings, reload.
 */
#include "serve/service.h"

#include "base/text/chars.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/log.h"
#include "base/text/memo.h"
#include "base/unit.h"
#include "config/files.h"
#include "engine/reload.h"
#include "engine/reloader.h"
#include "port/claim.h"
#include "serve/control.h"
#include "serve/kept.h"
#include "serve/losses.h"
#include "serve/metrics.h"
#include "serve/publish.h"
#include "serve/recordings.h"
#include "serve/start.h"
#include "serve/verdicts.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>

struct service {
    host *host;
    size_t place; /* in the rig */
    live *live;
    const cfg *config; /* the configuration in effect */
    const cfg_node *nodes; /* ... of which these are the nodes: another one has others */
    publisher *publisher;
    engine *engine;
    control *control;
    kept *kept; /* NULL without a control socket */
    ev_timer again; /* injects kept rules after a reload */
    metrics *metrics;
    status_errors errors; /* since the start, for both */
    recordings *recordings;
    verdicts *verdicts;
    losses losses;
    reloader *reloader;
    uint64_t hangups[2];                 /* rounds of reloads that SIGHUP has requested */
    char refused[SERVICE_TROUBLE_BYTES]; /* reason of the last refused reload, or empty */
    ev_timer statistics;
    claim name; /* of the bus, among units */
};

/* Names the bus of the messages that follow. */
static void enter(const service *s)
{
    (void)log_enter(s->host->rig ? s->host->rig->names[s->place] : NULL);
}

/* ---- Events and bits ------------------------------------------------------------------------- */

/* Passes an event on to all who are interested. */
static void on_event(void *user, const cw_event *event)
{
    service *s = user;
    status_count(&s->errors, event);
    if (s->publisher)
        publisher_event(s->publisher, event);
    if (s->recordings)
        recordings_event(s->recordings, event, engine_realtime_ns(s->engine, event->tick));
    verdicts_event(s->verdicts, event);
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

/* ---- Reload ---------------------------------------------------------------------------------- */

/* Logs each line of the errors. */
static void log_lines(char *text)
{
    char *rest = text;
    for (char *line = strtok_r(rest, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest))
        log_error("%s", line);
}

/* Returns true when any bus of the rig reloads: the service manager sees them as one. */
static bool is_reloading(const host *h)
{
    for (size_t i = 0; i < h->count; i++)
        if (h->buses[i] && reloader_is_busy(h->buses[i]->reloader))
            return true;
    return false;
}

/* Notifies the service manager. on_change(), or the refusal of the reload, ends this state. */
static void on_reading(void *user)
{
    const service *s = user;
    s->host->owes_ready = false;
    notify_reloading(s->host->notifier);
}

/* Checks the files of a bus of a rig together with those of the others. */
static bool check_files(const service *s, const cfg *next, FILE *errors)
{
    const cfg *all[RIG_BUSES_MAX];
    const host *h = s->host;
    for (size_t i = 0; i < h->count; i++)
        all[i] = i == s->place ? next : h->buses[i]->config;
    return h->count == 1 || cfg_check_all_files(all, h->count, &h->files, "canwired", errors);
}

/* Takes a configuration that has been read. It is refused when its files cannot be used; then all
 * stays. */
static bool take_reload(void *user, reload *r, FILE *errors)
{
    const service *s = user;
    enter(s);
    if (!check_files(s, r->config, errors) || !metrics_prepare(s->metrics, r->config, errors)) {
        reload_free(r);
        return false;
    }
    const bool taken = engine_reload(s->engine, r, errors);
    metrics_settle(s->metrics, taken);
    return taken;
}

/* Remembers the first line of the reason until the next good reload. */
static void note_refusal(service *s, const char *why)
{
    (void)snprintf(s->refused, sizeof s->refused, "%.*s", (int)strcspn(why, "\n"), why);
}

/* Tells the service manager the state, and that no reload is under way any more. */
static void end_reload(const service *s)
{
    host *h = s->host;
    if (h->stopping)
        return;
    h->owes_ready = h->owes_ready || !is_reloading(h);
    ev_feed_event(h->loop, h->told, EV_TIMER);
}

/* Logs a refusal. That canwired is stopping is not an error, and is logged once. */
static void log_refusal(service *s, char *errors)
{
    if (s->host->stopping) {
        if (!s->host->stopping_reported)
            log_info("reload: canwired is stopping, nothing was changed");
        s->host->stopping_reported = true;
        return;
    }
    log_lines(errors);
    log_error("reload: nothing was changed");
}

/* Reports the end of a round of reloads to all that have requested it. */
static void on_round(void *user, uint64_t round, char *errors)
{
    service *s = user;
    enter(s);
    if (errors)
        note_refusal(s, errors);
    else
        s->refused[0] = '\0';
    if (s->control)
        control_reloaded(s->control, round, errors);
    if (errors && s->hangups[round % 2] == round)
        log_refusal(s, errors);
    if (errors) /* after all its messages: who waits for the end finds them in the journal */
        end_reload(s);
}

static const reloader_calls reload_calls = {
    .begins = on_reading, .take = take_reload, .over = on_round};

/* Returns the round, or 0 after writing the reason. */
static uint64_t ask_for_reload(void *user, FILE *errors)
{
    service *s = user;
    return reloader_ask(s->reloader, s->config->file, errors);
}

void service_hang_up(service *s)
{
    memo errors;
    enter(s);
    uint64_t round = memo_begin(&errors) ? ask_for_reload(s, errors.out) : 0;
    char none[] = "out of memory";
    if (round == 0) {
        char *text = memo_text(&errors) ? errors.text : none;
        note_refusal(s, text);
        log_refusal(s, text);
        end_reload(s);
    }
    s->hangups[round % 2] = round;
    memo_end(&errors);
    (void)log_enter(NULL);
}

/* Handles a request at the control socket, whose client gets the errors. */
static uint64_t on_reload_request(void *user, FILE *errors)
{
    service *s = user;
    uint64_t round = ask_for_reload(s, errors);
    if (round == 0) {
        note_refusal(s, "it cannot be begun");
        end_reload(s);
    }
    return round;
}

static double seconds(cfg_time time, cw_rate rate)
{
    return (double)text_time_ticks(time, rate) / CW_CLOCK_HZ;
}

/* Adapts to another configuration of the bus, or to another name of a guest. */
static void on_change(void *user, const uint8_t from[CW_NODES_MAX])
{
    service *s = user;
    const bool reloaded = s->nodes != s->config->nodes;
    s->nodes = s->config->nodes;
    losses_remap(&s->losses, from);
    recordings_reload(s->recordings, engine_bus(s->engine));
    if (reloaded)
        verdicts_reload(s->verdicts, engine_bus(s->engine), from);
    else
        verdicts_rename(s->verdicts, engine_bus(s->engine));
    if (s->host->journal)
        journal_retry(s->host->journal, engine_inputs(s->engine));
    observe_bits(s);
    confined_warn(s->config);
    if (reloaded)
        metrics_change(s->metrics);
    reload_remap(s->errors.rx, sizeof s->errors.rx[0], from);
    reload_remap(s->errors.tx, sizeof s->errors.tx[0], from);
    if (s->publisher) {
        publisher_remap(s->publisher, from);
        s->statistics.repeat = seconds(s->config->lcm.period, s->config->rate);
        ev_timer_again(s->host->loop, &s->statistics);
    }
    if (s->kept) /* not here, inside the engine's turn, but before any request */
        ev_feed_event(s->host->loop, &s->again, EV_TIMER);
    end_reload(s);
}

static void apply_kept(service *s)
{
    kept_apply(s->kept, engine_change(s->engine));
    engine_update(s->engine);
}

/* A reload is over: kept rules are injected again before other callbacks of the loop. */
static void on_again(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    enter(timer->data);
    apply_kept(timer->data);
    (void)log_enter(NULL);
}

/* ---- Statistics and status ------------------------------------------------------------------- */

static json_t *gateways_json(const service *s)
{
    return gateways_stats(engine_group_gateways(s->host->group), s->place);
}

/* Returns the sinks of the bus alone. */
static sink_list own_sinks(const service *s)
{
    sink_list all = {.count = 0};
    if (s->publisher)
        publisher_sink(s->publisher, &all);
    recordings_sinks(s->recordings, &all);
    verdicts_sink(s->verdicts, &all);
    return all;
}

/* Returns the sinks with the journal, which all buses of a rig share. */
static sink_list all_sinks(const service *s)
{
    sink_list all = own_sinks(s);
    if (s->host->journal)
        journal_sink(s->host->journal, &all);
    return all;
}

/* Adds the bus to a page of metrics. */
static void measure(service *s, metrics_page *page)
{
    report beyond;
    engine_update(s->engine);
    enter(s);
    engine_report(s->engine, &beyond);
    metrics_page_bus(page, s->config, engine_bus(s->engine), &beyond, &s->errors);
    const sink_list own = own_sinks(s);
    metrics_page_sinks(page, s->config->bus_name, &own);
    metrics_page_verdicts(page, s->config->bus_name, s->verdicts);
    (void)log_enter(NULL);
}

/* Fills a page with all buses of the process. */
static void measure_all(void *user, metrics_page *page)
{
    const host *h = user;
    sink_list shared = {.count = 0};
    for (size_t i = 0; i < h->count; i++)
        measure(h->buses[i], page);
    if (h->journal)
        journal_sink(h->journal, &shared);
    metrics_page_sinks(page, h->group ? NULL : h->buses[0]->config->bus_name, &shared);
    if (!h->group)
        return;
    json_t *now = gateways_stats(engine_group_gateways(h->group), GATEWAYS_ALL);
    metrics_page_gateways(page, now);
    json_decref(now);
}

/* Puts what status_json() does not know. */
static void put_more(void *user, json_t *status)
{
    const service *s = user;
    const sink_list all = all_sinks(s);
    put_text(status, "rig", s->host->rig ? s->host->rig->file : NULL);
    put(status, "recordings", recordings_json(s->recordings));
    if (s->host->journal)
        put(status, "journal", journal_to_json(s->host->journal));
    put(status, "sinks", sinks_json(&all));
    verdicts_put(s->verdicts, engine_bus(s->engine), status);
    put(status, "metrics", metrics_json(s->metrics));
    losses_put_lately(&s->losses, s->config, status);
    if (s->kept)
        kept_put(s->kept, status);
    if (*s->refused)
        put_text(status, "reload_refused", s->refused);
    if (s->host->group)
        put(status, "gateways", gateways_json(s));
}

/* Publishes all counters, as often as the configuration says. */
static void on_statistics(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    service *s = timer->data;
    engine_update(s->engine);
    enter(s);
    report beyond;
    engine_report(s->engine, &beyond);
    publisher_stats(s->publisher, engine_bus(s->engine), &beyond);
    const sink_list all = all_sinks(s);
    publisher_sinks(s->publisher, &all);
    publisher_verdicts(s->publisher, engine_bus(s->engine), s->verdicts);
    if (!s->host->group)
        return;
    json_t *now = gateways_json(s);
    publisher_gateways(s->publisher, now);
    json_decref(now);
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
static void print_trouble(char out[SERVICE_TROUBLE_BYTES], const service *s, const report *beyond)
{
    size_t used = 0;
    out[0] = '\0';
    for (unsigned i = 0; i < s->config->node_count; i++) {
        const char *trouble = trouble_of(s, i, beyond->nodes[i].link);
        if (trouble)
            used = chars_print(out, SERVICE_TROUBLE_BYTES, used, ", %s %s",
                               s->config->nodes[i].name, trouble);
    }
    if (verdicts_failed(s->verdicts) > 0)
        (void)chars_print(out, SERVICE_TROUBLE_BYTES, used, ", %s failed",
                          counted(verdicts_failed(s->verdicts), "expectation").text);
}

/* Notes beyond a crash how many verdicts it would lose. */
static void note_verdicts(service *s)
{
    kept_judges(s->kept, (kept_tally){.expectations = verdicts_count(s->verdicts),
                                      .failed = verdicts_failed(s->verdicts)});
}

void service_update(service *s)
{
    report beyond;
    engine_update(s->engine);
    enter(s);
    engine_count_loopless(s->engine);
    engine_report(s->engine, &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond, false);
    recordings_update(s->recordings, engine_bus(s->engine));
    verdicts_update(s->verdicts, engine_bus(s->engine));
    observe_bits(s);
    if (s->kept) {
        note_verdicts(s);
        kept_live(s->kept);
    }
    (void)log_enter(NULL);
}

void service_tell(service *s, service_status *out)
{
    report beyond;
    engine_report(s->engine, &beyond);
    cw_bus_get_stats(engine_bus(s->engine), &out->bus);
    print_trouble(out->trouble, s, &beyond);
    out->refused = s->refused;
    out->rules = s->kept ? kept_trouble(s->kept) : "";
    out->sinks = own_sinks(s);
}

/* ---- Start and end --------------------------------------------------------------------------- */

service *service_new(host *h, live *config)
{
    service *s = calloc(1, sizeof *s);
    if (!s) {
        log_error("out of memory");
        return NULL;
    }
    *s = (service){
        .host = h, .place = h->count, .live = config, .config = live_config(config),
        .nodes = live_config(config)->nodes,
        .name = CLAIM_NONE};
    if (s->config->lcm.enabled && !(s->publisher = publisher_start(s->config))) {
        log_error("out of memory");
        free(s);
        return NULL;
    }
    return s;
}

/* Kept rules are in their file, or could not be written: clients wait for that. */
static void on_saved(void *user, uint64_t save, int error)
{
    service *s = user;
    enter(s);
    control_saved(s->control, save, error);
    (void)log_enter(NULL);
}

/* Remembers injected rules beside the control socket, if that has a path. A bus runs without,
 * too. */
static void start_kept(service *s, int inherited)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    socklen_t size = sizeof address - 1;
    const char *path = s->config->control;
    if (!path && getsockname(inherited, (struct sockaddr *)&address, &size) == 0)
        path = address.sun_path;
    if (!path || !*path)
        return;
    s->kept = kept_open(s->host->loop, path, s->config->bus_name, on_saved, s);
    control_keep(s->control, s->kept);
    ev_timer_init(&s->again, on_again, 0.0, 0.0);
    ev_set_priority(&s->again, EV_MAXPRI);
    s->again.data = s;
}

/* Starts the control socket at the configured path, or at the socket of the service manager. */
static bool start_control(service *s, int inherited)
{
    if (!s->config->control && inherited < 0)
        return true;
    s->control = control_start(s->host->loop, s->live, s->engine, &s->errors, inherited);
    if (!s->control)
        return false;
    control_on_reload(s->control, on_reload_request, s);
    control_show_more(s->control, put_more, s);
    start_kept(s, inherited);
    return true;
}

/* Listens for programs that read metrics, if it is wanted. */
static bool start_metrics(service *s)
{
    memo errors;
    s->metrics = metrics_new(s->host->loop, measure_all, s->host);
    const bool ready = s->metrics && memo_begin(&errors);
    const bool good = ready && metrics_prepare(s->metrics, s->config, errors.out);
    if (good)
        metrics_change(s->metrics);
    else if (!ready || !memo_text(&errors))
        log_error("out of memory");
    else
        log_lines(errors.text);
    if (ready)
        memo_end(&errors);
    return good;
}

/* Tells when another unit runs a bus of this name, which LCM and logs then mix up. */
static void claim_name(service *s)
{
    char key[CLAIM_KEY_BYTES];
    claim_owner other;
    if (!unit_instance())
        return;
    (void)snprintf(key, sizeof key, "bus/%s", s->config->bus_name);
    if (claim_take(&s->name, key, unit_instance()) == EADDRINUSE && claim_find(&other, key))
        log_warning("canwired@%s, pid %ld, runs a bus of the same name, %s: their messages over "
                    "LCM and in the journal cannot be told apart; give one another `bus: { name: "
                    "... }`", other.name, other.pid, s->config->bus_name);
}

bool service_start(service *s, engine *bus, int inherited)
{
    enter(s);
    s->engine = bus;
    s->reloader = reloader_new(s->host->loop, &s->host->files, &reload_calls, s);
    if (!s->reloader) {
        log_error("out of memory");
        return false;
    }
    reloader_keep_rig(s->reloader, s->host->rig);
    engine_on_change(bus, on_change, s);
    if (!start_control(s, inherited) || !start_metrics(s))
        return false;
    s->recordings =
        recordings_start(s->host->loop, s->config, engine_bus(bus), on_recording, s);
    if (!s->recordings)
        return false;
    s->verdicts = verdicts_start(s->config, engine_bus(bus),
                                 s->host->rig ? s->host->rig->names[s->place] : NULL);
    if (!s->verdicts)
        return false;
    engine_observe(bus, on_event, s);
    observe_bits(s);
    claim_name(s);
    confined_warn(s->config);
    return true;
}

void service_run(service *s)
{
    enter(s);
    verdicts_begin(s->verdicts);
    if (s->kept)
        apply_kept(s);
    (void)log_enter(NULL);
    if (!s->publisher)
        return;
    double period = seconds(s->config->lcm.period, s->config->rate);
    ev_timer_init(&s->statistics, on_statistics, period, period);
    s->statistics.data = s;
    ev_timer_start(s->host->loop, &s->statistics);
}

const cfg *service_config(const service *s)
{
    return s->config;
}

live *service_live(const service *s)
{
    return s->live;
}

engine *service_engine(const service *s)
{
    return s->engine;
}

/* Returns the frames that the nodes have dropped on their way onto the bus. */
static uint64_t count_dropped(const service *s)
{
    uint64_t sum = 0;
    for (unsigned i = 0; i < s->config->node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(engine_bus(s->engine), i, &stats) != CW_OK)
            continue;
        for (unsigned why = 0; why < CW_DROP_COUNT; why++)
            sum += stats.dropped[why];
    }
    return sum;
}

void service_report_end(service *s)
{
    report beyond;
    cw_bus_stats stats;
    enter(s);
    engine_count_loopless(s->engine);
    engine_report(s->engine, &beyond);
    if (s->publisher)
        publisher_stats(s->publisher, engine_bus(s->engine), &beyond);
    losses_log(&s->losses, s->config, engine_bus(s->engine), &beyond, true);
    (void)engine_check_books(s->engine);
    cw_bus_get_stats(engine_bus(s->engine), &stats);
    log_info("stopped: %s, %s, %s not sent, %" PRIu64 " dropped",
             counted(stats.frames, "frame").text, counted(stats.error_frames, "error frame").text,
             counted(stats.pending, "frame").text, count_dropped(s));
    verdicts_conclude(s->verdicts, engine_bus(s->engine));
    if (s->publisher)
        publisher_verdicts(s->publisher, engine_bus(s->engine), s->verdicts);
    s->host->expectation_failed =
        s->host->expectation_failed || verdicts_failed(s->verdicts) > 0;
    (void)log_enter(NULL);
}

void service_finish(service *s)
{
    recordings_finish(s->recordings);
}

void service_stop(service *s, const struct timespec *until)
{
    enter(s);
    reloader_free(s->reloader);
    s->reloader = NULL;
    control_stop(s->control);
    s->control = NULL;
    if (s->kept)
        ev_timer_stop(s->host->loop, &s->again);
    kept_close(s->kept);
    s->kept = NULL;
    metrics_free(s->metrics);
    s->metrics = NULL;
    recordings_stop(s->recordings, until);
    s->recordings = NULL;
    s->host->report_missing = !verdicts_stop(s->verdicts, until) || s->host->report_missing;
    s->verdicts = NULL;
    (void)log_enter(NULL);
}

void service_free(service *s)
{
    if (!s)
        return;
    claim_release(&s->name);
    publisher_stop(s->publisher);
    live_free(s->live);
    free(s);
}
