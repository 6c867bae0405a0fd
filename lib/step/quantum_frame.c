/* SPDX-License-Identifier: MIT
 *
 * quantum_frame.c - clean frames of nodes with clocks of their own, without their bits.
 *
 * Only one node has a frame, or will have one, and the others read it right for sure
 * (quantum_proof.c). Then the course of the frame follows from few moments. The sender goes by its
 * own clock up to the acknowledgement. Each receiver is synchronised by the last edge to dominant
 * before that; nothing is left of those before, but for what is counted (quantum_count.c). The
 * acknowledgements come in the order of time (quantum_edge.c). After them all nodes go by their own
 * clocks to the end of the frame and to the intermission (quantum_park.c).
 *
 * The step begins and ends between two bit times, while all nodes are idle or in the intermission.
 * It has the events of single bits, at the same ticks.
 */
#include "step/frame.h"
#include "step/quantum_clean.h"

#include "format/bits.h"
#include "mac/confinement.h"
#include "mac/mac.h"

#include <string.h>

#define BITS_TO_RX 7  /* from the ACK delimiter to the end of the last but one bit of EOF */
#define BITS_TO_EOF 8 /* ... to the end of EOF */
#define BITS_AFTER_EOF (BITS_TO_EOF + (cw_span)CW_INTERMISSION_BITS)

/* ---- Conditions ------------------------------------------------------------------------------ */

/* Returns true when nothing but the frame itself can change what the nodes do. */
static bool may_go(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    return t->active && !cw_wants_event(bus, CW_EVENT_SYNC) &&
           bus->rules.awake_count == 0 && t->disturbances.count == 0 && t->cable.dominant == 0 &&
           !t->rings && t->touched == 0 && !bus->stepping && !bus->watching && !bus->pending &&
           bus->group_count == 1 && t->one_wire && !cw_host_side_acts(bus) && !bus->dozing &&
           !bus->error_flag.now && !bus->overload_flag.now && !cw_rules_delay_edges(&bus->rules) &&
           !cw_fast_nodes(bus) && cw_timed_is_straight(bus);
}

/* Returns true when a node is idle or in the intermission. */
static bool is_between_frames(const cw_mac *m)
{
    return m->phase == CW_MAC_IDLE || m->phase == CW_MAC_INTERMISSION;
}

/* Finds the frame that comes next: the only one that waits, or the first one of the inbox. */
static bool find_frame(cw_clean_frame *f, const cw_bus *bus)
{
    f->due = 0;
    if (bus->waiting & (bus->waiting - 1))
        return false;
    if (bus->waiting) {
        f->sender = cw_lowest_node(bus->waiting);
        const cw_queue *q = &bus->nodes[f->sender].queue;
        f->frame = cw_queue_at(q, cw_queue_first(q))->frame;
    } else if (cw_inbox_first(bus) != CW_NEVER) {
        const cw_inbox_entry *entry = cw_inbox_at(&bus->inbox, 0);
        f->sender = entry->node;
        f->frame = entry->frame;
        f->due = entry->at_tick;
    } else {
        return false;
    }
    if (f->due > cw_now(bus) + CW_LEAP_TICKS || cw_frame_is_fd(f->frame) ||
        (bus->old && cw_frame_is_extended(f->frame)) ||
        (bus->strict && f->frame->dlc > CW_CLASSICAL_DATA_MAX))
        return false;
    if (f->due && (bus->rules.hand_in_rules || !cw_knows_frame(bus, f->sender, f->frame) ||
                   (bus->asleep >> f->sender & 1u) ||
                   cw_refusal(bus, f->sender) != CW_DROP_COUNT))
        return false;
    return is_between_frames(&bus->nodes[f->sender].mac);
}

/* Finds the start of the frame, and whether all nodes take it for one. The earliest edge comes with
 * the least delay. */
static bool find_begin(cw_clean_frame *f, const cw_bus *bus)
{
    const cw_span due = f->due > cw_now(bus) ? cw_moment_of(bus, f->due) : f->now;
    f->begin = cw_clean_ready(bus, f->sender, due);
    return cw_clean_takes_sof(bus, f->begin + bus->timed.clean.least_delay);
}

/* Returns true when a rule waits for such a frame. It may wait for one that is still to come. */
static bool is_watched(cw_bus *bus, const cw_clean_frame *f)
{
    if (f->due)
        return cw_rules_wait_for_frames(&bus->rules);
    return cw_find_watched(bus, bus->waiting, f->sender);
}

/* Returns true when the frame wins though a lower identifier waits behind it in its queue. */
static bool wins_improperly(cw_bus *bus, const cw_clean_frame *f)
{
    const cw_queue *q = &bus->nodes[f->sender].queue;
    if (f->due || q->count < 2 || (q->mode == CW_ORDER_PRIORITY && q->boxed == 0))
        return false;
    cw_order_begin(bus, f->sender, cw_now(bus));
    return cw_order_is_improper(bus, f->sender, cw_queue_first(q));
}

/* Returns true when the sender's frame is clean for sure, with no state or rule to look at. */
static bool may_send(const cw_bus *bus, const cw_clean_frame *f)
{
    const cw_mac *m = &bus->nodes[f->sender].mac;
    const unsigned silent = m->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED);
    return !silent && !cw_confinement_passive(&m->confinement) &&
           !(bus->rules.error_rules && m->confinement.tec > 0) &&
           (cw_clean_at(&bus->timed.clean, f->sender)->harmless & bus->all) == bus->all;
}

/* ---- The course of the frame ----------------------------------------------------------------- */

/* Finds the length of the frame and the course of its acknowledgement. */
static bool find_course(cw_clean_frame *f, cw_bus *bus)
{
    f->edge = cw_bits_last_edge(f->frame, &f->length);
    f->slot = f->length - CW_AFTER_ACK_BITS - 1u;
    f->bit = cw_clean_at(&bus->timed.clean, f->sender)->bit;
    return cw_clean_acknowledge(bus, f);
}

/* The step ends between two bit times, behind the frame at all nodes, and before the first node can
 * begin another one. */
static bool find_end(cw_clean_frame *f, const cw_bus *bus)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_span first = f->least_end + BITS_AFTER_EOF * clean->least_bit;
    const cw_span last_eof = f->most_end + BITS_TO_EOF * clean->most_bit;
    const cw_span last_rx = f->most_end + BITS_TO_RX * clean->most_bit;
    const cw_clean_node *sender = cw_clean_at(clean, f->sender);
    const cw_span sent = cw_clean_end_of_slot(clean, f->slots, sender) + BITS_TO_EOF * f->bit;
    f->bit_times = (uint64_t)((first - f->now) / bus->timed.bit_time);
    f->until = f->now + (cw_span)f->bit_times * bus->timed.bit_time;
    return last_eof < f->until && last_rx < sent &&
           f->released + bus->timed.cable.longest < f->least_end + BITS_TO_RX * clean->least_bit;
}

/* Returns the tick of the first frame to come, apart from the one on its way. */
static uint64_t next_frame_at(const cw_bus *bus, const cw_clean_frame *f)
{
    const cw_inbox *in = &bus->inbox;
    if (f->due == 0)
        return cw_inbox_first(bus);
    return in->count < 2 ? CW_NEVER : cw_inbox_at(in, 1)->at_tick;
}

/* Returns true when no frame that comes is dropped. */
static bool takes_all(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_bus_node *n = &bus->nodes[i];
        const bool room = n->queue.count + n->inbox <= n->queue_limit;
        if (n->inbox && (!room || cw_refusal(bus, i) != CW_DROP_COUNT))
            return false;
    }
    return true;
}

/* Nothing must come in but frames for later, when it is too late to join the SOF (M6). */
static bool is_undisturbed(const cw_bus *bus, const cw_clean_frame *f, uint64_t tick)
{
    const uint64_t end = cw_tick_of(bus, f->until), first = next_frame_at(bus, f);
    const cw_span joined = f->begin + bus->timed.cable.longest + 3 * bus->timed.bit_time;
    return end <= tick && bus->node_due >= end && bus->rules.next_due >= end &&
           (first >= end || (first > cw_tick_of(bus, joined) && takes_all(bus)));
}

/* ---- Its effects ----------------------------------------------------------------------------- */

/* Returns the bit times, of those to come, that begin before a moment. */
static uint64_t bit_times_before(const cw_bus *bus, cw_span moment, uint64_t most)
{
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    if (moment <= now)
        return 0;
    return cw_least((uint64_t)((moment - now + bus->timed.bit_time - 1) / bus->timed.bit_time),
                    most);
}

/* The bus is busy up to the end of the intermission of the frame before, and from SOF on. */
static void count_load(cw_bus *bus, const cw_clean_frame *f)
{
    const uint64_t before = bit_times_before(bus, f->begin, f->bit_times);
    const uint64_t busy = cw_least(cw_clean_busy_bits(bus), f->bit_times);
    const uint64_t idle = before > busy ? before - busy : 0;
    cw_count_clean_bits(bus);
    cw_clean_count_bits(bus, busy, true);
    cw_clean_count_bits(bus, idle, false);
    cw_clean_count_bits(bus, f->bit_times - busy - idle, true);
    bus->stats.bits += f->bit_times;
}

/* Returns the moment from which on the wire is recessive everywhere. Not inlined, since it is not
 * always needed. */
__attribute__((noinline)) static cw_span find_released(const cw_bus *bus, const cw_clean_frame *f)
{
    cw_span released = 0;
    for (uint64_t rest = f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(&bus->timed.clean, cw_lowest_node(rest));
        const cw_span gone = cw_clean_delimiter(&bus->timed.clean, c->node) + c->last_arrival;
        released = gone > released ? gone : released;
    }
    return released;
}

/* Returns the recessive bit times up to the end of the step. Mostly one ends in the ACK slot. */
static uint64_t recessive_bits(const cw_bus *bus, const cw_clean_frame *f)
{
    const cw_span bit = bus->timed.bit_time;
    cw_span begun = f->begun, last = (f->released - f->now) / bit;
    if ((f->leaves - f->now) / bit != last || begun >= f->now + last * bit) {
        const cw_span released = find_released(bus, f);
        const cw_span sure = cw_clean_begun(&bus->timed.clean, released);
        last = (released - f->now) / bit;
        begun = sure < begun ? sure : begun;
    }
    if (begun < f->now + last * bit)
        return f->bit_times - (uint64_t)last;
    return cw_clean_recessive_bits(bus, f, f->bit_times);
}

/* Begins to send the first frame of the queue: a retransmission if it has been tried before. */
static void begin_attempt(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_queue_slot *slot = cw_queue_at(&n->queue, cw_queue_first(&n->queue));
    cw_pin_first(n);
    n->mac.offered = false;
    cw_share_lost(bus, i);
    n->stats.retransmissions += slot->tried;
    slot->tried = true;
    bus->error_flag = (cw_flag_watch){.now = false};
    bus->overload_flag = (cw_flag_watch){.now = false};
}

/* Returns the end of that many bits of a node, its ACK delimiter being the first one. */
static cw_span end_of_bits(const cw_clean *clean, unsigned i, cw_span bits)
{
    return cw_clean_delimiter(clean, i) + bits * cw_clean_at(clean, i)->bit;
}

/* Returns the place of a number among others, which are sorted. */
static unsigned place_of(const uint64_t *numbers, unsigned count, uint64_t number)
{
    unsigned place = 0;
    while (count > 0) {
        const unsigned half = count / 2;
        const bool behind = numbers[place + half] < number;
        place += behind ? half + 1 : 0;
        count = behind ? count - half - 1 : half;
    }
    return place;
}

/* Sorts the receivers by the ends of their frames. A number is the end, from a moment on, and the
 * node. */
static unsigned sort_receivers(const cw_bus *bus, const cw_clean_frame *f,
                               uint64_t order[CW_NODES_MAX])
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_span from = f->least_end + BITS_TO_RX * clean->least_bit;
    unsigned count = 0;
    for (uint64_t rest = bus->all & ~clean->away & ~cw_node_bit(f->sender); rest;
         rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_span end = end_of_bits(clean, i, BITS_TO_RX);
        const uint64_t number = (uint64_t)(end - from) * CW_NODES_MAX + i;
        const unsigned place = place_of(order, count, number);
        memmove(&order[place + 1], &order[place], (count - place) * sizeof order[0]);
        order[place] = number;
        count++;
    }
    return count;
}

/* Hands the frame to the receivers, each at its own tick, in the order of time. Not inlined, since
 * often no host wants to know. */
__attribute__((noinline)) static void hand_out(cw_bus *bus, const cw_clean_frame *f)
{
    const cw_bus_node *n = &bus->nodes[f->sender];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    const cw_frame_origin origin = {.from = cw_node_bit(f->sender), .handed_in = slot->handed_in};
    uint64_t order[CW_NODES_MAX];
    cw_frame frame;
    cw_frame_copy(&frame, slot->frame);
    for (unsigned k = slot->bytes; k < CW_CLASSICAL_DATA_MAX; k++)
        frame.data[k] = 0; /* not on the wire */
    const unsigned count = sort_receivers(bus, f, order);
    for (unsigned k = 0; k < count; k++) {
        const unsigned i = (unsigned)(order[k] % CW_NODES_MAX);
        const cw_span end = end_of_bits(&bus->timed.clean, i, BITS_TO_RX);
        cw_wire_go_to(&bus->time, cw_tick_of(bus, end));
        bus->nodes[i].stats.rx_accepted++;
        cw_push_rx(bus, i, &frame, &origin);
    }
}

/* Counts the frame for all receivers, or hands it to each. */
static void quantum_frame_receive(cw_bus *bus, const cw_clean_frame *f)
{
    const cw_bus_node *n = &bus->nodes[f->sender];
    if (cw_wants_event(bus, CW_EVENT_RX)) {
        hand_out(bus, f);
        return;
    }
    cw_set_listeners(bus, bus->all & ~bus->timed.clean.away);
    cw_count_received(bus, f->sender, cw_queue_at(&n->queue, n->offered_slot)->bytes);
}

/* The frame becomes valid for its transmitter, at the tick of its end of EOF (M7). */
static void finish_transmission(cw_bus *bus, const cw_clean_frame *f)
{
    const unsigned i = f->sender;
    cw_mac *m = &bus->nodes[i].mac;
    const cw_span end = end_of_bits(&bus->timed.clean, i, BITS_TO_EOF);
    cw_wire_go_to(&bus->time, cw_tick_of(bus, end));
    cw_take_inbox_before(bus, cw_now(bus)); /* it waits while the other frame ends */
    cw_confinement_tx_success(&m->confinement);
    m->reported_state = m->confinement.state;
    cw_commit_sent(bus, i, f->length);
    cw_report_state(bus, i);
}

/* Does all that the frame brings. Nodes are parked behind it. */
static void go_to_end(cw_bus *bus, const cw_clean_frame *f)
{
    const uint64_t now = cw_now(bus);
    cw_clean *clean = &bus->timed.clean;
    count_load(bus, f);
    cw_clean_pass(bus, f);
    clean->last = f->slots;
    bus->recessive_bits = recessive_bits(bus, f);
    if (f->due)
        cw_take_inbox(bus, f->due + 1);
    begin_attempt(bus, f->sender);
    quantum_frame_receive(bus, f);
    finish_transmission(bus, f);
    cw_wire_go_to(&bus->time, now);
    cw_wire_pass(&bus->time, f->bit_times);
    clean->senders = cw_node_bit(f->sender);
    clean->late_end = f->late_end;
    clean->most_end = f->most_end;
    bus->wire = CW_RECESSIVE;
    cw_outlook_forget(bus);
    cw_take_inbox_before(bus, cw_now(bus));
}

bool cw_timed_frame_go(cw_bus *bus, uint64_t tick)
{
    cw_clean_frame f;
    if (!may_go(bus) || !find_frame(&f, bus))
        return false;
    cw_timed_rebase(bus);
    cw_clean_prove(bus);
    if (!may_send(bus, &f) || !cw_clean_park(bus))
        return false;
    f.now = cw_moment_of(bus, cw_now(bus));
    const bool goes = find_begin(&f, bus) && !is_watched(bus, &f) && !wins_improperly(bus, &f) &&
                      find_course(&f, bus) && find_end(&f, bus) && is_undisturbed(bus, &f, tick);
    if (goes)
        go_to_end(bus, &f);
    cw_clean_settle(bus);
    return goes;
}
