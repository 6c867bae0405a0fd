/* SPDX-License-Identifier: MIT
 *
 * quantum_sync.c - counts how the clocks of nodes keep up with the bus (T3 to T5).
 */
#include "step/quantum.h"

#include "mac/mac.h"

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
}

void cw_sync_count(cw_bus *bus, unsigned i, bool hard, int phase_error)
{
    const cw_span quantum = bus->timed.nodes[i].timing.quantum;
    const int error = hard ? 0 : phase_error;
    const cw_sync_stats one = {.hard_syncs = hard, .resyncs = error != 0, .phase_error_tq = error,
                               .phase_error = error * quantum, .margin = CW_NO_MARGIN};
    cw_sync_stats_add(&record_of(bus, i)->stats, &one);
}

static void count_margin(cw_sync_stats *stats, cw_span margin)
{
    if (margin < stats->margin)
        stats->margin = margin;
}

void cw_sync_count_sample(cw_bus *bus, unsigned i, bool level, cw_span moment)
{
    cw_sync_record *r = record_of(bus, i);
    if (!r->measures || level == bus->timed.nodes[i].pcs.last_sample)
        return;
    const cw_span change = cw_timed_change(bus, i, level, r->sampled_at, moment);
    if (change == CW_SPAN_MAX)
        return;
    count_margin(&r->stats, change - r->sampled_at);
    count_margin(&r->stats, moment - change);
}

void cw_sync_sampled(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_sync_record *r = record_of(bus, i);
    r->sampled_at = moment;
    r->measures = !cw_mac_synchronises_hard(&bus->nodes[i].mac);
}
