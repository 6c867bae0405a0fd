/* SPDX-License-Identifier: MIT
 *
 * local_time.c - local times and slots of time-triggered nodes, for statistics and status.
 */
#include "record/local_time.h"

#include "base/text/jsonput.h"
#include "trace/frametext.h"

/* A capture and the time of a master are null until the node has seen them. */
static json_t *time_json(const cfg *config, const cw_node_time *t, unsigned node)
{
    json_t *object = json_object();
    put_count(object, "now", t->local);
    put_count(object, "bits", config->nodes[node].local.bits);
    put(object, "unit_ps", json_integer(text_span_ps(config->nodes[node].local.unit)));
    put_text(object, "capture", config->nodes[node].local.at_eof ? "eof" : "sof");
    put_count(object, "captures", t->captures);
    put(object, "captured", t->captures ? json_integer((json_int_t)t->captured) : json_null());
    put(object, "global", t->has_global ? json_integer((json_int_t)t->global) : json_null());
    put_text(object, "master",
             t->has_global && t->master < config->node_count ? config->nodes[t->master].name
                                                             : NULL);
    return object;
}

/* Returns a trigger and its counters. Until a frame has begun, its lateness is null. */
static json_t *trigger_json(const cfg_schedule *s, const cw_bus *bus, unsigned node, unsigned k)
{
    const cw_time_trigger *trigger = &s->triggers[k];
    cw_trigger_stats stats = {.slots = 0};
    char frame[FRAME_TEXT_MAX];
    json_t *object = json_object();
    (void)cw_node_get_trigger_stats(bus, node, k, &stats);
    text_print_frame(frame, &trigger->frame);
    put_count(object, "at", trigger->at);
    put_count(object, "slot", trigger->slot);
    put_text(object, "frame", frame);
    put_text(object, "window", s->arbitrating[k] ? "arbitrating" : "exclusive");
    put_count(object, "slots", stats.slots);
    put_count(object, "sent", stats.sent);
    put_count(object, "missed", stats.missed);
    put_count(object, "failed", stats.failed);
    put_count(object, "arbitration_lost", stats.lost);
    put(object, "late_min_ns",
        stats.started ? json_integer((json_int_t)text_ticks_ns(stats.late_least)) : json_null());
    put(object, "late_max_ns",
        stats.started ? json_integer((json_int_t)text_ticks_ns(stats.late_most)) : json_null());
    return object;
}

/* Returns where in the matrix the node is, and all triggers in the order of their times. */
static json_t *schedule_json(const cfg *config, const cw_bus *bus, const cw_node_time *t,
                             unsigned node)
{
    const cfg_schedule *s = &config->nodes[node].schedule;
    json_t *object = json_object(), *triggers = json_array();
    put_bool(object, "in_cycle", t->in_cycle);
    put_count(object, "cycle", t->cycle);
    put_count(object, "cycles", s->cycles);
    put(object, "cycle_time",
        t->in_cycle ? json_integer((json_int_t)t->cycle_time) : json_null());
    put_count(object, "references", t->references);
    for (unsigned k = 0; k < s->trigger_count; k++)
        put_last(triggers, trigger_json(s, bus, node, k));
    put(object, "triggers", triggers);
    return object;
}

void local_time_put(json_t *object, const cfg *config, const cw_bus *bus, unsigned node)
{
    cw_node_time time;
    if (cw_node_get_time(bus, node, &time) != CW_OK)
        return;
    put(object, "local-time", time_json(config, &time, node));
    put(object, "local_time", time_json(config, &time, node)); /* deprecated, not in 0.3 */
    if (config->nodes[node].schedule.cycles)
        put(object, "schedule", schedule_json(config, bus, &time, node));
}

cw_trigger_stats local_time_slots(const cw_bus *bus, unsigned node)
{
    cw_trigger_stats sum = {.slots = 0}, one;
    for (unsigned k = 0; cw_node_get_trigger_stats(bus, node, k, &one) == CW_OK; k++) {
        sum.slots += one.slots;
        sum.started += one.started;
        sum.sent += one.sent;
        sum.missed += one.missed;
        sum.failed += one.failed;
        sum.lost += one.lost;
        sum.late_most = one.late_most > sum.late_most ? one.late_most : sum.late_most;
    }
    return sum;
}
