/* SPDX-License-Identifier: MIT
 *
 * compare.c - all that can be read of two buses, side by side.
 */
#include "differential.h"

#include <inttypes.h>
#include <string.h>

/* The state of one comparison. */
typedef struct comparison {
    FILE *out; /* NULL: nothing is written */
    const char *of;
    unsigned number;
    bool same;
} comparison;

static void same(comparison *c, const char *what, uint64_t fast, uint64_t reference)
{
    if (fast == reference)
        return;
    c->same = false;
    if (c->out)
        fprintf(c->out, "%s %u, %s: fast %" PRIu64 ", reference %" PRIu64 "\n", c->of, c->number,
                what, fast, reference);
}

#define SAME(field) same(c, #field, (uint64_t)a->field, (uint64_t)b->field)

/* ---- Events ---------------------------------------------------------------------------------- */

/* Compares all fields; those without a meaning for the kind of event are zero. */
bool diff_same_event(const cw_event *a, const cw_event *b)
{
    comparison of_event = {.same = true};
    comparison *c = &of_event;
    SAME(tick);
    SAME(nodes);
    SAME(kind);
    SAME(tec);
    SAME(rec);
    SAME(error.type);
    SAME(error.role);
    SAME(error.place.field);
    SAME(error.place.index);
    SAME(error.place.stuff);
    SAME(error.place.extended);
    SAME(error.flag);
    SAME(error.sent);
    SAME(state);
    SAME(state_before);
    SAME(why);
    SAME(lost_bit);
    SAME(fast);
    SAME(ticks);
    SAME(from);
    SAME(handed_in);
    SAME(rule);
    SAME(hit);
    SAME(frame.id);
    SAME(frame.flags);
    SAME(frame.dlc);
    unsigned length = cw_frame_length(&a->frame);
    return c->same && memcmp(a->frame.data, b->frame.data, length) == 0;
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Compares all counters of a table. */
static void compare_counters(comparison *c, const cw_stat *counters, const void *a, const void *b)
{
    for (const cw_stat *s = counters; s->name; s++)
        for (unsigned i = 0; i < s->count; i++)
            same(c, s->name, cw_stat_value(s, a, i), cw_stat_value(s, b, i));
}

static void compare_bus_stats(comparison *c, const cw_bus *fast, const cw_bus *reference)
{
    cw_bus_stats fast_stats;
    cw_bus_stats reference_stats;
    cw_bus_get_stats(fast, &fast_stats);
    cw_bus_get_stats(reference, &reference_stats);
    const cw_bus_stats *a = &fast_stats;
    const cw_bus_stats *b = &reference_stats;
    compare_counters(c, cw_bus_counters, a, b);
    SAME(load_permille);
}

static void compare_delays(comparison *c, const cw_delay *a, const cw_delay *b)
{
    SAME(count);
    SAME(sum_ticks);
    SAME(min_ticks);
    SAME(max_ticks);
    for (unsigned i = 0; i < CW_DELAY_BUCKETS; i++)
        SAME(bucket[i]);
}

static void compare_node_stats(comparison *c, const cw_node_stats *a, const cw_node_stats *b)
{
    compare_counters(c, cw_node_counters, a, b);
    SAME(tec);
    SAME(rec);
    SAME(state);
    compare_delays(c, &a->delay, &b->delay);
}

static void compare_syncs(comparison *c, const cw_sync_stats *a, const cw_sync_stats *b)
{
    SAME(hard_syncs);
    SAME(resyncs);
    SAME(phase_error_tq);
    same(c, "phase error", (uint64_t)a->phase_error, (uint64_t)b->phase_error);
    same(c, "margin", (uint64_t)a->margin, (uint64_t)b->margin);
}

static void compare_data(comparison *c, const cw_data_stats *a, const cw_data_stats *b)
{
    SAME(tdcv);
    for (unsigned i = 0; i < CW_ERROR_COUNT; i++)
        SAME(errors[i]);
}

static void compare_times(comparison *c, const cw_node_time *a, const cw_node_time *b)
{
    SAME(local);
    SAME(captured);
    SAME(captures);
    SAME(references);
    SAME(cycle_time);
    SAME(has_global);
    SAME(global);
    SAME(cycle);
    SAME(in_cycle);
    SAME(triggers);
}

static void compare_slots(comparison *c, const cw_trigger_stats *a, const cw_trigger_stats *b)
{
    SAME(slots);
    SAME(started);
    SAME(sent);
    SAME(missed);
    SAME(failed);
    SAME(lost);
    SAME(late_least);
    SAME(late_most);
}

/* Compares local times and slots of a node. */
static void compare_schedules(comparison *c, const cw_bus *fast, const cw_bus *reference)
{
    cw_node_time times[2];
    cw_trigger_stats slots[2];
    const cw_status status = cw_node_get_time(fast, c->number, &times[0]);
    same(c, "status", status, cw_node_get_time(reference, c->number, &times[1]));
    if (status != CW_OK)
        return;
    compare_times(c, &times[0], &times[1]);
    for (unsigned k = 0; cw_node_get_trigger_stats(fast, c->number, k, &slots[0]) == CW_OK; k++) {
        (void)cw_node_get_trigger_stats(reference, c->number, k, &slots[1]);
        compare_slots(c, &slots[0], &slots[1]);
    }
}

static void compare_settings(comparison *c, const cw_settings *a, const cw_settings *b)
{
    SAME(which);
    SAME(modes_mask);
    SAME(modes);
    SAME(order);
    SAME(queue);
    SAME(warning_limit);
    SAME(restart_ticks);
    SAME(sleeps);
    SAME(sleep.filter_ticks);
    SAME(sleep.wake_ticks);
    SAME(sleep.frame_count);
}

/* Returns false when there is no such node. */
static bool compare_node(comparison *c, const cw_bus *fast, const cw_bus *reference)
{
    cw_node_stats stats[2];
    cw_sync_stats syncs[2];
    cw_data_stats data[2];
    cw_host_stats hosts[2];
    cw_sleep_stats sleeps[2];
    cw_settings settings[2];
    cw_status status = cw_node_get_stats(fast, c->number, &stats[0]);
    same(c, "status", status, cw_node_get_stats(reference, c->number, &stats[1]));
    if (status != CW_OK)
        return false;
    compare_node_stats(c, &stats[0], &stats[1]);
    status = cw_node_get_data_stats(fast, c->number, &data[0]);
    same(c, "status", status, cw_node_get_data_stats(reference, c->number, &data[1]));
    if (status == CW_OK)
        compare_data(c, &data[0], &data[1]);
    status = cw_node_get_host_stats(fast, c->number, &hosts[0]);
    same(c, "status", status, cw_node_get_host_stats(reference, c->number, &hosts[1]));
    if (status == CW_OK)
        compare_counters(c, cw_host_counters, &hosts[0], &hosts[1]);
    (void)cw_node_get_sleep_stats(fast, c->number, &sleeps[0]);
    (void)cw_node_get_sleep_stats(reference, c->number, &sleeps[1]);
    compare_counters(c, cw_sleep_counters, &sleeps[0], &sleeps[1]);
    status = cw_node_get_sync_stats(fast, c->number, &syncs[0]);
    same(c, "status", status, cw_node_get_sync_stats(reference, c->number, &syncs[1]));
    if (status == CW_OK)
        compare_syncs(c, &syncs[0], &syncs[1]);
    compare_schedules(c, fast, reference);
    same(c, "balance", cw_node_stats_balance(&stats[0]), true);
    same(c, "attached", cw_node_attached(fast, c->number), cw_node_attached(reference, c->number));
    status = cw_node_get_settings(fast, c->number, &settings[0]);
    same(c, "status", status, cw_node_get_settings(reference, c->number, &settings[1]));
    compare_settings(c, &settings[0], &settings[1]);
    return true;
}

static void compare_bit_node(comparison *c, const cw_bit_node *a, const cw_bit_node *b)
{
    SAME(place.field);
    SAME(place.index);
    SAME(place.stuff);
    SAME(place.extended);
    SAME(phase);
    SAME(role);
    SAME(wire);
    SAME(state);
    SAME(tec);
    SAME(rec);
}

/* Compares bits. The reference has simulated each bit by itself; the fast bus need not have. */
static void compare_bits(comparison *c, const cw_bus *fast, const cw_bus *reference)
{
    cw_bit_view fast_view;
    cw_bit_view reference_view;
    cw_status status = cw_bus_get_bit(reference, &reference_view);
    if (cw_bus_get_bit(fast, &fast_view) != CW_OK)
        return;
    const cw_bit_view *a = &fast_view;
    const cw_bit_view *b = &reference_view;
    same(c, "bit is known", true, status == CW_OK);
    if (status != CW_OK)
        return;
    SAME(start);
    SAME(end);
    SAME(driven);
    SAME(wire);
    SAME(sampled);
    SAME(tx_faults);
    SAME(wire_faults);
    SAME(rx_faults);
    SAME(fast);
    SAME(node_count);
    SAME(wire_count);
    c->of = "bit of node";
    for (c->number = 0; c->number < b->node_count; c->number++)
        compare_bit_node(c, &a->nodes[c->number], &b->nodes[c->number]);
}

static void compare_rule(comparison *c, const cw_bus *fast, const cw_bus *reference)
{
    cw_rule_stats fast_stats = {.hits = 0};
    cw_rule_stats reference_stats = {.hits = 0};
    cw_status status = cw_rule_get_stats(fast, c->number, &fast_stats);
    same(c, "status", status, cw_rule_get_stats(reference, c->number, &reference_stats));
    const cw_rule_stats *a = &fast_stats;
    const cw_rule_stats *b = &reference_stats;
    SAME(matches);
    SAME(misses);
    SAME(hits);
    SAME(active);
    SAME(over);
}

bool diff_same_buses(const cw_bus *fast, const cw_bus *reference, unsigned rules, FILE *out)
{
    comparison of_buses = {.out = out, .of = "bus", .same = true};
    comparison *c = &of_buses;
    same(c, "now", cw_bus_now(fast), cw_bus_now(reference));
    same(c, "pending", cw_bus_pending(fast), cw_bus_pending(reference));
    same(c, "idle", cw_bus_idle(fast), cw_bus_idle(reference));
    same(c, "recessive bits", cw_bus_recessive_bits(fast), cw_bus_recessive_bits(reference));
    same(c, "first of the inbox", cw_bus_inbox_first(fast), cw_bus_inbox_first(reference));
    compare_bus_stats(c, fast, reference);
    c->of = "node";
    while (compare_node(c, fast, reference))
        c->number++;
    c->of = "rule";
    for (c->number = 0; c->number < rules; c->number++)
        compare_rule(c, fast, reference);
    return c->same;
}

bool diff_same_bits(const cw_bus *fast, const cw_bus *reference, FILE *out)
{
    comparison of_bits = {.out = out, .of = "bit", .same = true};
    compare_bits(&of_bits, fast, reference);
    return of_bits.same;
}
