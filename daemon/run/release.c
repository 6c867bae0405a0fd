/* SPDX-License-Identifier: MIT
 *
 * release.c - releases the frames of nodes without port at their times.
 *
 * A binary heap over the sources of frames, ordered by time and then by their place in the file.
 * Replays are not in it while they wait for their node: with `speed: max` until it has nothing to
 * send, else until its queue has room.
 */
#include "run/release.h"

#include "base/text/counted.h"
#include "base/text/sametext.h"
#include "run/replay.h"
#include "trace/frametext.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define LATE_TICKS (CW_CLOCK_HZ / 1000u) /* until a late file is asked again */
#define LATE_TOLD_TICKS CW_CLOCK_HZ
#define JOINED_BITS 4u
#define LOOK_BITS 100u /* too few for a node to go bus-off and come back */

typedef struct source {
    const cfg_traffic *traffic;
    unsigned node;
    unsigned place;        /* in the file */
    uint64_t done;         /* send: releases so far */
    uint64_t tick;         /* of the next one */
    uint64_t jitter_seed;  /* of the stream of this entry */
    uint64_t jitter_ticks; /* at most */
    replay *replay;        /* NULL for a send, and for a replay that is finished or has moved on */
    bool has_frame;        /* of a replay: `frame` is the next one */
    bool late;             /* of a replay: the thread has not read its file up to here */
    uint64_t late_ticks;   /* ... for this time */
    bool waits;            /* for its node, and not in the heap */
    bool behind;           /* of a replay: it has waited for room and not caught up yet ... */
    uint64_t planned;      /* ... with the frame that the file has at this tick */
    uint64_t late_frames;  /* of a replay: frames that came after that tick ... */
    uint64_t late_most;    /* ... by at most that many ticks */
    bool moved;            /* another plan continues it */
    bool reported;         /* entries that were left out of its file have been reported */
    bool tested;           /* `passes` is known */
    bool passes;           /* the test of release_next_rx() */
    uint64_t rx_ticks;     /* ... then at least so long up to a reception */
    cw_frame frame;
} source;

struct release_plan {
    const cfg *config;
    release_reporter *report;
    void *user;
    cw_rate rate;
    unsigned fast; /* replays with `speed: max` that are not finished */
    unsigned full; /* others that wait for room */
    bool failed;
    bool knows_next;   /* `next_tick` is that of release_next_rx() */
    uint64_t next_tick;
    size_t source_count;
    source *sources;
    size_t count; /* of the heap */
    source *heap[];
};

/* ---- Heap ------------------------------------------------------------------------------------ */

/* Returns the tick at which the next frame of a source was to come. */
static uint64_t planned(const source *s)
{
    return s->behind ? s->planned : s->tick;
}

/* Of frames that have waited those go first that are later. */
static bool comes_before(const source *a, const source *b)
{
    if (a->tick != b->tick)
        return a->tick < b->tick;
    return planned(a) < planned(b) || (planned(a) == planned(b) && a->place < b->place);
}

static void swap(source **a, source **b)
{
    source *t = *a;
    *a = *b;
    *b = t;
}

/* Puts an entry of the heap below all that come before it. */
static void sift_down(release_plan *plan, size_t i)
{
    source *const moved = plan->heap[i];
    for (size_t child; (child = 2 * i + 1) < plan->count; i = child) {
        if (child + 1 < plan->count && comes_before(plan->heap[child + 1], plan->heap[child]))
            child++;
        if (!comes_before(plan->heap[child], moved))
            break;
        plan->heap[i] = plan->heap[child];
    }
    plan->heap[i] = moved;
}

/* Puts a source into the heap, by the tick of its next frame. */
static void push(release_plan *plan, source *s)
{
    size_t i = plan->count++;
    plan->knows_next = false;
    plan->heap[i] = s;
    for (; i > 0 && comes_before(s, plan->heap[(i - 1) / 2]); i = (i - 1) / 2)
        swap(&plan->heap[i], &plan->heap[(i - 1) / 2]);
}

static void pop(release_plan *plan)
{
    plan->heap[0] = plan->heap[--plan->count];
    sift_down(plan, 0);
}

/* ---- send ------------------------------------------------------------------------------------ */

/* Returns the place among the node's entries with the same frame. */
static uint64_t ordinal(const cfg_node *node, const cfg_traffic *traffic)
{
    uint64_t before = 0;
    for (const cfg_traffic *t = node->traffic; t < traffic; t++)
        before += t->kind == CFG_TRAFFIC_SEND && cw_frame_equal(&t->frame, &traffic->frame);
    return before;
}

/* Starts a send. Its stream depends on seed, node and frame, so that other entries do not change
 * it. */
static void start_send(release_plan *plan, source *s)
{
    char frame[FRAME_TEXT_MAX];
    const cfg_node *node = &plan->config->nodes[s->node];
    s->jitter_ticks = text_time_ticks(s->traffic->jitter, plan->rate);
    if (s->jitter_ticks == 0)
        return;
    text_print_frame(frame, &s->traffic->frame);
    uint64_t seed = cw_random(plan->config->seed, node->name, ordinal(node, s->traffic));
    s->jitter_seed = cw_random(seed, frame, 0);
}

/* Returns the tick of release k. Jitter delays it, but never beyond the undelayed place of the next
 * one. */
static uint64_t send_tick(const release_plan *plan, const source *s, uint64_t k)
{
    const cfg_traffic *t = s->traffic;
    uint64_t tick = text_time_ticks_sum(t->offset, k, t->every, plan->rate);
    if (s->jitter_ticks == 0)
        return tick;
    uint64_t draw = cw_random(s->jitter_seed, "jitter", k);
    uint64_t delay = s->jitter_ticks == UINT64_MAX ? draw : draw % (s->jitter_ticks + 1);
    uint64_t late = delay < CW_NEVER - tick ? tick + delay : CW_NEVER;
    uint64_t next = t->has_every && k + 1 < t->count
                        ? text_time_ticks_sum(t->offset, k + 1, t->every, plan->rate)
                        : CW_NEVER;
    return late < next ? late : next;
}

/* Returns the first release at or after a tick; s->traffic->count when there is none. */
static uint64_t first_from(const release_plan *plan, const source *s, uint64_t tick)
{
    uint64_t low = 0;
    uint64_t high = s->traffic->count;
    while (low < high) {
        uint64_t middle = low + (high - low) / 2;
        if (send_tick(plan, s, middle) < tick)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* ---- replay ---------------------------------------------------------------------------------- */

/* Returns true when another source has reported the same already: nodes may share a file. */
static bool is_known(const release_plan *plan, const source *s)
{
    for (size_t i = 0; i < plan->source_count; i++) {
        const source *other = &plan->sources[i];
        if (other->reported && other->traffic->kind == CFG_TRAFFIC_REPLAY &&
            same_text(other->traffic->file, s->traffic->file) &&
            same_text(other->traffic->channel, s->traffic->channel))
            return true;
    }
    return false;
}

/* Reports once what has been left out of a replayed file. */
static void report_note(const release_plan *plan, source *s)
{
    char note[REPLAY_NOTE_MAX];
    if (!s->reported && replay_note(s->replay, is_known(plan, s), note))
        plan->report(plan->user, false, note);
    s->reported = true;
}

/* Reports how late frames came that have waited for room in the queue. */
static void report_wait(const release_plan *plan, source *s)
{
    char text[REPLAY_NOTE_MAX];
    char late[TIME_TEXT_MAX];
    const cfg_node *node = &plan->config->nodes[s->node];
    if (s->late_frames == 0)
        return;
    text_print_span(late, s->late_most);
    (void)snprintf(text, sizeof text,
                   "%s: %s waited for room in the queue of %s and came up to %s late (queue: %u)",
                   s->traffic->file, counted(s->late_frames, "frame").text, node->name, late,
                   node->queue);
    plan->report(plan->user, false, text);
    s->late_frames = 0;
}

/* Closes a replay, at its end or with a problem, and reports what it has left out. */
static void end_replay(release_plan *plan, source *s, const char *problem)
{
    if (s->replay)
        report_note(plan, s);
    report_wait(plan, s);
    if (problem) {
        plan->report(plan->user, true, problem);
        plan->failed = true;
    }
    if (s->replay && s->traffic->fast)
        plan->fast--;
    replay_close(s->replay);
    s->replay = NULL;
}

/* Asks again later, and reports a file that stays late. */
static void note_late(const release_plan *plan, source *s)
{
    char text[TRACE_PROBLEM_MAX];
    s->tick = s->tick < CW_NEVER - LATE_TICKS ? s->tick + LATE_TICKS : CW_NEVER;
    s->late_ticks += LATE_TICKS;
    if (s->late_ticks != LATE_TOLD_TICKS)
        return;
    (void)snprintf(text, sizeof text, "%s: reading it takes long, its frames come late",
                   s->traffic->file);
    plan->report(plan->user, false, text);
}

/* Reads the next frame of a file. Returns false when the file is finished. A frame that is read
 * late delays all later ones by as much: together they would fill the node's queue. After a wait
 * for room the later ones catch up. */
static bool fetch(release_plan *plan, source *s)
{
    const uint64_t asked = s->tick;
    replay_step step = replay_next(s->replay, &s->frame, &s->tick);
    s->has_frame = step == REPLAY_FRAME;
    s->late = step == REPLAY_LATER;
    s->planned = s->tick;
    s->behind = s->behind && s->tick < asked;
    if (s->tick < asked && !s->traffic->fast && !s->behind)
        replay_delay(s->replay, asked - s->tick);
    if (s->tick < asked || s->traffic->fast) /* a fast replay ignores the times of its file */
        s->tick = asked;
    if (s->late)
        note_late(plan, s);
    else
        s->late_ticks = 0;
    if (replay_passes(s->replay) > 0)
        report_note(plan, s);
    if (step == REPLAY_FAILED || step == REPLAY_OVER)
        end_replay(plan, s, step == REPLAY_FAILED ? replay_problem(s->replay) : NULL);
    return s->replay != NULL;
}

/* Opens a replay and fetches its first frame. */
static void start_replay(release_plan *plan, source *s)
{
    char problem[TRACE_PROBLEM_MAX];
    s->replay = replay_open(s->traffic, plan->rate, 0, problem);
    if (!s->replay) {
        end_replay(plan, s, problem);
        return;
    }
    plan->fast += s->traffic->fast;
    (void)fetch(plan, s);
}

/* Returns true when both play the same frames of the same file, so that one can go on from the
 * other. */
static bool same_replay(const cfg_traffic *a, const cfg_traffic *b)
{
    return a->kind == CFG_TRAFFIC_REPLAY && b->kind == CFG_TRAFFIC_REPLAY &&
           same_text(a->file, b->file) && same_text(a->channel, b->channel) &&
           a->format == b->format && a->fast == b->fast && a->count == b->count &&
           a->offset.ns == b->offset.ns && a->offset.bits == b->offset.bits &&
           a->gap.ns == b->gap.ns && a->gap.bits == b->gap.bits &&
           a->filter_count == b->filter_count &&
           memcmp(a->filters, b->filters, a->filter_count * sizeof a->filters[0]) == 0;
}

/* ---- Plans ----------------------------------------------------------------------------------- */

/* Finds the first frame of a source. */
static void release_start(release_plan *plan, source *s)
{
    if (s->traffic->kind == CFG_TRAFFIC_REPLAY) {
        start_replay(plan, s);
        return;
    }
    start_send(plan, s);
    s->tick = send_tick(plan, s, 0);
}

/* Puts a source that begins, or has been taken over, into the heap or among the waiting ones. */
static void place(release_plan *plan, source *s)
{
    bool is_replay = s->traffic->kind == CFG_TRAFFIC_REPLAY;
    s->waits = is_replay && s->replay && s->traffic->fast;
    if (!s->waits && (is_replay ? s->replay != NULL : s->done < s->traffic->count))
        push(plan, s);
}

/* kinds: of traffic, as a set. */
static void release_add_node(release_plan *plan, const cfg_node *node, unsigned index,
                             unsigned kinds)
{
    for (size_t t = 0; t < node->traffic_count; t++) {
        if (!(kinds >> node->traffic[t].kind & 1u))
            continue;
        unsigned number = (unsigned)plan->source_count++;
        source *s = &plan->sources[number];
        *s = (source){.traffic = &node->traffic[t], .node = index, .place = number};
        release_start(plan, s);
        place(plan, s);
    }
}

/* Makes a plan of all traffic of some kinds, or returns NULL without memory. */
static release_plan *make_plan(const cfg *config, unsigned kinds, release_reporter *report,
                               void *user)
{
    size_t sources = 0;
    for (size_t i = 0; i < config->node_count; i++)
        sources += config->nodes[i].traffic_count;
    release_plan *plan = calloc(1, sizeof *plan + sources * sizeof plan->heap[0]);
    source *all = calloc(sources + 1, sizeof *all);
    if (!plan || !all) {
        free(plan);
        free(all);
        return NULL;
    }
    plan->config = config;
    plan->report = report;
    plan->user = user;
    plan->rate = config->rate;
    plan->sources = all;
    for (size_t i = 0; i < config->node_count; i++)
        release_add_node(plan, &config->nodes[i], (unsigned)i, kinds);
    return plan;
}

release_plan *release_plan_new(const cfg *config, release_reporter *report, void *user)
{
    return make_plan(config, 1u << CFG_TRAFFIC_SEND | 1u << CFG_TRAFFIC_REPLAY, report, user);
}

release_plan *release_plan_of_sends(const cfg *config)
{
    return make_plan(config, 1u << CFG_TRAFFIC_SEND, NULL, NULL);
}

bool release_read_ahead(release_plan *plan)
{
    for (size_t i = 0; i < plan->source_count; i++)
        if (plan->sources[i].replay && !replay_read_ahead(plan->sources[i].replay))
            return false;
    return true;
}

void release_tell(release_plan *plan)
{
    for (size_t i = 0; i < plan->source_count; i++)
        if (plan->sources[i].replay)
            report_note(plan, &plan->sources[i]);
}

void release_plan_free(release_plan *plan)
{
    if (!plan)
        return;
    for (size_t i = 0; i < plan->source_count; i++)
        if (plan->sources[i].replay)
            end_replay(plan, &plan->sources[i], NULL);
    free(plan->sources);
    free(plan);
}

/* ---- Taking over ----------------------------------------------------------------------------- */

/* Returns the source of the old plan that a replay continues, or NULL. */
static source *find_old(release_plan *old, const source *s, uint8_t node)
{
    for (size_t i = 0; node != CW_NO_NODE && i < old->source_count; i++) {
        source *o = &old->sources[i];
        if (o->node == node && !o->moved && same_replay(o->traffic, s->traffic))
            return o;
    }
    return NULL;
}

/* Takes over where a source of the old configuration stands, so that no frame comes twice or gets
 * lost. */
static void go_on_from(source *s, source *old, uint64_t tick)
{
    replay_close(s->replay); /* was opened only as a test */
    s->replay = old->replay;
    s->tick = old->tick;
    s->has_frame = old->has_frame;
    s->frame = old->frame;
    s->reported = old->reported;
    s->behind = old->behind || old->waits;
    s->planned = old->planned;
    s->late_frames = old->late_frames;
    s->late_most = old->late_most;
    if (s->behind && s->tick < tick)
        s->tick = tick;
    old->late_frames = 0;
    old->replay = NULL;
    old->moved = true;
    if (s->replay)
        replay_set_traffic(s->replay, s->traffic);
}

void release_take_over(release_plan *plan, release_plan *old, const uint8_t from[CW_NODES_MAX],
                       uint64_t tick)
{
    plan->count = 0;
    plan->fast = 0;
    plan->full = 0;
    plan->knows_next = false;
    for (size_t i = 0; i < plan->source_count; i++) {
        source *s = &plan->sources[i];
        source *o = find_old(old, s, from[s->node]);
        if (o) {
            go_on_from(s, o, tick);
        } else if (s->replay) {
            replay_move(s->replay, tick);
            s->tick = s->tick < CW_NEVER - tick ? s->tick + tick : CW_NEVER;
        } else if (s->traffic->kind == CFG_TRAFFIC_SEND) {
            s->done = first_from(plan, s, tick);
            if (s->done < s->traffic->count)
                s->tick = send_tick(plan, s, s->done);
        }
        plan->fast += s->replay && s->traffic->fast;
        place(plan, s);
    }
}

/* ---- Releases -------------------------------------------------------------------------------- */

uint64_t release_next_tick(const release_plan *plan)
{
    return plan->count ? plan->heap[0]->tick : CW_NEVER;
}

/* A frame may join another one's SOF (M6), and receivers have it before its last bit (M7). The
 * stuff bits of one with a counter differ from frame to frame. */
static uint64_t rx_ticks(const release_plan *plan, const source *s, uint64_t least)
{
    const cw_frame *frame = &s->traffic->frame;
    if (s->traffic->kind != CFG_TRAFFIC_SEND || plan->config->dbitrate_bps > 0 ||
        cfg_is_protected(s->traffic) || !cw_frame_valid(frame))
        return least;
    const uint64_t ticks = cw_rate_ticks(plan->rate, cw_frame_wire_bits(frame) - JOINED_BITS);
    return ticks > least ? ticks : least;
}

/* Returns true when the frames of a source pass a test. It is asked once, as a source sends one
 * frame only. */
static bool passes(const release_plan *plan, source *s, cw_frame_test *test, const void *user,
                   uint64_t least)
{
    if (!s->tested) {
        s->passes = s->traffic->kind != CFG_TRAFFIC_SEND || test(user, s->node, &s->traffic->frame);
        s->rx_ticks = rx_ticks(plan, s, least);
    }
    s->tested = true;
    return s->passes;
}

/* Returns the place in the heap that comes after one and all below it; 0: that was all. */
static size_t place_behind(size_t i)
{
    while (i > 0 && i % 2 == 0)
        i = (i - 1) / 2;
    return i > 0 ? i + 1 : 0;
}

/* Leaves out what is below a source that comes too late. */
static uint64_t find_next_rx(const release_plan *plan, cw_frame_test *test, const void *user,
                             uint64_t least)
{
    uint64_t tick = CW_NEVER;
    size_t i = 0;
    do {
        source *s = i < plan->count ? plan->heap[i] : NULL;
        const bool early = s && s->tick < tick;
        if (early && passes(plan, s, test, user, least)) {
            const uint64_t rx = cw_after(s->tick, s->rx_ticks);
            tick = rx < tick ? rx : tick;
        }
        i = early ? 2 * i + 1 : place_behind(i);
    } while (i > 0);
    return tick;
}

uint64_t release_next_rx(release_plan *plan, cw_frame_test *test, const void *user,
                         uint64_t least)
{
    if (!plan->knows_next)
        plan->next_tick = find_next_rx(plan, test, user, least);
    plan->knows_next = true;
    return plan->next_tick;
}

/* Jitter only delays releases. */
uint64_t release_sure_tick(const release_plan *plan)
{
    uint64_t sure = 0;
    for (size_t i = 0; i < plan->count; i++) {
        const source *s = plan->heap[i];
        const cfg_traffic *t = s->traffic;
        uint64_t last = s->tick;
        if (t->kind == CFG_TRAFFIC_SEND)
            last = text_time_ticks_sum(t->offset, t->count - 1, t->every, plan->rate);
        last = last != CW_NEVER && last > s->tick ? last : s->tick;
        sure = last != CW_NEVER && last > sure ? last : sure;
    }
    return sure;
}

const cw_frame *release_first(const release_plan *plan, unsigned *node)
{
    assert(plan->count > 0);
    const source *s = plan->heap[0];
    *node = s->node;
    if (s->traffic->kind == CFG_TRAFFIC_SEND)
        return &s->traffic->frame;
    return s->has_frame ? &s->frame : NULL;
}

/* One of two entries is the second of the heap. */
uint64_t release_second_tick(const release_plan *plan)
{
    uint64_t tick = CW_NEVER;
    assert(plan->count > 0);
    for (size_t i = 1; i < 3 && i < plan->count; i++)
        if (plan->heap[i]->tick < tick)
            tick = plan->heap[i]->tick;
    return tick;
}

bool release_is_sure(const release_plan *plan)
{
    return plan->count > 0 && plan->fast + plan->full == 0 &&
           plan->heap[0]->traffic->kind == CFG_TRAFFIC_SEND;
}

bool release_is_as_written(const release_plan *plan)
{
    assert(plan->count > 0);
    const cfg_traffic *traffic = plan->heap[0]->traffic;
    return traffic->kind == CFG_TRAFFIC_SEND && !cfg_is_protected(traffic);
}

bool release_is_determined(const release_plan *plan)
{
    assert(plan->count > 0);
    return plan->heap[0]->traffic->kind == CFG_TRAFFIC_SEND;
}

/* Moves the first source to its next release, or removes it. */
static void release_go_on(release_plan *plan)
{
    source *s = plan->heap[0];
    bool goes_on;
    plan->knows_next = plan->knows_next && s->tested && !s->passes;
    if (s->traffic->kind == CFG_TRAFFIC_SEND) {
        goes_on = ++s->done < s->traffic->count;
        if (goes_on)
            s->tick = send_tick(plan, s, s->done);
    } else {
        s->waits = fetch(plan, s) && s->traffic->fast && !s->late;
        goes_on = s->replay && !s->waits;
    }
    if (goes_on)
        sift_down(plan, 0);
    else
        pop(plan);
}

cfg_place release_place(const release_plan *plan)
{
    assert(plan->count > 0);
    return plan->heap[0]->traffic->place;
}

void release_pass(release_plan *plan)
{
    assert(plan->count > 0);
    release_go_on(plan);
}

/* Returns true when the next frame is one of a file and finds its node's queue full. */
static bool finds_no_room(const source *s, const cw_bus *bus)
{
    return s->has_frame && s->traffic->kind == CFG_TRAFFIC_REPLAY && !s->traffic->fast &&
           cw_node_room(bus, s->node) == 0;
}

/* Takes the first source out of the heap until its node's queue has room. */
static void wait_for_room(release_plan *plan)
{
    source *s = plan->heap[0];
    s->planned = planned(s);
    s->waits = true;
    plan->full++;
    plan->knows_next = false;
    pop(plan);
}

/* Counts a frame that came after its time, since there was no room for it before. */
static void count_late(source *s)
{
    if (!s->behind || s->tick <= s->planned)
        return;
    const uint64_t late = s->tick - s->planned;
    s->late_frames++;
    s->late_most = late > s->late_most ? late : s->late_most;
}

cw_status release_hand_in(release_plan *plan, cw_bus *bus)
{
    unsigned node;
    const cw_frame *frame = release_first(plan, &node);
    if (frame && finds_no_room(plan->heap[0], bus)) {
        wait_for_room(plan);
        return CW_AGAIN;
    }
    cw_status status = frame ? cw_node_send(bus, node, frame, plan->heap[0]->tick) : CW_OK;
    if (status != CW_OK)
        return status;
    count_late(plan->heap[0]);
    release_go_on(plan);
    return status;
}

/* ---- Files that wait for their node ---------------------------------------------------------- */

bool release_is_fast(const release_plan *plan)
{
    return plan->fast + plan->full > 0;
}

static bool node_is_free(const cw_bus *bus, unsigned node)
{
    cw_node_stats stats;
    return cw_node_get_stats(bus, node, &stats) == CW_OK && stats.queue == 0 && stats.inbox == 0 &&
           cw_node_takes_frames(bus, node) && cw_node_room(bus, node) > 0;
}

/* Returns true when the node finishes its frame at the end of a frame on the bus. Such a node has a
 * frame to send, and tries it again until it is through. */
static bool is_busy_till_end_of_frame(const cw_bus *bus, unsigned node)
{
    cw_node_stats stats;
    cw_settings settings;
    return cw_node_get_stats(bus, node, &stats) == CW_OK && stats.queue > 0 &&
           stats.state != CW_STATE_BUS_OFF && cw_node_get_settings(bus, node, &settings) == CW_OK &&
           !(settings.modes & (CW_MODE_ONE_SHOT | CW_MODE_TIME_TRIGGERED));
}

uint64_t release_look_at(const release_plan *plan, const cw_bus *bus)
{
    uint64_t now = cw_bus_now(bus);
    uint64_t next = cw_bus_next(bus);
    uint64_t last = cw_bus_tick_after(bus, LOOK_BITS);
    for (size_t i = 0; i < plan->source_count; i++) {
        const source *s = &plan->sources[i];
        if (s->waits && !(s->has_frame && is_busy_till_end_of_frame(bus, s->node)))
            return cw_bus_tick_after(bus, 1);
    }
    next = next < last ? next : last;
    next = cw_rate_bit_begin(plan->rate, next);
    return next > now ? next : cw_bus_tick_after(bus, 1);
}

/* Goes on with a replay that waits for room. Its frame, and frames before it that are in the inbox,
 * may have a tick that has not come. */
static void look_for_room(release_plan *plan, source *s, const cw_bus *bus)
{
    if (cw_node_room(bus, s->node) == 0)
        return;
    const uint64_t next = cw_bus_now(bus) + 1; /* the events of this tick have been taken */
    s->waits = false;
    s->behind = true;
    s->tick = next > s->tick ? next : s->tick;
    plan->full--;
    push(plan, s);
}

/* Looks again at a source that waits: is there room in the queue, or, with `fast`, is the node
 * free? */
static void run_release_look(release_plan *plan, source *s, const cw_bus *bus)
{
    if (!s->traffic->fast) {
        look_for_room(plan, s, bus);
        return;
    }
    if (!s->has_frame)
        s->tick = cw_bus_now(bus);
    bool over = !s->has_frame && !fetch(plan, s);
    if (!over && !s->late && (!s->has_frame || !node_is_free(bus, s->node)))
        return;
    s->waits = false;
    if (over)
        return;
    if (!s->late)
        s->tick = cw_bus_now(bus) + 1; /* the events of this tick have been taken */
    push(plan, s);
}

void release_look(release_plan *plan, const cw_bus *bus)
{
    for (size_t i = 0; release_is_fast(plan) && i < plan->source_count; i++)
        if (plan->sources[i].waits)
            run_release_look(plan, &plan->sources[i], bus);
}

/* ---- The rest -------------------------------------------------------------------------------- */

bool release_failed(const release_plan *plan)
{
    return plan->failed;
}

/* Guesses when a source ends. For a replay, by the part of its file that has been read. */
static uint64_t guess_source_end(const release_plan *plan, const source *s, uint64_t now)
{
    const cfg_traffic *t = s->traffic;
    if (t->kind == CFG_TRAFFIC_SEND && t->count == UINT64_MAX)
        return CW_NEVER;
    if (t->kind == CFG_TRAFFIC_SEND)
        return text_time_ticks_sum(t->offset, t->count - 1, t->every, plan->rate);
    if (!s->replay)
        return 0;
    unsigned permille = replay_permille(s->replay);
    return permille ? now / permille * 1000 : CW_NEVER;
}

uint64_t release_guess_end(const release_plan *plan, uint64_t now)
{
    uint64_t end = 0;
    for (size_t i = 0; i < plan->source_count; i++) {
        uint64_t one = guess_source_end(plan, &plan->sources[i], now);
        end = one > end ? one : end;
    }
    return end;
}

/* Returns the rule that does what traffic of kind `reply` says. It is quiet, since nobody has
 * written it as a rule. */
static cw_rule reply_rule(const cfg *config, unsigned node, const cfg_traffic *t)
{
    cw_rule rule = {.name = config->nodes[node].name,
                    .trigger = CW_TRIGGER_FRAME,
                    .filter_count = t->filter_count,
                    .time_end = CW_NEVER,
                    .every = 1,
                    .count = t->count == UINT64_MAX ? 0 : (uint32_t)t->count,
                    .probability = UINT64_MAX,
                    .quiet = true,
                    .action = CW_ACTION_REPLY,
                    .bits = 1,
                    .node = (uint8_t)node,
                    .for_ticks = text_time_ticks(t->delay, config->rate),
                    .frame = t->frame};
    memcpy(rule.filters, t->filters, sizeof rule.filters);
    return rule;
}

void release_add_replies(cw_bus *bus, const cfg *config)
{
    for (unsigned i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        for (size_t t = 0; t < node->traffic_count; t++) {
            unsigned index;
            if (node->traffic[t].kind != CFG_TRAFFIC_REPLY)
                continue;
            const cw_rule rule = reply_rule(config, i, &node->traffic[t]);
            cw_status status = cw_bus_add_rule(bus, &index, &rule);
            assert(status == CW_OK);
            (void)status;
        }
    }
}
