/* SPDX-License-Identifier: MIT
 *
 * verdicts.c - judges a running bus by `expect` in its configuration, and reports at its end.
 */
#include "serve/verdicts.h"

#include "base/file/folder.h"
#include "base/file/lookout.h"
#include "base/file/spool.h"
#include "base/log.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/text/memo.h"
#include "base/text/number.h"
#include "base/unit.h"
#include "serve/recordings.h"
#include "sim/expect.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MOMENT_BYTES 400
#define ONE_BYTES 1000u             /* of an expectation in a status, without them */
#define STATUS_BYTES (256u * 1024u) /* of the texts in a status, which must fit into a reply */

struct verdicts {
    const cfg *config;
    const char *label;
    expect *judge;
    size_t count;
    verdict *all; /* by expectation of the configuration */
    size_t gone_count;
    verdict *gone;
    uint64_t gone_left_out; /* that were too many */
    uint64_t failed;
    uint64_t judged; /* expectations, those that are gone included */
    unsigned configuration;
    char *cleared;  /* the file whose old report has been removed, or NULL */
    lookout *watch; /* over where the report will be, or NULL */
    int error;      /* why it could not be written now, as the log has told; 0: it could */
    char *file;     /* of the report that is being written; NULL: none is */
    spool *report;
    bool unwritten; /* it could not be begun, or not be made as a text */
};

static const char *text_or_end(const char *text)
{
    if (!text)
        json_no_memory();
    return text ? text : "";
}

/* The program ends without memory, as for JSON: a verdict must not be lost. */
static char *copy_of(const char *text)
{
    char *copy = strdup(text_or_end(text));
    if (!copy)
        json_no_memory();
    return copy;
}

static void free_verdict(verdict *one)
{
    free(one->name);
    free(one->wanted);
    free(one->got);
    free(one->event);
}

static void free_all(verdict *all, size_t count)
{
    for (size_t i = 0; i < count; i++)
        free_verdict(&all[i]);
    free(all);
}

/* ---- Failures -------------------------------------------------------------------------------- */

/* Prints "at 2.5s by tx 123#11 at engine". */
static void print_moment(char out[MOMENT_BYTES], const verdict *one)
{
    char time[TIME_TEXT_MAX];
    text_print_span(time, one->tick);
    (void)snprintf(out, MOMENT_BYTES, "at %s%s%s", time, *one->event ? " by " : "", one->event);
}

/* Logs the failure of an expectation, whose name may be what is wanted. */
static void log_failure(const verdicts *v, const verdict *one)
{
    const bool named = strcmp(one->name, one->wanted) != 0;
    char moment[MOMENT_BYTES];
    const char *before = log_enter(v->label);
    print_moment(moment, one);
    log_error("expectation failed %s: %s%swanted %s, got %s", moment, named ? one->name : "",
              named ? ": " : "", one->wanted, one->got);
    (void)log_enter(before);
}

/* Notes the first failure of an expectation. Later ones do not change it. */
static void note_failure(verdicts *v, verdict *one, const expect_failure *f)
{
    one->failed = true;
    one->tick = f->tick;
    one->got = copy_of(f->got);
    one->event = copy_of(f->event);
    v->failed++;
    log_failure(v, one);
}

static void on_failed(void *user, const expect_failure *f)
{
    verdicts *v = user;
    note_failure(v, &v->all[f->index], f);
}

/* ---- Start and reload ------------------------------------------------------------------------ */

/* Makes the judge of a configuration, with what it is to judge by. */
static void judge_anew(verdicts *v, const cw_bus *bus)
{
    cw_bus_stats now;
    cw_bus_get_stats(bus, &now);
    v->configuration++;
    v->count = v->config->expect_count;
    v->judge = expect_start(v->config, &now);
    v->all = calloc(v->count + 1, sizeof *v->all);
    if (!v->judge || !v->all) {
        json_no_memory();
        return;
    }
    expect_watch(v->judge, on_failed, v);
    for (size_t i = 0; i < v->count; i++) {
        expect_outcome now_is;
        if (!expect_look(v->judge, i, &now, &now_is))
            json_no_memory();
        v->all[i] = (verdict){.wanted = copy_of(now_is.wanted),
                              .name = copy_of(now_is.name ? now_is.name : now_is.wanted),
                              .configuration = v->configuration};
        expect_outcome_free(&now_is);
    }
}

/* Looks if the report can be written. */
static bool prepare_report(verdicts *v)
{
    const cfg *config = v->config;
    v->error = config->expect_report ? spool_probe(config->expect_report, 1) : 0;
    if (v->error == 0)
        return true;
    log_error("%s:%d:%d: expect-report %s: %s%s", config->file, config->expect_report_place.line,
              config->expect_report_place.column, config->expect_report, spool_explain(v->error),
              unit_hint(config->expect_report, v->error));
    unit_blame(v->error);
    return spool_may_wait(v->error);
}

verdicts *verdicts_start(const cfg *config, const cw_bus *bus, const char *label)
{
    verdicts *v = calloc(1, sizeof *v);
    if (!v) {
        log_error("out of memory");
        return NULL;
    }
    *v = (verdicts){.config = config, .label = label};
    if (!prepare_report(v)) {
        free(v);
        return NULL;
    }
    judge_anew(v, bus);
    v->judged = v->count;
    return v;
}

/* Removes a report that is old, or not whole: nobody must take it for that of this run. */
static int remove_report(const char *file)
{
    folder in;
    int error = folder_open(&in, file);
    if (error == 0 && unlinkat(in.fd, in.name, 0) != 0)
        error = errno;
    folder_close(&in);
    return error;
}

/* Begins to look after the report, to know of a full disk before the end. */
static void watch_over(verdicts *v, const char *file)
{
    v->watch = lookout_start(file, v->error);
    if (!v->watch)
        log_warning("expect-report %s: nobody looks if it can be written: %s", file,
                    strerror(errno));
}

void verdicts_begin(verdicts *v)
{
    const char *file = v->config->expect_report;
    if (file && v->watch && strcmp(v->cleared, file) == 0)
        return;
    if (v->watch)
        v->error = 0; /* of another report */
    lookout_end(v->watch);
    v->watch = NULL;
    if (!file)
        return;
    watch_over(v, file);
    free(v->cleared);
    v->cleared = copy_of(file);
    const int error = remove_report(file);
    if (error != 0 && error != ENOENT)
        log_warning("expect-report %s: the old one cannot be removed: %s", file,
                    spool_explain(error));
}

/* Keeps what has failed, when the configuration no longer has it. */
static void note_gone(verdicts *v, verdict *one)
{
    if (!one->failed)
        log_info("expectation removed: %s", one->name);
    verdict *longer = one->failed && v->gone_count < VERDICTS_GONE_MAX
                          ? realloc(v->gone, (v->gone_count + 1) * sizeof *longer)
                          : NULL;
    if (longer) {
        one->gone = true;
        v->gone = longer;
        v->gone[v->gone_count++] = *one;
        return;
    }
    v->gone_left_out += one->failed;
    free_verdict(one);
}

/* Finds an equal expectation that has not been taken; returns the count without one. */
static size_t find_equal(const verdict *old, size_t count, const bool *taken, const verdict *one)
{
    for (size_t k = 0; k < count; k++)
        if (!taken[k] && strcmp(old[k].name, one->name) == 0 &&
            strcmp(old[k].wanted, one->wanted) == 0)
            return k;
    return count;
}

void verdicts_reload(verdicts *v, const cw_bus *bus, const uint8_t from[CW_NODES_MAX])
{
    expect *old_judge = v->judge;
    verdict *old = v->all;
    const size_t old_count = v->count;
    verdicts_begin(v);
    if (old_count == 0 && v->config->expect_count == 0) {
        v->configuration++;
        return;
    }
    bool *taken = calloc(old_count + 1, sizeof *taken);
    if (!taken) {
        json_no_memory();
        return;
    }
    judge_anew(v, bus);
    for (size_t i = 0; i < v->count; i++) {
        const size_t k = find_equal(old, old_count, taken, &v->all[i]);
        v->judged += k == old_count;
        if (k == old_count)
            continue;
        taken[k] = true;
        expect_adopt(v->judge, i, old_judge, k, from);
        free_verdict(&v->all[i]);
        v->all[i] = old[k];
        v->all[i].configuration = v->configuration;
    }
    for (size_t k = 0; k < old_count; k++)
        if (!taken[k])
            note_gone(v, &old[k]);
    free(taken);
    free(old);
    expect_free(old_judge);
}

void verdicts_rename(verdicts *v, const cw_bus *bus)
{
    cw_bus_stats now;
    cw_bus_get_stats(bus, &now);
    for (size_t i = 0; i < v->count; i++) {
        verdict *one = &v->all[i];
        expect_outcome o;
        if (!expect_look(v->judge, i, &now, &o))
            json_no_memory();
        free(one->wanted);
        free(one->name);
        one->wanted = copy_of(o.wanted);
        one->name = copy_of(o.name ? o.name : o.wanted);
        expect_outcome_free(&o);
    }
}

/* ---- While the bus runs ---------------------------------------------------------------------- */

void verdicts_event(verdicts *v, const cw_event *event)
{
    expect_event(v->judge, event);
}

/* Tells that the report could not be written now, and the end of that. */
static void look_after_report(verdicts *v)
{
    const int error = v->watch ? lookout_look(v->watch) : v->error;
    if (error == v->error)
        return;
    v->error = error;
    if (error != 0)
        log_warning("expect-report %s: it could not be written now: %s", v->cleared,
                    spool_explain(error));
    else
        log_info("expect-report %s: it could be written again", v->cleared);
}

void verdicts_update(verdicts *v, const cw_bus *bus)
{
    expect_pass(v->judge, cw_bus_now(bus));
    look_after_report(v);
}

size_t verdicts_count(const verdicts *v)
{
    return v->gone_count + v->count;
}

uint64_t verdicts_failed(const verdicts *v)
{
    return v->failed;
}

const verdict *verdicts_at(const verdicts *v, size_t i)
{
    return i < v->gone_count ? &v->gone[i] : &v->all[i - v->gone_count];
}

/* Says how an expectation stands now. One that is gone stays as it was. */
static expect_outcome outcome_now(const verdicts *v, size_t i, const cw_bus_stats *now)
{
    const verdict *one = verdicts_at(v, i);
    expect_outcome o = {.ticks = one->tick};
    if (!one->gone && !expect_look(v->judge, i - v->gone_count, now, &o))
        json_no_memory();
    if (!one->gone)
        return o;
    o.wanted = copy_of(one->wanted);
    o.name = copy_of(one->name);
    o.got = copy_of(one->got);
    return o;
}

/* Returns an expectation with its state: failed, met or still open. */
static json_t *verdict_json(const verdicts *v, size_t i, const cw_bus_stats *now)
{
    const verdict *one = verdicts_at(v, i);
    expect_outcome o = outcome_now(v, i, now);
    json_t *object = json_object();
    put(object, "name", text_to_json(one->name, strlen(one->name)));
    put_text(object, "wanted", one->wanted);
    put_text(object, "got", o.got);
    put_text(object, "state", one->failed ? "failed" : o.met ? "met" : "open");
    if (one->failed) {
        put_ticks(object, "failed_ns", one->tick);
        put_text(object, "event", *one->event ? one->event : NULL);
    }
    put_bool(object, "removed", one->gone);
    expect_outcome_free(&o);
    return object;
}

/* Returns about how many bytes an expectation takes in a status: what was got names the same nodes
 * as what is wanted. */
static size_t status_size(const verdict *one)
{
    return strlen(one->name) + 2 * strlen(one->wanted) + ONE_BYTES;
}

/* Returns the room of a status that those which have failed leave for others. */
static size_t room_for_others(const verdicts *v)
{
    size_t room = STATUS_BYTES;
    for (size_t i = 0; i < verdicts_count(v); i++) {
        const verdict *one = verdicts_at(v, i);
        const size_t size = one->failed ? status_size(one) : 0;
        room -= size < room ? size : room;
    }
    return room;
}

void verdicts_put(const verdicts *v, const cw_bus *bus, json_t *status)
{
    cw_bus_stats now;
    size_t left_out = 0, rooms[] = {room_for_others(v), STATUS_BYTES};
    if (verdicts_count(v) == 0)
        return;
    json_t *array = json_array();
    cw_bus_get_stats(bus, &now);
    for (size_t i = 0; i < verdicts_count(v); i++) {
        const verdict *one = verdicts_at(v, i);
        const size_t size = status_size(one);
        if (size > rooms[one->failed]) {
            left_out++;
            continue;
        }
        rooms[one->failed] -= size;
        put_last(array, verdict_json(v, i, &now));
    }
    put(status, "expectations", array);
    put_count(status, "expectations_left_out", left_out);
}

void verdicts_sink(const verdicts *v, sink_list *out)
{
    if (v->config->expect_report)
        sinks_add(out, &(sink_info){.kind = SINK_EXPECT,
                                    .name = v->config->expect_report,
                                    .state = "judging",
                                    .why = v->error != 0 ? spool_explain(v->error) : NULL,
                                    .good = v->error == 0,
                                    .written = v->judged,
                                    .lost = v->gone_left_out});
}

/* ---- The end --------------------------------------------------------------------------------- */

/* Adds the verdict of the whole run to a report. */
static void conclude_one(verdicts *v, expect_report *report, size_t i, const cw_bus_stats *now)
{
    verdict *one = i < v->gone_count ? &v->gone[i] : &v->all[i - v->gone_count];
    expect_outcome o = outcome_now(v, i, now);
    char moment[MOMENT_BYTES];
    const size_t size = MOMENT_BYTES + strlen(o.got) + sizeof "; failed ";
    char *got = malloc(size);
    if (!o.met && !one->failed)
        note_failure(v, one, &(expect_failure){.tick = now->ticks, .got = o.got,
                                               .event = "the end of the run"});
    o.met = !one->failed;
    if (got && one->failed) {
        print_moment(moment, one);
        (void)snprintf(got, size, "%s; failed %s", o.got, moment);
        free(o.got);
        o.got = got;
    } else {
        free(got);
    }
    report->configuration = one->configuration;
    if (!expect_report_add(report, o))
        json_no_memory();
}

/* Queues a text, in as many parts as it takes. */
static bool queue_text(spool *to, const char *text, size_t size)
{
    bool good = true;
    for (size_t part; size > 0 && good; text += part, size -= part) {
        part = size < SPOOL_RECORD_MAX ? size : SPOOL_RECORD_MAX;
        good = part < size ? spool_write_part(to, text, part) : spool_write(to, text, part);
    }
    return good;
}

/* Begins to write the report. A disk that hangs delays nothing but the end of verdicts_stop(). */
static void begin_report(verdicts *v, const expect_report *report, uint64_t ticks)
{
    const expect_suite suite = {.report = report, .bus = v->config->bus_name};
    int error = 0;
    memo text;
    v->file = copy_of(v->config->expect_report);
    if (memo_begin(&text))
        expect_report_junit(text.out, &suite, 1, ticks);
    const char *all = text_or_end(memo_text(&text));
    v->report = spool_open_later(v->file, 1, NULL, NULL, &error);
    v->unwritten = !v->report || !queue_text(v->report, all, text.size);
    if (v->report)
        spool_end(v->report);
    else
        log_error("expect-report %s: %s", v->file, spool_explain(error));
    memo_end(&text);
}

void verdicts_conclude(verdicts *v, const cw_bus *bus)
{
    expect_report report = {.count = 0};
    cw_bus_stats now;
    cw_bus_get_stats(bus, &now);
    expect_pass(v->judge, now.ticks);
    for (size_t i = 0; i < verdicts_count(v); i++)
        conclude_one(v, &report, i, &now);
    if (report.count > 0)
        log_info("%s, %zu met, %zu failed", counted(report.count, "expectation").text,
                 report.count - report.failed, report.failed);
    if (v->config->expect_report)
        begin_report(v, &report, now.ticks);
    expect_report_free(&report);
}

/* Waits for the report. Returns false after logging why it is not there. */
static bool end_report(verdicts *v, const struct timespec *until)
{
    if (!v->report)
        return !v->unwritten;
    const bool ended = spool_wait(v->report, until);
    const int error = spool_error(v->report);
    if (!ended)
        log_error("expect-report %s: it could not be written in %d s", v->file,
                  RECORDINGS_PATIENCE_S);
    else if (error != 0 || v->unwritten)
        log_error("expect-report %s: %s%s", v->file,
                  error != 0 ? spool_explain(error) : "there is no room for it",
                  unit_hint(v->file, error));
    (void)spool_close(v->report, 0);
    if (ended && (error != 0 || v->unwritten))
        (void)remove_report(v->file);
    return ended && error == 0 && !v->unwritten;
}

bool verdicts_stop(verdicts *v, const struct timespec *until)
{
    if (!v)
        return true;
    const char *before = log_enter(v->label);
    const bool good = end_report(v, until);
    (void)log_enter(before);
    lookout_end(v->watch);
    expect_free(v->judge);
    free_all(v->all, v->count);
    free_all(v->gone, v->gone_count);
    free(v->file);
    free(v->cleared);
    free(v);
    return good;
}
