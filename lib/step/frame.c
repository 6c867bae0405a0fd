/* SPDX-License-Identifier: MIT
 *
 * frame.c - clean frames without their single bits.
 *
 * While all nodes are idle and a node wants to send, the course of the frame follows from its
 * encoding. That gives the losers of arbitration and their lost bits, the moments of
 * acknowledgement and acceptance, and the end. So the bus goes from one of these moments to the
 * next. Controllers stay idle meanwhile. When a fault rule wants to look at a bit, or a call
 * changes a node, frame_end.c moves the controllers to their present points. Single bits go on from
 * there.
 *
 * When only the end of a frame can be seen, its length is enough: the frame passes at once, without
 * its bits (cw_frame_step_whole()).
 *
 * Rules that act on levels in every bit act on the levels of the encoded frame. As long as no node
 * sees a difference, the step goes on, bit by bit but without controllers.
 *
 * `at` is the number of bits, from SOF to the third bit of the intermission, that have passed.
 */
#include "step/frame.h"

/* ---- Bits to go ------------------------------------------------------------------------------ */

/* Goes on by bits, and counts nothing. */
static void frame_move(cw_bus *bus, unsigned bits)
{
    bus->frame_step.at = (uint16_t)(bus->frame_step.at + bits);
    cw_wire_pass(&bus->time, bits);
}

/* Goes on by bits and counts them; noise uses up its draws. */
static void pass(cw_bus *bus, unsigned bits)
{
    if (bus->frame_step.fast.to) {
        cw_frame_step_pass_fast(bus, bits);
        return;
    }
    frame_move(bus, bits);
    cw_frame_step_count_bits(bus, bits);
    if (bus->rules.awake_count && !bus->frame_step.at_work)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
}

/* Returns the bit at which the step ends at the latest. */
static unsigned frame_end_of(const cw_frame_step *step)
{
    return step->length + CW_INTERMISSION_BITS - step->tail;
}

/* Returns the whole bits up to a tick, at most `bits`. */
static unsigned bits_up_to(const cw_bus *bus, uint64_t tick, unsigned bits)
{
    const cw_wire_time *time = &bus->time;
    return cw_wire_fits(time, bits, tick) ? bits : (unsigned)cw_wire_bits_to(time, tick);
}

/* Returns the bits to go at once, 0 when noise flips the next one. The last of them is the first
 * bit in which something happens or comes in, or after which something is due. */
static unsigned bits_to_go(cw_bus *bus, uint64_t tick)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned bits = cw_frame_step_next_moment(bus) - step->at;
    bits = (unsigned)cw_least(bits, frame_end_of(step) - (uint64_t)step->at);
    if (step->fast.to)
        return cw_frame_step_fast_bits(bus, tick, bits);
    if (step->look.bit != CW_NO_LOOK)
        bits = (unsigned)cw_least(bits, (uint64_t)step->look.bit - step->at);
    bits = bits_up_to(bus, tick, bits);
    const uint64_t due = cw_first_due(bus);
    if (!cw_wire_fits(&bus->time, bits, due)) /* due is later than now */
        bits = (unsigned)cw_wire_bits_until(&bus->time, due);
    if (bus->rules.awake_count == 0)
        return bits;
    return (unsigned)cw_rules_keep_quiet(&bus->rules, bits, true);
}

/* ---- Rules at work --------------------------------------------------------------------------- */

/* Contenders with hidden losses are left out, which makes no difference to the wire (see
 * hides_losses()). */
uint64_t cw_frame_step_drivers(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t drivers = cw_node_bit(step->node);
    if (step->at == cw_frame_step_acknowledged(step) - 1)
        return bus->outlook.acknowledgers & ~drivers;
    if (step->at >= step->length || cw_bits_level(step->bits, step->at))
        return 0;
    for (uint64_t rest = step->undecided; rest; rest &= rest - 1)
        if (step->lost_at[cw_lowest_node(rest)] != step->at)
            drivers |= rest & (~rest + 1);
    return drivers;
}

/* Lets rules act on the next bit. Returns true when the bit is still as expected. */
static bool stands_rules(cw_bus *bus, cw_levels *levels)
{
    const uint64_t drivers = cw_frame_step_drivers(bus);
    const uint64_t expected = drivers ? 0 : UINT64_MAX;
    levels->driven = ~drivers;
    cw_find_levels(bus, levels);
    return levels->wire == expected &&
           ((levels->sampled ^ expected) & bus->frame_step.listeners) == 0;
}

/* Passes all but the last of some bits, each with the actions of rules. When rules change a bit,
 * even the last one, the controllers take it as it is and the step ends. It then returns false. */
static bool pass_under_rules(cw_bus *bus, unsigned bits)
{
    cw_levels levels;
    unsigned passed = 0;
    bool stands;
    while ((stands = stands_rules(bus, &levels)) && passed + 1 < bits) {
        passed++;
        frame_move(bus, 1);
    }
    cw_frame_step_count_bits(bus, passed);
    if (stands)
        return true;
    cw_wake_controllers(bus);
    cw_step_with(bus, &levels);
    return false;
}

/* ---- The rest at once ------------------------------------------------------------------------ */

/* Goes to the end of the frame. Nothing but frames for the queues comes in before. */
static void go_straight_to_end(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    const unsigned bits = step->length + CW_INTERMISSION_BITS - step->at;
    if (step->fast.to)
        cw_frame_step_count_fast(bus, bits);
    else
        cw_frame_step_count_bits(bus, bits);
    step->hidden = 0; /* all losses happen from here on */
    if (bus->rules.awake_count)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
    while (step->undecided) {
        step->at = (uint16_t)cw_frame_step_pass_to(bus, step->at, step->next_loss + 1u);
        cw_losses_report(bus);
    }
    if (step->fast.to)
        cw_frame_step_save_time(bus);
    cw_frame_step_go_to_end(bus, step->at);
}

/* Returns true when nothing happens up to the end of the bit at which the step stops. */
static bool goes_straight_to_look(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    return step->look.bit < cw_frame_step_next_moment(bus) &&
           cw_inbox_first(bus) >= cw_frame_step_tick(bus, step->look.bit + 1u);
}

/* Asks rules in advance, as far as that cannot be seen before it is time. A rule with a rough stop
 * is asked last, when nothing else keeps the frame from its end. Returns false when a rule is left
 * to be asked, or has a hit. */
static bool rules_let_pass(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->sure)
        return false;
    if (step->look.bit != CW_NO_LOOK && !step->look.exact) {
        if (cw_frame_step_consume_look(bus))
            step->look.bit = CW_NO_LOOK;
        return step->look.bit == CW_NO_LOOK;
    }
    while (step->look.bit != CW_NO_LOOK && goes_straight_to_look(bus) &&
           cw_frame_step_consume_look(bus))
        step->look = cw_frame_step_next_look(bus, step->look.bit + 1u);
    return step->look.bit == CW_NO_LOOK;
}

/* Returns true when nothing can be seen of the rest of the frame but its end. */
static bool can_go_to_end(cw_bus *bus, uint64_t tick)
{
    const cw_frame_step *step = &bus->frame_step;
    const unsigned end = step->length + CW_INTERMISSION_BITS;
    const unsigned bits = end - step->at;
    bool traffic = bus->rules.awake_count && bus->rules.traffic_rules; /* traffic rules send after a
                                                                          frame */
    return cw_frame_step_tick(bus, end) <= tick && step->tail == 0 && step->won_at == 0 &&
           !step->at_work && !traffic &&
           !cw_host_side_acts(bus) &&
           cw_frame_step_is_undisturbed_until(bus, cw_frame_step_tick(bus, end)) &&
           cw_frame_step_is_noise_free(bus, bits) && rules_let_pass(bus);
}

/* ---- Going on, one moment after the other -------------------------------------------------- */

/* Finds the exact bit of a stop that was known only roughly. */
static void find_bits(cw_bus *bus)
{
    cw_bus_node *n = &bus->nodes[bus->frame_step.node];
    if (!n->mac.offered)
        cw_offer_slot(n, n->offered_slot);
    cw_frame_step_know(&bus->frame_step, cw_mac_tx(&n->mac));
    bus->frame_step.look = cw_frame_step_next_look(bus, 0);
}

/* Stops before a bit at which a rule may look. When the rule has no hit, the step goes on;
 * otherwise single bits go on from here. */
static void look_at_stop(cw_bus *bus)
{
    if (!bus->frame_step.bits) {
        find_bits(bus);
        return;
    }
    /* noise first: a rule that lets the bit pass has counted it, so the bit must pass then */
    if (!cw_frame_step_is_noise_free(bus, 1) || bus->frame_step.sure ||
        !cw_frame_step_consume_look(bus))
        cw_wake_controllers(bus);
    else
        bus->frame_step.look = cw_frame_step_next_look(bus, bus->frame_step.at + 1u);
}

/* Returns true when the stop before the next bit can be looked at before the step returns. The
 * caller would find nothing to do, and go on with this bit. */
static bool stops_at_once(const cw_bus *bus, uint64_t tick)
{
    return bus->frame_step.at != frame_end_of(&bus->frame_step) &&
           !cw_frame_step_is_broken(bus) && bus->rules.awake_count == 0 && !bus->pending &&
           cw_first_due(bus) > cw_now(bus) && cw_next_bit_fits(bus, tick) && cw_ring_has_room(bus);
}

/* Goes on to the next moment of the frame, up to a tick. Ends the step where single bits are
 * needed. */
static void frame_go_on(cw_bus *bus, uint64_t tick)
{
    cw_frame_step *step = &bus->frame_step;
    const bool observed = step->fast.to && bus->rules.awake_count;
    if (cw_frame_step_is_broken(bus) || step->at == frame_end_of(step) || observed) {
        cw_wake_controllers(bus);
        return;
    }
    if (step->at == step->look.bit) {
        look_at_stop(bus);
        return;
    }
    if (can_go_to_end(bus, tick)) {
        go_straight_to_end(bus);
        return;
    }
    unsigned bits = bits_to_go(bus, tick);
    if (bits == 0) {
        cw_wake_controllers(bus);
        return;
    }
    if (!step->at_work)
        pass(bus, bits - 1);
    else if (!pass_under_rules(bus, bits))
        return;
    cw_take_inbox_before(bus, cw_frame_step_tick(bus, step->at + 1u));
    pass(bus, 1);
    cw_frame_step_run_moment(bus);
    if (step->at == step->length + CW_INTERMISSION_BITS)
        cw_frame_step_end_slot(bus);
    else if (step->at == step->look.bit && stops_at_once(bus, tick))
        look_at_stop(bus);
}

/* A new step has begun when the caller can change something. */
bool cw_frame_step_go(cw_bus *bus, uint64_t tick)
{
    if (!bus->frame_step.active && !cw_frame_step_begin(bus, tick))
        return false;
    if (bus->frame_step.active) /* otherwise the frame has passed at once */
        frame_go_on(bus, tick);
    return true;
}
