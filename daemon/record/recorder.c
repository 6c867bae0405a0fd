/* SPDX-License-Identifier: MIT
 *
 * recorder.c - records the events of a bus in a file: candump log, pcapng or VCD.
 *
 * The formats write to a stream in memory; the text of one entry becomes a record of the spool. A
 * full spool causes a gap: entries are left out until it has enough room again. So a recording has
 * stretches of traffic rather than scattered frames.
 */
#include "record/recorder.h"

#include "base/text/memo.h"
#include "record/output.h"
#include "record/pcapng.h"
#include "record/vcd.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define RESERVE (2 * SPOOL_RECORD_MAX) /* for the end of a file and the beginning of the next */
#define GAP_ENDS (SPOOL_QUEUE_BYTES / 2)

/* The functions of a format; they write to r->entry.out. */
typedef struct format {
    bool (*begin)(recorder *r, const cw_bus *bus); /* of a file; false: no memory */
    void (*event)(recorder *r, const cw_event *event, uint64_t time_ns);
    void (*bit)(recorder *r, const cw_bit_view *bit); /* NULL: bits are not used */
    void (*end)(recorder *r);                         /* of a file */
    bool has_nodes; /* a file begins with the nodes, on which the rest depends */
    bool (*takes)(const cw_event *event); /* makes it an entry? NULL: bits do */
} format;

struct recorder {
    const format *format;
    const cfg *config;
    spool *spool;
    memo entry;
    vcd *vcd;
    char *nodes;      /* names and ports of the nodes at the beginning of the file */
    uint64_t size;    /* limit at which the next file begins */
    uint64_t in_file; /* bytes */
    bool is_stream;    /* nothing is begun a second time */
    size_t first;      /* the interface of the first node in a capture */
    size_t interfaces; /* of the capture */
    bool gap;         /* entries are being left out */
    bool begin_anew;  /* the end of the gap begins another file */
    bool ended;
    recorder_stats stats;
};

/* ---- Formats --------------------------------------------------------------------------------- */

static bool begin_nothing(recorder *r, const cw_bus *bus)
{
    (void)r;
    (void)bus;
    return true;
}

static void end_nothing(recorder *r)
{
    (void)r;
}

static void log_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    output_log_at(r->entry.out, r->config, event, time_ns);
}

static bool log_takes(const cw_event *event)
{
    return event->kind == CW_EVENT_TX;
}

/* In a file each begin is a new section. A stream goes on, with further interfaces for the new
 * nodes. */
static bool begin_capture(recorder *r, const cw_bus *bus)
{
    (void)bus;
    if (!r->is_stream || r->interfaces == 0)
        pcapng_begin(r->entry.out, r->config);
    else
        pcapng_add_interfaces(r->entry.out, r->config);
    r->first = r->is_stream ? r->interfaces : 0;
    r->interfaces = r->first + r->config->node_count;
    return true;
}

static void capture_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    pcapng_event_of_bus(r->entry.out, r->config, (unsigned)r->first, event, time_ns);
}

static bool begin_dump(recorder *r, const cw_bus *bus)
{
    r->vcd = vcd_open(r->entry.out, r->config, bus);
    return r->vcd != NULL;
}

static void dump_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    (void)time_ns; /* a dump is in bus time */
    vcd_event(r->vcd, event);
}

static void dump_bit(recorder *r, const cw_bit_view *bit)
{
    vcd_bit(r->vcd, bit);
    vcd_flush(r->vcd);
}

static void end_dump(recorder *r)
{
    vcd_close(r->vcd);
    r->vcd = NULL;
}

static const format formats[] = {
    [CFG_RECORD_CANDUMP] = {begin_nothing, log_event, NULL, end_nothing, false, log_takes},
    [CFG_RECORD_PCAPNG] = {begin_capture, capture_event, NULL, end_nothing, true, pcapng_takes},
    [CFG_RECORD_VCD] = {begin_dump, dump_event, dump_bit, end_dump, true, NULL},
};

/* ---- To the spool ---------------------------------------------------------------------------- */

/* Moves the text of the stream to the spool, if there is any. Returns false without room or memory;
 * the text is then left out. */
static bool recorder_pass_on(recorder *r)
{
    const char *text = memo_text(&r->entry);
    size_t length = text ? r->entry.size : 0;
    rewind(r->entry.out);
    if (length == 0)
        return text;
    if (length > SPOOL_RECORD_MAX || !spool_write(r->spool, text, length))
        return false;
    r->in_file += length;
    r->stats.bytes += length;
    return true;
}

/* Returns a description of the nodes, their names and ports, to be freed. Returns NULL without
 * memory. */
static char *describe_nodes(const cfg *config)
{
    memo all;
    FILE *out = memo_begin(&all);
    for (size_t i = 0; out && i < config->node_count; i++)
        fprintf(out, "%s %s\n", config->nodes[i].name,
                config->nodes[i].port ? config->nodes[i].port : "");
    return memo_take(&all);
}

/* Begins a file with what its format needs. False: without memory or room. */
static bool begin_file(recorder *r, const cw_bus *bus)
{
    free(r->nodes);
    r->nodes = describe_nodes(r->config);
    r->in_file = 0;
    r->stats.begun++;
    return r->nodes && r->format->begin(r, bus) && recorder_pass_on(r);
}

/* Goes on in another file, for which there is room. Without memory the recording ends. */
static void change_file(recorder *r, const cw_bus *bus)
{
    r->format->end(r);
    bool good = recorder_pass_on(r) && spool_cut(r->spool) && begin_file(r, bus);
    if (!good)
        recorder_end(r);
}

static bool recorder_is_over(const recorder *r)
{
    return r->ended || spool_error(r->spool) != 0;
}

/* Decides if entries can be recorded from now on. It is called between two entries, in a VCD
 * between two bits. */
static void look_at_room(recorder *r, const cw_bus *bus)
{
    size_t room = spool_room(r->spool);
    if (r->gap ? room < GAP_ENDS : room < RESERVE + SPOOL_RECORD_MAX) {
        r->gap = true;
        return;
    }
    r->gap = false;
    if (r->begin_anew || r->in_file >= r->size)
        change_file(r, bus);
    r->begin_anew = false;
}

/* Counts an entry after it was written to the stream or left out. */
static void count_entry(recorder *r)
{
    const uint64_t before = r->stats.bytes;
    bool good = recorder_pass_on(r);
    if (!good)
        r->stats.lost++;
    else if (r->stats.bytes > before)
        r->stats.entries++;
}

/* Counts an entry that falls into a gap as lost. */
static void count_lost(recorder *r)
{
    (void)fflush(r->entry.out);
    r->stats.lost += r->entry.size > 0;
    rewind(r->entry.out);
}

/* ---- Events and bits ------------------------------------------------------------------------- */

bool recorder_takes(cfg_record_format of, const cw_event *event)
{
    return formats[of].takes && formats[of].takes(event);
}

bool recorder_wants_bits(const recorder *r)
{
    return r->format->bit != NULL;
}

void recorder_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    if (recorder_is_over(r)) { /* its owner is about to hear of that */
        r->stats.lost += r->format->takes && r->format->takes(event);
        return;
    }
    if (r->format->bit) { /* the event is written with its bit */
        if (!r->gap)
            r->format->event(r, event, time_ns);
        return;
    }
    look_at_room(r, NULL);
    if (r->ended)
        return;
    r->format->event(r, event, time_ns);
    if (r->gap)
        count_lost(r);
    else
        count_entry(r);
}

void recorder_bit(recorder *r, const cw_bus *bus)
{
    cw_bit_view bit;
    if (!r->format->bit || recorder_is_over(r))
        return;
    if (r->gap)
        r->stats.lost++;
    else if (cw_bus_get_bit(bus, &bit) == CW_OK) {
        r->format->bit(r, &bit);
        count_entry(r);
    }
    look_at_room(r, bus);
}

void recorder_nodes_changed(recorder *r, const cw_bus *bus)
{
    if (recorder_is_over(r) || !r->format->has_nodes)
        return;
    char *nodes = describe_nodes(r->config);
    bool same = nodes && strcmp(nodes, r->nodes) == 0;
    free(nodes);
    if (same)
        return;
    r->begin_anew = true;
    r->gap = true;
    if (spool_room(r->spool) >= RESERVE)
        look_at_room(r, bus);
}

/* ---- Start and end --------------------------------------------------------------------------- */

/* The spool must have been closed. */
static void free_recorder(recorder *r)
{
    vcd_close(r->vcd);
    memo_end(&r->entry);
    free(r->nodes);
    free(r);
}

/* Makes a recorder without a spool; returns NULL without memory. */
static recorder *make_recorder(const cfg_record *what, const cfg *config)
{
    recorder *r = calloc(1, sizeof *r);
    if (!r)
        return NULL;
    *r = (recorder){.format = &formats[what->format], .config = config, .size = what->size};
    if (memo_begin(&r->entry))
        return r;
    free_recorder(r);
    return NULL;
}

/* Begins the first file of a recorder whose spool may be NULL. patience_s limits closing it after a
 * failure. */
static recorder *recorder_begin(recorder *r, const cw_bus *bus, unsigned patience_s, int *error)
{
    if (r->spool && r->format->has_nodes)
        spool_has_head(r->spool);
    if (r->spool && begin_file(r, bus))
        return r;
    if (r->spool)
        *error = ENOMEM;
    (void)spool_close(r->spool, patience_s);
    free_recorder(r);
    return NULL;
}

recorder *recorder_start(const cfg_record *what, const cfg *config, const cw_bus *bus,
                         spool_notify *notify, void *user, int *error)
{
    recorder *r = make_recorder(what, config);
    *error = ENOMEM;
    if (!r)
        return NULL;
    r->spool = spool_open(what->file, what->files, notify, user, error);
    if (r->spool)
        *error = spool_reserve(r->spool);
    if (*error != 0) {
        (void)spool_close(r->spool, UINT32_MAX);
        r->spool = NULL;
    }
    return recorder_begin(r, bus, UINT32_MAX, error);
}

recorder *recorder_start_stream(const cfg_record *what, const cfg *config, int fd,
                                spool_notify *notify, void *user, int *error)
{
    recorder *r = make_recorder(what, config);
    *error = ENOMEM;
    if (!r) {
        (void)close(fd);
        return NULL;
    }
    r->is_stream = true;
    r->size = UINT64_MAX;
    r->spool = spool_stream(fd, notify, user, error);
    return recorder_begin(r, NULL, 0, error);
}

recorder *recorder_start_later(const cfg_record *what, const cfg *config, const cw_bus *bus,
                               spool_notify *notify, void *user, int *error)
{
    recorder *r = make_recorder(what, config);
    *error = ENOMEM;
    if (!r)
        return NULL;
    r->spool = spool_open_later(what->file, what->files, notify, user, error);
    return recorder_begin(r, bus, 0, error);
}

void recorder_look(recorder *r)
{
    spool_look(r->spool);
}

spool_found recorder_begin_anew(recorder *r, const cw_bus *bus)
{
    const spool_found found = spool_take_found(r->spool);
    if (found == SPOOL_AS_IT_WAS || recorder_is_over(r))
        return SPOOL_AS_IT_WAS;
    if (found == SPOOL_SHORTENED && !r->format->has_nodes) {
        r->in_file = 0; /* each line stands for itself */
        return found;
    }
    r->begin_anew = true;
    if (spool_room(r->spool) >= RESERVE + SPOOL_RECORD_MAX)
        look_at_room(r, bus);
    return found;
}

bool recorder_is_open(const recorder *r)
{
    return spool_is_open(r->spool);
}

void recorder_set_limits(recorder *r, uint64_t size, unsigned files)
{
    r->size = size;
    spool_set_files(r->spool, files);
}

void recorder_end(recorder *r)
{
    if (r->ended)
        return;
    r->ended = true;
    r->format->end(r);
    (void)recorder_pass_on(r);
    spool_end(r->spool);
}

bool recorder_wait(recorder *r, const struct timespec *until)
{
    recorder_end(r);
    return spool_wait(r->spool, until);
}

bool recorder_has_ended(const recorder *r)
{
    return spool_has_ended(r->spool);
}

int recorder_error(const recorder *r)
{
    return spool_error(r->spool);
}

bool recorder_close(recorder *r, unsigned patience_s)
{
    if (!r)
        return true;
    recorder_end(r);
    bool written = spool_close(r->spool, patience_s);
    free_recorder(r);
    return written;
}

/* Entries that the spool has lost, or left out of a file without its head, count as lost, not as
 * entries. */
void recorder_get_stats(const recorder *r, recorder_stats *stats)
{
    *stats = r->stats;
    stats->headless = spool_left_out(r->spool);
    stats->unwritten = spool_lost(r->spool);
    const uint64_t gone = stats->headless + stats->unwritten;
    stats->lost += gone;
    stats->entries -= gone < stats->entries ? gone : stats->entries;
}
