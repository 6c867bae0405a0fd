/* SPDX-License-Identifier: MIT
 *
 * sleep.c - nodes that sleep, and what wakes them.
 *
 * The controller of a sleeping node is asleep, and its transceiver looks at the wire: it waits for
 * a dominant phase, which step/doze.c measures. With frames that wake it (partial networking) a
 * receiver goes on reading. That is the controller itself, as a listen-only one. Nothing that it
 * finds is reported, but a frame that wakes the node.
 */
#include "state/state.h"

#include <assert.h>

static cw_sleep *sleep_of(cw_bus *bus, unsigned i)
{
    return &bus->sleeps[i];
}

bool cw_sleep_valid(const cw_sleep_settings *s)
{
    return s->filter_ticks <= CW_WAKE_TICKS_MAX && s->wake_ticks <= CW_WAKE_TICKS_MAX &&
           s->frame_count <= CW_WAKE_FILTERS_MAX;
}

bool cw_sleep_wanted(const cw_bus *bus, unsigned i)
{
    if (bus->asleep >> i & 1u)
        return bus->sleeps[i].awake_at == CW_NEVER && !bus->sleeps[i].called;
    return bus->nodes[i].mac.sleeps;
}

/* ---- Modes ----------------------------------------------------------------------------------- */

void cw_set_modes_of(cw_bus *bus, unsigned i, unsigned modes)
{
    cw_mac *m = &bus->nodes[i].mac;
    const unsigned leaves = CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK | CW_MODE_RESTRICTED;
    if (bus->listening >> i & 1u) {
        sleep_of(bus, i)->modes = (uint8_t)modes;
        return;
    }
    if ((m->modes ^ modes) & leaves)
        cw_note_left(bus, i);
    cw_mac_set_modes(m, modes);
}

/* ---- Listening ------------------------------------------------------------------------------- */

/* A controller that is cut off stays so. */
static void listen(cw_bus *bus, unsigned i)
{
    cw_mac *m = &bus->nodes[i].mac;
    if (bus->listening >> i & 1u)
        return;
    sleep_of(bus, i)->modes = m->modes;
    bus->listening |= cw_node_bit(i);
    cw_mac_wake(m);
    cw_mac_set_modes(m, CW_MODE_LISTEN_ONLY);
}

/* Gives the controller its own modes again, and it sleeps. */
static void stop_listening(cw_bus *bus, unsigned i)
{
    cw_mac *m = &bus->nodes[i].mac;
    if (!(bus->listening >> i & 1u))
        return;
    const bool reads = cw_mac_is_on_bus(m);
    bus->listening &= ~cw_node_bit(i);
    if (reads) /* in the middle of a frame, too */
        cw_mac_disconnect(m);
    cw_mac_set_modes(m, sleep_of(bus, i)->modes);
    cw_mac_sleep(m);
    if (reads)
        cw_mac_reconnect(m);
}

void cw_sleep_wait(cw_bus *bus, unsigned i)
{
    const uint64_t self = cw_node_bit(i);
    if (!(bus->asleep & self) || sleep_of(bus, i)->awake_at != CW_NEVER)
        return;
    cw_sleep *s = sleep_of(bus, i);
    cw_outlook_forget(bus);
    s->filter.length = s->settings.filter_ticks * (uint64_t)CW_TICK;
    if (s->settings.frame_count) {
        bus->dozing &= ~self;
        listen(bus, i);
        return;
    }
    stop_listening(bus, i);
    if (!(bus->dozing & self))
        s->filter.dominant = 0;
    bus->dozing |= self;
}

/* ---- Falling asleep -------------------------------------------------------------------------- */

void cw_sleep_settle(cw_bus *bus, unsigned i)
{
    const cw_mac *m = &bus->nodes[i].mac;
    const bool sleeps = m->sleeps && (m->phase == CW_MAC_ASLEEP || m->phase == CW_MAC_OFF);
    if (!sleeps || (bus->asleep >> i & 1u))
        return;
    bus->asleep |= cw_node_bit(i);
    sleep_of(bus, i)->since = cw_now(bus);
    sleep_of(bus, i)->awake_at = CW_NEVER;
    cw_share_lost(bus, i);
    cw_queue_changed(bus, i);
    cw_sleep_wait(bus, i);
}

void cw_sleep_request(cw_bus *bus, unsigned i)
{
    cw_sleep *s = sleep_of(bus, i);
    s->called = false;
    if (bus->asleep >> i & 1u) {
        s->awake_at = CW_NEVER;
        cw_sleep_wait(bus, i);
        cw_find_node_due(bus);
        return;
    }
    cw_mac_sleep(cw_own_mac(bus, i));
    cw_sleep_settle(bus, i);
}

/* ---- Waking up ------------------------------------------------------------------------------- */

void cw_sleep_call(cw_bus *bus, unsigned i)
{
    if (bus->asleep >> i & 1u)
        sleep_of(bus, i)->called = sleep_of(bus, i)->awake_at == CW_NEVER;
    else
        cw_mac_wake(cw_own_mac(bus, i));
}

/* Takes a node out of the sets of those that sleep. */
static void leave_sets(cw_bus *bus, unsigned i)
{
    cw_sleep *s = sleep_of(bus, i);
    s->stats.ticks += cw_now(bus) - s->since;
    s->called = false;
    s->awake_at = CW_NEVER;
    bus->asleep &= ~cw_node_bit(i);
    bus->dozing &= ~cw_node_bit(i);
    cw_share_lost(bus, i);
    cw_queue_changed(bus, i);
}

/* Wakes a controller, which comes to the bus by integration (M10). */
static void integrate(cw_bus *bus, unsigned i)
{
    leave_sets(bus, i);
    cw_mac_wake(&bus->nodes[i].mac);
    cw_report_state(bus, i);
}

void cw_sleep_wake(cw_bus *bus, unsigned i, cw_wake why)
{
    cw_sleep *s = sleep_of(bus, i);
    assert(bus->asleep >> i & 1u);
    cw_push_node_event(bus, CW_EVENT_WAKE, i)->why = (uint8_t)why;
    s->stats.wake_ups++;
    s->called = false;
    stop_listening(bus, i);
    bus->dozing &= ~cw_node_bit(i);
    if (s->settings.wake_ticks == 0) {
        integrate(bus, i);
        return;
    }
    s->awake_at = cw_after(cw_now(bus), s->settings.wake_ticks);
    bus->node_due = cw_least(bus->node_due, s->awake_at);
}

void cw_sleep_run(cw_bus *bus, unsigned i)
{
    if (!(bus->asleep >> i & 1u))
        return;
    const cw_sleep *s = sleep_of(bus, i);
    if (!s->called && s->awake_at > cw_now(bus))
        return;
    (void)cw_own_mac(bus, i);
    if (s->called)
        cw_sleep_wake(bus, i, CW_WAKE_HOST);
    else
        integrate(bus, i);
}

void cw_sleep_forget(cw_bus *bus, unsigned i)
{
    if (!(bus->asleep >> i & 1u)) {
        bus->nodes[i].mac.sleeps = false;
        return;
    }
    if (bus->listening >> i & 1u)
        cw_mac_set_modes(&bus->nodes[i].mac, sleep_of(bus, i)->modes);
    bus->listening &= ~cw_node_bit(i);
    leave_sets(bus, i);
    cw_mac_wake(&bus->nodes[i].mac);
    cw_find_node_due(bus);
}

void cw_sleep_hear(cw_bus *bus, unsigned i, const cw_frame *frame)
{
    const cw_sleep_settings *s = &sleep_of(bus, i)->settings;
    if (cw_frame_matches(frame, s->frames, s->frame_count))
        cw_sleep_wake(bus, i, CW_WAKE_FRAME);
}
