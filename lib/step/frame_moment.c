/* SPDX-License-Identifier: MIT
 *
 * frame_moment.c - what happens in a frame step, and at which bits: lost arbitrations, the
 * acknowledgement, the acceptance, the end.
 */
#include "step/frame.h"

#include "mac/confinement.h"

void cw_frame_step_lower_counters(cw_bus *bus)
{
    uint64_t nodes = bus->outlook.counting & ~cw_node_bit(bus->frame_step.node);
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac *m = &bus->nodes[i].mac;
        cw_confinement_rx_success(&m->confinement);
        if (m->reported_state != m->confinement.state) {
            m->reported_state = m->confinement.state;
            cw_report_state(bus, i);
        }
        if (m->confinement.rec == 0)
            bus->outlook.counting &= ~cw_node_bit(i);
    }
}

/* Lets all listeners receive in one event, as no rule may treat them differently. */
static inline void receive_at_once(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    const cw_bus_node *n = &bus->nodes[step->node];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    cw_event *e = cw_receive_together(bus, step->node, step->listeners & ~cw_node_bit(step->node),
                                      slot->bytes);
    cw_queue_copy_received(&e->frame, slot);
}

/* The frame becomes valid for receivers, at the end of the last but one bit of EOF (M7). */
static void frame_moment_receive(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    const cw_bus_node *n = &bus->nodes[step->node];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    cw_frame frame;
    if (!cw_host_side_acts(bus)) {
        receive_at_once(bus);
        return;
    }
    cw_queue_copy_received(&frame, slot);
    for (uint64_t rest = step->listeners & ~cw_node_bit(step->node); rest; rest &= rest - 1)
        cw_receive(bus, cw_lowest_node(rest), &frame);
}

/* The frame becomes valid for its transmitter, at the end of EOF (M7). */
static void finish_transmission(cw_bus *bus)
{
    const unsigned i = bus->frame_step.node;
    cw_mac *m = &bus->nodes[i].mac;
    m->offered = false;
    cw_confinement_tx_success(&m->confinement);
    m->reported_state = m->confinement.state;
    cw_commit_sent(bus, i, bus->frame_step.length);
    cw_report_state(bus, i);
}

/* Carries out the moment at the end of the bit that has just passed. */
void cw_frame_step_run_moment(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->undecided && step->next_loss + 1u == step->at)
        cw_losses_report(bus);
    if (step->won_at == step->at) {
        step->won_at = 0;
        cw_order_check(bus, step->node);
    }
    if (step->at == cw_frame_step_acknowledged(step))
        cw_frame_step_lower_counters(bus);
    else if (step->at == step->length - CW_AFTER_ACCEPT_BITS)
        frame_moment_receive(bus);
    else if (step->at == step->length)
        finish_transmission(bus);
}

unsigned cw_frame_step_next_moment(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned loss = step->undecided ? step->next_loss + 1u : CW_NO_LOOK;
    unsigned next = step->length + CW_INTERMISSION_BITS;
    if (step->at < step->length)
        next = step->length;
    if (step->at < step->length - CW_AFTER_ACCEPT_BITS)
        next = step->length - CW_AFTER_ACCEPT_BITS;
    if (step->at < cw_frame_step_acknowledged(step) && bus->outlook.counting)
        next = cw_frame_step_acknowledged(step);
    if (step->won_at && step->won_at < next)
        next = step->won_at;
    return loss < next ? loss : next;
}

void cw_frame_step_end_slot(cw_bus *bus)
{
    bus->frame_step.active = false;
    bus->recessive_bits = bus->frame_step.after_ack + CW_INTERMISSION_BITS;
    if (bus->rules.awake_count)
        cw_rules_unbind(&bus->rules);
}

void cw_frame_step_go_to_end(cw_bus *bus, unsigned at)
{
    const unsigned length = bus->frame_step.length;
    if (bus->outlook.counting && at < cw_frame_step_acknowledged(&bus->frame_step)) {
        at = cw_frame_step_pass_to(bus, at, cw_frame_step_acknowledged(&bus->frame_step));
        cw_frame_step_lower_counters(bus);
    }
    if (at < length - CW_AFTER_ACCEPT_BITS) {
        at = cw_frame_step_pass_to(bus, at, length - CW_AFTER_ACCEPT_BITS);
        receive_at_once(bus);
    }
    if (at < length) {
        at = cw_frame_step_pass_to(bus, at, length);
        finish_transmission(bus);
    }
    (void)cw_frame_step_pass_to(bus, at, length + CW_INTERMISSION_BITS);
    cw_frame_step_end_slot(bus);
}
