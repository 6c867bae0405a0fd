/* SPDX-License-Identifier: MIT
 *
 * recordings.c - the recordings of a running bus, by `record` in its configuration.
 *
 * A removed entry is still written to its end, but the bus does not wait for that. Its file is in
 * use until then, and a new entry for the file waits.
 */
#include "serve/recordings.h"

#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/log.h"
#include "base/thread.h"
#include "base/unit.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

typedef struct entry {
    struct entry *next; /* of the entries that are ending */
    cfg_record what;    /* the file is a copy */
    recorder *recorder; /* NULL: it has not begun, or has ended */
    bool open;          /* its file has been opened, which has been reported */
    int error;          /* the errno that has ended it */
    bool waits;         /* its file is still in use */
    recorder_stats before; /* of recorders that have ended; lost: what came without one, too */
    uint64_t lost_reported; /* of the present one */
    uint64_t headless_reported;
} entry;

struct recordings {
    struct ev_loop *loop;
    const cfg *config;
    const cw_bus *bus; /* until the next reload */
    recordings_reported *reported;
    void *user;
    ev_async wakeup;
    size_t count;
    entry *entries[CFG_RECORDS_MAX];
    entry *ending;
};

/* ---- Entries --------------------------------------------------------------------------------- */

/* Makes the entry of a recording, with a file name of its own, as the request may end before it
 * does. */
static entry *make_entry(const cfg_record *what)
{
    entry *e = calloc(1, sizeof *e);
    char *file = strdup(what->file);
    if (!e || !file) {
        free(e);
        free(file);
        return NULL;
    }
    e->what = *what;
    e->what.file = file;
    return e;
}

static void free_entry(entry *e)
{
    if (e)
        free(e->what.file);
    free(e);
}

/* Runs in the thread of a recording whose file has been opened, or that has ended. */
static void on_wakeup_of_thread(void *user)
{
    recordings *all = user;
    ev_async_send(all->loop, &all->wakeup);
}

/* Returns true when no recording that is ending still writes this file. */
static bool is_free(const recordings *all, const char *file)
{
    for (const entry *e = all->ending; e; e = e->next)
        if (strcmp(e->what.file, file) == 0)
            return false;
    return true;
}

/* Tells that the file is open, and of losses from before. */
static void log_begun(entry *e)
{
    e->open = true;
    if (e->before.lost > 0)
        log_warning("record %s: begun again, without %s that came before", e->what.file,
                    counted(e->before.lost, "entry").text);
    else
        log_info("record %s: begun", e->what.file);
}

static void log_not_begun(const recordings *all, const entry *e)
{
    log_error("%s:%d:%d: record %s: %s%s", all->config->file, e->what.place.line,
              e->what.place.column, e->what.file, spool_explain(e->error),
              unit_hint(e->what.file, e->error));
}

/* Begins an entry at the start of the bus, which waits for the disk. */
static void begin_first(recordings *all, entry *e, const cw_bus *bus)
{
    e->recorder = recorder_start(&e->what, all->config, bus, on_wakeup_of_thread, all, &e->error);
    if (e->recorder) {
        log_begun(e);
        return;
    }
    log_not_begun(all, e);
    unit_blame(e->error);
}

static void recordings_report(const recordings *all, const entry *e)
{
    if (all->reported)
        all->reported(all->user, e->what.file, e->recorder ? NULL : spool_explain(e->error));
}

/* Begins an entry while the bus runs. The opened file, or the failure, is reported later. */
static void begin_later(recordings *all, entry *e, const cw_bus *bus)
{
    e->waits = !is_free(all, e->what.file);
    e->error = 0;
    e->open = false;
    e->lost_reported = 0;
    e->headless_reported = 0;
    if (e->waits)
        return;
    e->recorder =
        recorder_start_later(&e->what, all->config, bus, on_wakeup_of_thread, all, &e->error);
    if (e->recorder)
        return;
    log_not_begun(all, e);
    recordings_report(all, e);
}

/* Adds the counters of a recorder to the sum over those before it. */
static void add_stats(recorder_stats *sum, const recorder_stats *more)
{
    sum->entries += more->entries;
    sum->lost += more->lost;
    sum->bytes += more->bytes;
    sum->begun += more->begun;
}

/* Returns the counters of all recorders that the entry has had. */
static void get_stats(const entry *e, recorder_stats *stats)
{
    recorder_stats now;
    *stats = e->before;
    if (!e->recorder)
        return;
    recorder_get_stats(e->recorder, &now);
    add_stats(stats, &now);
}

/* Warns of entries that the file lacks since the last warning, by reason. */
static void log_lost(entry *e)
{
    recorder_stats stats;
    if (!e->recorder)
        return;
    recorder_get_stats(e->recorder, &stats);
    const uint64_t headless = stats.headless - e->headless_reported;
    const uint64_t slow = stats.lost - stats.unwritten - e->lost_reported - headless;
    if (slow > 0)
        log_warning("record %s: %s left out, the disk is too slow", e->what.file,
                    counted(slow, "entry").text);
    if (headless > 0)
        log_warning("record %s: %s left out, until the file had its begin again",
                    e->what.file, counted(headless, "entry").text);
    e->lost_reported = stats.lost - stats.unwritten;
    e->headless_reported = stats.headless;
}

/* Ends an entry whose recorder has stopped by itself. Without a file all its entries are lost. */
static void note_error(const recordings *all, entry *e)
{
    recorder_stats stats;
    e->error = recorder_error(e->recorder);
    recorder_get_stats(e->recorder, &stats);
    if (recorder_is_open(e->recorder)) {
        log_lost(e);
        log_error("record %s: stopped: %s", e->what.file, spool_explain(e->error));
    } else {
        stats = (recorder_stats){.lost = stats.entries + stats.lost};
        log_not_begun(all, e);
    }
    add_stats(&e->before, &stats);
    (void)recorder_close(e->recorder, RECORDINGS_PATIENCE_S);
    e->recorder = NULL;
}

/* ---- Reports of the threads ------------------------------------------------------------------ */

/* Frees recordings that have been ended and are written to their end. */
static void reap_ending(recordings *all)
{
    for (entry **link = &all->ending; *link;) {
        entry *e = *link;
        if (!recorder_has_ended(e->recorder)) {
            link = &e->next;
            continue;
        }
        if (recorder_error(e->recorder) != 0)
            note_error(all, e);
        (void)recorder_close(e->recorder, RECORDINGS_PATIENCE_S);
        *link = e->next;
        free_entry(e);
    }
}

/* Begins the file anew when somebody has taken it away. */
static void look_after_file(const recordings *all, entry *e)
{
    switch (recorder_begin_anew(e->recorder, all->bus)) {
    case SPOOL_AS_IT_WAS:
        return;
    case SPOOL_REMOVED:
        log_warning("record %s: somebody has removed the file, with what was in it; begun anew",
                    e->what.file);
        break;
    case SPOOL_MOVED:
        log_info("record %s: somebody has renamed the file; begun anew", e->what.file);
        break;
    case SPOOL_SHORTENED:
        log_info("record %s: somebody has made the file shorter; it goes on", e->what.file);
        break;
    }
    recordings_report(all, e);
}

/* The writing thread of a recording has something to tell: it has begun, has lost entries, or has
 * stopped. */
static void on_wakeup(struct ev_loop *loop, ev_async *wakeup, int events)
{
    (void)loop;
    (void)events;
    recordings *all = wakeup->data;
    reap_ending(all);
    for (size_t i = 0; i < all->count; i++) {
        entry *e = all->entries[i];
        if (e->recorder && !e->open && recorder_is_open(e->recorder)) {
            log_begun(e);
            recordings_report(all, e);
        }
        if (e->recorder && e->open)
            look_after_file(all, e);
        if (e->recorder && recorder_has_ended(e->recorder)) {
            note_error(all, e);
            recordings_report(all, e);
        }
    }
}

/* Begins entries whose file has become free. */
static void begin_waiting(recordings *all, const cw_bus *bus)
{
    for (size_t i = 0; i < all->count; i++)
        if (all->entries[i]->waits && is_free(all, all->entries[i]->what.file))
            begin_later(all, all->entries[i], bus);
}

/* ---- Start, reload, stop --------------------------------------------------------------------- */

recordings *recordings_start(struct ev_loop *loop, const cfg *config, const cw_bus *bus,
                             recordings_reported *reported, void *user)
{
    recordings *all = calloc(1, sizeof *all);
    bool good = all != NULL;
    if (!all) {
        log_error("out of memory");
        return NULL;
    }
    *all = (recordings){
        .loop = loop, .config = config, .bus = bus, .reported = reported, .user = user};
    ev_async_init(&all->wakeup, on_wakeup);
    all->wakeup.data = all;
    ev_async_start(loop, &all->wakeup);
    for (size_t i = 0; i < config->record_count && good; i++) {
        entry *e = make_entry(&config->records[i]);
        if (!e) {
            log_error("out of memory");
            good = false;
            break;
        }
        all->entries[all->count++] = e;
        begin_first(all, e, bus);
        good = e->error == 0 || spool_may_wait(e->error);
    }
    if (good)
        return all;
    const struct timespec until = thread_in_seconds(RECORDINGS_PATIENCE_S);
    recordings_stop(all, &until);
    return NULL;
}

/* Ends a recording. The thread writes the rest without anybody waiting for it. */
static void recordings_end(recordings *all, entry *e)
{
    if (!e->recorder) {
        free_entry(e);
        return;
    }
    log_lost(e);
    log_info("record %s: ended", e->what.file);
    recorder_end(e->recorder);
    e->next = all->ending;
    all->ending = e;
}

/* Takes the old entry that records the same into the same file; returns NULL without one. */
static entry *take_old(entry **old, size_t count, const cfg_record *what)
{
    for (size_t i = 0; i < count; i++) {
        entry *e = old[i];
        if (!e || strcmp(e->what.file, what->file) != 0 || e->what.format != what->format)
            continue;
        old[i] = NULL;
        e->what.place = what->place;
        e->what.size = what->size;
        e->what.files = what->files;
        return e;
    }
    return NULL;
}

void recordings_reload(recordings *all, const cw_bus *bus)
{
    entry *old[CFG_RECORDS_MAX];
    size_t old_count = all->count;
    all->bus = bus;
    memcpy(old, all->entries, sizeof old);
    all->count = 0;
    for (size_t i = 0; i < all->config->record_count; i++) {
        const cfg_record *what = &all->config->records[i];
        entry *e = take_old(old, old_count, what);
        if (!e)
            e = make_entry(what);
        if (e)
            all->entries[all->count++] = e;
        else
            log_error("record %s: out of memory", what->file);
    }
    for (size_t i = 0; i < old_count; i++)
        if (old[i])
            recordings_end(all, old[i]);
    for (size_t i = 0; i < all->count; i++) {
        entry *e = all->entries[i];
        if (e->recorder) {
            recorder_set_limits(e->recorder, e->what.size, e->what.files);
            recorder_nodes_changed(e->recorder, bus);
            recorder_look(e->recorder);
        } else {
            begin_later(all, e, bus);
        }
    }
}

/* Ends a recording when canwired stops, which waits for it until then. */
static void stop(entry *e, const struct timespec *until)
{
    if (!e->recorder)
        return;
    bool written = recorder_wait(e->recorder, until);
    int error = recorder_error(e->recorder);
    log_lost(e);
    if (!recorder_close(e->recorder, 0) && !written)
        log_error("record %s: not all of it could be written in %d s", e->what.file,
                  RECORDINGS_PATIENCE_S);
    else if (error != 0)
        log_error("record %s: stopped: %s", e->what.file, spool_explain(error));
}

void recordings_finish(recordings *all)
{
    for (size_t i = 0; all && i < all->count; i++)
        if (all->entries[i]->recorder)
            recorder_end(all->entries[i]->recorder);
}

void recordings_stop(recordings *all, const struct timespec *until)
{
    if (!all)
        return;
    recordings_finish(all);
    for (size_t i = 0; i < all->count; i++) {
        stop(all->entries[i], until);
        free_entry(all->entries[i]);
    }
    while (all->ending) {
        entry *e = all->ending;
        all->ending = e->next;
        stop(e, until);
        free_entry(e);
    }
    ev_async_stop(all->loop, &all->wakeup);
    free(all);
}

/* ---- While the bus runs ---------------------------------------------------------------------- */

void recordings_event(recordings *all, const cw_event *event, uint64_t time_ns)
{
    for (size_t i = 0; i < all->count; i++) {
        entry *e = all->entries[i];
        if (e->recorder)
            recorder_event(e->recorder, event, time_ns);
        else
            e->before.lost += recorder_takes(e->what.format, event);
    }
}

void recordings_bit(recordings *all, const cw_bus *bus)
{
    for (size_t i = 0; i < all->count; i++)
        if (all->entries[i]->recorder)
            recorder_bit(all->entries[i]->recorder, bus);
}

bool recordings_want_bits(const recordings *all)
{
    for (size_t i = 0; i < all->count; i++)
        if (all->entries[i]->recorder && recorder_wants_bits(all->entries[i]->recorder))
            return true;
    return false;
}

void recordings_update(recordings *all, const cw_bus *bus)
{
    begin_waiting(all, bus);
    for (size_t i = 0; i < all->count; i++) {
        log_lost(all->entries[i]);
        if (all->entries[i]->recorder)
            recorder_look(all->entries[i]->recorder);
    }
}

static const char *state_name(const entry *e)
{
    if (e->waits || (e->recorder && !e->open))
        return "waiting";
    return e->recorder ? "recording" : "stopped";
}

/* Describes a recording for the status. */
static json_t *entry_json(const entry *e)
{
    json_t *object = json_object();
    recorder_stats stats;
    get_stats(e, &stats);
    put(object, "file", text_to_json(e->what.file, strlen(e->what.file)));
    put_text(object, "format", cfg_record_format_name(e->what.format));
    put_text(object, "state", state_name(e));
    put_text(object, "why", e->error != 0 ? spool_explain(e->error) : NULL);
    put_count(object, "entries", stats.entries);
    put_count(object, "lost", stats.lost);
    put_count(object, "bytes", stats.bytes);
    put_count(object, "files_begun", stats.begun);
    put_count(object, "files", e->what.files);
    return object;
}

json_t *recordings_json(const recordings *all)
{
    json_t *array = json_array();
    for (size_t i = 0; i < all->count; i++)
        put_last(array, entry_json(all->entries[i]));
    return array;
}

void recordings_sinks(const recordings *all, sink_list *out)
{
    for (size_t i = 0; i < all->count; i++) {
        const entry *e = all->entries[i];
        recorder_stats stats;
        get_stats(e, &stats);
        sinks_add(out, &(sink_info){.kind = SINK_RECORD,
                               .name = e->what.file,
                               .state = state_name(e),
                               .why = e->error != 0 ? spool_explain(e->error) : NULL,
                               .good = e->recorder != NULL || e->waits,
                               .written = stats.entries,
                               .lost = stats.lost,
                               .bytes = stats.bytes});
    }
}
