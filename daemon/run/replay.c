/* SPDX-License-Identifier: MIT
 *
 * replay.c - the frames of a recorded file in their order, with their times on the bus.
 */
#include "run/replay.h"

#include "trace/ahead.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define ENTRIES_AT_ONCE 1000u /* that are skipped before other sources get their turn */
#define PLACE_MAX TRACE_CHANNEL_MAX
#define OTHERS_MAX 8u /* interfaces that a message lists when the file lacks the selected one */

/* Entries of one kind that were not replayed. */
typedef struct tally {
    uint64_t count;
    uint64_t first; /* place of the first one */
    uint64_t bytes; /* of those that are not whole */
} tally;

struct replay {
    const cfg_traffic *traffic;
    cw_rate rate;
    uint64_t origin;
    cfg_time begin;  /* of the present pass, from the origin on */
    uint64_t passes; /* completed passes */
    bool begun;      /* base_ns is set, by the first entry with a time */
    uint64_t base_ns;
    uint64_t last_ns;                 /* the latest time of this pass, from base_ns on */
    uint64_t last_tick;               /* of a frame */
    uint64_t matched;                 /* frames of this pass */
    tally left_out[TRACE_KIND_COUNT]; /* of the first pass */
    tally stepped_back;
    tally untimed;   /* frames without a time stamp that are left out */
    tally cut;       /* the last frame, without the end of its line */
    bool whole;      /* there is an entry that is whole: the file is a recording */
    bool stamped;    /* a frame has a time stamp */
    bool heard; /* an entry has the selected interface */
    bool more;  /* there are more other interfaces than are kept */
    unsigned other_count;
    char others[OTHERS_MAX][TRACE_CHANNEL_MAX]; /* names of the other interfaces of the file */
    trace_reader *reader; /* with `ahead` it belongs to a thread: only constant members may be
                             read */
    trace_ahead *ahead;   /* or NULL */
    uint64_t position;    /* in the file, up to which entries have been taken */
    bool failed;          /* for `problem`, which is of an entry and not of the reader */
    char problem[TRACE_PROBLEM_MAX];
};

static const char *const kind_names[TRACE_KIND_COUNT][2] = {
    [TRACE_FRAME] = {"frame", "frames"},
    [TRACE_DAMAGED] = {"damaged entry", "damaged entries"},
    [TRACE_ERROR_FRAME] = {"error frame", "error frames"},
    [TRACE_FD_FRAME] = {"CAN FD frame", "CAN FD frames"},
    [TRACE_XL_FRAME] = {"CAN XL frame", "CAN XL frames"},
    [TRACE_OTHER] = {"entry of another kind", "entries of other kinds"},
    [TRACE_MARK] = {"beginning", "beginnings"},
};

replay *replay_open(const cfg_traffic *traffic, cw_rate rate, uint64_t origin,
                    char problem[TRACE_PROBLEM_MAX])
{
    replay *r = calloc(1, sizeof *r);
    if (!r) {
        (void)snprintf(problem, TRACE_PROBLEM_MAX, "%s: out of memory", traffic->file);
        return NULL;
    }
    *r = (replay){.traffic = traffic,
                  .rate = rate,
                  .origin = origin,
                  .last_tick = origin,
                  .begin = traffic->offset,
                  .reader = trace_open(traffic->file, traffic->format, problem)};
    if (r->reader)
        return r;
    free(r);
    return NULL;
}

void replay_close(replay *r)
{
    if (!r)
        return;
    if (r->ahead)
        trace_ahead_close(r->ahead);
    else
        trace_close(r->reader);
    free(r);
}

bool replay_read_ahead(replay *r)
{
    if (!r->ahead)
        r->ahead = trace_ahead_start(r->reader, r->passes + 1 < r->traffic->count);
    if (r->ahead)
        trace_ahead_fill(r->ahead);
    return r->ahead != NULL;
}

/* ---- Entries --------------------------------------------------------------------------------- */

/* Counts a record in a tally, in the first pass through the file only. */
static void replay_count(const replay *r, tally *t, const trace_record *record)
{
    if (r->passes > 0)
        return;
    if (t->count++ == 0)
        t->first = record->place;
    t->bytes += record->bytes;
}

/* Returns the time since the first entry of the file. */
static uint64_t elapsed_ns(replay *r, const trace_record *record)
{
    if (!r->begun) {
        r->begun = true;
        r->base_ns = record->time_ns;
    }
    uint64_t ns = record->time_ns > r->base_ns ? record->time_ns - r->base_ns : 0;
    if (record->time_ns < r->base_ns || ns < r->last_ns)
        replay_count(r, &r->stepped_back, record);
    else
        r->last_ns = ns;
    return r->last_ns;
}

/* Rounds the beginning of the pass and the time in the file to ticks together. */
static uint64_t tick_of(replay *r, uint64_t ns)
{
    const cfg_time elapsed = {.ns = ns};
    uint64_t tick = text_time_ticks_sum(r->begin, 1, elapsed, r->rate);
    tick = tick < CW_NEVER - r->origin ? r->origin + tick : CW_NEVER;
    if (tick > r->last_tick)
        r->last_tick = tick;
    return r->last_tick;
}

/* Returns true for a frame that the bus can carry. */
static bool is_carried(const replay *r, const trace_record *record)
{
    return record->kind == TRACE_FRAME || (record->kind == TRACE_FD_FRAME && r->traffic->fd);
}

static bool is_wanted(const replay *r, const trace_record *record)
{
    const cfg_traffic *t = r->traffic;
    return cw_frame_matches(&record->frame, t->filters, t->filter_count);
}

/* Remembers the name of another channel, for the message that no record is on the wanted one. */
static void keep_other(replay *r, const char *channel)
{
    for (unsigned i = 0; i < r->other_count; i++)
        if (strcmp(r->others[i], channel) == 0)
            return;
    r->more = r->other_count == OTHERS_MAX;
    if (!r->more)
        memcpy(r->others[r->other_count++], channel, TRACE_CHANNEL_MAX);
}

/* Returns true for a record of the wanted channel. Records without channel belong to all of
 * them. */
static bool is_on_channel(replay *r, const trace_record *record)
{
    const char *wanted = r->traffic->channel;
    if (!wanted || record->channel[0] == '\0')
        return true;
    bool same = strcmp(wanted, record->channel) == 0;
    r->heard = r->heard || same;
    if (!r->heard)
        keep_other(r, record->channel);
    return same;
}

/* ---- Passes ---------------------------------------------------------------------------------- */

static uint64_t replay_sum(uint64_t a, uint64_t b)
{
    return b < UINT64_MAX - a ? a + b : UINT64_MAX;
}

/* Begins the next pass at the end of the file, or ends the replay. A pass without a frame is the
 * last. */
static replay_step end_pass(replay *r)
{
    const cfg_time *gap = &r->traffic->gap;
    bool again = r->matched > 0 && r->passes + 1 < r->traffic->count;
    r->failed = r->untimed.count > 0 && !r->stamped;
    if (r->failed)
        return REPLAY_FAILED;
    r->passes++;
    if (!again)
        return REPLAY_OVER;
    if (!r->ahead && !trace_rewind(r->reader))
        return REPLAY_FAILED;
    r->begin.ns = replay_sum(replay_sum(r->begin.ns, r->last_ns), gap->ns);
    r->begin.bits = replay_sum(r->begin.bits, gap->bits);
    r->begun = false;
    r->last_ns = 0;
    r->matched = 0;
    return REPLAY_PAUSE;
}

/* Reads the next record, from the thread that reads ahead if there is one. */
static trace_result next_entry(replay *r, trace_record *record)
{
    if (r->ahead)
        return trace_ahead_next(r->ahead, record, &r->position);
    trace_result result = trace_next(r->reader, record);
    r->position = trace_position(r->reader);
    return result;
}

/* Leaves out a frame without a time: its line may be torn. end_pass() refuses a file of which no
 * frame has a time. */
static void leave_untimed(replay *r, const trace_record *record)
{
    if (r->untimed.count == 0)
        trace_complain_no_time(r->problem, r->reader, record);
    replay_count(r, &r->untimed, record);
}

/* Reads one entry. REPLAY_PAUSE: the entry is not sent. */
static replay_step step(replay *r, cw_frame *frame, uint64_t *tick)
{
    trace_record record;
    trace_result result = next_entry(r, &record);
    if (result == TRACE_LATER)
        return REPLAY_LATER;
    if (result != TRACE_RECORD)
        return result == TRACE_END ? end_pass(r) : REPLAY_FAILED;
    if (record.timed)
        *tick = tick_of(r, elapsed_ns(r, &record));
    r->whole = r->whole || record.kind != TRACE_DAMAGED;
    bool here = is_on_channel(r, &record);
    const bool carried = is_carried(r, &record);
    if (!carried && record.kind != TRACE_MARK && here)
        replay_count(r, &r->left_out[record.kind], &record);
    if (!carried || !here || !is_wanted(r, &record))
        return REPLAY_PAUSE;
    if (!record.timed && !r->traffic->fast) {
        leave_untimed(r, &record);
        return REPLAY_PAUSE;
    }
    if (record.cut)
        replay_count(r, &r->cut, &record);
    r->stamped = r->stamped || record.timed;
    r->matched++;
    *frame = record.frame;
    return REPLAY_FRAME;
}

replay_step replay_next(replay *r, cw_frame *frame, uint64_t *tick)
{
    *tick = r->last_tick;
    for (unsigned i = 0; i < ENTRIES_AT_ONCE; i++) {
        replay_step result = step(r, frame, tick);
        if (result != REPLAY_PAUSE)
            return result;
    }
    return REPLAY_PAUSE;
}

void replay_move(replay *r, uint64_t origin)
{
    r->last_tick += origin - r->origin;
    r->origin = origin;
}

void replay_delay(replay *r, uint64_t ticks)
{
    replay_move(r, ticks < CW_NEVER - r->origin ? r->origin + ticks : CW_NEVER);
}

void replay_set_traffic(replay *r, const cfg_traffic *traffic)
{
    r->traffic = traffic;
}

/* ---- Messages -------------------------------------------------------------------------------- */

const char *replay_problem(const replay *r)
{
    return r->failed ? r->problem : trace_problem(r->reader);
}

/* Adds "12 error frames (the first at line 7)". */
static void add_tally(const replay *r, FILE *out, const char *begin, const char *const names[2],
                      const tally *t, const char *why)
{
    char place[PLACE_MAX];
    trace_print_place(place, r->reader, t->first);
    fprintf(out, "%s%" PRIu64 " %s", begin, t->count, names[t->count > 1]);
    if (t->bytes > 0)
        fprintf(out, " of %" PRIu64 " bytes", t->bytes);
    fprintf(out, " (%s%s%s%s)", t->count > 1 ? "the first at " : "", place, why ? ": " : "",
            why ? why : "");
}

/* Adds what was left out. Returns true when there is any. */
static bool add_left_out(const replay *r, FILE *out)
{
    static const char *const untimed[2] = {"frame without a time", "frames without a time"};
    bool any = false;
    for (unsigned kind = TRACE_DAMAGED; kind < TRACE_KIND_COUNT; kind++) {
        if (r->left_out[kind].count == 0 || (kind == TRACE_DAMAGED && !r->whole))
            continue;
        add_tally(r, out, any ? ", " : "left out: ", kind_names[kind], &r->left_out[kind],
                  kind == TRACE_DAMAGED ? trace_damage(r->reader) : NULL);
        any = true;
    }
    if (r->untimed.count == 0 || !r->stamped)
        return any;
    add_tally(r, out, any ? ", " : "left out: ", untimed, &r->untimed, NULL);
    return true;
}

/* Reports that the file lacks the selected interface. */
static void add_interfaces(const replay *r, FILE *out)
{
    fprintf(out, "no interface '%s'; there is", r->traffic->channel);
    for (unsigned i = 0; i < r->other_count; i++)
        fprintf(out, "%s %s", i > 0 ? "," : "", r->others[i]);
    fputs(r->more ? " and more" : "", out);
}

bool replay_note(const replay *r, bool known, char note[REPLAY_NOTE_MAX])
{
    static const char *const steps[2] = {"entry that steps back in time",
                                         "entries that step back in time"};
    static const char *const ends[2] = {"frame whose line has no end and may be cut", ""};
    bool any = false;
    FILE *out = fmemopen(note, REPLAY_NOTE_MAX, "w");
    note[0] = '\0';
    if (!out)
        return false;
    fprintf(out, "%s: ", r->traffic->file);
    any = !known && add_left_out(r, out);
    if (!known && r->cut.count > 0) {
        add_tally(r, out, any ? "; " : "", ends, &r->cut, NULL);
        any = true;
    }
    if (!known && r->stepped_back.count > 0 && !r->traffic->fast) {
        add_tally(r, out, any ? "; " : "", steps, &r->stepped_back, NULL);
        fprintf(out, ", sent at once (%s)", trace_stepped_back(r->reader));
        any = true;
    }
    if (r->passes > 0 && r->traffic->channel && !r->heard && r->other_count > 0) {
        fputs(any ? "; " : "", out);
        add_interfaces(r, out);
        any = true;
    } else if (r->passes > 0 && r->matched == 0) {
        fprintf(out, "%sno frame%s", any ? "; " : "",
                r->traffic->filter_count || r->traffic->channel ? " that is asked for" : "");
        any = true;
    }
    (void)fclose(out);
    return any;
}

uint64_t replay_passes(const replay *r)
{
    return r->passes;
}

unsigned replay_permille(const replay *r)
{
    uint64_t size = trace_size(r->reader);
    uint64_t position = r->position;
    if (r->traffic->count == UINT64_MAX || size == 0)
        return 0;
    if (position > size)
        position = size;
    double done = ((double)r->passes + (double)position / (double)size) / (double)r->traffic->count;
    return done < 1 ? (unsigned)(done * 1000) : 1000;
}

bool replay_check(const cfg_traffic *traffic, uint64_t *frames, char note[REPLAY_NOTE_MAX])
{
    cfg_traffic once = *traffic;
    cw_frame frame;
    uint64_t tick;
    char problem[TRACE_PROBLEM_MAX];
    replay_step result = REPLAY_FAILED;
    once.count = 1;
    *frames = 0;
    note[0] = '\0';
    replay *r = replay_open(&once, cw_rate_of(1), 0, problem);
    if (r)
        while ((result = replay_next(r, &frame, &tick)) <= REPLAY_LATER)
            *frames += result == REPLAY_FRAME;
    if (result == REPLAY_FAILED)
        (void)snprintf(note, REPLAY_NOTE_MAX, "%s", r ? replay_problem(r) : problem);
    else if (!replay_note(r, false, note))
        note[0] = '\0';
    replay_close(r);
    return result != REPLAY_FAILED;
}
