/* SPDX-License-Identifier: MIT
 *
 * bit.c - one bit of all nodes: they drive, the wire is the AND of the levels, then they sample.
 *
 * Frames handed in meanwhile go to their queues before the nodes sample. So the order of the nodes
 * matters only for the order of events. This is the reference: all other steps have the results of
 * single bits.
 */
#include "step/step.h"

#include "format/bits.h"

#include <assert.h>

/* ---- One bit: drive -------------------------------------------------------------------------- */

/* Chooses the frame anew at each start (M1), but encodes it only when it is another one. */
void cw_offer_first(cw_bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (!n->mac.offered || n->offered_slot != slot)
        cw_offer_slot(n, slot);
}

void cw_offer_slot(cw_bus_node *n, uint16_t slot)
{
    n->offered_slot = slot;
    n->deviates = 0;
    cw_status status = cw_mac_offer(&n->mac, cw_queue_at(&n->queue, slot)->frame);
    assert(status == CW_OK);
    (void)status;
}

void cw_bind_rules(cw_bus *bus, unsigned i, const cw_frame *frame, unsigned source)
{
    cw_bus_node *n = &bus->nodes[i];
    const bool wrong_crc = cw_rules_bind(&bus->rules, i, frame);
    const unsigned deviations = source ? cw_rules_deviations(&bus->rules, source) : 0;
    const uint8_t deviates = (uint8_t)(deviations | (wrong_crc ? CW_WRONG_CRC : 0));
    if (n->deviates == deviates)
        return;
    n->deviates = deviates;
    cw_mac_encode(&n->mac, frame, (wrong_crc ? 1 : 0) | deviations << CW_DEVIATES_SHIFT);
}

/* Returns the tick at which the SOF of a node's frame began, which the node has begun to send. It
 * may have joined a SOF that came from another node (M6). */
static uint64_t begin_of_sof(const cw_bus *bus, const cw_mac *m)
{
    const uint64_t bit = cw_rate_ticks(cw_wire_rate(&bus->time), 1);
    return m->tx_next ? cw_now(bus) - bit : cw_now(bus);
}

void cw_note_start(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    cw_share_lost(bus, i);
    n->stats.retransmissions += slot->tried;
    slot->tried = true;
    bus->starts[i].stopped = 0; /* in loopback its own receptions are of this frame */
    if (n->mac.modes & CW_MODE_LOOPBACK) /* M15: the frame is not on the wire */
        return;
    bus->error_flag = (cw_flag_watch){.now = false};
    bus->overload_flag = (cw_flag_watch){.now = false};
    cw_order_begin(bus, i, begin_of_sof(bus, &n->mac));
    cw_bind_rules(bus, i, slot->frame, slot->source);
}

/* Notes that a node sends SOF, for traces and for triggers (L5). */
static void note_start(cw_bus *bus, unsigned i)
{
    cw_note_start(bus, i);
    if (bus->tt)
        cw_tt_started(bus, i, bus->nodes[i].offered_slot, cw_now(bus));
}

/* Returns the levels that all nodes put onto their wires; recessive beyond the last node. */
static uint64_t drive_all(cw_bus *bus)
{
    uint64_t levels = UINT64_MAX;
    if (bus->followers && cw_mac_may_start(&bus->common))
        cw_leave(bus, bus->waiting);
    if (bus->followers && cw_mac_drive(&bus->common) == CW_DOMINANT)
        levels &= ~bus->followers;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_bus_node *n = &bus->nodes[i];
        if (n->queue.count > 0 && cw_mac_may_start(&n->mac)) {
            cw_mailboxes_load(bus, i);
            cw_offer_first(n);
        }
        if (cw_mac_drive(&n->mac) == CW_DOMINANT)
            levels &= ~cw_node_bit(i);
        if (n->mac.started)
            note_start(bus, i);
    }
    return levels;
}

/* ---- One bit: state of the wire -------------------------------------------------------------- */

/* Notes for that many bits that a flag is on the wire, or not. Skipped bits begin and end no
 * flag. */
static void watch_flag(cw_flag_watch *w, bool now, uint64_t bits, uint64_t *frames)
{
    if (now && !w->now)
        (*frames)++;
    if (w->now) {
        w->length++;
        w->over = w->over || !now;
    }
    w->now = now;
    if (now)
        w->length += bits - 1;
}

/* Returns what a node is doing to the wire. A node in loopback does nothing to it, and a node that
 * only listens sends no flags (M11, M15). */
static unsigned view_mac(const cw_mac *m)
{
    static const uint8_t views[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_FRAME] = CW_WIRE_BUSY,
        [CW_MAC_ERROR_ACTIVE] = CW_WIRE_BUSY | CW_WIRE_ERROR,
        [CW_MAC_ERROR_PASSIVE] = CW_WIRE_BUSY | CW_WIRE_ERROR,
        [CW_MAC_ERROR_WAIT] = CW_WIRE_BUSY,
        [CW_MAC_ERROR_DELIMITER] = CW_WIRE_BUSY,
        [CW_MAC_OVERLOAD_FLAG] = CW_WIRE_BUSY | CW_WIRE_OVERLOAD,
        [CW_MAC_OVERLOAD_WAIT] = CW_WIRE_BUSY,
        [CW_MAC_OVERLOAD_DELIMITER] = CW_WIRE_BUSY,
        [CW_MAC_INTERMISSION] = CW_WIRE_BUSY,
    };
    if (m->modes & CW_MODE_LOOPBACK)
        return 0;
    return m->modes & CW_MODE_LISTEN_ONLY ? views[m->phase] & CW_WIRE_BUSY : views[m->phase];
}

unsigned cw_view_wire(const cw_bus *bus)
{
    unsigned view = bus->followers ? view_mac(&bus->common) : 0;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1)
        view |= view_mac(&bus->nodes[cw_lowest_node(rest)].mac);
    return view;
}

void cw_watch_view(cw_bus *bus, unsigned view, uint64_t bits)
{
    cw_count_clean_bits(bus);
    watch_flag(&bus->error_flag, view & CW_WIRE_ERROR, bits, &bus->stats.error_frames);
    watch_flag(&bus->overload_flag, view & CW_WIRE_OVERLOAD, bits, &bus->stats.overload_frames);
    bus->stats.busy_bits += view & CW_WIRE_BUSY ? bits : 0;
    cw_load_add(&bus->load, bits * bus->load.unit - bus->time.short_by, view & CW_WIRE_BUSY);
}

/* ---- One bit --------------------------------------------------------------------------------- */

typedef struct bit_reports {
    uint64_t together; /* nodes for which `common` holds */
    uint64_t from;     /* nodes with a report to commit */
    cw_mac_report common;
    cw_mac_report own[CW_NODES_MAX];
} bit_reports;

/* Adds the reports of nodes that are woken in this bit. */
static void look_for_wake_ups(cw_bus *bus, uint64_t levels, bit_reports *reports)
{
    const uint64_t woken = cw_doze(bus, levels, 1);
    for (uint64_t rest = woken; rest; rest &= rest - 1)
        reports->own[cw_lowest_node(rest)].what |= CW_REPORT_WAKE;
    reports->from |= woken;
}

/* Lets all controllers sample, those that share one together. Collects who has anything to
 * report. */
static void sample_all(cw_bus *bus, uint64_t levels, bit_reports *reports)
{
    cw_split_followers(bus, levels);
    reports->together = bus->followers;
    reports->from = 0;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac_sample(&bus->nodes[i].mac, levels >> i & 1u, &reports->own[i]);
        if (reports->own[i].what & ~CW_REPORT_STARTED)
            reports->from |= cw_node_bit(i);
    }
    if (bus->followers && cw_sample_common(bus, levels, &reports->common))
        reports->from |= reports->together;
    if (bus->dozing)
        look_for_wake_ups(bus, levels, reports);
}

/* Turns the reports of a bit into events, in the order of the nodes. */
static void commit(cw_bus *bus, const bit_reports *reports)
{
    bool reception = reports->from == reports->together && reports->common.what == CW_REPORT_RX;
    if (reception && cw_commit_reception(bus))
        return;
    for (uint64_t rest = reports->from & ~reports->together; rest; rest &= rest - 1)
        cw_note_report(bus, cw_lowest_node(rest), &reports->own[cw_lowest_node(rest)]);
    for (uint64_t rest = reports->from; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool together = reports->together >> i & 1u;
        cw_commit_node(bus, i, together ? &reports->common : &reports->own[i]);
    }
}

/* Joins nodes that have come to the point of the others: between frames, or after a lost
 * arbitration. */
static void gather(cw_bus *bus, const bit_reports *reports)
{
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool lost = !(reports->together >> i & 1u) &&
                    (reports->own[i].what & CW_REPORT_ARBITRATION_LOST);
        if (lost || bus->nodes[i].mac.phase == CW_MAC_IDLE)
            cw_join(bus, i);
    }
}

/* The bit is over: time goes on, and recessive bits in a row are counted. */
static void end_bit(cw_bus *bus)
{
    cw_wire_end_bit(&bus->time);
    bus->stats.bits++;
    bus->recessive_bits = bus->wire ? bus->recessive_bits + 1 : 0;
}

void cw_find_levels(cw_bus *bus, cw_levels *levels)
{
    if (bus->rules.awake_count) {
        if (bus->rules.rewired)
            cw_apply_topology(bus);
        cw_rules_change_driven(&bus->rules, levels);
    }
    levels->clean = levels->wire = levels->sampled = cw_wired_and(bus, levels->driven);
    if (bus->rules.awake_count)
        cw_rules_change_sampled(&bus->rules, levels);
    bus->wire = (bus->all & ~levels->wire) == 0;
}

/* Ends a bit whose levels are known: nodes sample, rules report, events follow. */
static void finish_bit(cw_bus *bus, const cw_levels *levels)
{
    bit_reports reports;
    cw_take_inbox_before(bus, cw_bit_end(bus));
    sample_all(bus, levels->sampled, &reports);
    end_bit(bus);
    if (bus->rules.awake_count)
        cw_rules_emit(&bus->rules);
    if (reports.from)
        commit(bus, &reports);
    if (!bus->stepping)
        gather(bus, &reports);
}

void cw_step_bit(cw_bus *bus)
{
    cw_outlook_forget(bus);
    cw_levels levels = {.driven = drive_all(bus)};
    cw_watch_wire(bus, 1);
    cw_find_levels(bus, &levels);
    if (bus->stepping || bus->watching)
        cw_view_note(bus, &levels);
    finish_bit(bus, &levels);
}

void cw_step_with(cw_bus *bus, const cw_levels *levels)
{
    (void)drive_all(bus);
    cw_watch_wire(bus, 1);
    finish_bit(bus, levels);
}
