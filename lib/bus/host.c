/* SPDX-License-Identifier: MIT
 *
 * host.c - the actions of the nodes' hosts beside frames: off and on the bus, restart, settings.
 */
#include "bus/bus_private.h"

#include "mac/confinement.h"

#include <string.h>

/* ---- Room, and off the bus for good ---------------------------------------------------------- */

bool cw_node_takes_frames(const cw_bus *bus, unsigned i)
{
    if (i >= bus->node_count)
        return false;
    const cw_drop why = cw_refusal(bus, i);
    const bool restarts = why == CW_DROP_BUS_OFF && cw_restart_is_due(bus, i);
    return why == CW_DROP_COUNT || why == CW_DROP_QUEUE_FULL || restarts;
}

unsigned cw_node_room(const cw_bus *bus, unsigned i)
{
    uint32_t held, rx_held;
    if (!cw_node_takes_frames(bus, i))
        return CW_QUEUE_MAX;
    const cw_bus_node *n = &bus->nodes[i];
    cw_rules_count_held(&bus->rules, i, &held, &rx_held);
    uint32_t used = n->queue.count - cw_mailbox_replies(bus, i) + n->inbox + held;
    return used < n->queue_limit ? n->queue_limit - used : 0;
}

/* Drops the frames of a removed node that rules hold back. */
static void flush_held(cw_bus *bus, unsigned i)
{
    cw_held_frame held;
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
    cw_commit_early(bus, i);
    cw_mac *m = cw_own_mac(bus, i);
    cw_note_left(bus, i);
    cw_sleep_forget(bus, i);
    m->offered = false;
    m->role = CW_ROLE_NONE;
    m->phase = CW_MAC_OFF;
    bus->detached |= cw_node_bit(i);
    bus->removed |= cw_node_bit(i);
    bus->restarts[i].at = CW_NEVER;
    cw_tt_stop(bus, i);
    cw_find_node_due(bus);
    cw_flush_queue(bus, i, CW_DROP_REMOVED);
    cw_flush_inbox(bus, i);
    flush_held(bus, i);
    cw_buffers_flush(bus, i, CW_DROP_REMOVED);
    cw_apply_topology(bus);
    return CW_OK;
}

/* ---- On and off the bus ---------------------------------------------------------------------- */

/* Resets the controller as at a stop and start: all that rules did to it meanwhile is gone. */
static void reset_controller(cw_bus *bus, unsigned i)
{
    cw_mac *m = cw_own_mac(bus, i);
    cw_note_left(bus, i);
    const unsigned protocol = m->protocol;
    cw_fd_part *fd = m->fd;
    const unsigned variants = cw_mac_variants(m);
    cw_sleep_forget(bus, i);
    cw_mac_init(m, m->modes, m->confinement.warning_limit);
    m->tells_won = true;
    (void)cw_mac_set_protocol(m, protocol, fd);
    (void)cw_mac_set_variants(m, variants);
    bus->restarts[i].at = CW_NEVER;
    cw_flush_queue(bus, i, CW_DROP_LINK_DOWN);
    cw_buffers_flush(bus, i, CW_DROP_LINK_DOWN);
    cw_find_node_due(bus);
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
    cw_commit_early(bus, i);
    cw_push_event(bus, CW_EVENT_LINK, cw_now(bus), cw_node_bit(i))->up = on;
    bus->detached ^= cw_node_bit(i);
    const bool sleeps = cw_sleep_wanted(bus, i);
    reset_controller(bus, i);
    cw_apply_topology(bus);
    if (sleeps)
        cw_sleep_request(bus, i);
    bus->pending = true;
    return CW_OK;
}

bool cw_node_attached(const cw_bus *bus, unsigned i)
{
    return i < bus->node_count && !(bus->detached & cw_node_bit(i));
}

/* ---- Restart (R12) --------------------------------------------------------------------------- */

cw_status cw_node_restart(cw_bus *bus, unsigned i)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    cw_bus_node *n = &bus->nodes[i];
    if (n->mac.phase != CW_MAC_BUS_OFF || bus->restarts[i].ticks != 0 ||
        bus->restarts[i].at != CW_NEVER)
        return CW_REFUSED;
    cw_schedule_restart(bus, i, cw_now(bus));
    return CW_OK;
}

void cw_restart_now(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    bus->restarts[i].at = CW_NEVER;
    cw_commit_early(bus, i);
    if (cw_mac_request_restart(cw_own_mac(bus, i)) != CW_OK)
        return;
    cw_flush_queue(bus, i, CW_DROP_BUS_OFF);
    n->stats.restarts++;
    cw_rules_error(&bus->rules, i, cw_push_node_event(bus, CW_EVENT_RESTART, i));
}

void cw_run_due_node(cw_bus *bus, unsigned i)
{
    cw_take_inbox_of(bus, i);
    if (cw_restart_is_due(bus, i)) {
        cw_restart_now(bus, i);
        cw_take_inbox_of(bus, i);
    }
    cw_sleep_run(bus, i);
    cw_buffers_run(bus, i);
    cw_tt_run(bus, i);
}

/* ---- Settings -------------------------------------------------------------------------------- */

/* Returns the data timing that the settings bring, or NULL. */
static const cw_data_timing *new_data(const cw_settings *s)
{
    return s->which & CW_SET_DATA ? &s->data : NULL;
}

/* Returns the bit timing that a node would have with the settings. */
static cw_bit_timing new_timing(const cw_bus *bus, unsigned i, const cw_settings *s)
{
    const cw_bit_timing now = cw_timing_now(bus, i);
    return cw_timing_with(&now, s);
}

bool cw_settings_valid(const cw_bus *bus, unsigned i, const cw_settings *s)
{
    const cw_bus_node *n = &bus->nodes[i];
    bool queue = !(s->which & CW_SET_QUEUE) || (s->queue >= 1 && s->queue <= n->queue.capacity);
    bool limit = !(s->which & CW_SET_WARNING) || (s->warning_limit >= 1 && s->warning_limit <= 255);
    const cw_bit_timing next = new_timing(bus, i, s);
    bool timing = !(s->which & (CW_SET_TIMING | CW_SET_DATA)) ||
                  cw_new_timing_valid(bus, i, &next, new_data(s));
    const bool changes_way = s->which & (CW_SET_WAY | CW_SET_RINGING);
    const bool wakes = s->which & (CW_SET_WAKE | CW_SET_SLEEP);
    const bool wake = !wakes || (!bus->lean && cw_sleep_valid(&s->sleep));
    const bool unit = !(s->which & CW_SET_UNIT) ||
                      ((s->which & CW_SET_QUANTUM) && s->unit >= CW_TICK / 2 &&
                       s->unit <= 2 * CW_LOCAL_UNIT_MAX);
    return queue && limit && timing && wake && unit &&
           (!changes_way || cw_new_way_valid(bus, i, s));
}

/* Sets the time to the automatic restart. It counts from bus-off on, also for a node that is
 * bus-off already (R12). */
static void set_restart(cw_bus *bus, unsigned i, uint64_t ticks)
{
    cw_bus_node *n = &bus->nodes[i];
    bus->restarts[i].ticks = ticks;
    if (n->mac.phase != CW_MAC_BUS_OFF || cw_restart_is_due(bus, i))
        return;
    bus->restarts[i].at = cw_automatic_restart(bus, i);
    cw_find_node_due(bus);
}

/* Changes modes. A node that may no longer send loses its frames. */
static void set_modes(cw_bus *bus, unsigned i, const cw_settings *s)
{
    cw_bus_node *n = &bus->nodes[i];
    const unsigned before = cw_modes_of(bus, i);
    const unsigned mask = s->modes_mask, modes = (before & ~mask) | (s->modes & mask);
    if (modes != before)
        cw_commit_early(bus, i);
    (void)cw_own_mac(bus, i);
    cw_set_modes_of(bus, i, modes);
    if (cw_modes_of(bus, i) & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED)) {
        n->mac.offered = false;
        cw_flush_queue(bus, i, CW_DROP_LISTEN_ONLY);
    }
}

/* Sets filter, time and frames of the wake-up. A sleeping node goes on with the new ones. */
static void set_wake(cw_bus *bus, unsigned i, const cw_settings *s)
{
    cw_sleep_settings *now = &bus->sleeps[i].settings;
    if (s->which & CW_SET_WAKE_FILTER)
        now->filter_ticks = s->sleep.filter_ticks;
    if (s->which & CW_SET_WAKE_TIME)
        now->wake_ticks = s->sleep.wake_ticks;
    if (s->which & CW_SET_WAKE_ON) {
        now->frame_count = s->sleep.frame_count;
        memcpy(now->frames, s->sleep.frames, sizeof now->frames);
    }
    (void)cw_own_mac(bus, i);
    cw_sleep_wait(bus, i);
}

/* Lets the host send its controller to sleep, or call it back. */
static void set_sleep(cw_bus *bus, unsigned i, bool sleeps)
{
    if (sleeps)
        cw_sleep_request(bus, i);
    else
        cw_sleep_call(bus, i);
}

cw_status cw_node_set(cw_bus *bus, unsigned i, const cw_settings *s)
{
    if (i >= bus->node_count || !cw_settings_valid(bus, i, s))
        return CW_INVALID;
    cw_bus_node *n = &bus->nodes[i];
    const cw_bit_timing timing = new_timing(bus, i, s);
    cw_wake_controllers(bus);
    if (s->which & CW_SET_MODES)
        set_modes(bus, i, s);
    if (s->which & CW_SET_RESTART)
        set_restart(bus, i, s->restart_ticks);
    if (s->which & CW_SET_QUEUE)
        n->queue_limit = s->queue;
    cw_share_lost(bus, i);
    if (s->which & CW_SET_ORDER) {
        cw_queue_set_order(&n->queue, s->order);
        cw_outlook_forget(bus);
    }
    cw_queue_changed(bus, i);
    if (s->which & CW_SET_WARNING)
        cw_confinement_set_warning_limit(&cw_own_mac(bus, i)->confinement, s->warning_limit);
    if (bus->tt && (s->which & CW_SET_UNIT))
        cw_tt_give_unit(bus, i, s->unit, timing.quantum);
    if (s->which & (CW_SET_TIMING | CW_SET_DATA))
        cw_retime(bus, i, &timing, new_data(s));
    if (s->which & (CW_SET_WAY | CW_SET_RINGING))
        cw_set_way(bus, i, s);
    if (s->which & CW_SET_WAKE)
        set_wake(bus, i, s);
    if (s->which & CW_SET_SLEEP)
        set_sleep(bus, i, s->sleeps);
    bus->pending = true;
    return CW_OK;
}

unsigned cw_node_modes(const cw_bus *bus, unsigned i)
{
    return i < bus->node_count ? cw_modes_of(bus, i) : 0;
}

cw_status cw_node_get_settings(const cw_bus *bus, unsigned i, cw_settings *s)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    const cw_bus_node *n = &bus->nodes[i];
    *s = (cw_settings){
        .which = CW_SET_MODES | CW_SET_RESTART | CW_SET_QUEUE | CW_SET_ORDER | CW_SET_WARNING |
                 CW_SET_TIMING | (bus->timed.rates ? CW_SET_DATA : 0) | CW_SET_SLEEP | CW_SET_WAKE,
        .modes_mask = UINT8_MAX,
        .modes = (uint8_t)cw_modes_of(bus, i),
        .order = n->queue.mode,
        .queue = n->queue_limit,
        .warning_limit = n->mac.confinement.warning_limit,
        .restart_ticks = bus->restarts[i].ticks,
        .timing = cw_timing_now(bus, i),
        .data = cw_data_timing_now(bus, i),
    };
    if (!bus->lean) {
        s->sleeps = cw_sleep_wanted(bus, i);
        s->sleep = bus->sleeps[i].settings;
    }
    cw_get_way(bus, i, s);
    return CW_OK;
}
