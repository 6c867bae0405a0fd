/* SPDX-License-Identifier: MIT
 *
 * frame.c - clean frames without their single bits.
 *
 * While all nodes are idle and somebody wants to send, what the frame will do follows from its
 * encoding: who loses arbitration and where, when receivers acknowledge and take it, when it ends.
 * So the bus goes from one of these moments to the next. Controllers stay idle meanwhile; when a
 * fault rule wants to look at a bit, or somebody does something to a node, they are put where they
 * would be by then (frame_end.c), and single bits go on from there.
 *
 * When nobody can see more of a frame than its end, its length is all that is needed: it is leapt
 * over in one go, without its bits (cw_leap_whole()).
 *
 * Rules that act on levels in every bit do so on those that the frame says. As long as nobody sees
 * a difference, the leap goes on, bit by bit but without controllers.
 *
 * `at` is the number of bits, from SOF to the third bit of the intermission, that have passed.
 */
#include "step/frame.h"

#include "mac/confinement.h"

/* ---- Moments --------------------------------------------------------------------------------- */

/* R8, at the ACK slot. */
static void lower_counters(cw_bus *bus)
{
    uint64_t nodes = bus->outlook.counting & ~cw_node_bit(bus->leap.node);
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

/* As a receiver decodes it: bytes that are not on the wire are 0. */
static void copy_received(cw_frame *to, const cw_frame *from, unsigned length)
{
    *to = *from;
    for (unsigned i = length; i < CW_FRAME_DATA_MAX; i++)
        to->data[i] = 0;
}

static inline void receive_at_once(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    const bus_node *n = &bus->nodes[leap->node];
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    cw_event *e = cw_receive_together(bus, leap->node, leap->listeners & ~cw_node_bit(leap->node),
                                      slot->bytes);
    copy_received(&e->frame, &slot->frame, slot->bytes);
}

static void receive(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    const bus_node *n = &bus->nodes[leap->node];
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    cw_frame frame;
    if (!cw_host_side_acts(bus)) {
        receive_at_once(bus);
        return;
    }
    copy_received(&frame, &slot->frame, slot->bytes);
    for (uint64_t rest = leap->listeners & ~cw_node_bit(leap->node); rest; rest &= rest - 1)
        cw_receive(bus, cw_lowest_node(rest), &frame);
}

static void finish_transmission(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    cw_mac *m = &bus->nodes[leap->node].mac;
    m->offered = false;
    cw_confinement_tx_success(&m->confinement);
    m->told_state = m->confinement.state;
    cw_commit_sent(bus, leap->node, leap->length);
    cw_tell_state(bus, leap->node);
}

/* What happens at the end of the bit that has just passed. */
static void run_moment(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    if (leap->undecided && leap->next_loss + 1u == leap->at)
        cw_losses_tell(bus);
    if (leap->at == leap->length - CW_AFTER_ACK_BITS)
        lower_counters(bus);
    else if (leap->at == leap->length - CW_AFTER_ACCEPT_BITS)
        receive(bus);
    else if (leap->at == leap->length)
        finish_transmission(bus);
}

static unsigned next_moment(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    unsigned loss = leap->undecided ? leap->next_loss + 1u : CW_NO_LOOK;
    unsigned next = leap->length + CW_INTERMISSION_BITS;
    if (leap->at < leap->length)
        next = leap->length;
    if (leap->at < leap->length - CW_AFTER_ACCEPT_BITS)
        next = leap->length - CW_AFTER_ACCEPT_BITS;
    if (leap->at < leap->length - CW_AFTER_ACK_BITS && bus->outlook.counting)
        next = leap->length - CW_AFTER_ACK_BITS;
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
    bus->leap.at = (uint16_t)(bus->leap.at + bits);
    cw_wire_pass(&bus->time, bits);
}

static void pass(cw_bus *bus, unsigned bits)
{
    move(bus, bits);
    count_bits(bus, bits);
    if (bus->rules.awake_count && !bus->leap.at_work)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
}

/* Where it ends at the latest. */
static unsigned end_of(const cw_leap *leap)
{
    return leap->length + CW_INTERMISSION_BITS - leap->tail;
}

/* Whole bits up to a tick, no more than that many. */
static unsigned bits_up_to(const cw_bus *bus, uint64_t tick, unsigned bits)
{
    const cw_wire_time *time = &bus->time;
    return cw_wire_fits(time, bits, tick) ? bits : (unsigned)cw_wire_bits_to(time, tick);
}

/* Bits to go at once, 0 when noise flips the next one: up to the end of the one in which something
 * happens or comes in, or after which something is due. */
static unsigned bits_to_go(cw_bus *bus, uint64_t tick)
{
    const cw_leap *leap = &bus->leap;
    unsigned bits = next_moment(bus) - leap->at;
    bits = (unsigned)cw_least(bits, end_of(leap) - (uint64_t)leap->at);
    if (leap->look.bit != CW_NO_LOOK)
        bits = (unsigned)cw_least(bits, (uint64_t)leap->look.bit - leap->at);
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
    bus->leap.active = false;
    bus->recessive_bits = CW_AFTER_ACK_BITS + CW_INTERMISSION_BITS;
    if (bus->rules.awake_count)
        cw_rules_unbind(&bus->rules);
}

/* ---- Rules at work --------------------------------------------------------------------------- */

/* The nodes that drive a dominant bit; of contenders whose losses are not seen the winner alone,
 * which makes no difference to the wire (see hides_losses()). */
static uint64_t find_drivers(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    uint64_t drivers = cw_node_bit(leap->node);
    if (leap->at == leap->length - CW_AFTER_ACK_BITS - 1)
        return bus->outlook.acknowledgers & ~drivers;
    if (leap->at >= leap->length || cw_bits_level(leap->bits, leap->at))
        return 0;
    for (uint64_t rest = leap->undecided; rest; rest &= rest - 1)
        if (leap->lost_at[cw_lowest_node(rest)] != leap->at)
            drivers |= rest & (~rest + 1);
    return drivers;
}

/* Rules act on the bit that comes next. Returns whether it is still what it was to be. */
static bool stands_rules(cw_bus *bus, cw_levels *levels)
{
    const uint64_t drivers = find_drivers(bus);
    const uint64_t expected = drivers ? 0 : UINT64_MAX;
    levels->driven = ~drivers;
    cw_find_levels(bus, levels);
    return levels->wire == expected && ((levels->sampled ^ expected) & bus->leap.listeners) == 0;
}

/* Passes all but the last of some bits, each with what rules do to it. When they change a bit, be
 * it the last one, the controllers take it as it is, the leap is over, and it returns false. */
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

/* Goes from a bit to one that lies ahead, which it returns. Frames that come before its end go to
 * their queues. */
static inline unsigned pass_to(cw_bus *bus, unsigned from, unsigned to)
{
    cw_wire_pass(&bus->time, to - from);
    cw_take_inbox_before(bus, cw_now(bus));
    return to;
}

/* The moments behind arbitration, from a bit on. */
static inline void go_to_end(cw_bus *bus, unsigned at)
{
    const unsigned length = bus->leap.length;
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

/* To the end, where nothing comes in between but frames for the queues. */
static void leap_over(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    const unsigned bits = leap->length + CW_INTERMISSION_BITS - leap->at;
    count_bits(bus, bits);
    leap->hidden = 0; /* from here on all losses come to pass */
    if (bus->rules.awake_count)
        (void)cw_rules_consume(&bus->rules, bits, NULL, NULL);
    while (leap->undecided) {
        leap->at = (uint16_t)pass_to(bus, leap->at, leap->next_loss + 1u);
        cw_losses_tell(bus);
    }
    go_to_end(bus, leap->at);
}

/* Whether nothing happens up to the end of the bit at which the leap stops. */
static bool goes_straight_to_look(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    return leap->look.bit < next_moment(bus) &&
           cw_inbox_first(bus) >= cw_leap_tick(bus, leap->look.bit + 1u);
}

/* Rules are asked in advance, as far as nobody can see that before it is time; one with a rough
 * stop only when that is all. False when something is left to be asked, or is a hit. */
static bool rules_let_pass(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    if (leap->look.bit != CW_NO_LOOK && !leap->look.exact) {
        if (cw_leap_consume_look(bus))
            leap->look.bit = CW_NO_LOOK;
        return leap->look.bit == CW_NO_LOOK;
    }
    while (leap->look.bit != CW_NO_LOOK && goes_straight_to_look(bus) &&
           cw_leap_consume_look(bus))
        leap->look = cw_leap_next_look(bus, leap->look.bit + 1u);
    return leap->look.bit == CW_NO_LOOK;
}

/* Whether nothing but frames for the queues comes in before that tick. Those for nodes in loopback
 * are sent at once (M15). */
static bool is_undisturbed_until(const cw_bus *bus, uint64_t tick)
{
    bool loopback = (bus->leap.listeners | bus->outlook.away) != bus->all;
    return bus->next_restart >= tick && bus->rules.next_due >= tick &&
           (!loopback || cw_inbox_first(bus) >= tick);
}

static bool can_leap_over(cw_bus *bus, uint64_t tick)
{
    const cw_leap *leap = &bus->leap;
    const unsigned end = leap->length + CW_INTERMISSION_BITS;
    const unsigned bits = end - leap->at;
    bool traffic = bus->rules.awake_count && bus->rules.traffic_rules; /* follows a frame */
    return cw_wire_fits(&bus->time, bits, tick) && leap->tail == 0 && !leap->at_work && !traffic &&
           !cw_host_side_acts(bus) &&
           is_undisturbed_until(bus, cw_leap_tick(bus, end)) && cw_leap_is_noise_free(bus, bits) &&
           rules_let_pass(bus);
}

static bool rule_lets_whole_pass(cw_bus *bus, unsigned winner, const cw_frame *frame)
{
    const cw_look look = {.rule = bus->rules.watcher[winner]};
    const cw_frame_view view = {.frame = frame, .length = bus->leap.length};
    return cw_rules_stop_roughly(&bus->rules, winner) &&
           cw_rules_consume(&bus->rules, 0, &look, &view);
}

bool cw_leap_whole(cw_bus *bus, unsigned winner, uint64_t contenders, uint64_t tick)
{
    cw_leap *leap = &bus->leap;
    bus_node *n = &bus->nodes[winner];
    const uint16_t slot = cw_queue_first(&n->queue);
    leap->listeners = bus->outlook.listeners;
    leap->length = n->queue.slots[slot].wire_bits;
    const unsigned bits = leap->length + CW_INTERMISSION_BITS;
    if (!cw_wire_fits(&bus->time, bits, tick) || bus->rules.awake_count ||
        cw_host_side_acts(bus) || !is_undisturbed_until(bus, cw_wire_tick(&bus->time, bits)) ||
        (leap->watched && !rule_lets_whole_pass(bus, winner, &n->queue.slots[slot].frame)))
        return false;
    n->offered_slot = slot;
    n->mac.offered = false; /* not encoded */
    leap->node = (uint8_t)winner;
    leap->contenders = contenders;
    cw_losses_hide(bus);
    bus->clean_bits += bits;
    go_to_end(bus, 0);
    return true;
}

/* ---- Going on, one moment after the other -------------------------------------------------- */

/* Where the leap stops roughly it is time to find out where it stops. */
static void find_bits(cw_bus *bus)
{
    bus_node *n = &bus->nodes[bus->leap.node];
    if (!n->mac.offered)
        cw_offer_slot(n, n->offered_slot);
    bus->leap.bits = &n->mac.tx;
    bus->leap.look = cw_leap_next_look(bus, 0);
}

/* Perhaps a rule looks at the next bit. It may let it pass; else single bits go on from here. */
static void look_at_stop(cw_bus *bus)
{
    if (!bus->leap.bits) {
        find_bits(bus);
        return;
    }
    /* noise first: what lets the bit pass has counted it, so it has to be passed then */
    if (!cw_leap_is_noise_free(bus, 1) || !cw_leap_consume_look(bus))
        cw_wake_controllers(bus);
    else
        bus->leap.look = cw_leap_next_look(bus, bus->leap.at + 1u);
}

/* A node in loopback sends it at once (M15), one that is idle may join a frame that has only just
 * begun (M6). */
void cw_leap_frame_comes(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick)
{
    cw_leap *leap = &bus->leap;
    const bus_node *n = &bus->nodes[i];
    bool loopback = n->mac.modes & CW_MODE_LOOPBACK;
    bool may_join = leap->at == 1 && tick <= cw_now(bus);
    leap->broken = leap->broken || loopback || may_join;
    if ((leap->hidden >> i & 1u) && cw_queue_goes_first(&n->queue, frame))
        cw_losses_show(bus, cw_node_bit(i)); /* while the frame that it has begun with goes first */
}

static void go_on(cw_bus *bus, uint64_t tick)
{
    cw_leap *leap = &bus->leap;
    if (leap->broken || leap->at == end_of(leap)) {
        cw_wake_controllers(bus);
        return;
    }
    if (leap->at == leap->look.bit) {
        look_at_stop(bus);
        return;
    }
    if (can_leap_over(bus, tick)) {
        leap_over(bus);
        return;
    }
    unsigned bits = bits_to_go(bus, tick);
    if (bits == 0) {
        cw_wake_controllers(bus);
        return;
    }
    if (!leap->at_work)
        pass(bus, bits - 1);
    else if (!pass_under_rules(bus, bits))
        return;
    cw_take_inbox_before(bus, cw_bit_end(bus));
    pass(bus, 1);
    run_moment(bus);
    if (leap->at == leap->length + CW_INTERMISSION_BITS)
        end_slot(bus);
}

/* A step that begins has begun when the caller can do something. */
bool cw_leap_go(cw_bus *bus, uint64_t tick)
{
    if (!bus->leap.active && !cw_leap_begin(bus, tick) && !cw_leap_resume(bus))
        return false;
    if (bus->leap.active) /* else it went to its end at once */
        go_on(bus, tick);
    return true;
}

/* ---- Reading --------------------------------------------------------------------------------- */

uint64_t cw_leap_recessive_bits(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    unsigned n = leap->at;
    if (n > leap->length - CW_AFTER_ACK_BITS)
        return n - (leap->length - CW_AFTER_ACK_BITS);
    if (n == leap->length - CW_AFTER_ACK_BITS)
        return 0;
    cw_bits room;
    const cw_bits *bits = cw_leap_bits(bus, &room);
    while (n > 0 && cw_bits_level(bits, n - 1))
        n--;
    return leap->at - n;
}

/* As if no rule had a hit. */
static uint64_t clean_horizon(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    if (leap->broken)
        return 1; /* what comes then is another frame's */
    if (leap->at < leap->length - CW_AFTER_ACCEPT_BITS)
        return leap->length - CW_AFTER_ACCEPT_BITS - leap->at;
    if (leap->at < leap->length)
        return leap->length - leap->at;
    return bus->waiting ? CW_FRAME_BITS_MIN - 1 : CW_QUIET_FOREVER;
}

uint64_t cw_leap_horizon(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    uint64_t bits = clean_horizon(bus);
    return leap->look.bit == CW_NO_LOOK ? bits
                                        : cw_least(bits, leap->look.bit + 1u - leap->at);
}
