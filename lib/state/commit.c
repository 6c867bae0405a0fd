/* SPDX-License-Identifier: MIT
 *
 * commit.c - turns the reports of the controllers at the end of a bit into events and statistics.
 */
#include "state/state.h"

#include "mac/confinement.h"

void cw_count_clean_bits_now(cw_bus *bus)
{
    bus->stats.bits += bus->clean_bits;
    bus->stats.busy_bits += bus->clean_bits;
    cw_load_add(&bus->load, bus->clean_bits * bus->load.unit, true);
    bus->clean_bits = 0;
}

/* Returns the offered slot, whose contents stay readable until the next frame is put in. */
static const cw_queue_slot *offered_slot(const cw_bus_node *n)
{
    return cw_queue_at(&n->queue, n->offered_slot);
}

/* Counts a frame for its transmitter, which has sent it at a tick, and for the bus if it was on the
 * wire (M15). */
static inline void count_sent(cw_bus *bus, cw_bus_node *n, const cw_queue_slot *slot,
                              unsigned wire_bits, uint64_t tick)
{
    n->stats.tx_frames++;
    n->stats.tx_bytes += slot->bytes;
    n->stats.tx_bits += wire_bits;
    if (!(n->mac.modes & CW_MODE_LOOPBACK)) { /* M15: not on the wire */
        bus->stats.frames++;
        bus->stats.fd_frames += cw_frame_is_fd(slot->frame);
        bus->stats.frame_bits += wire_bits;
    }
    cw_delay_add(&n->stats.delay, tick - slot->handed_in);
}

/* Adds what time-triggered operation knows of a frame that has been sent. */
static void commit_time(cw_bus *bus, unsigned i, const cw_queue_slot *slot, cw_event *e)
{
    e->trigger = slot->trigger;
    e->late = slot->trigger ? cw_tt_late(bus, i, slot) : 0;
    cw_tt_sent(bus, i, slot);
}

void cw_commit_sent(cw_bus *bus, unsigned i, unsigned wire_bits)
{
    cw_bus_node *n = &bus->nodes[i];
    const cw_queue_slot *slot = offered_slot(n);
    count_sent(bus, n, slot, wire_bits, cw_now(bus));
    cw_note_end(bus, i, cw_now(bus));
    cw_remove_slot(bus, i, n->offered_slot);
    cw_event *e = cw_push_node_event(bus, CW_EVENT_TX, i);
    cw_frame_copy(&e->frame, slot->frame);
    e->from = cw_node_bit(i);
    e->handed_in = slot->handed_in;
    if (bus->tt)
        commit_time(bus, i, slot, e);
}

void cw_commit_rx_tx(cw_bus *bus, const cw_rx_tx *pair)
{
    const unsigned i = pair->sender;
    const uint64_t self = cw_node_bit(i);
    cw_bus_node *n = &bus->nodes[i];
    const cw_queue_slot *slot = offered_slot(n);
    cw_set_listeners(bus, pair->receivers | self);
    cw_count_received(bus, i, slot->bytes);
    cw_queue_copy_received(&pair->rx->frame, slot);
    cw_frame_copy(&pair->tx->frame, slot->frame);
    pair->rx->from = pair->tx->from = self;
    pair->rx->handed_in = pair->tx->handed_in = slot->handed_in;
    count_sent(bus, n, slot, slot->wire_bits, pair->ended);
    bus->starts[i].stopped = pair->ended;
    bus->starts[i].handed_in = slot->handed_in;
    bus->starts[i].end = CW_END_SENT;
    cw_remove_sent(bus, i);
    if (n->mac.confinement.tec == 0)
        return;
    cw_confinement_tx_success(&n->mac.confinement);
    pair->tx->tec = n->mac.confinement.tec;
    if (n->mac.reported_state == n->mac.confinement.state)
        return;
    n->mac.reported_state = n->mac.confinement.state;
    cw_report_state(bus, i);
}

/* Commits that a one-shot node has given up its frame. */
static void commit_given_up(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_remove_slot(bus, i, n->offered_slot);
    if (bus->tt)
        cw_tt_failed(bus, i, n->offered_slot);
    cw_push_drop(bus, i, CW_SIDE_TX, offered_slot(n)->frame, CW_DROP_ONE_SHOT, cw_now(bus))
        ->trigger = offered_slot(n)->trigger;
}

void cw_report_arbitration_lost(cw_bus *bus, unsigned i, uint8_t bit)
{
    bus->nodes[i].stats.arbitration_lost++;
    bus->stats.arbitration_lost++;
    if (bus->tt)
        cw_tt_lost(bus, i, bus->nodes[i].offered_slot);
    if (!cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST) && bus->rules.error_rules == 0)
        return;
    cw_event *e = cw_push_node_event(bus, CW_EVENT_ARBITRATION_LOST, i);
    e->lost_bit = bit;
    e->trigger = offered_slot(&bus->nodes[i])->trigger;
    cw_frame_copy(&e->frame, offered_slot(&bus->nodes[i])->frame);
    e->frame.flags &= (uint8_t)~CW_FRAME_ESI; /* it has not been sent */
    cw_rules_error(&bus->rules, i, e);
}

/* Reports an error, counts it, and shows it to rules that wait for errors. */
static void report_error(cw_bus *bus, unsigned i, const cw_error *error, bool fast)
{
    cw_event *e = cw_push_node_event(bus, CW_EVENT_ERROR, i);
    e->error = *error;
    e->fast = fast;
    cw_find_error_frame(bus, i, e);
    if (fast && bus->timed.rates)
        bus->timed.rates[i].stats.errors[error->type]++;
    bus->nodes[i].stats.errors[error->type]++;
    cw_rules_error(&bus->rules, i, e);
}

/* Returns the frame that a node is sending, as it is on the wire. */
static const cw_frame *sent_frame(const cw_bus_node *n)
{
    const cw_frame *offered = cw_mac_offered(&n->mac);
    return offered ? offered : offered_slot(n)->frame;
}

/* Returns true when the accepted content is not what any transmitter sent (section 6 of
 * RULES.md). */
static bool is_corrupted(const cw_bus *bus, const cw_frame *frame)
{
    bool sent = false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_bus_node *n = &bus->nodes[i];
        if (!cw_mac_is_sending(&n->mac) || (n->mac.modes & CW_MODE_LOOPBACK))
            continue;
        if (cw_frame_equal(sent_frame(n), frame))
            return false;
        sent = true;
    }
    return sent;
}

void cw_receive(cw_bus *bus, unsigned i, const cw_frame *received)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_frame frame;
    cw_frame_copy(&frame, received);
    if (!(n->mac.modes & CW_MODE_LOOPBACK) && is_corrupted(bus, &frame)) {
        n->stats.undetected_errors++;
        bus->stats.undetected_errors++;
    }
    const cw_frame_origin origin = cw_find_origin(bus, i);
    if (bus->tt)
        cw_tt_received(bus, i, &frame, origin.from);
    if (!cw_buffers_accept(bus, i, &frame))
        return;
    cw_buffers_receive(bus, i, &frame, &origin);
}

cw_event *cw_receive_together(cw_bus *bus, unsigned sender, uint64_t receivers, unsigned bytes)
{
    cw_set_listeners(bus, receivers | cw_node_bit(sender));
    cw_count_received(bus, sender, bytes);
    cw_event *e = cw_push_node_event(bus, CW_EVENT_RX, cw_lowest_node(receivers));
    e->nodes = receivers;
    e->from = cw_node_bit(sender);
    e->handed_in = offered_slot(&bus->nodes[sender])->handed_in;
    return e;
}

bool cw_commit_reception(cw_bus *bus)
{
    const cw_frame *frame = cw_mac_received(&bus->common);
    if (cw_host_side_acts(bus) || bus->group_count > 1 || bus->rules.raw)
        return false;
    uint64_t senders = cw_find_senders(bus, cw_lowest_node(bus->followers));
    if (senders == 0 || (senders & (senders - 1)) || is_corrupted(bus, frame))
        return false;
    const unsigned sender = cw_lowest_node(senders);
    cw_event *e = cw_receive_together(bus, sender, bus->followers, cw_frame_length(frame));
    e->handed_in = cw_handed_in_of(bus, sender);
    cw_frame_copy(&e->frame, frame);
    return true;
}

/* Keeps ESI as it was sent (D8). */
static void keep_sent_flags(const cw_bus_node *n)
{
    const cw_frame *sent = cw_mac_offered(&n->mac);
    if (sent)
        cw_queue_at(&n->queue, n->offered_slot)->frame->flags = sent->flags;
}

/* A node that sleeps reports nothing but what wakes it. */
static void commit_asleep(cw_bus *bus, unsigned i, const cw_mac_report *r)
{
    if (r->what & CW_REPORT_WAKE)
        cw_sleep_wake(bus, i, CW_WAKE_PATTERN);
    else if ((r->what & CW_REPORT_RX) && (bus->listening >> i & 1u))
        cw_sleep_hear(bus, i, cw_mac_received(&bus->nodes[i].mac));
    cw_report_state(bus, i);
}

#define BEFORE_ERROR                                                                               \
    (CW_REPORT_STARTED | CW_REPORT_DROPPED | CW_REPORT_ARBITRATION_LOST | CW_REPORT_ARBITRATION_WON)

/* Commits what comes before the error of a report. The frame that bus-off takes back stays in the
 * queue; the restart drops it with all others. */
static void commit_before_error(cw_bus *bus, unsigned i, const cw_mac_report *r)
{
    if ((r->what & CW_REPORT_DROPPED) && r->why == CW_DROP_ONE_SHOT)
        commit_given_up(bus, i);
    if (r->what & CW_REPORT_ARBITRATION_LOST)
        cw_report_arbitration_lost(bus, i, r->lost_bit);
    if (r->what & CW_REPORT_ARBITRATION_WON)
        cw_order_check(bus, i);
}

/* Commits what comes behind the error. */
static void commit_rest(cw_bus *bus, unsigned i, const cw_mac_report *r)
{
    if (r->what & CW_REPORT_TOLERATED)
        cw_push_node_event(bus, CW_EVENT_TOLERATED, i)->error = r->error;
    if (r->what & CW_REPORT_OVERLOAD) {
        (void)cw_push_node_event(bus, CW_EVENT_OVERLOAD, i);
        bus->nodes[i].stats.overloads++;
    }
    if (r->what & CW_REPORT_RX)
        cw_receive(bus, i, cw_mac_received(cw_mac_of(bus, i)));
    if (r->what & CW_REPORT_EXCEPTION)
        (void)cw_push_node_event(bus, CW_EVENT_EXCEPTION, i);
    if (r->what & CW_REPORT_TX) {
        keep_sent_flags(&bus->nodes[i]);
        cw_commit_sent(bus, i, cw_mac_tx(&bus->nodes[i].mac)->length);
    }
    if (r->what & CW_REPORT_SLEEP)
        cw_sleep_settle(bus, i);
}

void cw_commit_node(cw_bus *bus, unsigned i, const cw_mac_report *r)
{
    if (bus->asleep >> i & 1u) {
        commit_asleep(bus, i, r);
        return;
    }
    cw_note_report(bus, i, r);
    if (r->what & BEFORE_ERROR)
        commit_before_error(bus, i, r);
    if (r->what & CW_REPORT_ERROR)
        report_error(bus, i, &r->error, r->fast);
    if (r->what & ~(BEFORE_ERROR | CW_REPORT_ERROR))
        commit_rest(bus, i, r);
    cw_report_state(bus, i);
}

void cw_commit_early(cw_bus *bus, unsigned i)
{
    cw_mac_report *pending = &bus->timed.nodes[i].report;
    if (!bus->timed.active || pending->what == 0)
        return;
    const cw_mac_report report = *pending;
    pending->what = 0;
    cw_commit_node(bus, i, &report);
}
