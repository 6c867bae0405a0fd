/* SPDX-License-Identifier: MIT
 *
 * ledger.c - checks each frame that is handed in. It has exactly one event, sent or dropped, or is
 * still in a queue.
 *
 * At the end of a scenario all nodes are flushed, so that no queue has a frame. Each frame counts
 * by itself when no rule makes or changes frames; otherwise only their number counts.
 */
#include "differential.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* The number of these frames that were handed in and not reported yet. */
typedef struct entry {
    cw_frame frame;
    int64_t open;
} entry;

typedef struct account {
    uint64_t handed_in;
    uint64_t sent;    /* events */
    uint64_t dropped; /* events, those of received frames, too */
    entry *entries;
    size_t count;
    size_t room;
} account;

struct diff_ledger {
    bool each;   /* frame has an entry of its own */
    bool closed; /* events have been left out: nothing can be said any more */
    account nodes[CW_NODES_MAX];
};

/* ---- Begin and end --------------------------------------------------------------------------- */

/* Returns true when a node sends and drops only frames that were handed in at it. */
static bool leaves_frames_alone(const cw_rule *r)
{
    const cw_action_kind kind = cw_action_kind_of(r->action);
    bool makes = r->action == CW_ACTION_DUPLICATE || r->action == CW_ACTION_CHANGE ||
                 kind == CW_KIND_TRAFFIC;
    return !makes && !(kind == CW_KIND_HOST && r->side == CW_SIDE_RX);
}

static bool rules_leave_frames_alone(const diff_scenario *s)
{
    bool alone = true;
    for (unsigned i = 0; i < s->added_count; i++)
        alone = alone && leaves_frames_alone(&s->added[i].rule);
    for (unsigned p = 0; p < s->plan_count; p++) {
        alone = alone && s->plans[p].config.protection_count == 0;
        for (unsigned i = 0; i < s->plans[p].config.rule_count; i++)
            alone = alone && leaves_frames_alone(&s->plans[p].rules[i].rule);
        for (unsigned i = 0; i < s->plans[p].config.node_count; i++)
            alone = alone && s->plans[p].nodes[i].host.receive_buffers == 0 &&
                    s->plans[p].nodes[i].host.mailbox_count == 0 &&
                    s->plans[p].nodes[i].schedule.trigger_count == 0;
    }
    return alone;
}

diff_ledger *diff_ledger_new(const diff_scenario *s)
{
    diff_ledger *l = diff_allocate(NULL, sizeof *l);
    memset(l, 0, sizeof *l);
    l->each = rules_leave_frames_alone(s);
    return l;
}

void diff_ledger_free(diff_ledger *l)
{
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        free(l->nodes[i].entries);
    free(l);
}

void diff_ledger_close(diff_ledger *l)
{
    l->closed = true;
}

/* ---- Booking --------------------------------------------------------------------------------- */

/* Compares frames. Data bytes behind the length are ignored; all bytes of an invalid frame
 * count. */
static bool is_same(const cw_frame *a, const cw_frame *b)
{
    if (cw_frame_valid(a) && cw_frame_valid(b))
        return cw_frame_equal(a, b);
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, CW_CLASSICAL_DATA_MAX) == 0;
}

/* Returns the frame without what the bus changes: controllers set flags of FD frames, and a bus
 * without FD keeps the begin of one alone. */
static cw_frame without_changes(const cw_frame *frame)
{
    const unsigned set = CW_FRAME_ESI | CW_FRAME_NON_ISO | CW_FRAME_CUT;
    cw_frame f = {.id = frame->id, .flags = frame->flags, .dlc = frame->dlc};
    memcpy(f.data, frame->data, CW_CLASSICAL_DATA_MAX);
    if (!(f.flags & (CW_FRAME_FD | CW_FRAME_CUT)))
        return f;
    f.flags = (uint8_t)((f.flags & ~set) | CW_FRAME_FD);
    f.dlc = f.dlc < CW_CLASSICAL_DATA_MAX ? f.dlc : CW_CLASSICAL_DATA_MAX;
    return f;
}

static void book(account *a, cw_frame frame, int change)
{
    size_t i = 0;
    while (i < a->count && !is_same(&a->entries[i].frame, &frame))
        i++;
    if (i == a->room) {
        a->room = a->room ? 2 * a->room : 16;
        a->entries = diff_allocate(a->entries, a->room * sizeof a->entries[0]);
    }
    if (i == a->count)
        a->entries[a->count++] = (entry){.frame = frame};
    a->entries[i].open += change;
}

void diff_ledger_send(diff_ledger *l, unsigned node, const cw_frame *frame)
{
    l->nodes[node].handed_in++;
    if (l->each)
        book(&l->nodes[node], without_changes(frame), 1);
}

void diff_ledger_event(diff_ledger *l, const cw_event *e)
{
    if (e->kind != CW_EVENT_TX && e->kind != CW_EVENT_DROP)
        return;
    account *a = &l->nodes[__builtin_ctzll(e->nodes)];
    a->sent += e->kind == CW_EVENT_TX;
    a->dropped += e->kind == CW_EVENT_DROP;
    if (l->each)
        book(a, without_changes(&e->frame), -1);
}

/* Takes over the frames; those of removed nodes are lost, unless they have been flushed. */
void diff_ledger_take_over(diff_ledger *l, const uint8_t *from, unsigned node_count)
{
    account before[CW_NODES_MAX];
    memcpy(before, l->nodes, sizeof before);
    memset(l->nodes, 0, sizeof l->nodes);
    for (unsigned i = 0; i < node_count; i++) {
        if (from[i] == CW_NO_NODE)
            continue;
        l->nodes[i] = before[from[i]];
        before[from[i]].entries = NULL;
    }
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        free(before[i].entries);
}

/* ---- Checking -------------------------------------------------------------------------------- */

static bool agrees(FILE *out, unsigned node, const char *what, uint64_t told, uint64_t counted)
{
    if (told != counted && out)
        fprintf(out, "node %u, %s: %" PRIu64 " by events and calls, %" PRIu64 " counted\n", node,
                what, told, counted);
    return told == counted;
}

static uint64_t drops_told(const cw_node_stats *s)
{
    uint64_t sum = 0;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        sum += s->dropped[why] + (why == CW_DROP_QUEUE_FULL ? 0 : s->rx_dropped[why]);
    return sum;
}

static bool check_node(const account *a, unsigned node, const cw_node_stats *s, FILE *out)
{
    bool good = agrees(out, node, "handed in", a->handed_in, s->handed_in + s->inbox);
    good = agrees(out, node, "sent", a->sent, s->tx_frames) && good;
    return agrees(out, node, "dropped", a->dropped, drops_told(s)) && good;
}

bool diff_ledger_check(const diff_ledger *l, const cw_bus *bus, FILE *out)
{
    cw_node_stats stats;
    cw_bus_stats of_bus;
    bool good = true;
    cw_bus_get_stats(bus, &of_bus);
    if (l->closed || of_bus.events_lost > 0)
        return true;
    for (unsigned i = 0; cw_node_get_stats(bus, i, &stats) == CW_OK; i++)
        good = check_node(&l->nodes[i], i, &stats, out) && good;
    return good;
}

static bool nothing_is_open(const account *a, unsigned node, FILE *out)
{
    bool good = true;
    for (size_t i = 0; i < a->count; i++) {
        if (a->entries[i].open == 0)
            continue;
        good = false;
        if (out)
            fprintf(out, "node %u, frame %" PRIX32 " (DLC %u): %+" PRId64 " not told of\n", node,
                    a->entries[i].frame.id, a->entries[i].frame.dlc, a->entries[i].open);
    }
    return good;
}

bool diff_ledger_check_end(const diff_ledger *l, const cw_bus *bus, FILE *out)
{
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    bool good = diff_ledger_check(l, bus, out);
    if (cw_bus_pending(bus) != 0 && out)
        fprintf(out, "%zu frames are left after all nodes have been flushed\n",
                cw_bus_pending(bus));
    good = good && cw_bus_pending(bus) == 0;
    for (unsigned i = 0; !l->closed && stats.events_lost == 0 && i < CW_NODES_MAX; i++)
        good = nothing_is_open(&l->nodes[i], i, out) && good;
    return good;
}
