/* SPDX-License-Identifier: MIT
 *
 * leap.c - clean frames without their single bits.
 *
 * While all nodes are idle, no fault rule is at work and somebody wants to send, all that the frame
 * will do follows from its encoding: who loses arbitration and where, when receivers acknowledge and
 * take it, when it ends. So the bus goes from one of these moments to the next. The controllers stay
 * idle meanwhile; when a fault rule wants to look at a bit, or somebody does something to a node,
 * they are put where they would be by then, and single bits go on from there.
 *
 * `at` is the number of bits, from SOF to the third bit of the intermission, that have passed.
 */
#include "bus_private.h"

#include "bits.h"
#include "codec.h"
#include "confinement.h"

#include <assert.h>

#define NO_BIT CW_NO_STOP

/* Bits before the end of EOF after which things happen. */
#define ACK_BEFORE_END 8u /* the ACK slot has been sampled */
#define RX_BEFORE_END 1u  /* M7 */

/* Every arbitration is over after so many wire bits: the field with its SOF, IDE and stuff bits. */
#define ARBITRATION_BITS_BASE 17u
#define ARBITRATION_BITS_EXTENDED 41u

/* ---- Who is there ---------------------------------------------------------------------------- */

/* A node that is neither idle nor away for longer than a frame: no leap. */
static bool is_calm(const cw_mac *m)
{
    bool away = m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF;
    return (away || m->phase == CW_MAC_IDLE) && m->told_state == m->confinement.state &&
           m->overloads_wanted == 0;
}

static void count_node(cw_crowd *crowd, const cw_mac *m, uint64_t self)
{
    if (m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF)
        crowd->away |= self;
    if (m->phase != CW_MAC_IDLE || (m->modes & CW_MODE_LOOPBACK))
        return;
    crowd->riders |= self;
    if (m->modes & CW_MODE_LISTEN_ONLY)
        return;
    crowd->starters |= self;
    if (m->modes & CW_MODE_ONE_SHOT)
        crowd->one_shot |= self;
    if (m->no_ack)
        return;
    crowd->answerers |= self;
    if (m->confinement.rec > 0)
        crowd->counting |= self;
}

/* Followers have a phase of their own that says idle, as the shared one does (see can_begin()). */
static void look_around(cw_bus *bus)
{
    cw_crowd crowd = {.valid = true, .calm = true};
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_mac *m = &bus->nodes[i].mac;
        crowd.calm = crowd.calm && is_calm(m);
        count_node(&crowd, m, cw_node_bit(i));
    }
    bus->crowd = crowd;
}

/* ---- Beginning ------------------------------------------------------------------------------- */

/* Cheap checks first: in the middle of a frame this is asked for every bit. */
static bool can_begin(cw_bus *bus)
{
    if (bus->waiting == 0 || bus->group_count > 1 || bus->news ||
        (bus->followers && bus->common.phase != CW_MAC_IDLE))
        return false;
    if (!bus->crowd.valid)
        look_around(bus);
    if (bus->crowd.calm && bus->faults.awake_count)
        cw_fault_unbind(bus);
    if (bus->faults.awake_count &&
        (!cw_fault_only_noise(bus) || cw_fault_noise_free(bus, 1) == 0))
        return false;
    /* a frame that comes during the SOF may join it (M6) */
    return bus->crowd.calm && cw_inbox_first(bus) > bus->now + bus->bit_ticks;
}

/* Rules on errors and states see nothing of a leap in which there are none. */
static bool error_rules_may_act(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    bool several = (contenders & (contenders - 1)) != 0;
    return bus->faults.error_rules &&
           (several || bus->crowd.counting || bus->nodes[winner].mac.confinement.tec > 0);
}

static bool is_leapable(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    const cw_crowd *crowd = &bus->crowd;
    uint64_t self = cw_node_bit(winner);
    bool acknowledged = (crowd->answerers & ~self) != 0;
    bool given_up = contenders != self && (contenders & crowd->one_shot); /* M13 */
    bool suspends = cw_confinement_passive(&bus->nodes[winner].mac.confinement); /* M8 */
    return acknowledged && !given_up && !suspends && !error_rules_may_act(bus, contenders, winner);
}

/* The frame of a node as the wire would carry it. */
static void encode(bus_node *n)
{
    if (n->wrong_crc)
        n->mac.offered = false;
    cw_offer_first(n);
}

/* Rules on bits are bound to their transmissions as they would be at SOF. */
static void bind_rules(cw_bus *bus, uint64_t nodes)
{
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bus_node *n = &bus->nodes[i];
        encode(n);
        cw_fault_transmission(bus, i, &n->queue.slots[n->offered_slot].frame);
    }
}

/* ---- Losing arbitration ---------------------------------------------------------------------- */

/* The frame that a contender has begun with, whatever comes to its queue meanwhile. */
static void pin_frame(bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (n->offered_slot != slot)
        n->mac.offered = false; /* not encoded */
    n->offered_slot = slot;
}

static void begin_attempt(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    cw_share_lost(bus, i);
    if (n->queue.slots[n->offered_slot].attempts++ > 0)
        n->stats.retransmissions++;
}

static void prepare_loser(cw_bus *bus, unsigned i)
{
    cw_leap *leap = &bus->leap;
    uint32_t differing = cw_contest_key(bus, i) ^ cw_contest_key(bus, leap->node);
    pin_frame(&bus->nodes[i]);
    begin_attempt(bus, i);
    leap->lost_bit[i] = (uint8_t)__builtin_clz(differing);
    leap->lost_at[i] = (uint8_t)cw_bits_wire_index(leap->bits, 1u + leap->lost_bit[i]);
}

/* Losses one by one, where somebody may see them. */
static void prepare_losses(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    leap->undecided = leap->contenders & ~cw_node_bit(leap->node);
    for (uint64_t rest = leap->undecided; rest; rest &= rest - 1)
        prepare_loser(bus, cw_lowest_node(rest));
    begin_attempt(bus, leap->node);
}

static unsigned next_loss(const cw_leap *leap)
{
    unsigned next = NO_BIT;
    for (uint64_t rest = leap->undecided; rest; rest &= rest - 1) {
        unsigned at = leap->lost_at[cw_lowest_node(rest)] + 1u;
        next = at < next ? at : next;
    }
    return next;
}

static void tell_losses(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    for (uint64_t rest = leap->undecided; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        if (leap->lost_at[i] + 1u != leap->at)
            continue;
        leap->undecided &= ~cw_node_bit(i);
        cw_tell_arbitration_lost(bus, i, leap->lost_bit[i]);
    }
}

/* All losses at once; what they add to single nodes is shared out later (contest.c). */
static void count_losses(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    bus_node *n = &bus->nodes[leap->node];
    cw_set_contenders(bus, leap->contenders);
    begin_attempt(bus, leap->node);
    bus->contest.lost++;
    n->lost_before = bus->contest.lost;
    bus->stats.arbitration_lost += cw_count_bits(leap->contenders) - 1;
    leap->undecided = 0;
}

/* ---- Moments --------------------------------------------------------------------------------- */

/* R8, at the ACK slot. */
static void lower_counters(cw_bus *bus)
{
    uint64_t nodes = bus->crowd.counting & ~cw_node_bit(bus->leap.node);
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac *m = &bus->nodes[i].mac;
        cw_confinement_rx_success(&m->confinement);
        m->told_state = m->confinement.state;
        cw_tell_state(bus, i);
    }
    if (nodes)
        bus->crowd.valid = false;
}

/* As a receiver decodes it: bytes that are not on the wire are 0. */
static void copy_received(cw_frame *to, const cw_frame *from)
{
    unsigned length = cw_frame_length(from);
    *to = *from;
    for (unsigned i = length; i < CW_FRAME_DATA_MAX; i++)
        to->data[i] = 0;
}

/* Whether a frame may be more to its receivers than an event. */
static bool host_side_acts(const cw_bus *bus)
{
    return bus->faults.host_rules || bus->faults.reply_rules || bus->held_count;
}

static void receive(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    const bus_node *n = &bus->nodes[leap->node];
    uint64_t receivers = leap->riders & ~cw_node_bit(leap->node);
    cw_frame frame;
    copy_received(&frame, &n->queue.slots[n->offered_slot].frame);
    if (host_side_acts(bus)) {
        for (uint64_t rest = receivers; rest; rest &= rest - 1)
            cw_receive(bus, cw_lowest_node(rest), &frame);
        return;
    }
    cw_set_listeners(bus, leap->riders);
    cw_count_received(bus, leap->node, cw_frame_length(&frame));
    cw_event *e = cw_push_node_event(bus, CW_EVENT_RX, cw_lowest_node(receivers));
    e->nodes = receivers;
    e->from = cw_node_bit(leap->node);
    e->handed_in = n->queue.slots[n->offered_slot].handed_in;
    e->frame = frame;
}

static void finish_transmission(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    cw_mac *m = &bus->nodes[leap->node].mac;
    m->offered = false;
    cw_confinement_tx_success(&m->confinement);
    m->told_state = m->confinement.state;
    cw_settle_sent(bus, leap->node);
    cw_tell_state(bus, leap->node);
}

/* What happens at the end of the bit that has just passed. */
static void run_moment(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    if (leap->undecided)
        tell_losses(bus);
    if (leap->at == leap->length - ACK_BEFORE_END)
        lower_counters(bus);
    else if (leap->at == leap->length - RX_BEFORE_END)
        receive(bus);
    else if (leap->at == leap->length)
        finish_transmission(bus);
}

static unsigned next_moment(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    unsigned loss = leap->undecided ? next_loss(leap) : NO_BIT;
    unsigned next = leap->length + CW_INTERMISSION_BITS;
    if (leap->at < leap->length)
        next = leap->length;
    if (leap->at < leap->length - RX_BEFORE_END)
        next = leap->length - RX_BEFORE_END;
    if (leap->at < leap->length - ACK_BEFORE_END && bus->crowd.counting)
        next = leap->length - ACK_BEFORE_END;
    return loss < next ? loss : next;
}

/* ---- Going on -------------------------------------------------------------------------------- */

static void count_bits(cw_bus *bus, unsigned bits)
{
    bus->stats.bits += bits;
    bus->stats.busy_bits += bits;
    cw_load_add(&bus->load, bits, true);
    if (bus->faults.awake_count)
        cw_fault_pass_noise(bus, bits);
}

static void pass(cw_bus *bus, unsigned bits)
{
    bus->leap.at = (uint16_t)(bus->leap.at + bits);
    bus->now += (uint64_t)bits * bus->bit_ticks;
    count_bits(bus, bits);
}

/* Whole bits up to a tick, no more than that many. */
static unsigned bits_up_to(const cw_bus *bus, uint64_t tick, unsigned bits)
{
    uint64_t ticks = tick - bus->now;
    return ticks >= (uint64_t)bits * bus->bit_ticks ? bits : (unsigned)(ticks / bus->bit_ticks);
}

/* Bits to go at once, 0 when noise flips the next one: up to the end of the one in which something happens or comes in, or after
 * which something is due. */
static unsigned bits_to_go(cw_bus *bus, uint64_t tick)
{
    const cw_leap *leap = &bus->leap;
    unsigned bits = next_moment(bus) - leap->at;
    if (leap->stop != NO_BIT)
        bits = (unsigned)cw_least(bits, (uint64_t)leap->stop - leap->at);
    bits = bits_up_to(bus, tick, bits);
    uint64_t due = cw_least(bus->next_restart, bus->faults.next_due);
    due = cw_least(due, cw_inbox_first(bus));
    if (due - bus->now < (uint64_t)bits * bus->bit_ticks) /* due is later than now */
        bits = bits_up_to(bus, due + bus->bit_ticks - 1, bits);
    return bus->faults.awake_count ? (unsigned)cw_fault_noise_free(bus, bits) : bits;
}

static void end_slot(cw_bus *bus)
{
    bus->leap.active = false;
    bus->recessive_bits = ACK_BEFORE_END + CW_INTERMISSION_BITS;
    if (bus->faults.awake_count)
        cw_fault_unbind(bus);
}

/* ---- The rest at once ------------------------------------------------------------------------ */

/* Goes up to a bit that lies ahead; false when it does not. */
static bool move_to(cw_bus *bus, unsigned at)
{
    if (bus->leap.at >= at)
        return false;
    bus->now += (uint64_t)(at - bus->leap.at) * bus->bit_ticks;
    bus->leap.at = (uint16_t)at;
    return true;
}

/* To the end, where nothing can come in between. */
static void leap_over(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    const unsigned length = leap->length;
    count_bits(bus, length + CW_INTERMISSION_BITS - leap->at);
    if (move_to(bus, length - ACK_BEFORE_END) && bus->crowd.counting)
        lower_counters(bus);
    if (move_to(bus, length - RX_BEFORE_END))
        receive(bus);
    if (move_to(bus, length))
        finish_transmission(bus);
    (void)move_to(bus, length + CW_INTERMISSION_BITS);
    end_slot(bus);
}

/* Whether nothing is due or comes in before that tick. */
static bool is_quiet_until(const cw_bus *bus, uint64_t tick)
{
    return bus->next_restart >= tick && bus->faults.next_due >= tick &&
           cw_inbox_first(bus) >= tick;
}

static bool is_noise_free(cw_bus *bus, unsigned bits)
{
    return bus->faults.awake_count == 0 || cw_fault_noise_free(bus, bits) == bits;
}

static bool can_leap_over(cw_bus *bus, uint64_t tick)
{
    const cw_leap *leap = &bus->leap;
    unsigned bits = leap->length + CW_INTERMISSION_BITS - leap->at;
    uint64_t ticks = (uint64_t)bits * bus->bit_ticks;
    return !leap->undecided && leap->stop == NO_BIT && !host_side_acts(bus) &&
           tick - bus->now >= ticks && is_quiet_until(bus, bus->now + ticks) &&
           is_noise_free(bus, bits);
}

/* ---- Going on, one moment after the other -------------------------------------------------- */

/* Perhaps a rule looks at the next bit. It may let it pass; else single bits go on from here. */
static void look_at_stop(cw_bus *bus)
{
    if (bus->leap.broken || !cw_fault_lets_pass(bus))
        cw_leap_end(bus);
    else
        cw_fault_find_stop(bus, bus->leap.at + 1u);
}

/* A node in loopback sends it at once (M15), one that is idle may join a frame that has only just
 * begun (M6). */
void cw_leap_frame_came(cw_bus *bus, unsigned i, uint64_t tick)
{
    bool loopback = bus->nodes[i].mac.modes & CW_MODE_LOOPBACK;
    bool may_join = bus->leap.at == 1 && tick <= bus->now;
    bus->leap.broken = bus->leap.broken || loopback || may_join;
}

void cw_leap_on(cw_bus *bus, uint64_t tick)
{
    cw_leap *leap = &bus->leap;
    if (leap->broken || leap->at == leap->stop) {
        look_at_stop(bus);
        return;
    }
    if (can_leap_over(bus, tick)) {
        leap_over(bus);
        return;
    }
    unsigned bits = bits_to_go(bus, tick);
    if (bits == 0) {
        cw_leap_end(bus);
        return;
    }
    pass(bus, bits - 1);
    cw_take_inbox_before(bus, bus->now + bus->bit_ticks);
    pass(bus, 1);
    run_moment(bus);
    if (leap->at == leap->length + CW_INTERMISSION_BITS)
        end_slot(bus);
}

/* Whether nobody can see the single losses. */
static bool passes_arbitration(cw_bus *bus, uint64_t tick)
{
    const cw_leap *leap = &bus->leap;
    unsigned bits = leap->bits->extended ? ARBITRATION_BITS_EXTENDED : ARBITRATION_BITS_BASE;
    uint64_t ticks = (uint64_t)bits * bus->bit_ticks;
    return leap->stop >= bits && tick - bus->now >= ticks &&
           is_quiet_until(bus, bus->now + ticks) &&
           !cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST) && is_noise_free(bus, bits);
}

static void begin(cw_bus *bus, unsigned winner, uint64_t contenders)
{
    bus_node *n = &bus->nodes[winner];
    encode(n);
    bus->leap.active = true;
    bus->leap.broken = false;
    bus->leap.node = (uint8_t)winner;
    bus->leap.at = 0;
    bus->leap.stop = NO_BIT;
    bus->leap.length = n->mac.tx.length;
    bus->leap.bits = &n->mac.tx;
    bus->leap.riders = bus->crowd.riders;
    bus->leap.contenders = contenders;
    bus->error_flag = (flag_watch){.now = false};
    bus->overload_flag = (flag_watch){.now = false};
}

/* All begin to transmit; rules look at the frames of those that are watched. */
static void start_transmissions(cw_bus *bus, uint64_t watched, uint64_t tick)
{
    cw_leap *leap = &bus->leap;
    uint64_t self = cw_node_bit(leap->node);
    bind_rules(bus, watched);
    if (watched == self)
        cw_fault_find_stop(bus, 0);
    bool hidden = (watched & ~self) == 0 && passes_arbitration(bus, tick);
    if (leap->contenders == self || hidden) {
        count_losses(bus);
        return;
    }
    prepare_losses(bus);
    if (watched)
        cw_fault_find_stop(bus, 0);
}

bool cw_leap_begin(cw_bus *bus, uint64_t tick)
{
    unsigned winner;
    if (!can_begin(bus))
        return false;
    uint64_t contenders = bus->waiting & bus->crowd.starters;
    bool others = bus->waiting & ~(bus->crowd.riders | bus->crowd.away);
    if (contenders == 0 || others || !cw_contest_winner(bus, contenders, &winner) ||
        !is_leapable(bus, contenders, winner))
        return false;
    uint64_t watched = cw_fault_watched(bus, contenders, winner);
    if (watched && cw_fault_acts_at_start(bus, watched))
        return false;
    begin(bus, winner, contenders);
    start_transmissions(bus, watched, tick);
    cw_leap_on(bus, tick); /* so that it has begun when the caller can do something */
    return true;
}

/* ---- Ending before the end ------------------------------------------------------------------- */

/* Where a receiver is after that many bits. */
static void find_point(cw_mac *m, const cw_bus *bus)
{
    const bus_node *n = &bus->nodes[bus->leap.node];
    cw_mac_init(m, 0, CW_REC_MAX);
    cw_mac_go_into_frame(m, &n->queue.slots[n->offered_slot].frame, bus->leap.bits, bus->leap.at);
}

static void resume_sending(cw_bus *bus, unsigned i, const cw_mac *point)
{
    bus_node *n = &bus->nodes[i];
    cw_leave(bus, cw_node_bit(i));
    n->mac.phase = CW_MAC_IDLE; /* so that it takes an offer */
    if (!n->mac.offered && bus->leap.at < bus->leap.length)
        cw_offer_slot(n, n->offered_slot);
    cw_mac_go_to_point(&n->mac, point);
    cw_mac_become_transmitter(&n->mac, bus->leap.at);
}

/* Those who were to lose may do well after all, so rules on their later bits count again. */
static void bind_rest(cw_bus *bus)
{
    const cw_fault_set *set = &bus->faults;
    uint64_t nodes = bus->leap.undecided & set->watched & ~set->early;
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        const bus_node *n = &bus->nodes[i];
        cw_fault_transmission(bus, i, &n->queue.slots[n->offered_slot].frame);
    }
}

void cw_leap_end(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    cw_mac point;
    if (!leap->active)
        return;
    leap->active = false;
    bus->recessive_bits = cw_leap_recessive_bits(bus);
    find_point(&point, bus);
    if (bus->followers)
        cw_mac_go_to_point(&bus->common, &point);
    for (uint64_t rest = leap->riders & ~bus->followers; rest; rest &= rest - 1)
        cw_mac_go_to_point(&bus->nodes[cw_lowest_node(rest)].mac, &point);
    for (uint64_t rest = leap->undecided | cw_node_bit(leap->node); rest; rest &= rest - 1)
        resume_sending(bus, cw_lowest_node(rest), &point);
    bind_rest(bus);
    bus->crowd.valid = false;
}

/* ---- Reading --------------------------------------------------------------------------------- */

uint64_t cw_leap_recessive_bits(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    unsigned n = leap->at;
    if (n > leap->length - ACK_BEFORE_END)
        return n - (leap->length - ACK_BEFORE_END);
    if (n == leap->length - ACK_BEFORE_END)
        return 0;
    while (n > 0 && cw_bits_level(leap->bits, n - 1))
        n--;
    return leap->at - n;
}

uint64_t cw_leap_horizon(const cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    if (leap->at < leap->length - RX_BEFORE_END)
        return leap->length - RX_BEFORE_END - leap->at;
    if (leap->at < leap->length)
        return leap->length - leap->at;
    return bus->waiting ? CW_FRAME_BITS_MIN - 1 : CW_QUIET_FOREVER;
}
