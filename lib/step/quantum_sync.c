/* SPDX-License-Identifier: MIT
 *
 * quantum_sync.c - counts how the clocks of nodes keep up with the bus (T3 to T5), and marks what
 * they do, for traces.
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
    t->marking = bus->watching && t->mark_room > 0 && !t->uniform;
    t->mark_count = 0;
}

void cw_mark_put(cw_bus *bus, cw_mark_kind kind, unsigned i, cw_span moment, bool level,
                 int phase_error)
{
    cw_timed *t = &bus->timed;
    const cw_span since = moment - cw_moment_of(bus, cw_now(bus));
    if (t->mark_count == t->mark_room)
        return;
    t->marks[t->mark_count++] = (cw_mark){.at = since > 0 ? since : 0, .kind = kind,
                                          .quantum = t->nodes[i].timing.quantum,
                                          .phase_error = (int16_t)phase_error,
                                          .node = (uint8_t)i, .level = level};
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
