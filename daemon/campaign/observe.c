/* SPDX-License-Identifier: MIT
 *
 * observe.c - what the events of a run tell beside the counters of its end.
 */
#include "campaign/observe.h"

static void raise_to(uint16_t *most, uint16_t value)
{
    *most = value > *most ? value : *most;
}

/* Keeps the highest counters of each node. */
static void note_counters(observation *seen, const cw_event *event)
{
    for (uint64_t rest = event->nodes; rest; rest &= rest - 1) {
        const unsigned node = (unsigned)__builtin_ctzll(rest);
        raise_to(&seen->tec_max[node], event->tec);
        raise_to(&seen->rec_max[node], event->rec);
    }
}

/* Keeps when each node last left error active, and when it came back. */
static void note_state(observation *seen, const cw_event *event)
{
    const bool active = event->state == CW_STATE_ERROR_ACTIVE;
    const uint64_t changed = active ? event->nodes & seen->unwell : event->nodes & ~seen->unwell;
    for (uint64_t rest = changed; rest; rest &= rest - 1)
        (active ? seen->back_tick : seen->left_tick)[__builtin_ctzll(rest)] = event->tick;
    seen->unwell ^= changed;
}

/* Off the grid a node samples by its own clock. So its error may come up to a bit time of the bus
 * before the hit that makes it. */
static void note_fault(observation *seen, const cw_event *event, uint64_t early)
{
    seen->has_fault = true;
    seen->fault_tick = event->tick;
    if (seen->has_error && event->tick - seen->before_tick < early) {
        seen->has_later = true;
        seen->later_tick = event->tick;
    }
}

void observe_event(observation *seen, const cw_event *event, const cw_bus *bus, cw_rate rate)
{
    if (event->kind == CW_EVENT_FAULT && !seen->has_fault)
        note_fault(seen, event, cw_bus_is_on_grid(bus) ? 0 : cw_rate_ticks(rate, 1));
    if (event->kind == CW_EVENT_ERROR && seen->has_fault && !seen->has_later) {
        seen->has_later = true;
        seen->later_tick = event->tick;
    }
    if (event->kind == CW_EVENT_ERROR && !seen->has_fault)
        seen->before_tick = event->tick;
    if (event->kind == CW_EVENT_ERROR && !seen->has_error) {
        seen->has_error = true;
        seen->error_tick = event->tick;
        seen->error_nodes = event->nodes;
        seen->error = event->error;
    }
    if (event->kind == CW_EVENT_ERROR || event->kind == CW_EVENT_STATE)
        note_counters(seen, event);
    if (event->kind == CW_EVENT_STATE)
        note_state(seen, event);
}

void observe_end(observation *seen, const cw_bus *bus, unsigned node_count)
{
    for (unsigned i = 0; i < node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(bus, i, &stats) != CW_OK)
            continue;
        raise_to(&seen->tec_max[i], stats.tec);
        raise_to(&seen->rec_max[i], stats.rec);
    }
}
