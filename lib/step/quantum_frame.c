/* SPDX-License-Identifier: MIT
 *
 * quantum_frame.c - clean frames of nodes with clocks of their own, without their bits.
 *
 * Only one node has a frame, or will have one, and the others read it right for sure
 * (quantum_proof.c). Then the course of the frame follows from few moments. The sender goes by its
 * own clock up to the acknowledgement. Each receiver is synchronised by the last edge to dominant
 * before that; nothing is left of those before. The acknowledgements come in the order of time
 * (quantum_edge.c). After them all nodes go by their own clocks to the end of the frame and to the
 * intermission.
 *
 * Synchronisations are not counted in it, so a bus with records of them goes bit by bit.
 *
 * The step begins and ends between two bit times, while all nodes are idle or in the intermission.
 * It has the events of single bits, at the same ticks.
 */
#include "step/frame.h"
#include "step/quantum.h"

#include "format/bits.h"
#include "mac/confinement.h"
#include "mac/mac.h"

#define BITS_TO_RX 7  /* from the ACK delimiter to the end of the last but one bit of EOF */
#define BITS_TO_EOF 8 /* ... to the end of EOF */
#define BITS_AFTER_EOF (BITS_TO_EOF + (cw_span)CW_INTERMISSION_BITS)

/* A frame on its way, and the place of each node. */
typedef struct clean_frame {
    unsigned sender;
    const cw_frame *frame;
    uint64_t due;      /* tick at which it comes out of the inbox; 0: it waits */
    unsigned length;   /* bits, SOF to EOF */
    cw_span now;       /* the start of the step */
    cw_span begin;     /* of SOF */
    cw_span until;     /* the end of the step */
    cw_span busy;      /* up to there the bus is busy with the frame before */
    uint64_t bit_times;
    uint64_t nodes;
    uint64_t away;     /* of these, those that take no part */
    cw_common_edge ack;
} clean_frame;

/* ---- Conditions ------------------------------------------------------------------------------ */

/* Returns true when a node is idle or in the intermission. */
static bool is_between_frames(const cw_mac *m)
{
    return m->phase == CW_MAC_IDLE || m->phase == CW_MAC_INTERMISSION;
}

/* Returns true when nothing but the frame itself can change what the nodes do. */
static bool may_go(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    return t->active && (!t->records || t->uniform) && !cw_wants_event(bus, CW_EVENT_SYNC) &&
           bus->rules.awake_count == 0 && t->disturbances.count == 0 && t->cable.dominant == 0 &&
           !t->rings && t->touched == 0 && !bus->stepping && !bus->watching && !bus->pending &&
           bus->group_count == 1 && t->one_wire && !cw_host_side_acts(bus) && !bus->dozing &&
           !bus->error_flag.now && !bus->overload_flag.now && !cw_rules_delay_edges(&bus->rules) &&
           !cw_fast_nodes(bus) && cw_timed_is_straight(bus);
}

/* Finds the frame that comes next: the only one that waits, or the first one of the inbox. */
static bool find_frame(clean_frame *f, const cw_bus *bus)
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
    if (f->due && (!cw_knows_frame(bus, f->sender, f->frame) || (bus->asleep >> f->sender & 1u) ||
                   cw_refusal(bus, f->sender) != CW_DROP_COUNT))
        return false;
    return is_between_frames(&bus->nodes[f->sender].mac);
}

/* Returns true when a frame changes nothing at a controller but what it counts of it. */
static bool is_calm(const cw_mac *m)
{
    return m->confinement.rec == 0 && m->overloads_wanted == 0 && !m->sleeps &&
           m->reported_state == m->confinement.state && !(m->modes & CW_MODE_LOOPBACK);
}

static bool quantum_frame_is_away(const cw_mac *m)
{
    return m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_ASLEEP;
}

/* Returns true when a node is in a recessive bit as long as all others, and saw no edge in it. */
static bool is_in_plain_bit(const cw_timed_node *n, cw_span before)
{
    return !n->retimed && !n->pcs.synchronised && n->pcs.last_sample == CW_RECESSIVE &&
           n->report.what == 0 && n->sync_count == 0 && before < n->begin &&
           n->pcs.sample_at == cw_bit_timing_sample_at(&n->timing) &&
           n->pcs.end_at == cw_bit_timing_quanta(&n->timing);
}

/* Finds the first moment at which a node could begin a frame, and the one from which on it takes a
 * dominant level for SOF. Returns false when it has more to do than to wait. */
static bool find_ready(clean_frame *f, const cw_bus *bus, unsigned i, cw_span *ready, cw_span *open)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    const cw_mac *m = &bus->nodes[i].mac;
    const cw_span bit = bus->timed.proof.bit[i], begin = n->pcs.sampled ? n->next_begin : n->begin;
    const cw_span unsampled = !n->pcs.sampled;
    *open = INT64_MIN;
    *ready = begin + unsampled * bit;
    if (quantum_frame_is_away(m))
        return !(m->modes & CW_MODE_LOOPBACK); /* no edge moves its bits (M15) */
    if (m->phase == CW_MAC_IDLE)
        return is_calm(m);
    const bool suspends = m->role == CW_ROLE_TRANSMITTER &&
                          cw_confinement_passive(&m->confinement);
    if (m->phase != CW_MAC_INTERMISSION || !is_calm(m) || suspends)
        return false;
    const cw_span left = (cw_span)CW_INTERMISSION_BITS - m->count;
    const cw_span third = begin + (left - 1) * bit +
                          bus->timed.proof.to_sample[i];
    *ready = begin + left * bit;
    *open = left > 1 ? third - bit : INT64_MIN;
    f->busy = third > f->busy ? third : f->busy;
    return true;
}

/* Returns the first start of a bit of an idle node at which it has a frame that comes at a tick. */
static cw_span begin_after(const cw_bus *bus, uint64_t due, unsigned i, cw_span ready)
{
    const cw_span bit = bus->timed.proof.bit[i];
    const cw_span comes = due <= cw_now(bus) ? INT64_MIN : cw_moment_of(bus, due);
    return comes <= ready ? ready : ready + (comes - ready + bit - 1) / bit * bit;
}

/* Finds the start of the frame, and whether all nodes take it for one. */
static bool find_begin(clean_frame *f, cw_bus *bus)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_span before = cable->newest + cable->longest;
    cw_span ready, open, latest = INT64_MIN;
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (bus->timed.nodes[i].ahead)
            cw_timed_settle(&bus->timed, i);
        if (!is_in_plain_bit(&bus->timed.nodes[i], before) ||
            !find_ready(f, bus, i, &ready, &open))
            return false;
        if (i == f->sender)
            f->begin = begin_after(bus, f->due, i, ready);
        else
            latest = open > latest ? open : latest;
        f->away |= quantum_frame_is_away(&bus->nodes[i].mac) ? cw_node_bit(i) : 0;
    }
    /* the earliest edge comes with the least delay */
    return latest <= f->begin + bus->timed.proof.least_delay;
}

/* Returns true when a rule waits for such a frame. It may wait for one that is still to come. */
static bool is_watched(cw_bus *bus, const clean_frame *f)
{
    if (f->due)
        return cw_rules_wait_for_frames(&bus->rules);
    return cw_find_watched(bus, bus->waiting, f->sender);
}

/* Returns true when the frame wins though a lower identifier waits behind it in its queue. */
static bool wins_improperly(cw_bus *bus, const clean_frame *f)
{
    const cw_queue *q = &bus->nodes[f->sender].queue;
    if (f->due || q->count < 2 || (q->mode == CW_ORDER_PRIORITY && q->boxed == 0))
        return false;
    cw_order_begin(bus, f->sender, cw_now(bus));
    return cw_order_is_improper(bus, f->sender, cw_queue_first(q));
}

/* Returns true when the sender's frame is clean for sure, with no state or rule to look at. */
static bool may_send(const cw_bus *bus, const clean_frame *f)
{
    const cw_mac *m = &bus->nodes[f->sender].mac;
    const unsigned silent = m->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED);
    return !silent && !cw_confinement_passive(&m->confinement) &&
           !(bus->rules.error_rules && m->confinement.tec > 0) &&
           (bus->timed.proof.harmless[f->sender] & f->nodes) == f->nodes;
}

/* ---- The course of the frame ----------------------------------------------------------------- */

/* Returns the wire bit in which the last dominant row before the ACK slot begins. */
static unsigned last_edge(const cw_bits *bits)
{
    unsigned n = bits->length - CW_AFTER_ACK_BITS - 2u;
    while (cw_bits_level(bits, n))
        n--;
    while (n > 0 && !cw_bits_level(bits, n - 1))
        n--;
    return n;
}

/* Plans the ACK slot of each node as if nobody acknowledged. */
static void plan_ack(clean_frame *f, const cw_bus *bus, unsigned edge, unsigned slot)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_span driven = f->begin + edge * bus->timed.proof.bit[f->sender];
    f->ack.nodes = f->nodes;
    f->ack.hard = f->away;
    f->ack.drivers = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_timed_node *n = &bus->timed.nodes[i];
        const cw_mac *m = &bus->nodes[i].mac;
        const cw_span arrival = driven + cw_cable_delay(cable, f->sender, i, CW_DOMINANT);
        const cw_span sync = arrival - (arrival - n->begin) % n->timing.quantum;
        f->ack.begin[i] = sync + (slot - edge) * bus->timed.proof.bit[i];
        if (!(f->away >> i & 1u) && !(m->modes & CW_MODE_LISTEN_ONLY) && !m->no_ack)
            f->ack.drivers |= cw_node_bit(i);
    }
    f->ack.drivers &= ~cw_node_bit(f->sender);
    f->ack.begin[f->sender] = f->begin + slot * bus->timed.proof.bit[f->sender];
}

/* Finds the length of the frame and the course of its acknowledgement. */
static bool find_course(clean_frame *f, cw_bus *bus)
{
    cw_bits bits;
    (void)cw_bits_encode(&bits, f->frame);
    f->length = bits.length;
    plan_ack(f, bus, last_edge(&bits), f->length - CW_AFTER_ACK_BITS - 1u);
    return f->ack.drivers && cw_timed_find_edge(bus, &f->ack);
}

/* The step ends between two bit times, before the first node can begin another frame. */
static bool find_end(clean_frame *f, const cw_bus *bus)
{
    cw_span first = CW_SPAN_MAX, last_eof = 0, last_rx = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_span bit = bus->timed.proof.bit[i], delimiter = f->ack.next[i];
        const cw_span end = delimiter + BITS_AFTER_EOF * bit;
        const cw_span eof = delimiter + BITS_TO_EOF * bit;
        first = end < first ? end : first;
        last_eof = eof > last_eof ? eof : last_eof;
        if (i != f->sender)
            last_rx = eof - bit > last_rx ? eof - bit : last_rx;
    }
    f->bit_times = (uint64_t)((first - f->now) / bus->timed.bit_time);
    f->until = f->now + (cw_span)f->bit_times * bus->timed.bit_time;
    const cw_span sent = f->ack.next[f->sender] +
                         BITS_TO_EOF * bus->timed.proof.bit[f->sender];
    return last_eof < f->until && last_rx < sent &&
           f->ack.released + bus->timed.cable.longest < last_rx;
}

/* Returns the tick of the first frame to come, apart from the one on its way. */
static uint64_t next_frame_at(const cw_bus *bus, const clean_frame *f)
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
static bool is_undisturbed(const cw_bus *bus, const clean_frame *f, uint64_t tick)
{
    const uint64_t end = cw_tick_of(bus, f->until), first = next_frame_at(bus, f);
    const cw_span joined = f->begin + bus->timed.cable.longest + 3 * bus->timed.bit_time;
    return end <= tick && bus->node_due >= end && bus->rules.next_due >= end &&
           (first >= end || (first > cw_tick_of(bus, joined) && takes_all(bus)));
}

/* ---- Its effects ----------------------------------------------------------------------------- */

/* Counts bit times for load and statistics. */
static void count_bits(cw_bus *bus, uint64_t bits, bool busy)
{
    bus->stats.busy_bits += busy ? bits : 0;
    if (bits > 0)
        cw_load_add(&bus->load, bits * bus->load.unit, busy);
}

/* Returns the bit times of the step that begin before a moment. */
static uint64_t bit_times_before(const cw_bus *bus, const clean_frame *f, cw_span moment)
{
    if (moment <= f->now)
        return 0;
    const uint64_t n = (uint64_t)((moment - f->now + bus->timed.bit_time - 1) /
                                  bus->timed.bit_time);
    return n < f->bit_times ? n : f->bit_times;
}

/* The bus is busy up to the end of the intermission of the frame before, and from SOF on. */
static void count_load(cw_bus *bus, const clean_frame *f)
{
    const uint64_t before = bit_times_before(bus, f, f->busy);
    const uint64_t begin = bit_times_before(bus, f, f->begin);
    const uint64_t idle = begin > before ? begin - before : 0;
    cw_count_clean_bits(bus);
    count_bits(bus, before, true);
    count_bits(bus, idle, false);
    count_bits(bus, f->bit_times - before - idle, true);
    bus->stats.bits += f->bit_times;
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

/* Returns the receivers in the order in which their frames end. */
static unsigned sort_receivers(const cw_bus *bus, const clean_frame *f, uint8_t *order,
                               cw_span *ends)
{
    unsigned count = 0;
    for (uint64_t rest = f->nodes & ~f->away & ~cw_node_bit(f->sender); rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_span end = f->ack.next[i] + BITS_TO_RX * bus->timed.proof.bit[i];
        unsigned place = count++;
        for (; place > 0 && end < ends[place - 1]; place--) {
            ends[place] = ends[place - 1];
            order[place] = order[place - 1];
        }
        ends[place] = end;
        order[place] = (uint8_t)i;
    }
    return count;
}

/* Hands the frame to the receivers, each at its own tick, in the order of time. */
static void quantum_frame_receive(cw_bus *bus, const clean_frame *f)
{
    const cw_bus_node *n = &bus->nodes[f->sender];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    const cw_frame_origin origin = {.from = cw_node_bit(f->sender), .handed_in = slot->handed_in};
    uint8_t order[CW_NODES_MAX];
    cw_span ends[CW_NODES_MAX];
    cw_frame frame;
    cw_frame_copy(&frame, slot->frame);
    for (unsigned k = slot->bytes; k < CW_CLASSICAL_DATA_MAX; k++)
        frame.data[k] = 0; /* not on the wire */
    const unsigned count = sort_receivers(bus, f, order, ends);
    for (unsigned k = 0; k < count; k++) {
        cw_wire_go_to(&bus->time, cw_tick_of(bus, ends[k]));
        bus->nodes[order[k]].stats.rx_accepted++;
        cw_push_rx(bus, order[k], &frame, &origin);
    }
}

/* The frame becomes valid for its transmitter, at the tick of its end of EOF (M7). */
static void finish_transmission(cw_bus *bus, const clean_frame *f)
{
    const unsigned i = f->sender;
    cw_mac *m = &bus->nodes[i].mac;
    const cw_span end = f->ack.next[i] + BITS_TO_EOF * bus->timed.proof.bit[i];
    cw_wire_go_to(&bus->time, cw_tick_of(bus, end));
    cw_take_inbox_before(bus, cw_now(bus)); /* it waits while the other frame ends */
    cw_confinement_tx_success(&m->confinement);
    m->reported_state = m->confinement.state;
    cw_commit_sent(bus, i, f->length);
    cw_report_state(bus, i);
}

/* Puts a node into the bit in which it is at the end of the step, in or after the intermission. */
static void place_node(cw_bus *bus, const clean_frame *f, unsigned i)
{
    const cw_role role = i == f->sender ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER;
    const cw_span eof = f->ack.next[i] + BITS_TO_EOF * bus->timed.proof.bit[i];
    const unsigned sampled = cw_timed_place(bus, i, eof, f->until);
    if (!(f->away >> i & 1u))
        cw_mac_go_behind_frame(&bus->nodes[i].mac, role, sampled);
}

/* Does all that the frame brings, then places the nodes behind it. */
static void go_to_end(cw_bus *bus, const clean_frame *f)
{
    const uint64_t now = cw_now(bus);
    count_load(bus, f);
    if (f->due)
        cw_take_inbox(bus, f->due + 1);
    begin_attempt(bus, f->sender);
    quantum_frame_receive(bus, f);
    finish_transmission(bus, f);
    cw_wire_go_to(&bus->time, now);
    cw_wire_pass(&bus->time, f->bit_times);
    cw_agenda_clear(&bus->timed.agenda);
    for (unsigned i = 0; i < bus->node_count; i++)
        place_node(bus, f, i);
    const cw_span released = f->ack.released - f->now;
    bus->recessive_bits = f->bit_times - (uint64_t)(released / bus->timed.bit_time);
    bus->wire = CW_RECESSIVE;
    bus->timed.moment = f->until;
    bus->outlook.valid = false;
    cw_take_inbox_before(bus, cw_now(bus));
    cw_timed_leave(bus);
}

bool cw_timed_frame_go(cw_bus *bus, uint64_t tick)
{
    clean_frame f;
    if (!may_go(bus) || !find_frame(&f, bus))
        return false;
    cw_timed_rebase(bus);
    (void)cw_timed_proof(bus);
    f.nodes = bus->all;
    f.away = 0;
    f.now = f.busy = f.begin = cw_moment_of(bus, cw_now(bus));
    if (!may_send(bus, &f) || !find_begin(&f, bus) ||
        is_watched(bus, &f) || wins_improperly(bus, &f) || !find_course(&f, bus) ||
        !find_end(&f, bus) || !is_undisturbed(bus, &f, tick))
        return false;
    go_to_end(bus, &f);
    return true;
}
