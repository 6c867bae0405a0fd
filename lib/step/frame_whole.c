/* SPDX-License-Identifier: MIT
 *
 * frame_whole.c - takes a clean frame at once, without its bits, when only its end can be seen.
 */
#include "step/frame.h"

/* It is apart, so that a frame without rules needs no room for a view. */
static __attribute__((noinline)) bool rule_lets_whole_pass(cw_bus *bus, unsigned winner,
                                                           const cw_frame *frame)
{
    const cw_look look = {.rule = bus->rules.watcher[winner]};
    const cw_frame_view view = {.frame = frame, .length = bus->frame_step.length};
    bool passes = cw_rules_stop_roughly(&bus->rules, winner) &&
                  cw_rules_consume(&bus->rules, 0, &look, &view);
    bus->frame_step.hit = !passes;
    return passes;
}

/* It is apart for the same reason. */
static __attribute__((noinline)) void count_and_save_time(cw_bus *bus, unsigned bits)
{
    cw_frame_step_count_whole_fast(bus, bits);
    cw_frame_step_save_time(bus);
}

__attribute__((flatten)) bool cw_frame_step_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick)
{
    cw_frame_step *step = &bus->frame_step;
    cw_bus_node *n = &bus->nodes[winner];
    const uint16_t slot = cw_queue_first(&n->queue);
    const cw_queue_slot *first = cw_queue_at(&n->queue, slot);
    step->listeners = bus->outlook.listeners;
    step->length = first->wire_bits;
    const unsigned bits = step->length + CW_INTERMISSION_BITS;
    step->at = 0;
    const uint64_t end = cw_frame_step_tick(bus, bits);
    if (end > tick || bus->node_due < end || bus->rules.next_due < end ||
        (step->watched && !cw_rules_count_off(&bus->rules, winner) &&
         !rule_lets_whole_pass(bus, winner, first->frame)))
        return false;
    n->offered_slot = slot;
    n->mac.offered = false; /* not encoded */
    step->node = (uint8_t)winner;
    step->contenders = contenders;
    cw_losses_hide(bus);
    if (step->fast.to)
        count_and_save_time(bus, bits);
    else
        bus->clean_bits += bits;
    cw_frame_step_go_to_end(bus, 0);
    return true;
}
