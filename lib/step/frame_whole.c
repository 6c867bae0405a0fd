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
                  !cw_rules_hit_surely(&bus->rules, winner) &&
                  cw_rules_consume(&bus->rules, 0, &look, &view);
    bus->frame_step.hit = !passes;
    return passes;
}

/* Counts the arbitration of a frame that ends in this very step, and its only or last attempt. */
static inline void count_attempt(cw_bus *bus, cw_bus_node *n, uint64_t contenders)
{
    cw_set_contenders(bus, contenders);
    cw_share_lost(bus, bus->frame_step.node);
    n->stats.retransmissions += cw_queue_at(&n->queue, n->offered_slot)->tried;
    n->lost_before = ++bus->shares.lost;
    bus->stats.arbitration_lost += bus->shares.contender_count - 1;
}

/* It is apart, so that other frames need no room for it. */
static __attribute__((noinline)) void count_and_save_time(cw_bus *bus, unsigned bits)
{
    cw_frame_step_count_whole_fast(bus, bits);
    cw_frame_step_save_time(bus);
}

/* Counts the bits of a frame. From then on they are as long as others. */
static inline void count_whole(cw_bus *bus)
{
    const unsigned bits = bus->frame_step.length + CW_INTERMISSION_BITS;
    if (bus->frame_step.fast.to)
        count_and_save_time(bus, bits);
    else
        bus->clean_bits += bits;
}

/* Goes to the end of the frame. Frames that come in before it has been sent find it in its queue.
 * Their events, if they are dropped, are in the order of time in any case. */
static inline void go_through(cw_bus *bus, uint64_t end)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned at = 0;
    if (bus->outlook.counting) {
        at = cw_frame_step_pass_to(bus, at, cw_frame_step_acknowledged(step));
        cw_frame_step_lower_counters(bus);
    }
    cw_rx_tx pair = {.sender = step->node,
                     .receivers = step->listeners & ~cw_node_bit(step->node),
                     .accepted = cw_wire_tick(&bus->time, step->length - CW_AFTER_ACCEPT_BITS - at),
                     .ended = cw_wire_tick(&bus->time, step->length - at)};
    cw_take_inbox_before(bus, pair.ended);
    if (!cw_push_rx_tx(bus, &pair)) {
        cw_frame_step_go_to_end(bus, at);
        return;
    }
    cw_wire_go_to(&bus->time, pair.ended);
    cw_commit_rx_tx(bus, &pair);
    cw_wire_go_to(&bus->time, end);
    cw_take_inbox_before(bus, end);
    bus->recessive_bits = step->after_ack + CW_INTERMISSION_BITS;
}

__attribute__((flatten)) bool cw_frame_step_whole(cw_bus *bus, unsigned winner, uint64_t contenders,
                                                  uint64_t tick)
{
    cw_frame_step *step = &bus->frame_step;
    cw_bus_node *n = &bus->nodes[winner];
    const uint16_t slot = cw_queue_first(&n->queue);
    const cw_queue_slot *first = cw_queue_at(&n->queue, slot);
    step->length = first->wire_bits;
    step->at = 0;
    const uint64_t end = cw_frame_step_tick(bus, step->length + CW_INTERMISSION_BITS);
    if (end > tick || bus->node_due < end || bus->rules.next_due < end ||
        (step->watched && !cw_rules_count_off(&bus->rules, winner) &&
         !rule_lets_whole_pass(bus, winner, first->frame)))
        return false;
    n->offered_slot = slot;
    n->mac.offered = false; /* not encoded */
    step->node = (uint8_t)winner;
    step->listeners = bus->outlook.listeners;
    count_attempt(bus, n, contenders);
    count_whole(bus);
    go_through(bus, end);
    return true;
}
