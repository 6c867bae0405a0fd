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

#include "mac/confinement.h"

/* ---- Moments --------------------------------------------------------------------------------- */

/* Lowers the receivers' REC at the ACK slot (R8). */
static void lower_counters(cw_bus *bus)
{
    uint64_t nodes = bus->outlook.counting & ~cw_node_bit(bus->frame_step.node);
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac *m = &bus->nodes[i].mac;
        cw_confinement_rx_success(&m->confinement);
        m->told_state = m->confinement.state;
        cw_tell_state(bus, i);
    }
    if (nodes)
        bus->outlook.valid = false;
}

/* Copies a frame as a receiver decodes it: bytes that are not on the wire are 0. */
static void copy_received(cw_frame *to, const cw_frame *from, unsigned length)
{
    *to = *from;
    for (unsigned i = length; i < CW_FRAME_DATA_MAX; i++)
        to->data[i] = 0;
}

static inline void receive_at_once(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    const bus_node *n = &bus->nodes[step->node];
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    cw_event *e = cw_receive_together(bus, step->node, step->listeners & ~cw_node_bit(step->node),
                                      slot->bytes);
    copy_received(&e->frame, &slot->frame, slot->bytes);
}

static void receive(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    const bus_node *n = &bus->nodes[step->node];
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    cw_frame frame;
    if (!cw_host_side_acts(bus)) {
        receive_at_once(bus);
        return;
    }
    copy_received(&frame, &slot->frame, slot->bytes);
    for (uint64_t rest = step->listeners & ~cw_node_bit(step->node); rest; rest &= rest - 1)
        cw_receive(bus, cw_lowest_node(rest), &frame);
}

static void finish_transmission(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    cw_mac *m = &bus->nodes[step->node].mac;
    m->offered = false;
    cw_confinement_tx_success(&m->confinement);
    m->told_state = m->confinement.state;
    cw_commit_sent(bus, step->node, step->length);
    cw_tell_state(bus, step->node);
}

/* Carries out the moment at the end of the bit that has just passed. */
static void run_moment(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->undecided && step->next_loss + 1u == step->at)
        cw_losses_tell(bus);
    if (step->at == step->length - CW_AFTER_ACK_BITS)
        lower_counters(bus);
    else if (step->at == step->length - CW_AFTER_ACCEPT_BITS)
        receive(bus);
    else if (step->at == step->length)
        finish_transmission(bus);
}

static unsigned next_moment(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned loss = step->undecided ? step->next_loss + 1u : CW_NO_LOOK;
    unsigned next = step->length + CW_INTERMISSION_BITS;
    if (step->at < step->length)
        next = step->length;
    if (step->at < step->length - CW_AFTER_ACCEPT_BITS)
        next = step->length - CW_AFTER_ACCEPT_BITS;
    if (step->at < step->length - CW_AFTER_ACK_BITS && bus->outlook.counting)
        next = step->length - CW_AFTER_ACK_BITS;
    return loss < next ? loss : next;
}

/* ---- Bits to go ------------------------------------------------------------------------------ */

static void count_bits(cw_bus *bus, unsigned bits)
{
    cw_count_clean_bits(bus);
    bus->stats.bits += bits;
    bus->stats.busy_bits += bits;
    cw_load_add(&bus->load, bits, true);
}

static void move(cw_bus *bus, unsigned bits)
{
    bus->frame_step.at = (uint16_t)(bus->frame_step.at + bits);
    cw_wire_pass(&bus->time, bits);
}

static void pass(cw_bus *bus, unsigned bits)
{
    move(bus, bits);
    count_bits(bus, bits);
    if (bus->rules.awake_count && !bus->frame_step.at_work)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
}

/* Returns the bit at which the step ends at the latest. */
static unsigned end_of(const cw_frame_step *step)
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
    unsigned bits = next_moment(bus) - step->at;
    bits = (unsigned)cw_least(bits, end_of(step) - (uint64_t)step->at);
    if (step->look.bit != CW_NO_LOOK)
        bits = (unsigned)cw_least(bits, (uint64_t)step->look.bit - step->at);
    bits = bits_up_to(bus, tick, bits);
    uint64_t due = cw_least(bus->next_restart, bus->rules.next_due);
    due = cw_least(due, cw_inbox_first(bus));
    if (!cw_wire_fits(&bus->time, bits, due)) /* due is later than now */
        bits = (unsigned)cw_wire_bits_until(&bus->time, due);
    if (bus->rules.awake_count == 0)
        return bits;
    return (unsigned)cw_rules_keep_quiet(&bus->rules, bits, true);
}

static void end_slot(cw_bus *bus)
{
    bus->frame_step.active = false;
    bus->recessive_bits = CW_AFTER_ACK_BITS + CW_INTERMISSION_BITS;
    if (bus->rules.awake_count)
        cw_rules_unbind(&bus->rules);
}

/* ---- Rules at work --------------------------------------------------------------------------- */

/* Returns the nodes that drive a dominant bit. Contenders with hidden losses are left out, which
 * makes no difference to the wire (see hides_losses()). */
static uint64_t find_drivers(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t drivers = cw_node_bit(step->node);
    if (step->at == step->length - CW_AFTER_ACK_BITS - 1)
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
    const uint64_t drivers = find_drivers(bus);
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
        move(bus, 1);
    }
    count_bits(bus, passed);
    if (stands)
        return true;
    cw_wake_controllers(bus);
    cw_step_with(bus, &levels);
    return false;
}

/* ---- The rest at once ------------------------------------------------------------------------ */

/* Goes from a bit to a later one, which it returns. Frames that come before the end of that time go
 * to their queues. */
static inline unsigned pass_to(cw_bus *bus, unsigned from, unsigned to)
{
    cw_wire_pass(&bus->time, to - from);
    cw_take_inbox_before(bus, cw_now(bus));
    return to;
}

/* Carries out the moments after arbitration, from a bit on. */
static inline void go_to_end(cw_bus *bus, unsigned at)
{
    const unsigned length = bus->frame_step.length;
    if (bus->outlook.counting && at < length - CW_AFTER_ACK_BITS) {
        at = pass_to(bus, at, length - CW_AFTER_ACK_BITS);
        lower_counters(bus);
    }
    if (at < length - CW_AFTER_ACCEPT_BITS) {
        at = pass_to(bus, at, length - CW_AFTER_ACCEPT_BITS);
        receive_at_once(bus);
    }
    if (at < length) {
        at = pass_to(bus, at, length);
        finish_transmission(bus);
    }
    (void)pass_to(bus, at, length + CW_INTERMISSION_BITS);
    end_slot(bus);
}

/* Goes to the end of the frame. Nothing but frames for the queues comes in before. */
static void go_straight_to_end(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    const unsigned bits = step->length + CW_INTERMISSION_BITS - step->at;
    count_bits(bus, bits);
    step->hidden = 0; /* all losses happen from here on */
    if (bus->rules.awake_count)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
    while (step->undecided) {
        step->at = (uint16_t)pass_to(bus, step->at, step->next_loss + 1u);
        cw_losses_tell(bus);
    }
    go_to_end(bus, step->at);
}

/* Returns true when nothing happens up to the end of the bit at which the step stops. */
static bool goes_straight_to_look(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    return step->look.bit < next_moment(bus) &&
           cw_inbox_first(bus) >= cw_frame_step_tick(bus, step->look.bit + 1u);
}

/* Asks rules in advance, as far as that cannot be seen before it is time. A rule with a rough stop
 * is asked last, when nothing else keeps the frame from its end. Returns false when a rule is left
 * to be asked, or has a hit. */
static bool rules_let_pass(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->look.bit != CW_NO_LOOK && !step->look.exact) {
        if (cw_rules_count_off(&bus->rules, step->node) || cw_frame_step_consume_look(bus))
            step->look.bit = CW_NO_LOOK;
        return step->look.bit == CW_NO_LOOK;
    }
    while (step->look.bit != CW_NO_LOOK && goes_straight_to_look(bus) &&
           cw_frame_step_consume_look(bus))
        step->look = cw_frame_step_next_look(bus, step->look.bit + 1u);
    return step->look.bit == CW_NO_LOOK;
}

/* Returns true when nothing but frames for the queues comes in before that tick. Frames for nodes
 * in loopback are sent at once (M15). */
static bool is_undisturbed_until(const cw_bus *bus, uint64_t tick)
{
    bool loopback = (bus->frame_step.listeners | bus->outlook.away) != bus->all;
    return bus->next_restart >= tick && bus->rules.next_due >= tick &&
           (!loopback || cw_inbox_first(bus) >= tick);
}

static bool can_go_to_end(cw_bus *bus, uint64_t tick)
{
    const cw_frame_step *step = &bus->frame_step;
    const unsigned end = step->length + CW_INTERMISSION_BITS;
    const unsigned bits = end - step->at;
    bool traffic = bus->rules.awake_count && bus->rules.traffic_rules; /* traffic rules send after a
                                                                          frame */
    return cw_wire_fits(&bus->time, bits, tick) && step->tail == 0 && !step->at_work && !traffic &&
           !cw_host_side_acts(bus) &&
           is_undisturbed_until(bus, cw_frame_step_tick(bus, end)) &&
           cw_frame_step_is_noise_free(bus, bits) && rules_let_pass(bus);
}

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

bool cw_frame_step_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick)
{
    cw_frame_step *step = &bus->frame_step;
    bus_node *n = &bus->nodes[winner];
    const uint16_t slot = cw_queue_first(&n->queue);
    step->listeners = bus->outlook.listeners;
    step->length = n->queue.slots[slot].wire_bits;
    const unsigned bits = step->length + CW_INTERMISSION_BITS;
    if (!cw_wire_fits(&bus->time, bits, tick) || bus->rules.awake_count ||
        cw_host_side_acts(bus) || !is_undisturbed_until(bus, cw_wire_tick(&bus->time, bits)) ||
        (step->watched && !cw_rules_count_off(&bus->rules, winner) &&
         !rule_lets_whole_pass(bus, winner, &n->queue.slots[slot].frame)))
        return false;
    n->offered_slot = slot;
    n->mac.offered = false; /* not encoded */
    step->node = (uint8_t)winner;
    step->contenders = contenders;
    cw_losses_hide(bus);
    bus->clean_bits += bits;
    go_to_end(bus, 0);
    return true;
}

/* ---- Going on, one moment after the other -------------------------------------------------- */

/* Finds the exact bit of a stop that was known only roughly. */
static void find_bits(cw_bus *bus)
{
    bus_node *n = &bus->nodes[bus->frame_step.node];
    if (!n->mac.offered)
        cw_offer_slot(n, n->offered_slot);
    bus->frame_step.bits = &n->mac.tx;
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
    if (!cw_frame_step_is_noise_free(bus, 1) || !cw_frame_step_consume_look(bus))
        cw_wake_controllers(bus);
    else
        bus->frame_step.look = cw_frame_step_next_look(bus, bus->frame_step.at + 1u);
}

/* Returns true when a frame has come that ends the step. A node in loopback sends it at once (M15).
 * An idle node may join a frame that has only just begun (M6). */
static bool is_broken(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t starters = ~(step->listeners | bus->outlook.away);
    if (step->at == 1)
        starters |= bus->outlook.senders & ~step->contenders;
    return bus->waiting & starters;
}

static void go_on(cw_bus *bus, uint64_t tick)
{
    cw_frame_step *step = &bus->frame_step;
    if (is_broken(bus) || step->at == end_of(step)) {
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
    cw_take_inbox_before(bus, cw_bit_end(bus));
    pass(bus, 1);
    run_moment(bus);
    if (step->at == step->length + CW_INTERMISSION_BITS)
        end_slot(bus);
}

/* A new step has begun when the caller can change something. */
bool cw_frame_step_go(cw_bus *bus, uint64_t tick)
{
    if (!bus->frame_step.active && !cw_frame_step_begin(bus, tick) && !cw_frame_step_resume(bus))
        return false;
    if (bus->frame_step.active) /* otherwise the frame has passed at once */
        go_on(bus, tick);
    return true;
}

/* ---- Reading --------------------------------------------------------------------------------- */

uint64_t cw_frame_step_recessive_bits(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned n = step->at;
    if (n > step->length - CW_AFTER_ACK_BITS)
        return n - (step->length - CW_AFTER_ACK_BITS);
    if (n == step->length - CW_AFTER_ACK_BITS)
        return 0;
    cw_bits room;
    const cw_bits *bits = cw_frame_step_bits(bus, &room);
    while (n > 0 && cw_bits_level(bits, n - 1))
        n--;
    return step->at - n;
}

/* Returns the horizon without hits of rules. */
static uint64_t clean_horizon(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    if (is_broken(bus))
        return 1; /* the step ends then */
    if (step->at < step->length - CW_AFTER_ACCEPT_BITS)
        return step->length - CW_AFTER_ACCEPT_BITS - step->at;
    if (step->at < step->length)
        return step->length - step->at;
    return bus->waiting ? CW_FRAME_BITS_MIN - 1 : CW_QUIET_FOREVER;
}

uint64_t cw_frame_step_horizon(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t bits = clean_horizon(bus);
    return step->look.bit == CW_NO_LOOK ? bits
                                        : cw_least(bits, step->look.bit + 1u - step->at);
}
