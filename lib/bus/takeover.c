/* SPDX-License-Identifier: MIT
 *
 * takeover.c - continues a bus as another one with other nodes and rules, to reload a
 * configuration.
 */
#include "bus/bus_private.h"

#include "mac/confinement.h"

/* Returns true when the frame is on the wire, or will be tried again after the error being
 * signalled. */
static bool has_begun(const cw_mac *m)
{
    return m->offered && m->role == CW_ROLE_TRANSMITTER;
}

/* Does the same, also when the end of the frame has been sampled and is still to be reported. */
static bool is_under_way(const cw_bus *bus, unsigned i)
{
    const cw_timed_node *t = &bus->timed.nodes[i];
    const unsigned ends = CW_REPORT_TX | CW_REPORT_DROPPED;
    return has_begun(&bus->nodes[i].mac) || (bus->timed.active && (t->report.what & ends));
}

/* The new bus may have no room for FD frames. */
static void drop(cw_bus *bus, unsigned i, const cw_frame *frame, cw_drop why)
{
    cw_frame short_one;
    cw_frame_copy(&short_one, frame);
    if (cw_frame_is_fd(frame) && !bus->fd)
        cw_frame_cut(&short_one);
    cw_push_drop(bus, i, CW_SIDE_TX, &short_one, why, cw_now(bus));
}

/* Returns true when a node has the schedule that it had. */
static bool keeps_triggers(const cw_bus *bus, unsigned i, const cw_bus *old, unsigned from)
{
    return bus->tt && old->tt && cw_tt_goes_on(&bus->tt[i], &old->tt[from]);
}

/* Puts a frame into the queue of a node, as its controller would send it. */
static bool takeover_put(cw_bus *bus, unsigned i, const cw_queue_slot *slot)
{
    cw_bus_node *n = &bus->nodes[i];
    cw_frame frame;
    cw_frame_copy(&frame, slot->frame);
    if (!cw_queue_put(&n->queue, &frame, slot->handed_in, bus->lengths))
        return false;
    if (cw_frame_is_fd(&frame))
        cw_complete_fd(n);
    return true;
}

/* Returns true when the node can send the frame, as far as its protocol and its mailboxes go. A
 * frame that has begun needs no mailbox. */
static bool can_send(const cw_bus *bus, unsigned i, const cw_frame *frame, bool begun)
{
    return cw_knows_frame(bus, i, frame) &&
           (begun || !bus->buffers || cw_mailboxes_take(bus, i, frame));
}

/* reply: the frame is a reply of a mailbox. */
static void take_over_slot(cw_bus *bus, unsigned i, const cw_bus *old_bus, unsigned old_node,
                           uint16_t from, bool reply)
{
    cw_bus_node *n = &bus->nodes[i];
    const cw_bus_node *old = &old_bus->nodes[old_node];
    const cw_queue_slot *slot = cw_queue_at(&old->queue, from);
    const bool begun = is_under_way(old_bus, old_node) && old->offered_slot == from;
    const bool full = n->queue.count - cw_mailbox_replies(bus, i) >= n->queue_limit;
    cw_drop why = can_send(bus, i, slot->frame, begun || reply) ? CW_DROP_QUEUE_FULL
                                                                : CW_DROP_BAD_FRAME;
    if (why == CW_DROP_BAD_FRAME || (full && !reply) || !takeover_put(bus, i, slot)) {
        drop(bus, i, slot->frame, why);
        return;
    }
    cw_queue_at(&n->queue, n->queue.newest)->tried = slot->tried;
    cw_queue_at(&n->queue, n->queue.newest)->trigger = slot->trigger;
    if (bus->buffers)
        cw_mailboxes_find_again(bus, i, reply);
    if (old->offered_slot == from) /* of a frame under way, or of one whose end is to be reported */
        n->offered_slot = n->queue.newest;
    bus->queued++;
    cw_queue_changed(bus, i);
}

/* A frame that has begun gets a place in any case. */
static void take_over_queue(cw_bus *bus, unsigned i, const cw_bus *old_bus, unsigned old_node)
{
    const cw_bus_node *old = &old_bus->nodes[old_node];
    const bool begun = is_under_way(old_bus, old_node);
    for (unsigned k = 0; begun && k < old->queue.count; k++)
        if (cw_queue_nth(&old->queue, k) == old->offered_slot)
            take_over_slot(bus, i, old_bus, old_node, old->offered_slot,
                           cw_mailboxes_is_reply(old_bus, old_node, k));
    for (unsigned k = 0; k < old->queue.count; k++)
        if (!begun || cw_queue_nth(&old->queue, k) != old->offered_slot)
            take_over_slot(bus, i, old_bus, old_node, cw_queue_nth(&old->queue, k),
                           cw_mailboxes_is_reply(old_bus, old_node, k));
}

/* Returns true when two controllers are of one kind, so that one can go on for the other. */
static bool are_alike(const cw_mac *a, const cw_mac *b)
{
    return a->protocol == b->protocol && cw_mac_same_variant(a, b);
}

/* Applies settings as cw_node_set() would, when the bits of the node are those of the old bus. A
 * controller with another protocol has left its bit. */
static void apply_settings(cw_bus *bus, unsigned i, unsigned modes, const cw_bus *old,
                           unsigned from)
{
    const uint64_t restart_before = old->restarts[from].ticks;
    const cw_settings settings = {.which = CW_SET_MODES, .modes_mask = UINT8_MAX,
                                  .modes = (uint8_t)modes};
    const unsigned silent = CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED;
    if (!are_alike(&bus->nodes[i].mac, &old->nodes[from].mac))
        (void)cw_own_mac(bus, i);
    if (modes != cw_modes_of(bus, i) || (modes & silent))
        (void)cw_node_set(bus, i, &settings);
    if (bus->nodes[i].mac.phase == CW_MAC_BUS_OFF && bus->restarts[i].ticks != restart_before)
        bus->restarts[i].at = cw_automatic_restart(bus, i);
}

/* Takes the state of a controller. With another protocol it leaves the bus and integrates, as after
 * a change of modes. */
static void take_over_mac(cw_mac *m, const cw_mac *old)
{
    const unsigned protocol = m->protocol, variants = cw_mac_variants(m);
    cw_fd_part *fd = m->fd;
    const bool same = are_alike(m, old), compares_late = fd && fd->compares_late;
    *m = *old;
    (void)cw_mac_set_variants(m, variants);
    m->fd = fd;
    if (same && fd)
        *fd = *old->fd;
    if (!same)
        (void)cw_mac_set_protocol(m, protocol, fd);
    if (fd)
        fd->compares_late = compares_late; /* a setting */
}

/* Puts a node into a set, or leaves it out, as its old number was in the old set. */
static void take_over_set(uint64_t *set, unsigned i, uint64_t old, unsigned from)
{
    *set &= ~cw_node_bit(i);
    if (old >> from & 1u)
        *set |= cw_node_bit(i);
}

/* A node that sleeps goes on sleeping, and one that is awake stays so. */
static void take_over_sleep(cw_bus *bus, unsigned i, const cw_bus *old, unsigned from)
{
    const cw_sleep_settings settings = bus->sleeps[i].settings;
    bus->sleeps[i] = old->sleeps[from];
    bus->sleeps[i].settings = settings;
    take_over_set(&bus->asleep, i, old->asleep, from);
    take_over_set(&bus->dozing, i, old->dozing, from);
    take_over_set(&bus->listening, i, old->listening, from);
}

/* Notes that a node leaves its transmission. The frame may no longer have a place in its queue. */
static void note_stopped(cw_bus *bus, unsigned i, const cw_bus_node *old)
{
    cw_start *start = &bus->starts[i];
    if (start->stopped != 0)
        return;
    cw_note_stopped(bus, i, cw_mac_place(&old->mac));
    start->handed_in = cw_queue_at(&old->queue, old->offered_slot)->handed_in;
    start->can_id = cw_frame_can_id(cw_queue_at(&old->queue, old->offered_slot)->frame);
}

/* Takes state and counters of the old node, and settings of the new one. */
static void take_over_node(cw_bus *bus, unsigned i, const cw_bus *old_bus, unsigned from)
{
    const cw_bus_node *old = &old_bus->nodes[from];
    cw_bus_node *n = &bus->nodes[i];
    unsigned warning_limit = n->mac.confinement.warning_limit;
    n->stats = old->stats;
    bus->restarts[i].at = old_bus->restarts[from].at;
    bus->restarts[i].off_at = old_bus->restarts[from].off_at;
    take_over_sleep(bus, i, old_bus, from);
    take_over_queue(bus, i, old_bus, from);
    if (!are_alike(&n->mac, &old->mac) && old->mac.role == CW_ROLE_TRANSMITTER)
        note_stopped(bus, i, old);
    take_over_mac(&n->mac, &old->mac);
    n->mac.offered = are_alike(&n->mac, &old->mac) && has_begun(&old->mac);
    n->mac.no_ack = false;
    n->deviates = old->deviates;
    n->reported_state = old->reported_state;
    cw_mac_reconnect(&n->mac);
    cw_sleep_wait(bus, i);
    cw_confinement_set_warning_limit(&n->mac.confinement, warning_limit);
}

/* Statistics go on where both buses have records. */
static void take_over_sync_stats(cw_bus *bus, const cw_bus *old, const uint8_t *from)
{
    if (!bus->timed.records || !old->timed.records)
        return;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (from[i] != CW_NO_NODE)
            bus->timed.records[i].stats = old->timed.records[from[i]].stats;
}

/* Takes over the frames with a tick to come, of nodes that are still there. */
static void take_over_inbox(cw_bus *bus, const cw_bus *old, const uint8_t *to)
{
    for (unsigned i = 0; i < old->inbox.count; i++) {
        const cw_inbox_entry *e = cw_inbox_at(&old->inbox, i);
        const unsigned node = to[e->node];
        if (node == CW_NO_NODE)
            continue;
        if (e->trigger && keeps_triggers(bus, node, old, e->node))
            cw_inbox_put_triggered(bus, node, e->frame, e->at_tick, e->trigger);
        if (!e->trigger) /* one of another schedule is no longer due */
            (void)cw_node_send(bus, node, e->frame, e->at_tick);
    }
}

/* Makes frames of triggers ordinary ones, which no longer belong to a slot. */
static void forget_triggers(cw_bus_node *n)
{
    for (unsigned k = 0; k < n->queue.count; k++)
        cw_queue_at(&n->queue, cw_queue_nth(&n->queue, k))->trigger = 0;
}

/* Local times go on. */
static void take_over_tt(cw_bus *bus, const cw_bus *old, const uint8_t *from, const uint8_t *to)
{
    for (unsigned i = 0; old->tt && i < bus->node_count; i++) {
        if (from[i] == CW_NO_NODE)
            continue;
        if (!keeps_triggers(bus, i, old, from[i]))
            forget_triggers(&bus->nodes[i]);
        if (bus->tt)
            cw_tt_take_over(bus, i, &old->tt[from[i]], to);
        if (bus->removed & cw_node_bit(i))
            cw_tt_stop(bus, i);
    }
}

/* Returns nodes of the old bus as nodes of the new one, without those that no longer exist. */
static uint64_t renumber(uint64_t nodes, const uint8_t *to)
{
    uint64_t renumbered = 0;
    for (uint64_t rest = nodes; rest; rest &= rest - 1)
        if (to[cw_lowest_node(rest)] != CW_NO_NODE)
            renumbered |= cw_node_bit(to[cw_lowest_node(rest)]);
    return renumbered;
}

/* Releases the frames that old rules held back: those rules no longer exist. */
static void take_over_held(cw_bus *bus, const cw_bus *old, const uint8_t *to)
{
    for (unsigned i = 0; i < old->rules.held_count; i++) {
        cw_held_frame h;
        cw_held_copy(&old->rules, &h, cw_held_at(&old->rules, i));
        if (to[h.node] == CW_NO_NODE)
            continue;
        if (cw_frame_is_fd(&h.frame) && !bus->fd)
            cw_frame_cut(&h.frame);
        h.node = to[h.node];
        h.origin.from = renumber(h.origin.from, to);
        h.due = cw_now(bus);
        (void)cw_rules_hold(&bus->rules, &h);
    }
}

/* Frames that wait for their hosts go on waiting. A host with fewer buffers than before has the
 * first ones at once, so that frames keep their order. */
static void take_over_buffers(cw_bus *bus, const cw_bus *old, const uint8_t *from,
                              const uint8_t *to)
{
    for (unsigned i = 0; old->buffers && i < bus->node_count; i++) {
        if (from[i] == CW_NO_NODE)
            continue;
        const unsigned count = cw_buffers_count(old, from[i]);
        const unsigned limit = bus->buffers ? bus->buffers[i].limit : 0;
        for (unsigned n = 0; n < count; n++) {
            cw_stored_frame s = *cw_buffers_at(old, from[i], n);
            s.origin.from = renumber(s.origin.from, to);
            if (cw_frame_is_fd(&s.frame) && !bus->fd)
                cw_frame_cut(&s.frame);
            cw_buffers_put(bus, i, &s, count - n <= limit);
        }
        if (bus->buffers)
            bus->buffers[i].stats = old->buffers[from[i]].stats;
        if (bus->buffers)
            cw_mailboxes_take_over(bus, i, &old->buffers[from[i]]);
    }
}

/* Arbitrations that are under way go on. Nodes may be taken from their transmissions after this. */
static void take_over_starts(cw_bus *bus, const cw_bus *old, const uint8_t *from,
                             const uint8_t *to)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (from[i] == CW_NO_NODE)
            continue;
        bus->starts[i] = old->starts[from[i]];
        bus->starts[i].ready = renumber(old->starts[from[i]].ready, to);
        bus->error_frames[i] = old->error_frames[from[i]];
        bus->error_frames[i].from = renumber(old->error_frames[from[i]].from, to);
    }
}

/* The new bus must be fresh, have the same rate and room for what waits. No two nodes may come from
 * one. */
static bool takeover_fits(const cw_bus *bus, const cw_bus *old, const uint8_t *from)
{
    uint64_t taken = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        if (from[i] == CW_NO_NODE)
            continue;
        if (from[i] >= old->node_count || (taken & cw_node_bit(from[i])))
            return false;
        taken |= cw_node_bit(from[i]);
    }
    const bool one_rate = cw_rate_equal(cw_wire_rate(&bus->time), cw_wire_rate(&old->time));
    return one_rate && cw_now(bus) == 0 && !bus->lean && !old->lean &&
           bus->inbox.capacity - bus->inbox.kept_free >= old->inbox.count;
}

/* The inverse of from[]. */
static void find_new_numbers(uint8_t to[CW_NODES_MAX], const cw_bus *bus, const uint8_t *from)
{
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        to[i] = CW_NO_NODE;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (from[i] != CW_NO_NODE)
            to[from[i]] = (uint8_t)i;
}

cw_status cw_bus_take_over(cw_bus *bus, cw_bus *old, const uint8_t *from)
{
    uint8_t to[CW_NODES_MAX], modes[CW_NODES_MAX];
    if (!takeover_fits(bus, old, from))
        return CW_INVALID;
    cw_wake_controllers(old);
    cw_leave(old, old->all);
    cw_set_contenders(old, 0);
    cw_set_listeners(old, 0);
    find_new_numbers(to, bus, from);
    bus->time = old->time;
    bus->stepping = old->stepping;
    bus->watching = old->watching;
    bus->wanted = old->wanted;
    bus->work = cw_bus_work(old);
    bus->rules.work = 0;
    bus->recessive_bits = old->recessive_bits;
    if (bus->load.unit == old->load.unit)
        bus->load = old->load;
    bus->timed.short_ticks = old->timed.short_ticks;
    bus->early_ticks = bus->start_at_tick ? old->early_ticks : 0;
    bus->stats = old->stats;
    bus->error_flag = old->error_flag;
    bus->overload_flag = old->overload_flag;
    take_over_starts(bus, old, from, to);
    for (unsigned i = 0; i < bus->node_count; i++) {
        modes[i] = (uint8_t)bus->nodes[i].mac.modes;
        if (from[i] == CW_NO_NODE) {
            bus->sleeps[i].since = cw_now(bus);
            continue;
        }
        take_over_node(bus, i, old, from[i]);
        bus->detached &= ~cw_node_bit(i);
        if (!cw_node_attached(old, from[i]))
            bus->detached |= cw_node_bit(i);
        if (old->removed & cw_node_bit(from[i]))
            bus->removed |= cw_node_bit(i);
    }
    cw_timed_catch_up(old);
    cw_timed_take_over(bus, old, from);
    take_over_sync_stats(bus, old, from);
    cw_apply_topology(bus);
    take_over_buffers(bus, old, from, to);
    take_over_tt(bus, old, from, to);
    for (unsigned i = 0; i < bus->node_count; i++)
        if (from[i] != CW_NO_NODE) /* may end a frame early, for buffers and local time, too */
            apply_settings(bus, i, modes[i], old, from[i]);
    cw_find_node_due(bus);
    cw_rules_take_over_protections(&bus->rules, &old->rules, from);
    take_over_inbox(bus, old, to);
    take_over_held(bus, old, to);
    cw_rules_start(&bus->rules);
    bus->pending = true;
    return CW_OK;
}
