/* SPDX-License-Identifier: MIT
 *
 * host.c - the actions of the nodes' hosts: frames handed in, restart, settings.
 */
#include "bus/bus_private.h"

#include "mac/confinement.h"

#include <assert.h>

/* ---- Queues ---------------------------------------------------------------------------------- */

void cw_queue_changed(cw_bus *bus, unsigned i)
{
    if (bus->nodes[i].queue.count > 0)
        bus->waiting |= cw_node_bit(i);
    else
        bus->waiting &= ~cw_node_bit(i);
    cw_rules_forget_frame(&bus->rules, i);
    bus->arbiter.stale |= cw_node_bit(i);
}

/* Returns the reason why a node cannot take a frame now; CW_DROP_COUNT when it can. */
static cw_drop refusal(const cw_bus *bus, unsigned i, const cw_frame *frame)
{
    const bus_node *n = &bus->nodes[i];
    if (!cw_frame_valid(frame))
        return CW_DROP_BAD_FRAME;
    if (bus->detached & cw_node_bit(i))
        return bus->removed & cw_node_bit(i) ? CW_DROP_REMOVED : CW_DROP_LINK_DOWN;
    if (n->mac.modes & CW_MODE_LISTEN_ONLY)
        return CW_DROP_LISTEN_ONLY;
    if (cw_mac_state(&n->mac) == CW_STATE_BUS_OFF)
        return CW_DROP_BUS_OFF;
    return n->queue.count >= n->queue_limit ? CW_DROP_QUEUE_FULL : CW_DROP_COUNT;
}

void cw_pin_first(bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (n->offered_slot != slot || n->wrong_crc)
        n->mac.offered = false; /* not encoded */
    n->offered_slot = slot;
}

/* Keeps the frame with which a node has begun the arbitration under way, before another one comes
 * first. */
static void pin_frame(cw_bus *bus, unsigned i)
{
    cw_frame_step *step = &bus->frame_step;
    if (!step->active || !(step->hidden & ~step->pinned & cw_node_bit(i)))
        return;
    step->pinned |= cw_node_bit(i);
    cw_pin_first(&bus->nodes[i]);
}

static void enqueue(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick, unsigned source)
{
    bus_node *n = &bus->nodes[i];
    pin_frame(bus, i);
    bool put = cw_queue_put(&n->queue, frame, tick);
    assert(put);
    (void)put;
    bus->queued++;
    if (cw_queue_first(&n->queue) == n->queue.newest)
        cw_queue_changed(bus, i);
    n->queue.slots[n->queue.newest].source = (uint16_t)source;
    if (n->queue.count > n->stats.queue_peak)
        n->stats.queue_peak = n->queue.count;
}

void cw_queue_frame(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t tick, unsigned source)
{
    cw_share_lost(bus, i);
    cw_drop why = refusal(bus, i, frame);
    if (why != CW_DROP_COUNT) {
        cw_push_drop(bus, i, CW_SIDE_TX, frame, why, tick);
        return;
    }
    enqueue(bus, i, frame, tick, source);
    cw_rules_count_queued(&bus->rules, source);
}

void cw_remove_slot(cw_bus *bus, unsigned i, uint16_t slot)
{
    bus_node *n = &bus->nodes[i];
    cw_share_lost(bus, i);
    cw_rules_count_gone(&bus->rules, n->queue.slots[slot].source);
    cw_queue_remove(&n->queue, slot);
    bus->queued--;
    cw_queue_changed(bus, i);
}

static void flush_queue(cw_bus *bus, unsigned i, cw_drop why)
{
    bus_node *n = &bus->nodes[i];
    while (n->queue.count > 0) {
        uint16_t slot = cw_queue_first(&n->queue);
        cw_push_drop(bus, i, CW_SIDE_TX, &n->queue.slots[slot].frame, why, cw_now(bus));
        cw_remove_slot(bus, i, slot);
    }
}

/* ---- Hand-in --------------------------------------------------------------------------------- */

static inbox_entry *inbox_at(const inbox *box, unsigned i)
{
    unsigned place = box->first + i;
    return &box->entries[place < box->capacity ? place : place - box->capacity];
}

static void find_next(inbox *box)
{
    box->next = box->count ? inbox_at(box, 0)->at_tick : CW_NEVER;
}

static bool comes_after(const inbox_entry *a, uint64_t at_tick, unsigned node)
{
    return a->at_tick > at_tick || (a->at_tick == at_tick && a->node > node);
}

/* Returns true when nothing comes before a frame for now: no other frame, and nothing that rules
 * and nodes do at this tick. */
static bool is_next(const cw_bus *bus)
{
    return bus->inbox.count == 0 && bus->rules.next_due > cw_now(bus) &&
           bus->next_restart > cw_now(bus) && !bus->news && bus->rules.host_rules == 0 &&
           bus->rules.traffic_rules == 0 && bus->rules.held_count == 0;
}

/* Queues a frame for now that needs no place in the inbox. Returns false, with nothing done, when
 * the frame needs one. Returns false also when it would be dropped, since events come only while
 * the bus advances. */
static bool hand_in_now(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    if (!is_next(bus) || refusal(bus, i, frame) != CW_DROP_COUNT)
        return false;
    cw_share_lost(bus, i);
    bus->nodes[i].stats.handed_in++;
    enqueue(bus, i, frame, cw_now(bus), 0);
    return true;
}

cw_status cw_node_send(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t at_tick)
{
    inbox *box = &bus->inbox;
    if (i >= bus->node_count)
        return CW_INVALID;
    if (at_tick < cw_now(bus))
        at_tick = cw_now(bus);
    if (at_tick == cw_now(bus) && hand_in_now(bus, i, frame))
        return CW_OK;
    if (box->count == box->capacity)
        return CW_FULL;
    unsigned place = box->count++;
    for (; place > 0 && comes_after(inbox_at(box, place - 1), at_tick, i); place--)
        *inbox_at(box, place) = *inbox_at(box, place - 1);
    *inbox_at(box, place) = (inbox_entry){.at_tick = at_tick, .node = (uint8_t)i, .frame = *frame};
    find_next(box);
    bus->nodes[i].inbox++;
    return CW_OK;
}

unsigned cw_node_room(const cw_bus *bus, unsigned i)
{
    uint32_t held, rx_held;
    if (i >= bus->node_count)
        return CW_QUEUE_MAX;
    const bus_node *n = &bus->nodes[i];
    bool takes = !(bus->detached & cw_node_bit(i)) && !(n->mac.modes & CW_MODE_LISTEN_ONLY) &&
                 cw_mac_state(&n->mac) != CW_STATE_BUS_OFF;
    if (!takes)
        return CW_QUEUE_MAX;
    cw_rules_count_held(&bus->rules, i, &held, &rx_held);
    uint32_t used = n->queue.count + n->inbox + held;
    return used < n->queue_limit ? n->queue_limit - used : 0;
}

/* Frames for the same tick stay in their order. */
static void sort_inbox(inbox *box)
{
    for (unsigned i = 1; i < box->count; i++) {
        const inbox_entry entry = *inbox_at(box, i);
        unsigned place = i;
        for (; place > 0 && inbox_at(box, place - 1)->at_tick > entry.at_tick; place--)
            *inbox_at(box, place) = *inbox_at(box, place - 1);
        *inbox_at(box, place) = entry;
    }
}

void cw_nodes_bring_forward(cw_bus *bus, uint64_t nodes, uint64_t ticks)
{
    for (unsigned i = 0; i < bus->inbox.count; i++) {
        inbox_entry *e = inbox_at(&bus->inbox, i);
        if (!(nodes >> e->node & 1u) || e->at_tick == CW_NEVER || e->at_tick <= cw_now(bus))
            continue;
        e->at_tick = e->at_tick - cw_now(bus) > ticks ? e->at_tick - ticks : cw_now(bus);
    }
    sort_inbox(&bus->inbox);
    find_next(&bus->inbox);
}

void cw_bus_bring_forward(cw_bus *bus, uint64_t ticks)
{
    cw_nodes_bring_forward(bus, bus->all, ticks);
}

uint64_t cw_bus_inbox_first(const cw_bus *bus)
{
    return cw_inbox_first(bus);
}

unsigned cw_bus_inbox_room(const cw_bus *bus)
{
    return bus->inbox.capacity - bus->inbox.count;
}

/* Takes the earliest frame of the inbox: rules on the host side see it first, then it is queued. */
static void take_first(cw_bus *bus)
{
    inbox *box = &bus->inbox;
    inbox_entry entry = *inbox_at(box, 0);
    box->first = box->first + 1 < box->capacity ? box->first + 1 : 0;
    box->count--;
    find_next(box);
    bus->nodes[entry.node].inbox--;
    bus->nodes[entry.node].stats.handed_in++;
    if (cw_rules_hand_in(&bus->rules, entry.node, &entry.frame, entry.at_tick))
        cw_queue_frame(bus, entry.node, &entry.frame, entry.at_tick, 0);
    cw_rules_passed(&bus->rules, entry.node, CW_SIDE_TX, entry.at_tick);
}

void cw_take_inbox(cw_bus *bus, uint64_t tick)
{
    while (cw_inbox_first(bus) < tick)
        take_first(bus);
}

static void flush_inbox(cw_bus *bus, unsigned i)
{
    inbox *box = &bus->inbox;
    unsigned kept = 0;
    for (unsigned k = 0; k < box->count; k++) {
        inbox_entry entry = *inbox_at(box, k);
        if (entry.node != i) {
            *inbox_at(box, kept++) = entry;
            continue;
        }
        bus->nodes[i].stats.handed_in++;
        bus->nodes[i].inbox--;
        cw_push_drop(bus, i, CW_SIDE_TX, &entry.frame, CW_DROP_REMOVED, cw_now(bus));
    }
    box->count = kept;
    find_next(box);
}

static void flush_held(cw_bus *bus, unsigned i)
{
    held_frame held;
    while (cw_rules_take_held(&bus->rules, i, &held))
        cw_push_drop(bus, i, held.side, &held.frame, CW_DROP_REMOVED, cw_now(bus));
}

cw_status cw_node_flush(cw_bus *bus, unsigned i)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (!cw_ring_has_room(bus))
        return CW_FULL;
    cw_wake_controllers(bus);
    cw_mac *m = cw_own_mac(bus, i);
    m->offered = false;
    m->role = CW_ROLE_NONE;
    m->phase = CW_MAC_OFF;
    bus->detached |= cw_node_bit(i);
    bus->removed |= cw_node_bit(i);
    bus->nodes[i].restart_at = CW_NEVER;
    cw_find_next_restart(bus);
    flush_queue(bus, i, CW_DROP_REMOVED);
    flush_inbox(bus, i);
    flush_held(bus, i);
    cw_apply_topology(bus);
    return CW_OK;
}

/* ---- On and off the bus ---------------------------------------------------------------------- */

/* Resets the controller as at a stop and start: all that rules did to it meanwhile is gone. */
static void reset_controller(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    cw_mac_init(cw_own_mac(bus, i), n->mac.modes, n->mac.confinement.warning_limit);
    n->restart_at = CW_NEVER;
    cw_find_next_restart(bus);
    flush_queue(bus, i, CW_DROP_LINK_DOWN);
}

cw_status cw_node_attach(cw_bus *bus, unsigned i, bool on)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (cw_node_attached(bus, i) == on)
        return CW_OK;
    if (bus->removed & cw_node_bit(i))
        return CW_REFUSED;
    if (!cw_ring_has_room(bus))
        return CW_FULL;
    cw_wake_controllers(bus);
    cw_push_event(bus, CW_EVENT_LINK, cw_now(bus), cw_node_bit(i))->up = on;
    bus->detached ^= cw_node_bit(i);
    reset_controller(bus, i);
    cw_apply_topology(bus);
    bus->news = true;
    return CW_OK;
}

bool cw_node_attached(const cw_bus *bus, unsigned i)
{
    return i < bus->node_count && !(bus->detached & cw_node_bit(i));
}

/* ---- Restart (R12) --------------------------------------------------------------------------- */

void cw_schedule_restart(cw_bus *bus, unsigned i, uint64_t tick)
{
    bus->nodes[i].restart_at = tick;
    bus->next_restart = cw_least(bus->next_restart, tick);
}

uint64_t cw_automatic_restart(const cw_bus *bus, unsigned i)
{
    const bus_node *n = &bus->nodes[i];
    if (n->restart_ticks == 0)
        return CW_NEVER;
    uint64_t due = cw_after(n->off_at, n->restart_ticks);
    return due > cw_now(bus) ? due : cw_now(bus);
}

cw_status cw_node_restart(cw_bus *bus, unsigned i)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    bus_node *n = &bus->nodes[i];
    if (n->mac.phase != CW_MAC_BUS_OFF || n->restart_ticks != 0 || n->restart_at != CW_NEVER)
        return CW_REFUSED;
    cw_schedule_restart(bus, i, cw_now(bus));
    return CW_OK;
}

static void restart(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    n->restart_at = CW_NEVER;
    if (cw_mac_request_restart(cw_own_mac(bus, i)) != CW_OK)
        return;
    flush_queue(bus, i, CW_DROP_BUS_OFF);
    n->stats.restarts++;
    cw_rules_error(&bus->rules, i, cw_push_node_event(bus, CW_EVENT_RESTART, i));
}

void cw_find_next_restart(cw_bus *bus)
{
    bus->next_restart = CW_NEVER;
    for (unsigned i = 0; i < bus->node_count; i++)
        bus->next_restart = cw_least(bus->next_restart, bus->nodes[i].restart_at);
}

void cw_run_due_node(cw_bus *bus, unsigned i)
{
    while (bus->inbox.count && inbox_at(&bus->inbox, 0)->at_tick <= cw_now(bus) &&
           inbox_at(&bus->inbox, 0)->node == i)
        take_first(bus);
    if (bus->nodes[i].restart_at <= cw_now(bus))
        restart(bus, i);
}

/* ---- Settings -------------------------------------------------------------------------------- */

bool cw_settings_valid(const bus_node *n, const cw_settings *s)
{
    bool queue = !(s->which & CW_SET_QUEUE) || (s->queue >= 1 && s->queue <= n->queue.capacity);
    bool limit = !(s->which & CW_SET_WARNING) || (s->warning_limit >= 1 && s->warning_limit <= 255);
    return queue && limit;
}

static void set_restart(cw_bus *bus, unsigned i, uint64_t ticks)
{
    bus_node *n = &bus->nodes[i];
    n->restart_ticks = ticks;
    if (n->mac.phase != CW_MAC_BUS_OFF)
        return;
    n->restart_at = cw_automatic_restart(bus, i);
    cw_find_next_restart(bus);
}

static void set_modes(cw_bus *bus, unsigned i, const cw_settings *s)
{
    bus_node *n = &bus->nodes[i];
    cw_mac_set_modes(cw_own_mac(bus, i), (n->mac.modes & ~(unsigned)s->modes_mask) |
                                  (s->modes & (unsigned)s->modes_mask));
    if (n->mac.modes & CW_MODE_LISTEN_ONLY) {
        n->mac.offered = false;
        flush_queue(bus, i, CW_DROP_LISTEN_ONLY);
    }
}

cw_status cw_node_set(cw_bus *bus, unsigned i, const cw_settings *s)
{
    if (i >= bus->node_count || !cw_settings_valid(&bus->nodes[i], s))
        return CW_INVALID;
    bus_node *n = &bus->nodes[i];
    cw_wake_controllers(bus);
    if (s->which & CW_SET_MODES)
        set_modes(bus, i, s);
    if (s->which & CW_SET_RESTART)
        set_restart(bus, i, s->restart_ticks);
    if (s->which & CW_SET_QUEUE)
        n->queue_limit = s->queue;
    cw_share_lost(bus, i);
    if (s->which & CW_SET_ORDER)
        cw_queue_set_order(&n->queue, s->order);
    cw_queue_changed(bus, i);
    if (s->which & CW_SET_WARNING)
        cw_confinement_set_warning_limit(&cw_own_mac(bus, i)->confinement, s->warning_limit);
    bus->news = true;
    return CW_OK;
}

cw_status cw_node_get_settings(const cw_bus *bus, unsigned i, cw_settings *s)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    const bus_node *n = &bus->nodes[i];
    *s = (cw_settings){
        .which = CW_SET_MODES | CW_SET_RESTART | CW_SET_QUEUE | CW_SET_ORDER | CW_SET_WARNING,
        .modes_mask = UINT8_MAX,
        .modes = n->mac.modes,
        .order = n->queue.mode,
        .queue = n->queue_limit,
        .warning_limit = n->mac.confinement.warning_limit,
        .restart_ticks = n->restart_ticks,
    };
    return CW_OK;
}
