/* SPDX-License-Identifier: MIT
 *
 * quantum_sync.c - counts and reports how the clocks of nodes keep up with the bus (T3 to T5).
 */
#include "step/quantum.h"

#include "mac/mac.h"

#include <assert.h>

static cw_sync_record *record_of(cw_bus *bus, unsigned i)
{
    return &bus->timed.records[i];
}

void cw_sync_begin_bit_time(cw_bus *bus)
{
    cw_timed *t = &bus->timed;
    const bool counts = t->records && !t->uniform;
    for (unsigned i = 0; counts && !t->counts && i < bus->node_count; i++)
        t->records[i].measures = false;
    t->counts = counts;
    t->reports_syncs = cw_wants_event(bus, CW_EVENT_SYNC) && !t->uniform;
    t->marking = bus->watching && t->mark_room > 0;
    t->mark_count = 0;
    if (!t->marking)
        return;
    t->faults = (cw_bit_faults){.tx = 0};
    t->together = t->uniform && cw_timed_begins_together(bus);
}

/* ---- Synchronisations ------------------------------------------------------------------------ */

/* Counts one synchronisation of a node. */
static void count_sync(cw_bus *bus, unsigned i, const cw_sync *sync)
{
    const cw_span quantum = bus->timed.nodes[i].timing.quantum;
    const cw_sync_stats one = {.hard_syncs = sync->hard, .resyncs = sync->phase_error != 0,
                               .phase_error_tq = sync->phase_error,
                               .phase_error = sync->phase_error * quantum,
                               .margin = CW_NO_MARGIN};
    cw_sync_stats_add(&record_of(bus, i)->stats, &one);
}

/* Keeps a synchronisation that moves the clock for the end of the bit. */
static void report_sync(cw_bus *bus, unsigned i, const cw_sync *sync)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    assert(n->sync_count < CW_SYNCS_OF_BIT);
    if (sync->hard || sync->phase_error)
        n->syncs[n->sync_count++] = *sync;
}

void cw_sync_note(cw_bus *bus, unsigned i, bool hard, int phase_error, cw_span moment)
{
    const cw_sync sync = {.hard = hard, .phase_error = (int16_t)(hard ? 0 : phase_error)};
    if (bus->timed.counts)
        count_sync(bus, i, &sync);
    if (bus->timed.reports_syncs)
        report_sync(bus, i, &sync);
    if (bus->timed.marking)
        cw_mark_put(bus, hard ? CW_MARK_HARD_SYNC : CW_MARK_RESYNC, i, moment, CW_DOMINANT,
                    sync.phase_error);
}

void cw_sync_commit(cw_bus *bus, unsigned i)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    for (unsigned k = 0; k < n->sync_count; k++) {
        cw_event *e = cw_push_node_event(bus, CW_EVENT_SYNC, i);
        e->hard = n->syncs[k].hard;
        e->phase_error_tq = n->syncs[k].phase_error;
        e->phase_error = n->syncs[k].phase_error * n->timing.quantum;
    }
    n->sync_count = 0;
}

/* Keeps the least margin. */
static void count_margin(cw_sync_stats *stats, cw_span margin)
{
    if (margin < stats->margin)
        stats->margin = margin;
}

/* Counts the margins of the change of level between the last sample and this one. */
__attribute__((noinline)) static void count_margins(cw_bus *bus, unsigned i, bool level,
                                                    cw_span moment)
{
    cw_sync_record *r = record_of(bus, i);
    const cw_span change = cw_timed_change(bus, i, level, r->sampled_at, moment);
    if (change == CW_SPAN_MAX)
        return;
    count_margin(&r->stats, change - r->sampled_at);
    count_margin(&r->stats, moment - change);
}

void cw_sync_count_sample(cw_bus *bus, unsigned i, bool level, cw_span moment)
{
    cw_sync_record *r = record_of(bus, i);
    if (r->measures && level != bus->timed.nodes[i].pcs.last_sample)
        count_margins(bus, i, level, moment);
    r->sampled_at = moment;
    r->measures = !cw_mac_synchronises_hard(&bus->nodes[i].mac);
}
