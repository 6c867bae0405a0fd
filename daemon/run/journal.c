/* SPDX-License-Identifier: MIT
 *
 * journal.c - records all inputs of the buses of a process, so that the run can be repeated.
 */
#include "run/journal.h"

#include "base/text/chars.h"
#include "base/epoch.h"
#include "base/text/jsonput.h"
#include "base/text/jsontext.h"
#include "base/log.h"
#include "base/moment.h"
#include "base/text/number.h"
#include "base/file/spool.h"
#include "base/thread.h"
#include "base/unit.h"
#include "base/version.h"
#include "run/journal_keep.h"
#include "run/journal_pack.h"
#include "run/journal_seal.h"
#include "run/settings.h"
#include "trace/frametext.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define LINE_BYTES 512 /* of a short line */
#define RECORD_HEAD 16u /* bytes of the queue that a record takes in addition, at most */
#define RETRY_MARKS 5u /* about this many seconds until a broken journal is tried again */
#define JOURNAL_WHY_MAX 100
#define DIGEST_BYTES 17
#define NAMES_BYTES 640 /* of all buses of a rig */
#define UNSEALED_MAX 63u /* lines in a row */
#define PROGRESS_TICKS (CW_CLOCK_HZ / 50u) /* until a line says how far the bus has come */
#define CLOSE_S 2      /* limit for a disk that takes no more; see PATIENCE_S of recordings.c */

typedef enum journal_state {
    JOURNAL_WRITING = 0,
    JOURNAL_BROKEN_OFF, /* nothing is written */
    JOURNAL_TRYING      /* lines are written again, but none is known to be in the file yet */
} journal_state;

struct journal_part {
    journal *journal;
    bool named;        /* its lines have its name: it is one of a rig */
    const cfg *config; /* the live one */
    const inputs *in;
    uint64_t last_at; /* tick of its last line */
    uint64_t sent;    /* frames since then that the configuration determines */
    uint64_t digest;  /* of all such frames */
    bool advanced;    /* since its last line */
};

struct journal {
    spool *spool;
    char *file;
    size_t count;
    journal_part buses[RIG_BUSES_MAX];
    uint64_t last_at; /* tick of the last line */
    uint64_t number;   /* of lines so far, written or not */
    unsigned unsealed; /* the last lines, which have no seal ... */
    uint32_t crc;      /* ... and their checksum */
    journal_state state;
    bool reported;       /* the log reports that it is broken */
    bool reloaded;       /* since the journal is broken */
    unsigned marks;      /* since the journal is broken, or was tried again */
    uint64_t broken_at;  /* tick of the last line in the file */
    uint64_t taken_up_at;
    uint64_t lost;       /* lines that were not even queued */
    uint64_t lost_reported;
    unsigned gaps;
    char why[JOURNAL_WHY_MAX];
    spool_found found; /* of somebody else, to the file */
    char started[32];
};

/* ---- Counters -------------------------------------------------------------------------------- */

#define COUNTER(name_) {.name = #name_, CW_STAT_VALUES(cw_bus_stats, name_, 1)}
const cw_stat journal_counters[JOURNAL_COUNTERS] = {
    COUNTER(frames),           COUNTER(error_frames), COUNTER(overload_frames),
    COUNTER(arbitration_lost), COUNTER(faults),       COUNTER(pending),
};

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Stops writing until take_up(). A gap that is still open goes on. After an error the queue is
 * lost, too; a slow disk still writes the queue. */
static void break_off(journal *j, const char *why)
{
    if (j->state == JOURNAL_WRITING) {
        j->broken_at = spool_error(j->spool) != 0 ? spool_kept_stamp(j->spool) : j->last_at;
        j->reported = false;
        (void)snprintf(j->why, sizeof j->why, "%s", why);
    }
    j->state = JOURNAL_BROKEN_OFF;
    j->marks = 0;
}

/* Counts a line that is not written. Its number is used up, so that readers see the gap. */
static void lose_line(journal *j, const char *why)
{
    if (j->state != JOURNAL_BROKEN_OFF)
        break_off(j, why);
    j->number++;
    j->lost++;
}

/* Writes a line; one that is longer than a record of the spool goes in parts, which stay
 * together. */
static bool write_line(journal *j, const char *line, size_t size)
{
    bool good = size + size / SPOOL_RECORD_MAX * RECORD_HEAD + RECORD_HEAD <= spool_room(j->spool);
    while (good && size > SPOOL_RECORD_MAX) {
        good = spool_write_part(j->spool, line, SPOOL_RECORD_MAX);
        line += SPOOL_RECORD_MAX;
        size -= SPOOL_RECORD_MAX;
    }
    return good && spool_write(j->spool, line, size);
}

/* Writes a line, which has room for a seal. `often`: there are many like it, so that most have no
 * seal of their own. */
static void put_line(journal *j, char *line, size_t size, bool often)
{
    const bool seal = !often || j->unsealed == UNSEALED_MAX;
    if (seal)
        size = journal_seal_put(line, size, j->number + 1, j->crc);
    if (j->state != JOURNAL_BROKEN_OFF && write_line(j, line, size)) {
        j->number++;
        j->unsealed = seal ? 0 : j->unsealed + 1;
        j->crc = seal ? 0 : journal_crc32(j->crc, line, size);
        return;
    }
    int error = spool_error(j->spool);
    lose_line(j, error != 0 ? strerror(error) : "the disk is too slow");
}

/* Writes an object as a line, and frees it. The line needs room behind it for its seal. */
static void put_object(journal *j, json_t *object)
{
    char *text = json_dumps(object, JSON_COMPACT | JSON_PRESERVE_ORDER);
    size_t size = text ? strlen(text) : 0;
    char *line = text ? realloc(text, size + 2 + JOURNAL_SEAL_BYTES) : NULL;
    if (line) {
        memcpy(line + size, "\n", 2);
        put_line(j, line, size + 1, false);
    } else {
        lose_line(j, strerror(ENOMEM));
        free(text);
    }
    free(line);
    json_decref(object);
}

/* Makes the beginning of a line. "again": the bus was advanced once more to the tick of the line
 * before. */
static json_t *begin_line(const journal_part *b, uint64_t now)
{
    json_t *line = json_object();
    put_count(line, "at", now);
    if (b->named)
        put_text(line, "bus", b->config->bus_name);
    if (b->advanced && now == b->last_at)
        put_bool(line, "again", true);
    if (b->sent > 0)
        put_count(line, "sent", b->sent);
    return line;
}

/* The same without a JSON object, for lines of which there are many. Returns the end. */
static char *begin_text(const journal_part *b, char *line, uint64_t now)
{
    char *at = chars_decimal(chars_text(line, "{\"at\":"), now);
    if (b->named)
        at = AT_WORD(at, "bus", b->config->bus_name);
    if (b->advanced && now == b->last_at)
        at = chars_text(at, ",\"again\":true");
    if (b->sent > 0)
        at = AT_NUMBER(at, "sent", b->sent);
    return at;
}

static void end_text(const journal_part *b, char *line, char *at)
{
    at = chars_text(at, "}\n");
    put_line(b->journal, line, (size_t)(at - line), true);
}

/* Notes that a line has been written, or lost. */
static void end_line(journal_part *b, uint64_t at)
{
    b->last_at = at;
    b->sent = 0;
    b->advanced = false;
    b->journal->last_at = at;
}

/* Returns a text unchanged or, where JSON cannot hold it, as {"hex": ...}. */
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

/* Returns the texts of all files of a configuration, so that a journal needs no other file. */
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

/* Returns the bytes of data that count for a bus: more than those on the wire. */
static size_t data_room(const cw_frame *frame)
{
    return frame->flags & CW_FRAME_FD ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX;
}

/* Returns true when the text notation contains all of a frame. */
static bool is_plain(const cw_frame *frame, const char *text)
{
    cw_frame again = {.id = 0};
    return !text_parse_frame(&again, text) && again.id == frame->id &&
           again.flags == frame->flags && again.dlc == frame->dlc &&
           memcmp(again.data, frame->data, data_room(frame)) == 0;
}

/* Writes a frame of an ECU as a line. This is done without jansson, as most lines are of this
 * kind. */
static void put_send(const journal_part *b, const input *what)
{
    const cw_frame *frame = what->frame;
    char line[LINE_BYTES + JOURNAL_SEAL_BYTES];
    char text[FRAME_TEXT_MAX];
    char *at = AT_WORD(begin_text(b, line, what->now), "send", b->config->nodes[what->node].name);
    text_print_frame(text, frame);
    if (is_plain(frame, text)) {
        at = AT_WORD(at, "frame", text);
    } else {
        at = AT_NUMBER(at, "id", frame->id);
        at = AT_NUMBER(at, "flags", frame->flags);
        at = AT_NUMBER(at, "dlc", frame->dlc);
        at = chars_bytes(chars_text(at, ",\"data\":\""), frame->data, (unsigned)data_room(frame));
        *at++ = '"';
    }
    if (what->determined)
        at = chars_text(at, ",\"late\":true");
    else if (what->at_tick > what->now)
        at = AT_NUMBER(at, "in", what->at_tick - what->now);
    end_text(b, line, at);
}

/* Returns true for a frame that another run hands in by itself: before the bus gets to its tick.
 * Too much traffic may come later. */
static bool is_implied(const input *what)
{
    return what->kind == INPUT_SEND && what->determined &&
           (what->at_tick > what->now || what->now == 0);
}

/* Counts such a frame. A line says now and then how far the bus has come, since after a crash the
 * journal tells that. */
static void count_send(journal_part *b, const input *what)
{
    char line[LINE_BYTES + JOURNAL_SEAL_BYTES];
    b->sent++;
    b->digest = journal_digest(b->digest, what->node, what->frame, what->at_tick);
    if (what->now < b->last_at + PROGRESS_TICKS || b->journal->state == JOURNAL_BROKEN_OFF)
        return;
    end_text(b, line, begin_text(b, line, what->now));
    end_line(b, what->now);
}

/* Puts a text of rules. One that the bus has refused is there, too: rules before the refusal were
 * on it for a moment. */
static void put_inject(json_t *line, const input *what)
{
    put(line, "inject", bytes_to_json(what->text, what->size));
    put(line, "name", bytes_to_json(what->name, strlen(what->name)));
    if (what->refused)
        put_bool(line, "refused", true);
}

/* Writes any input but a frame as a line. */
static void put_other(const journal_part *b, const input *what)
{
    json_t *line = begin_line(b, what->now);
    const char *node = what->node < b->config->node_count ? b->config->nodes[what->node].name : "";
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
        put(line, "settings", settings_given_to_json(what->settings, what->time));
        break;
    case INPUT_ATTACH:
        put_text(line, what->on ? "attach" : "detach", node);
        if (what->as)
            put_text(line, "as", what->as);
        break;
    case INPUT_SKIP:
        put_count(line, "skip", what->skipped);
        put_count(line, "earlier", what->earlier);
        break;
    case INPUT_RELOAD:
        put(line, "reload", files_to_json(what->config));
        put_count(line, "traffic", what->at_tick);
        break;
    case INPUT_SEND:
    case INPUT_COUNT:
        break;
    }
    put_object(b->journal, line);
}

void journal_part_input(void *user, const input *what)
{
    journal_part *b = user;
    journal *j = b->journal;
    spool_stamp(j->spool, what->now);
    b->advanced = b->advanced || what->advanced;
    if (is_implied(what)) {
        count_send(b, what);
        return;
    }
    if (what->kind == INPUT_RELOAD && j->state != JOURNAL_WRITING)
        j->reloaded = true;
    if (j->state == JOURNAL_BROKEN_OFF)
        lose_line(j, "");
    else if (what->kind == INPUT_SEND)
        put_send(b, what);
    else
        put_other(b, what);
    end_line(b, what->now);
}

void journal_input(void *user, const input *what)
{
    journal *j = user;
    journal_part_input(&j->buses[0], what);
}

journal_part *journal_part_at(journal *j, size_t bus)
{
    return &j->buses[bus];
}

/* ---- Marks ----------------------------------------------------------------------------------- */

/* Writes counters and digest of the bus. A run of the journal compares its own with these. */
static void put_mark(journal_part *b, const char *key)
{
    cw_bus_stats stats;
    char digest[DIGEST_BYTES];
    json_t *counters = json_object();
    cw_bus_get_stats(b->in->bus, &stats);
    spool_stamp(b->journal->spool, stats.ticks);
    b->advanced = b->advanced || b->in->advanced;
    json_t *line = begin_line(b, stats.ticks);
    for (size_t i = 0; i < JOURNAL_COUNTERS; i++)
        put_count(counters, journal_counters[i].name,
                  cw_stat_value(&journal_counters[i], &stats, 0));
    put(line, key, counters);
    (void)snprintf(digest, sizeof digest, "%016" PRIx64, b->digest);
    put_text(line, "digest", digest);
    put_object(b->journal, line);
    end_line(b, stats.ticks);
}

static void put_marks(journal *j, const char *key)
{
    for (size_t i = 0; i < j->count; i++)
        put_mark(&j->buses[i], key);
}

/* ---- The beginning --------------------------------------------------------------------------- */

/* Writes when the buses have started, in virtual time that of its clock. */
static void print_time(char out[32], const cfg *config)
{
    struct timespec now = moment_of(EPOCH_REALTIME_NS);
    struct tm date;
    if (config->pacing != CFG_PACING_VIRTUAL)
        (void)clock_gettime(CLOCK_REALTIME, &now);
    size_t used = strftime(out, 32, "%Y-%m-%dT%H:%M:%S", gmtime_r(&now.tv_sec, &date));
    (void)snprintf(out + used, 32 - used, ".%06ldZ", now.tv_nsec / 1000);
}

/* Writes the names of all buses, for messages: "body, powertrain". */
static void print_names(char out[NAMES_BYTES], const journal *j)
{
    size_t used = 0;
    for (size_t i = 0; i < j->count; i++)
        used = chars_print(out, NAMES_BYTES, used, "%s%s", i > 0 ? ", " : "",
                           j->buses[i].config->bus_name);
}

/* Writes the first line: version, names of the buses, and the start of the journal. */
static void put_header(journal *j)
{
    char names[NAMES_BYTES] = "";
    const bool several = j->buses[0].named;
    json_t *header = json_object();
    print_names(names, j);
    put_count(header, "canwire-journal", JOURNAL_VERSION);
    put_text(header, "canwire", CANWIRE_VERSION);
    put_text(header, "bus", names);
    if (several)
        put_count(header, "buses", j->count);
    put_text(header, "started", j->started);
    put_object(j, header);
}

/* Writes the configurations of the buses from one of them on. */
static void put_configs(journal *j, size_t first)
{
    for (size_t i = first; i < j->count; i++) {
        const journal_part *b = &j->buses[i];
        json_t *line = json_object();
        put_count(line, "at", 0);
        if (b->named)
            put_text(line, "bus", b->config->bus_name);
        put(line, "config", files_to_json(b->config));
        put_object(j, line);
    }
}

/* ---- Gaps ------------------------------------------------------------------------------------ */

/* Returns the known state of a node behind a gap, since the journal does not contain the way to
 * it. */
static json_t *node_to_json(const journal_part *b, unsigned node)
{
    cw_node_stats stats;
    json_t *object = json_object();
    if (cw_node_get_stats(b->in->bus, node, &stats) != CW_OK)
        return object;
    put_text(object, "name", b->config->nodes[node].name);
    put_text(object, "state", cw_state_name(stats.state));
    put_count(object, "tec", stats.tec);
    put_count(object, "rec", stats.rec);
    put_count(object, "queue", stats.queue);
    return object;
}

/* Describes the bus after a gap: why there was one, the nodes, the rules, and the files after a
 * reload. */
static json_t *gap_to_json(const journal_part *b)
{
    const journal *j = b->journal;
    json_t *gap = json_object();
    json_t *nodes = json_array();
    json_t *rules = json_array();
    put_text(gap, "why", j->why);
    for (unsigned i = 0; i < b->config->node_count; i++)
        put_last(nodes, node_to_json(b, i));
    for (size_t i = 0; i < b->config->rule_count; i++)
        if (b->config->rules[i].name)
            put_text_last(rules, b->config->rules[i].name);
    put(gap, "nodes", nodes);
    put(gap, "rules", rules);
    if (j->reloaded)
        put(gap, "config", files_to_json(b->config));
    return gap;
}

/* Writes that lines are missing before this one, and how the bus is now. */
static void put_gap(journal_part *b)
{
    const uint64_t now = cw_bus_now(b->in->bus);
    spool_stamp(b->journal->spool, now);
    b->advanced = false;
    json_t *line = begin_line(b, now);
    put(line, "gap", gap_to_json(b));
    put_object(b->journal, line);
    end_line(b, now);
    b->journal->taken_up_at = now;
}

/* Tries to write again, with the line of the gap. journal_look() sees the success once that line is
 * in the file. */
static void take_up(journal *j)
{
    const uint64_t there = spool_kept(j->spool);
    spool_resume(j->spool);
    j->state = JOURNAL_TRYING;
    j->unsealed = 0; /* seals of before are not in the file */
    j->crc = 0;
    if (there == 0)
        put_header(j);
    if (there <= j->count)
        put_configs(j, there > 0 ? (size_t)there - 1 : 0);
    for (size_t i = 0; i < j->count; i++)
        put_gap(&j->buses[i]);
    put_marks(j, "mark");
}

/* Tells that the journal has stopped. The bus goes on without it. */
static void report_broken(journal *j)
{
    char time[TIME_TEXT_MAX];
    text_print_seconds(time, j->broken_at);
    log_error("journal %s: broken from %s s on: %s; the bus goes on without it", j->file, time,
              j->why);
    j->reported = true;
}

/* Tells that the journal goes on, and what is missing in it. */
static void report_taken_up(journal *j)
{
    char begin[TIME_TEXT_MAX];
    char end[TIME_TEXT_MAX];
    text_print_seconds(begin, j->broken_at);
    text_print_seconds(end, j->taken_up_at);
    log_warning("journal %s: taken up again, nothing is written from %s s to %s s, %" PRIu64
                " lines are missing; it can be run again up to there only",
                j->file, begin, end, journal_lost(j) - j->lost_reported);
    j->lost_reported = journal_lost(j);
}

/* Checks the progress of the disk and reports it. */
static void journal_look(journal *j)
{
    int error = spool_error(j->spool);
    if (j->state == JOURNAL_TRYING && spool_has_resumed(j->spool)) {
        j->state = JOURNAL_WRITING;
        j->reloaded = false;
        j->gaps++;
        report_taken_up(j);
    }
    if (j->state != JOURNAL_BROKEN_OFF && error != 0)
        break_off(j, strerror(error));
    if (j->state == JOURNAL_BROKEN_OFF && !j->reported)
        report_broken(j);
}

/* Returns true when a broken journal may be tried again. A slow disk must have written the queue;
 * another error gets some time. */
static bool may_be_tried(const journal *j)
{
    if (spool_error(j->spool) == 0)
        return spool_room(j->spool) > SPOOL_QUEUE_BYTES / 2;
    return j->marks >= RETRY_MARKS;
}

/* Takes the inputs of the only bus; those of a rig are known. */
static void take_inputs(journal *j, const inputs *in)
{
    if (!j->buses[0].named)
        j->buses[0].in = in;
}

/* Deeds of somebody else to the file, and why they are bad. */
static const struct {
    const char *name;
    const char *why;
} deeds[] = {
    [SPOOL_REMOVED] = {"removed", "what is written is lost; a restart begins another"},
    [SPOOL_MOVED] = {"renamed", "what is written goes on there; a restart begins another"},
    [SPOOL_SHORTENED] = {"shortened", "its begin is lost; a restart begins another"},
};

/* Says when another program has taken the file away. A run needs all of it, so it is not begun
 * anew. */
static void look_at_file(journal *j)
{
    const spool_found found = spool_take_found(j->spool);
    spool_look(j->spool);
    if (found == SPOOL_AS_IT_WAS)
        return;
    j->found = found;
    log_error("journal %s: somebody has %s the file; what is written goes on there, and a restart "
              "begins another", j->file, deeds[found].name);
}

void journal_mark(journal *j, const inputs *in)
{
    take_inputs(j, in);
    journal_look(j);
    look_at_file(j);
    if (j->state != JOURNAL_BROKEN_OFF)
        put_marks(j, "mark");
    else if (may_be_tried(j))
        take_up(j);
    j->marks++;
}

void journal_retry(journal *j, const inputs *in)
{
    take_inputs(j, in);
    journal_look(j);
    if (j->state == JOURNAL_BROKEN_OFF)
        take_up(j);
}

/* ---- Start and stop -------------------------------------------------------------------------- */

static void free_journal(journal *j)
{
    free(j->file);
    free(j);
}

/* Opens a file whose lines are packed, in virtual time so that two runs give the same file. Returns
 * NULL with an errno. */
static spool *open_packed(const char *file, const cfg *config, int *problem)
{
    spool_packer packer;
    if (!journal_packer(&packer, config->pacing == CFG_PACING_VIRTUAL)) {
        *problem = ENOMEM;
        return NULL;
    }
    spool *s = spool_open(file, 1, NULL, NULL, problem);
    if (s)
        spool_pack(s, &packer);
    else
        packer.free(packer.user);
    return s;
}

/* Opens the file. Returns NULL after writing the reason. */
static journal *journal_open_file(const char *file, unsigned files, const cfg *config,
                                  char error[JOURNAL_ERROR_MAX])
{
    journal *j = calloc(1, sizeof *j);
    int problem = ENOMEM;
    if (j)
        j->file = strdup(file);
    if (j && j->file)
        problem = journal_make_room(file, files);
    if (j && j->file && problem == 0)
        j->spool = open_packed(file, config, &problem);
    if (j && j->spool)
        return j;
    (void)snprintf(error, JOURNAL_ERROR_MAX, "journal %s: %s", file, spool_explain(problem));
    unit_blame(problem);
    if (j)
        free_journal(j);
    return NULL;
}

/* Writes what stands before all inputs: the head and the configurations. */
static journal *journal_begin(journal *j)
{
    spool_last(j->spool);
    print_time(j->started, j->buses[0].config);
    put_header(j);
    put_configs(j, 0);
    return j;
}

journal *journal_start(const char *file, unsigned files, const cfg *config,
                       char error[JOURNAL_ERROR_MAX])
{
    journal *j = journal_open_file(file, files, config, error);
    if (!j)
        return NULL;
    j->count = 1;
    j->buses[0] = (journal_part){.journal = j, .config = config};
    return journal_begin(j);
}

journal *journal_start_rig(const char *file, unsigned files, const inputs *const *buses,
                           size_t count, char error[JOURNAL_ERROR_MAX])
{
    journal *j = journal_open_file(file, files, live_config(buses[0]->config), error);
    if (!j)
        return NULL;
    for (j->count = 0; j->count < count; j->count++) {
        const cfg *config = live_config(buses[j->count]->config);
        j->buses[j->count] = (journal_part){.journal = j,
                                           .named = true,
                                           .config = config,
                                           .in = buses[j->count]};
    }
    return journal_begin(j);
}

/* Reports lines that are missing at the end of the file. */
static void report_end(journal *j, int error)
{
    if (error)
        log_error("journal %s: its end could not be written: %s; at least %" PRIu64
                  " lines are missing",
                  j->file, strerror(error), journal_lost(j) - j->lost_reported);
    else if (j->state != JOURNAL_WRITING)
        report_taken_up(j);
}

void journal_stop(journal *j, const inputs *in)
{
    if (!j)
        return;
    take_inputs(j, in);
    journal_look(j);
    if (j->state == JOURNAL_BROKEN_OFF)
        take_up(j);
    put_marks(j, "end");
    const struct timespec until = thread_in_seconds(CLOSE_S);
    int error = spool_wait(j->spool, &until) ? spool_error(j->spool) : ETIMEDOUT;
    if (error == 0 && j->state == JOURNAL_BROKEN_OFF)
        error = ENOBUFS;
    report_end(j, error);
    (void)spool_close(j->spool, 0);
    free_journal(j);
}

uint64_t journal_lost(const journal *j)
{
    return j->lost + spool_lost(j->spool);
}

json_t *journal_to_json(const journal *j)
{
    json_t *object = json_object();
    put(object, "file", text_to_json(j->file, strlen(j->file)));
    put_text(object, "state", j->state == JOURNAL_WRITING ? "writing" : "broken");
    put_text(object, "why", j->state == JOURNAL_WRITING ? NULL : j->why);
    put_count(object, "lines", j->number - journal_lost(j));
    put_count(object, "lost", journal_lost(j));
    put_count(object, "gaps", j->gaps);
    if (j->state != JOURNAL_WRITING)
        put_count(object, "broken_ns", text_ticks_ns(j->broken_at));
    return object;
}

void journal_sink(const journal *j, sink_list *out)
{
    const bool writing = j->state == JOURNAL_WRITING;
    sinks_add(out, &(sink_info){.kind = SINK_JOURNAL,
                           .name = j->file,
                           .state = !writing                     ? "broken"
                                    : j->found == SPOOL_AS_IT_WAS ? "writing"
                                                                  : deeds[j->found].name,
                           .why = writing ? deeds[j->found].why : j->why,
                           .good = writing && j->found == SPOOL_AS_IT_WAS,
                           .written = j->number - journal_lost(j),
                           .lost = journal_lost(j),
                           .bytes = spool_bytes(j->spool),
                           .gaps = j->gaps});
}
