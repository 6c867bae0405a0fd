/* SPDX-License-Identifier: MIT
 *
 * tt.c - time-triggered operation: captures, basic cycles, and the slots in which frames go.
 *
 * A capture becomes known at the end of its frame (L3). A reference message begins a basic cycle
 * (L4). The frame of the next trigger goes to the inbox shortly before its tick. The inbox knows
 * how frames come to nodes in the middle of bits. At the end of its slot a frame that has not
 * begun is taken out of the queue (L5).
 */
#include "state/state.h"

#include <string.h>

#define HAND_IN_EARLY_BITS 4u /* of the node, or of the bus, whichever are longer */

/* Returns true for a reference message of the node's schedule (L4). */
static bool matches_reference(const cw_tt *s, const cw_frame *frame)
{
    return s->schedule.cycles > 0 && cw_frame_matches(frame, &s->schedule.reference, 1);
}

/* ---- Moments --------------------------------------------------------------------------------- */

/* Returns the sample point of a bit that begins at a tick, where bits are common to all nodes. */
static cw_instant sample_point(const cw_bus *bus, unsigned i, uint64_t begin)
{
    const cw_timed *t = &bus->timed;
    const cw_bit_timing *timing = t->rates ? &t->rates[i].nominal : &t->nodes[i].timing;
    if (!t->divides)
        return (cw_instant){.tick = begin};
    return cw_instant_after(begin, timing->quantum * cw_bit_timing_sample_at(timing));
}

/* Returns local time at the sample point of a bit that began at a tick (L3). */
static uint64_t local_at_sample(const cw_bus *bus, unsigned i, uint64_t begin)
{
    return cw_local_at(&bus->tt[i].clock, sample_point(bus, i, begin));
}

static uint64_t ticks_of_bit(const cw_bus *bus)
{
    return cw_rate_ticks(cw_wire_rate(&bus->time), 1);
}

/* Returns a moment in the time of local clocks. */
static cw_instant instant_of(const cw_bus *bus, cw_span moment)
{
    return cw_instant_after(bus->timed.epoch, moment);
}

void cw_tt_see_sof(cw_bus *bus, unsigned i, uint64_t begin)
{
    cw_tt *s = &bus->tt[i];
    if (s->config.bits == 0)
        return;
    s->sof = local_at_sample(bus, i, begin);
    s->eof_seen = false;
}

void cw_tt_see_sofs(cw_bus *bus, uint64_t nodes, uint64_t begin)
{
    for (uint64_t rest = nodes & bus->all; rest; rest &= rest - 1)
        cw_tt_see_sof(bus, cw_lowest_node(rest), begin);
}

void cw_tt_look(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_mac *m = cw_mac_of(bus, i);
        if (cw_mac_has_seen_sof(m))
            cw_tt_see_sof(bus, i, cw_now(bus) - ticks_of_bit(bus));
    }
}

void cw_tt_see_sof_at(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_tt *s = &bus->tt[i];
    if (s->config.bits == 0)
        return;
    s->sof = cw_local_at(&s->clock, instant_of(bus, moment));
    s->eof_seen = false;
}

void cw_tt_see_eof_at(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_tt *s = &bus->tt[i];
    if (s->config.bits == 0)
        return;
    s->eof = cw_local_at(&s->clock, instant_of(bus, moment));
    s->eof_seen = true;
}

/* ---- Triggers -------------------------------------------------------------------------------- */

/* Notes that a trigger or a deadline of the node comes. */
static void note_due(cw_bus *bus, unsigned i)
{
    bus->node_due = cw_least(bus->node_due, cw_tt_due(bus, i));
}

/* Returns true when a trigger sends the reference message: the node is time master (L4). */
static bool is_reference(const cw_tt *s, unsigned k)
{
    return matches_reference(s, &s->schedule.triggers[k].frame);
}

/* Returns true when a trigger acts in the present basic cycle. Without one only the reference
 * message goes. */
static bool acts(const cw_tt *s, unsigned k)
{
    const cw_time_trigger *t = &s->schedule.triggers[k];
    if (is_reference(s, k))
        return true;
    return s->in_cycle && (t->repeat == 0 || s->cycle % t->repeat == t->cycle);
}

/* Returns how long before its tick a frame goes to the inbox. A node takes frames up to the end of
 * its bit when it samples. */
static uint64_t early(const cw_bus *bus, unsigned i)
{
    const cw_bit_timing *t = &bus->timed.nodes[i].timing;
    const uint64_t own = (uint64_t)(t->quantum / CW_TICK + 1) * cw_bit_timing_quanta(t);
    const uint64_t bit = ticks_of_bit(bus);
    return HAND_IN_EARLY_BITS * (own > bit && bus->timed.divides ? own : bit);
}

/* Plans the next trigger. */
static void plan(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    while (s->next < s->schedule.trigger_count && !acts(s, s->next))
        s->next++;
    s->hand_in = CW_NEVER;
    if (s->next == s->schedule.trigger_count || (bus->removed & cw_node_bit(i)))
        return;
    const uint64_t margin = early(bus, i);
    s->next_tick = cw_local_tick(&s->clock, s->base + s->schedule.triggers[s->next].at);
    s->hand_in = s->next_tick > margin ? s->next_tick - margin : 0;
    if (s->next_tick == CW_NEVER)
        s->hand_in = CW_NEVER;
    note_due(bus, i);
}

/* Returns the number of the basic cycle that the next reference message begins. */
static uint16_t next_cycle(const cw_tt *s)
{
    if (!s->references)
        return 0;
    return (uint16_t)((s->cycle + 1u) % s->schedule.cycles);
}

/* Returns the place of the slot's frame in the queue when it has not begun; NULL: it has, or has
 * left the queue. */
static const cw_queue_place *waiting_frame(const cw_bus_node *n)
{
    for (unsigned k = 0; k < n->queue.count; k++) {
        const cw_queue_place *place = &n->queue.order[k];
        const bool sent = n->offered_slot == place->slot && cw_mac_is_sending(&n->mac);
        if (cw_queue_at(&n->queue, place->slot)->trigger && !sent)
            return place;
    }
    return NULL;
}

/* Returns true when a frame of a trigger is under way that will be tried again. */
static bool may_come_back(const cw_bus_node *n)
{
    return cw_mac_is_sending(&n->mac) && !(n->mac.modes & CW_MODES_SINGLE) &&
           cw_queue_at(&n->queue, n->offered_slot)->trigger;
}

/* Returns true when a node off the grid has a report of its frame, which the end of its bit
 * commits. */
static bool has_ended(const cw_bus *bus, unsigned i)
{
    const unsigned ends = CW_REPORT_TX | CW_REPORT_DROPPED | CW_REPORT_ARBITRATION_LOST;
    return bus->timed.active && (bus->timed.nodes[i].report.what & ends);
}

/* Gives the frame of the open slot up, if it has not begun (L5). */
static void close_slot(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    cw_bus_node *n = &bus->nodes[i];
    const cw_queue_place *place = waiting_frame(n);
    if (has_ended(bus, i)) {
        s->deadline = cw_bit_end(bus);
        return;
    }
    s->deadline = CW_NEVER;
    if (!place) {
        if (may_come_back(n))
            s->deadline = cw_bit_end(bus);
        return;
    }
    const uint16_t slot = place->slot;
    s->stats[s->open].missed++;
    if (n->mac.offered && n->offered_slot == slot)
        cw_own_mac(bus, i)->offered = false;
    cw_remove_slot(bus, i, slot);
    cw_push_drop(bus, i, CW_SIDE_TX, cw_queue_at(&n->queue, slot)->frame, CW_DROP_SLOT_MISSED,
                 cw_now(bus))->trigger = cw_queue_at(&n->queue, slot)->trigger;
}

/* Returns the tick in which a moment of a bus off the grid lies, or which it is. */
static uint64_t tick_of(const cw_bus *bus, cw_span moment)
{
    return bus->timed.epoch + (uint64_t)(moment + CW_TICK - 1) / CW_TICK;
}

bool cw_tt_closes_by(const cw_bus *bus, unsigned i, cw_span moment)
{
    return bus->tt[i].deadline <= tick_of(bus, moment);
}

void cw_tt_close_at(cw_bus *bus, unsigned i, cw_span moment)
{
    const uint64_t now = cw_now(bus);
    if (!cw_tt_closes_by(bus, i, moment))
        return;
    cw_wire_go_to(&bus->time, tick_of(bus, moment));
    close_slot(bus, i);
    cw_wire_go_to(&bus->time, now);
}

/* A slot without a bit that could begin in it. */
static void miss(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    bus->nodes[i].stats.made_by_rules++;
    bus->tt[i].stats[bus->tt[i].open].missed++;
    cw_push_drop(bus, i, CW_SIDE_TX, frame, CW_DROP_SLOT_MISSED, cw_now(bus))->trigger =
        (uint16_t)(bus->tt[i].open + 1);
}

/* Opens the slot of the next trigger: its frame goes to the inbox. A reference message that is not
 * sent is tried again when its time comes once more (L4). */
static void open_slot(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    const cw_time_trigger *t = &s->schedule.triggers[s->next];
    const uint64_t tick = s->next_tick;
    cw_frame frame;
    cw_frame_copy(&frame, &t->frame);
    s->open = s->next++;
    s->stats[s->open].slots++;
    s->end = s->base + t->at + t->slot;
    s->deadline = cw_local_tick(&s->clock, s->end);
    if (is_reference(s, s->open)) {
        if (s->schedule.cycle_byte < cw_frame_length(&frame))
            frame.data[s->schedule.cycle_byte] = (uint8_t)next_cycle(s);
        s->base += t->at;
        s->in_cycle = false;
        s->next = 0;
    }
    plan(bus, i);
    if (s->next <= s->open && s->hand_in <= cw_now(bus))
        s->hand_in = cw_bit_end(bus);
    if (s->deadline > cw_now(bus)) {
        cw_inbox_put_triggered(bus, i, &frame, tick, s->open + 1);
        note_due(bus, i);
        return;
    }
    s->deadline = CW_NEVER;
    miss(bus, i, &frame);
}

/* Returns true when the slot before the next one is still open. */
static bool waits_for_slot(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    const bool open = s->deadline != CW_NEVER &&
                      (waiting_frame(&bus->nodes[i]) || bus->inbox.triggered >> i & 1u);
    if (open)
        s->hand_in = cw_least(s->deadline, cw_bit_end(bus));
    return open;
}

/* ---- Outcomes of slots ----------------------------------------------------------------------- */

/* Returns the statistics of the trigger whose frame is in a slot of the queue; NULL: none. */
static cw_trigger_stats *stats_of(cw_bus *bus, unsigned i, unsigned slot)
{
    const unsigned trigger = cw_queue_at(&bus->nodes[i].queue, slot)->trigger;
    return trigger ? &bus->tt[i].stats[trigger - 1] : NULL;
}

void cw_tt_started(cw_bus *bus, unsigned i, unsigned slot, uint64_t tick)
{
    cw_trigger_stats *stats = stats_of(bus, i, slot);
    if (!stats)
        return;
    const uint64_t late = tick - cw_queue_at(&bus->nodes[i].queue, slot)->handed_in;
    bus->tt[i].started = tick;
    stats->started++;
    stats->late_most = late > stats->late_most ? late : stats->late_most;
    if (stats->started == 1 || late < stats->late_least)
        stats->late_least = late;
}

uint64_t cw_tt_late(const cw_bus *bus, unsigned i, const cw_queue_slot *slot)
{
    return bus->tt[i].started - slot->handed_in;
}

void cw_tt_lost(cw_bus *bus, unsigned i, unsigned slot)
{
    cw_trigger_stats *stats = stats_of(bus, i, slot);
    if (stats)
        stats->lost++;
}

void cw_tt_failed(cw_bus *bus, unsigned i, unsigned slot)
{
    cw_trigger_stats *stats = stats_of(bus, i, slot);
    if (stats)
        stats->failed++;
}

/* ---- Captures -------------------------------------------------------------------------------- */

/* Keeps the newest capture in front of the older ones (L7). */
static void tt_keep(cw_tt_capture kept[CW_TT_CAPTURES_KEPT], const cw_tt_capture *newest)
{
    memmove(&kept[1], &kept[0], (CW_TT_CAPTURES_KEPT - 1) * sizeof kept[0]);
    kept[0] = *newest;
}

/* Begins a basic cycle with a reference message that has been captured. */
static void begin_cycle(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    const cw_frame *frame = &s->pending.frame;
    const unsigned byte = s->schedule.cycle_byte;
    const cw_tt_capture capture = {
        .local = s->captured, .tick = cw_now(bus), .master = s->pending.from};
    if (byte < cw_frame_length(frame))
        s->cycle = (uint16_t)(frame->data[byte] % s->schedule.cycles);
    else
        s->cycle = next_cycle(s);
    s->references++;
    s->base = s->captured;
    s->in_cycle = true;
    s->next = 0;
    tt_keep(s->pending.own ? s->own : s->seen, &capture);
    plan(bus, i);
}

/* Reports the capture of a frame, when it has become valid (L3). */
static void report_capture(cw_bus *bus, unsigned i)
{
    const cw_tt *s = &bus->tt[i];
    if (!cw_wants_event(bus, CW_EVENT_CAPTURE))
        return;
    cw_event *e = cw_push_node_event(bus, CW_EVENT_CAPTURE, i);
    cw_frame_copy(&e->frame, &s->pending.frame);
    e->from = s->pending.all_from;
    e->local_time = cw_tt_visible(s, s->captured);
}

/* Makes the capture of a frame known, at the end of its last bit. A node whose clock is its own may
 * not have sampled that one yet. One that has left the bus never does. */
static void publish(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    const cw_mac *m = cw_mac_of(bus, i);
    const bool known = s->pending.known || s->eof_seen;
    const bool away = m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF;
    if (!known && bus->timed.active && m->phase == CW_MAC_FRAME) {
        s->pending.due = cw_bit_end(bus);
        return;
    }
    const uint64_t begin = s->pending.due - ticks_of_bit(bus);
    s->pending.due = CW_NEVER;
    if (!known && away)
        return;
    s->captured = s->pending.known ? s->pending.local
                  : s->eof_seen    ? s->eof
                                   : local_at_sample(bus, i, begin);
    s->captures++;
    if (matches_reference(s, &s->pending.frame))
        begin_cycle(bus, i);
    report_capture(bus, i);
}

/* Notes a valid frame whose capture may still come, at the last bit of EOF. */
static void note_pending(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t from)
{
    cw_tt *s = &bus->tt[i];
    cw_frame_copy(&s->pending.frame, frame);
    s->pending.all_from = from;
    s->pending.from = from ? (uint8_t)cw_lowest_node(from) : CW_NO_NODE;
    s->pending.own = from == cw_node_bit(i);
    s->pending.known = !s->config.at_eof;
    s->pending.local = s->sof;
}

void cw_tt_received(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t from)
{
    if (bus->tt[i].config.bits == 0)
        return;
    bus->tt[i].eof_seen = false;
    note_pending(bus, i, frame, from);
    bus->tt[i].pending.due = cw_now(bus) + ticks_of_bit(bus);
    note_due(bus, i);
}

void cw_tt_sent(cw_bus *bus, unsigned i, const cw_queue_slot *slot)
{
    cw_tt *s = &bus->tt[i];
    if (slot->trigger)
        s->stats[slot->trigger - 1].sent++;
    if (s->config.bits == 0)
        return;
    note_pending(bus, i, slot->frame, cw_node_bit(i));
    if (s->config.at_eof) {
        s->pending.local = s->eof_seen ? s->eof
                                       : local_at_sample(bus, i, cw_now(bus) - ticks_of_bit(bus));
        s->pending.known = true;
    }
    s->pending.due = cw_now(bus);
    note_due(bus, i);
}

/* ---- Running --------------------------------------------------------------------------------- */

uint64_t cw_tt_due(const cw_bus *bus, unsigned i)
{
    const cw_tt *s = bus->tt ? &bus->tt[i] : NULL;
    return s && s->config.bits ? cw_least(s->pending.due, cw_least(s->deadline, s->hand_in))
                               : CW_NEVER;
}

void cw_tt_run(cw_bus *bus, unsigned i)
{
    cw_tt *s = bus->tt ? &bus->tt[i] : NULL;
    if (!s || s->config.bits == 0)
        return;
    if (s->pending.due <= cw_now(bus))
        publish(bus, i);
    if (s->deadline <= cw_now(bus))
        close_slot(bus, i);
    while (s->hand_in <= cw_now(bus) && !waits_for_slot(bus, i))
        open_slot(bus, i); /* the one after a reference message comes later than now */
}

void cw_tt_retime(cw_bus *bus, unsigned i, cw_instant from)
{
    cw_tt *s = &bus->tt[i];
    if (s->config.bits == 0)
        return;
    const cw_span quantum = bus->timed.rates ? bus->timed.rates[i].nominal.quantum
                                             : bus->timed.nodes[i].timing.quantum;
    cw_local_retime(&s->clock, quantum, from);
    if (s->deadline != CW_NEVER)
        s->deadline = cw_local_tick(&s->clock, s->end);
    if (s->hand_in != CW_NEVER)
        plan(bus, i);
    note_due(bus, i);
}

void cw_tt_give_unit(cw_bus *bus, unsigned i, cw_span unit, cw_span quantum)
{
    cw_local_give_unit(&bus->tt[i].clock, unit, quantum);
}

void cw_tt_stop(cw_bus *bus, unsigned i)
{
    if (!bus->tt)
        return;
    bus->tt[i].pending.due = bus->tt[i].deadline = bus->tt[i].hand_in = CW_NEVER;
}

void cw_tt_start(cw_bus *bus, unsigned i)
{
    if (bus->tt[i].schedule.cycles)
        plan(bus, i);
}

/* ---- Reading --------------------------------------------------------------------------------- */

#define SAME_MESSAGE_BITS 4u /* of time between the ends of one message at two nodes */

uint64_t cw_tt_visible(const cw_tt *s, uint64_t local)
{
    return local & (UINT64_MAX >> (64 - s->config.bits));
}

/* Finds the capture of the master for the same reference message. */
static const cw_tt_capture *capture_of_master(const cw_bus *bus, const cw_tt_capture *seen)
{
    const uint64_t most = SAME_MESSAGE_BITS * ticks_of_bit(bus);
    if (seen->master >= bus->node_count || seen->tick == 0)
        return NULL;
    for (unsigned k = 0; k < CW_TT_CAPTURES_KEPT; k++) {
        const cw_tt_capture *own = &bus->tt[seen->master].own[k];
        const bool before = own->tick <= seen->tick;
        const uint64_t apart = before ? seen->tick - own->tick : own->tick - seen->tick;
        if (own->tick && apart <= most)
            return own;
    }
    return NULL;
}

/* Finds the newest two reference messages that a node has received from the same master. */
static unsigned find_pairs(const cw_bus *bus, const cw_tt *s, cw_time_pair pairs[2],
                           unsigned *master)
{
    unsigned found = 0;
    for (unsigned k = 0; k < CW_TT_CAPTURES_KEPT && found < 2; k++) {
        const cw_tt_capture *own = capture_of_master(bus, &s->seen[k]);
        if (!own || (found && s->seen[k].master != *master))
            continue;
        *master = s->seen[k].master;
        pairs[1 - found] = (cw_time_pair){.a = own->local, .b = s->seen[k].local};
        found++;
    }
    return found;
}

/* Finds the time of the master of the last reference message, at this node (L7). */
static bool global_time(const cw_bus *bus, unsigned i, uint64_t now, cw_node_time *out)
{
    const cw_tt *s = &bus->tt[i];
    cw_time_pair pairs[2];
    unsigned master = i;
    if (s->own[0].tick > s->seen[0].tick) {
        out->global = now;
        out->master = (uint8_t)i;
        return true;
    }
    if (find_pairs(bus, s, pairs, &master) < 2)
        return false;
    out->master = (uint8_t)master;
    return cw_global_time(pairs, bus->tt[master].config.bits, s->config.bits, now, &out->global);
}

cw_status cw_node_get_time(const cw_bus *bus, unsigned i, cw_node_time *out)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (!bus->tt || bus->tt[i].config.bits == 0)
        return CW_REFUSED;
    const cw_tt *s = &bus->tt[i];
    const uint64_t now = cw_local_at(&s->clock, (cw_instant){.tick = cw_now(bus)});
    *out = (cw_node_time){.local = cw_tt_visible(s, now), .captures = s->captures,
                          .captured = cw_tt_visible(s, s->captured),
                          .references = s->references, .in_cycle = s->in_cycle,
                          .cycle = s->cycle, .cycle_time = s->in_cycle ? now - s->base : 0,
                          .triggers = s->schedule.trigger_count};
    out->has_global = global_time(bus, i, out->local, out);
    return CW_OK;
}

cw_status cw_node_get_trigger_stats(const cw_bus *bus, unsigned i, unsigned trigger,
                                    cw_trigger_stats *stats)
{
    if (i >= bus->node_count || !bus->tt || trigger >= bus->tt[i].schedule.trigger_count)
        return CW_INVALID;
    *stats = bus->tt[i].stats[trigger];
    return CW_OK;
}

/* ---- Taking over ----------------------------------------------------------------------------- */

static bool is_same_trigger(const cw_time_trigger *a, const cw_time_trigger *b)
{
    return a->at == b->at && a->slot == b->slot && a->cycle == b->cycle &&
           a->repeat == b->repeat && cw_frame_equal(&a->frame, &b->frame);
}

/* Returns true when both schedules are the same, so that a node can go on with its cycle. */
static bool is_same_schedule(const cw_schedule *a, const cw_schedule *b)
{
    bool same = a->trigger_count == b->trigger_count && a->cycles == b->cycles &&
                a->cycle_byte == b->cycle_byte && a->reference.value == b->reference.value &&
                a->reference.mask == b->reference.mask &&
                a->reference.inverted == b->reference.inverted;
    for (unsigned k = 0; same && k < a->trigger_count; k++)
        same = is_same_trigger(&a->triggers[k], &b->triggers[k]);
    return same;
}

/* Another schedule goes on in the basic cycle of the old one, with what comes later. */
static void go_into_cycle(cw_bus *bus, unsigned i)
{
    cw_tt *s = &bus->tt[i];
    const uint64_t now = cw_local_at(&s->clock, (cw_instant){.tick = cw_now(bus)});
    if (s->schedule.cycles == 0)
        return;
    s->cycle = (uint16_t)(s->cycle % s->schedule.cycles);
    s->next = 0;
    while (s->next < s->schedule.trigger_count &&
           s->base + s->schedule.triggers[s->next].at <= now)
        s->next++;
    plan(bus, i);
}

/* Changes the masters' numbers to those of a new bus. */
static void renumber(cw_tt_capture kept[CW_TT_CAPTURES_KEPT], const uint8_t to[CW_NODES_MAX])
{
    for (unsigned k = 0; k < CW_TT_CAPTURES_KEPT; k++)
        if (kept[k].master < CW_NODES_MAX)
            kept[k].master = to[kept[k].master];
}

/* The counter goes on, unless it is another one now. Its unit may be longer or shorter: so is that
 * of a clock with another error. */
static bool is_same_counter(const cw_local_time *a, const cw_local_time *b)
{
    return a->bits == b->bits && a->start == b->start;
}

bool cw_tt_goes_on(const cw_tt *tt, const cw_tt *old)
{
    return tt->config.bits && is_same_counter(&tt->config, &old->config) &&
           is_same_schedule(&tt->schedule, &old->schedule);
}

void cw_tt_take_over(cw_bus *bus, unsigned i, const cw_tt *old, const uint8_t to[CW_NODES_MAX])
{
    cw_tt *s = &bus->tt[i];
    const cw_tt own = *s;
    if (s->config.bits == 0 || !is_same_counter(&s->config, &old->config))
        return;
    const bool same = is_same_schedule(&s->schedule, &old->schedule);
    *s = *old;
    s->config = own.config;
    s->schedule = own.schedule;
    s->stats = own.stats;
    cw_local_give_unit(&s->clock, own.clock.nominal, own.clock.quantum);
    if (!bus->timed.active)
        cw_local_retime(&s->clock, own.clock.quantum, (cw_instant){.tick = cw_now(bus)});
    renumber(s->own, to);
    renumber(s->seen, to);
    if (s->pending.from < CW_NODES_MAX)
        s->pending.from = to[s->pending.from];
    s->pending.all_from = 0;
    for (unsigned k = 0; same && k < s->schedule.trigger_count; k++)
        s->stats[k] = old->stats[k];
    if (same)
        return;
    s->deadline = CW_NEVER;
    s->hand_in = CW_NEVER;
    s->open = 0;
    go_into_cycle(bus, i);
}
