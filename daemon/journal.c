/* SPDX-License-Identifier: MIT
 *
 * journal.c - writes down all that is done to a bus, so that it can be run again.
 */
#include "journal.h"

#include "jsonput.h"
#include "log.h"
#include "settings.h"
#include "spool.h"
#include "text.h"
#include "thread.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define LINE_BYTES 512 /* of a short line */
#define RECORD_HEAD 8u /* what a record needs in the queue besides its bytes, at most */
#define CLOSE_S 2      /* to wait for a disk that takes no more; see PATIENCE_S of recordings.c */

struct journal {
    spool *spool;
    char *file;
    const cfg *config; /* the live one */
    uint64_t last_at;  /* tick of the last line */
    bool broken;
    bool marked;        /* ... which is written in it */
    bool told;          /* ... and in the log */
    uint64_t broken_at; /* tick */
    uint64_t lost;      /* lines */
};

/* ---- Counters -------------------------------------------------------------------------------- */

static uint64_t read_frames(const cw_bus_stats *stats)
{
    return stats->frames;
}

static uint64_t read_error_frames(const cw_bus_stats *stats)
{
    return stats->error_frames;
}

static uint64_t read_overload_frames(const cw_bus_stats *stats)
{
    return stats->overload_frames;
}

static uint64_t read_arbitration_lost(const cw_bus_stats *stats)
{
    return stats->arbitration_lost;
}

static uint64_t read_faults(const cw_bus_stats *stats)
{
    return stats->faults;
}

static uint64_t read_pending(const cw_bus_stats *stats)
{
    return stats->pending;
}

const journal_counter journal_counters[JOURNAL_COUNTERS] = {
    {"frames", read_frames},
    {"error_frames", read_error_frames},
    {"overload_frames", read_overload_frames},
    {"arbitration_lost", read_arbitration_lost},
    {"faults", read_faults},
    {"pending", read_pending},
};

/* ---- Lines ----------------------------------------------------------------------------------- */

static void lose_line(journal *j)
{
    if (!j->broken)
        j->broken_at = j->last_at;
    j->broken = true;
    j->lost++;
}

/* A line that is longer than a record of the spool can be goes in pieces, but all of them. */
static bool write_line(journal *j, const char *line, size_t size)
{
    bool good = size + size / SPOOL_RECORD_MAX * RECORD_HEAD + RECORD_HEAD <= spool_room(j->spool);
    while (good && size > 0) {
        size_t piece = size < SPOOL_RECORD_MAX ? size : SPOOL_RECORD_MAX;
        good = spool_write(j->spool, line, piece);
        line += piece;
        size -= piece;
    }
    return good;
}

static void put_line(journal *j, const char *line, size_t size)
{
    if (j->broken || !write_line(j, line, size))
        lose_line(j);
}

static void __attribute__((format(printf, 2, 3))) put_short(journal *j, const char *format, ...)
{
    char line[LINE_BYTES];
    va_list args;
    va_start(args, format);
    int size = vsnprintf(line, sizeof line, format, args);
    va_end(args);
    put_line(j, line, (size_t)size);
}

static void put_object(journal *j, json_t *object)
{
    char *text = json_dumps(object, JSON_COMPACT | JSON_PRESERVE_ORDER);
    size_t size = text ? strlen(text) : 0;
    char *line = text ? realloc(text, size + 2) : NULL;
    if (line) {
        memcpy(line + size, "\n", 2);
        put_line(j, line, size + 1);
    } else {
        lose_line(j);
        free(text);
    }
    free(line);
    json_decref(object);
}

/* What every line begins with. "again" where the bus was advanced to the tick of the line before
 * once more. */
static json_t *begin_line(const journal *j, uint64_t now, bool advanced)
{
    json_t *line = json_object();
    put_count(line, "at", now);
    if (advanced && now == j->last_at)
        put_bool(line, "again", true);
    return line;
}

/* A text as it is: as a text, or, where JSON cannot hold it, as {"hex": ...}. */
static json_t *bytes_to_json(const char *bytes, size_t size)
{
    json_t *text = json_stringn(bytes, size);
    if (text)
        return text;
    char *hex = malloc(2 * size + 1);
    if (!hex)
        return json_null();
    hex[0] = '\0';
    for (size_t i = 0; i < size; i++)
        (void)sprintf(hex + 2 * i, "%02x", (unsigned)(unsigned char)bytes[i]);
    json_t *object = json_object();
    put_text(object, "hex", hex);
    free(hex);
    return object;
}

static json_t *files_to_json(const cfg *config)
{
    json_t *files = json_array();
    for (size_t i = 0; i < config->file_count; i++) {
        const cfg_file *file = &config->files[i];
        json_t *entry = json_object();
        put(entry, "name", bytes_to_json(file->name, strlen(file->name)));
        put(entry, "text", bytes_to_json(file->text, file->size));
        put_last(files, entry);
    }
    return files;
}

/* ---- Inputs ---------------------------------------------------------------------------------- */

/* Whether the notation that people use says all of a frame. */
static bool is_plain(const cw_frame *frame, const char *text)
{
    cw_frame again = {.id = 0};
    return !text_parse_frame(&again, text) && again.id == frame->id &&
           again.flags == frame->flags && again.dlc == frame->dlc &&
           memcmp(again.data, frame->data, sizeof again.data) == 0;
}

/* Most of the lines, so not by way of a JSON object. */
static void put_send(journal *j, const input *what)
{
    char frame[FRAME_TEXT_MAX];
    char raw[LINE_BYTES / 2];
    text_print_frame(frame, what->frame);
    if (is_plain(what->frame, frame)) {
        (void)snprintf(raw, sizeof raw, "\"frame\":\"%s\"", frame);
    } else {
        int used =
            snprintf(raw, sizeof raw, "\"id\":%" PRIu32 ",\"flags\":%u,\"dlc\":%u,\"data\":\"",
                     what->frame->id, (unsigned)what->frame->flags, (unsigned)what->frame->dlc);
        for (size_t i = 0; i < sizeof what->frame->data; i++)
            used += snprintf(raw + used, sizeof raw - (size_t)used, "%02X",
                             (unsigned)what->frame->data[i]);
        (void)snprintf(raw + used, sizeof raw - (size_t)used, "\"");
    }
    put_short(j, "{\"at\":%" PRIu64 "%s,\"send\":\"%s\",%s,\"tick\":%" PRIu64 "}\n", what->now,
              what->advanced && what->now == j->last_at ? ",\"again\":true" : "",
              j->config->nodes[what->node].name, raw, what->at_tick);
}

static void put_inject(json_t *line, const input *what)
{
    put(line, "inject", bytes_to_json(what->text, what->size));
    put(line, "name", bytes_to_json(what->name, strlen(what->name)));
    if (what->refused)
        put_bool(line, "refused", true);
}

static void put_other(journal *j, const input *what)
{
    json_t *line = begin_line(j, what->now, what->advanced);
    const char *node = what->node < j->config->node_count ? j->config->nodes[what->node].name : "";
    switch (what->kind) {
    case INPUT_INJECT:
        put_inject(line, what);
        break;
    case INPUT_CLEAR:
        put_text(line, "clear", what->rule);
        break;
    case INPUT_FIRE:
        put_text(line, "fire", what->rule);
        break;
    case INPUT_RESTART:
        put_text(line, "restart", node);
        break;
    case INPUT_SET:
        put_text(line, "set", node);
        put(line, "settings", settings_given_to_json(what->settings));
        break;
    case INPUT_ATTACH:
        put_text(line, what->on ? "attach" : "detach", node);
        break;
    case INPUT_SKIP:
        put_count(line, "skip", what->skipped);
        put_count(line, "earlier", what->earlier);
        break;
    case INPUT_RELOAD:
        put(line, "reload", files_to_json(what->config));
        break;
    case INPUT_SEND:
    case INPUT_COUNT:
        break;
    }
    put_object(j, line);
}

void journal_input(void *user, const input *what)
{
    journal *j = user;
    if (j->broken)
        lose_line(j);
    else if (what->kind == INPUT_SEND)
        put_send(j, what);
    else
        put_other(j, what);
    j->last_at = what->now;
}

/* ---- Marks ----------------------------------------------------------------------------------- */

static void put_mark(journal *j, const char *key, const inputs *in)
{
    cw_bus_stats stats;
    json_t *counters = json_object();
    cw_bus_get_stats(in->bus, &stats);
    json_t *line = begin_line(j, stats.ticks, in->advanced);
    for (size_t i = 0; i < JOURNAL_COUNTERS; i++)
        put_count(counters, journal_counters[i].name, journal_counters[i].read(&stats));
    put(line, key, counters);
    put_object(j, line);
    j->last_at = stats.ticks;
}

/* Whoever reads it is to know; as soon as there is room. */
static void mark_broken(journal *j)
{
    char line[LINE_BYTES];
    int size = snprintf(line, sizeof line, "{\"at\":%" PRIu64 ",\"broken\":true}\n", j->broken_at);
    j->marked = j->marked || write_line(j, line, (size_t)size);
}

static void tell_broken(journal *j)
{
    char time[TIME_TEXT_MAX];
    int error = spool_error(j->spool);
    text_print_seconds(time, j->broken_at);
    log_error("journal %s: broken from %s s on: %s; the bus goes on without it", j->file, time,
              error ? strerror(error) : "the disk is too slow");
    j->told = true;
}

void journal_mark(journal *j, const inputs *in)
{
    if (!j->broken && spool_error(j->spool) == 0)
        put_mark(j, "mark", in);
    else if (!j->broken)
        lose_line(j);
    if (j->broken)
        mark_broken(j);
    if (j->broken && !j->told)
        tell_broken(j);
}

/* ---- Start and stop -------------------------------------------------------------------------- */

static void print_time(char out[32])
{
    struct timespec now;
    struct tm date;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    size_t used = strftime(out, 32, "%Y-%m-%dT%H:%M:%S", gmtime_r(&now.tv_sec, &date));
    (void)snprintf(out + used, 32 - used, ".%06ldZ", now.tv_nsec / 1000);
}

static void put_header(journal *j)
{
    char time[32];
    json_t *header = json_object();
    print_time(time);
    put_count(header, "canwire-journal", JOURNAL_VERSION);
    put_text(header, "canwire", CANWIRE_VERSION);
    put_text(header, "bus", j->config->bus_name);
    put_text(header, "started", time);
    put_object(j, header);
    json_t *line = json_object();
    put_count(line, "at", 0);
    put(line, "config", files_to_json(j->config));
    put_object(j, line);
}

static void free_journal(journal *j)
{
    free(j->file);
    free(j);
}

journal *journal_start(const char *file, const cfg *config, char error[JOURNAL_ERROR_MAX])
{
    journal *j = calloc(1, sizeof *j);
    int problem = ENOMEM;
    if (j)
        j->file = strdup(file);
    if (j && j->file)
        j->spool = spool_open(file, JOURNAL_FILES, NULL, NULL, &problem);
    if (!j || !j->spool) {
        (void)snprintf(error, JOURNAL_ERROR_MAX, "journal %s: %s", file,
                       spool_explain(problem));
        if (j)
            free_journal(j);
        return NULL;
    }
    j->config = config;
    put_header(j);
    return j;
}

void journal_stop(journal *j, const inputs *in)
{
    if (!j)
        return;
    if (!j->broken)
        put_mark(j, "end", in);
    if (j->broken)
        mark_broken(j);
    const struct timespec until = thread_in_seconds(CLOSE_S);
    int error = spool_wait(j->spool, &until) ? spool_error(j->spool) : ETIMEDOUT;
    (void)spool_close(j->spool, 0);
    if (j->broken)
        log_error("journal %s: at least %" PRIu64 " lines are missing at its end", j->file,
                  j->lost);
    else if (error)
        log_error("journal %s: its end could not be written: %s", j->file, strerror(error));
    free_journal(j);
}

uint64_t journal_lost(const journal *j)
{
    return j->lost;
}
