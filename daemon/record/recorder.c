/* SPDX-License-Identifier: MIT
 *
 * recorder.c - records what happens on a bus into a file: candump log, pcapng or VCD.
 *
 * The formats write to a stream in memory; what one entry adds there is a record of the spool. When
 * the spool is full there is a gap: entries are left out until it has some room again, so that a
 * recording has stretches of traffic rather than a frame here and there.
 */
#include "record/recorder.h"

#include "record/output.h"
#include "record/pcapng.h"
#include "record/vcd.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define RESERVE (2 * SPOOL_RECORD_MAX) /* for the end of a file and the beginning of the next */
#define GAP_ENDS (SPOOL_QUEUE_BYTES / 2)

/* What a format does; it writes to r->stream. */
typedef struct format {
    bool (*begin)(recorder *r, const cw_bus *bus); /* of a file; false: no memory */
    void (*event)(recorder *r, const cw_event *event, uint64_t time_ns);
    void (*bit)(recorder *r, const cw_bit_view *bit); /* NULL: bits are of no interest */
    void (*end)(recorder *r);                         /* of a file */
    bool has_nodes; /* a file is about the nodes it began with */
} format;

struct recorder {
    const format *format;
    const cfg *config;
    spool *spool;
    FILE *stream; /* writes into text */
    char *text;
    size_t length;
    vcd *vcd;
    char *nodes;      /* names and ports of them when the file was begun */
    uint64_t size;    /* of a file before the next is begun */
    uint64_t in_file; /* bytes */
    bool gap;         /* entries are being left out */
    bool begin_anew;  /* when the gap ends, in another file */
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
    output_log_at(r->stream, r->config, event, time_ns);
}

static bool begin_capture(recorder *r, const cw_bus *bus)
{
    (void)bus;
    pcapng_begin(r->stream, r->config);
    return true;
}

static void capture_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    pcapng_event(r->stream, r->config, event, time_ns);
}

static bool begin_dump(recorder *r, const cw_bus *bus)
{
    r->vcd = vcd_open(r->stream, r->config, bus);
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
    [CFG_RECORD_CANDUMP] = {begin_nothing, log_event, NULL, end_nothing, false},
    [CFG_RECORD_PCAPNG] = {begin_capture, capture_event, NULL, end_nothing, true},
    [CFG_RECORD_VCD] = {begin_dump, dump_event, dump_bit, end_dump, true},
};

/* ---- To the spool ---------------------------------------------------------------------------- */

/* Takes what has been written to the stream to the spool, if there is something. False: it is left
 * out, since there is no room or no memory. */
static bool pass_on(recorder *r)
{
    bool good = fflush(r->stream) == 0;
    size_t length = good ? r->length : 0;
    rewind(r->stream);
    if (length == 0)
        return good;
    if (length > SPOOL_RECORD_MAX || !spool_write(r->spool, r->text, length))
        return false;
    r->in_file += length;
    r->stats.bytes += length;
    return true;
}

/* What the file is about: names and ports of the nodes; to be freed. NULL: no memory. */
static char *describe_nodes(const cfg *config)
{
    char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);
    if (!out)
        return NULL;
    for (size_t i = 0; i < config->node_count; i++)
        fprintf(out, "%s %s\n", config->nodes[i].name,
                config->nodes[i].port ? config->nodes[i].port : "");
    if (fclose(out) == 0)
        return text;
    free(text);
    return NULL;
}

static bool begin_file(recorder *r, const cw_bus *bus)
{
    free(r->nodes);
    r->nodes = describe_nodes(r->config);
    r->in_file = 0;
    r->stats.begun++;
    return r->nodes && r->format->begin(r, bus) && pass_on(r);
}

/* Goes on in another file; there is room for that. Without memory the recording ends. */
static void change_file(recorder *r, const cw_bus *bus)
{
    r->format->end(r);
    bool good = pass_on(r) && spool_cut(r->spool) && begin_file(r, bus);
    if (!good)
        recorder_end(r);
}

static bool is_over(const recorder *r)
{
    return r->ended || spool_error(r->spool) != 0;
}

/* Looks whether entries can be recorded from now on: between two of them, in a VCD between two
 * bits. */
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

/* After an entry has been written to the stream, or not. */
static void count_entry(recorder *r)
{
    const uint64_t before = r->stats.bytes;
    bool good = pass_on(r);
    if (!good)
        r->stats.lost++;
    else if (r->stats.bytes > before)
        r->stats.entries++;
}

/* In a gap: what would have been an entry counts as lost. */
static void count_lost(recorder *r)
{
    (void)fflush(r->stream);
    r->stats.lost += r->length > 0;
    rewind(r->stream);
}

/* ---- Events and bits ------------------------------------------------------------------------- */

bool recorder_wants_bits(const recorder *r)
{
    return r->format->bit != NULL;
}

void recorder_event(recorder *r, const cw_event *event, uint64_t time_ns)
{
    if (is_over(r))
        return;
    if (r->format->bit) { /* it is looked after with its bit */
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
    if (!r->format->bit || is_over(r))
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
    if (is_over(r) || !r->format->has_nodes)
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

static void free_recorder(recorder *r)
{
    vcd_close(r->vcd);
    if (r->stream)
        (void)fclose(r->stream);
    free(r->text);
    free(r->nodes);
    free(r);
}

/* A recorder without a spool yet; NULL: no memory. */
static recorder *make_recorder(const cfg_record *what, const cfg *config)
{
    recorder *r = calloc(1, sizeof *r);
    if (!r)
        return NULL;
    *r = (recorder){.format = &formats[what->format], .config = config, .size = what->size};
    r->stream = open_memstream(&r->text, &r->length);
    if (r->stream)
        return r;
    free_recorder(r);
    return NULL;
}

/* Begins the first file of a recorder whose spool may be NULL. patience_s is for that. */
static recorder *begin(recorder *r, const cw_bus *bus, unsigned patience_s, int *error)
{
    if (r->spool && begin_file(r, bus))
        return r;
    if (r->spool)
        *error = ENOMEM;
    (void)spool_close(r->spool, patience_s);
    free_recorder(r);
    return NULL;
}

recorder *recorder_start(const cfg_record *what, const cfg *config, const cw_bus *bus,
                         spool_news *news, void *user, int *error)
{
    recorder *r = make_recorder(what, config);
    *error = ENOMEM;
    if (!r)
        return NULL;
    r->spool = spool_open(what->file, what->files, news, user, error);
    return begin(r, bus, UINT32_MAX, error);
}

recorder *recorder_start_later(const cfg_record *what, const cfg *config, const cw_bus *bus,
                               spool_news *news, void *user, int *error)
{
    recorder *r = make_recorder(what, config);
    *error = ENOMEM;
    if (!r)
        return NULL;
    r->spool = spool_open_later(what->file, what->files, news, user, error);
    return begin(r, bus, 0, error);
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
    (void)pass_on(r);
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

void recorder_get_stats(const recorder *r, recorder_stats *stats)
{
    *stats = r->stats;
}
