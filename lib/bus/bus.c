/* SPDX-License-Identifier: MIT
 *
 * bus.c - time of the bus: runs everything that is due now, and chooses the next step.
 */
#include "bus/bus_private.h"
#include "bus/invariants.h"

#include <assert.h>

/* ---- Due work -------------------------------------------------------------------------------- */

/* Reports states that rules or settings have changed, and wakes nodes for them. */
static void report_pending(cw_bus *bus)
{
    bus->pending = false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_sleep_settle(bus, i);
        cw_sleep_run(bus, i);
        cw_report_state(bus, i);
    }
}

/* Runs the restarts, wake-ups and triggers of nodes that are due now, and hands in the frames that
 * come now. */
static void run_due_nodes(cw_bus *bus)
{
    if (bus->node_due > cw_now(bus)) {
        cw_take_inbox_before(bus, cw_now(bus) + 1); /* sorted by node, too */
        return;
    }
    for (unsigned i = 0; i < bus->node_count; i++)
        cw_run_due_node(bus, i);
    /* after cw_bus_bring_forward() the inbox is not sorted by node */
    cw_take_inbox_before(bus, cw_now(bus) + 1);
    cw_find_node_due(bus);
}

/* Rules may trigger each other, but in this way each one acts only once at a tick, so the loop
 * ends. Nothing is left pending at this tick. A frame step goes on when nothing but frames come in.
 * A node that has been due may take frames again, after a restart for example. So rules with
 * traffic look once more. */
static void run_due(cw_bus *bus)
{
    bool nodes;
    cw_count_clean_bits(bus);
    do {
        nodes = bus->node_due <= cw_now(bus);
        bus->work += bus->rules.awake_count;
        if (bus->pending || bus->rules.next_due <= cw_now(bus) || bus->node_due <= cw_now(bus))
            cw_wake_controllers(bus);
        cw_rules_run_due(&bus->rules);
        run_due_nodes(bus);
        if (bus->pending)
            report_pending(bus);
    } while (bus->pending || bus->rules.next_due <= cw_now(bus) ||
             (nodes && bus->rules.awake_count));
}

/* Returns true when there may be something to run at this tick. */
static inline bool is_due(const cw_bus *bus)
{
    return cw_first_due(bus) <= cw_now(bus) || bus->pending || bus->rules.awake_count;
}

/* Runs it. */
static void run_all_due(cw_bus *bus)
{
    if (is_due(bus))
        run_due(bus);
}

/* ---- Going on -------------------------------------------------------------------------------- */

/* Goes one bit, and lets nodes with local time note a SOF in it (L3). */
static void step_bit(cw_bus *bus)
{
    cw_step_bit(bus);
    if (bus->tt)
        cw_tt_look(bus);
}

/* Takes a bit that ends early, since a frame begins then. Returns false when the next one does
 * not. */
static bool starts_at_tick(cw_bus *bus)
{
    const uint64_t usual = cw_wire_tick(&bus->time, 1);
    const uint64_t end = cw_start_in_bit(bus, usual);
    if (end == usual)
        return false;
    bus->time.short_by = (uint32_t)(usual - end);
    bus->early_ticks += bus->time.short_by;
    step_bit(bus);
    return true;
}

/* Goes on in a way other than frame steps, where the bus has to. Returns false when it has not. */
static bool goes_another_way(cw_bus *bus, uint64_t tick)
{
    if (bus->start_at_tick && starts_at_tick(bus))
        return true;
    if (cw_is_off_grid(bus)) {
        if (!cw_timed_may_leap(bus) ||
            ((bus->tt || !cw_timed_frame_go(bus, tick)) && !cw_timed_rest_go(bus, tick)))
            cw_step_bit_times(bus, tick);
        return true;
    }
    if (bus->stepping || bus->watching) {
        if (bus->stepping || !cw_frame_seen_go(bus))
            step_bit(bus);
        return true;
    }
    return false;
}

/* Goes on by equal bits, or by one bit. Other bits follow those of a flag at once, since no frame
 * can begin there. */
static void run_or_step(cw_bus *bus, uint64_t tick)
{
    cw_held held;
    do {
        held = cw_find_held(bus);
        const uint64_t bits = cw_run_reach(bus, &held, tick);
        if (bits == 0) {
            step_bit(bus);
            return;
        }
        cw_run_go(bus, bits, &held);
    } while (held.bits && !is_due(bus) && cw_ring_has_room(bus) && cw_next_bit_fits(bus, tick));
}

/* Goes on by some bits, at least one. */
static void bus_go_on(cw_bus *bus, uint64_t tick)
{
    if (bus->outlook.plain == 0 && goes_another_way(bus, tick))
        return;
    if (cw_frame_step_go(bus, tick)) {
        if (bus->tt && !bus->frame_step.active) /* maybe by a single bit */
            cw_tt_look(bus);
        return;
    }
    run_or_step(bus, tick);
}

/* Goes up to a tick, or stops when work and events reach `enough`; goes at least one bit. */
static cw_status go_to(cw_bus *bus, uint64_t tick, uint64_t enough)
{
    if (!cw_ring_has_room(bus))
        return CW_FULL;
    run_all_due(bus);
    const uint64_t begin = cw_now(bus);
    for (bool more = cw_next_bit_fits(bus, tick); more;) {
        if (!cw_ring_has_room(bus))
            return CW_FULL;
        bus_go_on(bus, tick);
        run_all_due(bus);
        bus->work++;
        if (CW_CHECKED)
            cw_assert_bus(bus);
        more = cw_next_bit_fits(bus, tick);
        if (more && cw_bus_work(bus) + bus->ring.count >= enough && cw_now(bus) > begin)
            return CW_AGAIN;
    }
    return CW_OK;
}

/* All has been done up to a tick: another advance to it, or to the end of the last bit before it,
 * changes nothing. So a journal, which has the ends of bits, repeats a run. */
static void assert_reached(const cw_bus *bus, uint64_t tick)
{
    assert(!cw_next_bit_fits(bus, tick) && cw_next_bit_end(bus) != cw_now(bus));
    assert(cw_first_due(bus) > cw_now(bus) && !bus->pending);
}

/* Goes up to a tick, or until `work` has been spent. Events count as work. */
static cw_status bus_advance(cw_bus *bus, uint64_t tick, uint64_t work)
{
    const unsigned events = bus->ring.count;
    const uint64_t begin = cw_now(bus);
    cw_status status = go_to(bus, tick, cw_after(cw_bus_work(bus) + events, work));
    bus->work += bus->ring.count - events;
    cw_count_clean_bits(bus);
    assert(cw_now(bus) <= tick || cw_now(bus) == begin);
    if (CW_CHECKED && status == CW_OK)
        assert_reached(bus, tick);
    return status;
}

cw_status cw_bus_advance(cw_bus *bus, uint64_t tick)
{
    return bus_advance(bus, tick, UINT64_MAX);
}

cw_status cw_bus_advance_some(cw_bus *bus, uint64_t tick, uint64_t work)
{
    return bus_advance(bus, tick, work);
}

uint64_t cw_bus_work(const cw_bus *bus)
{
    return bus->work + bus->rules.work;
}

void cw_bus_set_stepping(cw_bus *bus, bool stepping)
{
    bus->stepping = stepping;
    cw_outlook_forget(bus);
    if (!stepping)
        return;
    cw_wake_controllers(bus);
    cw_leave(bus, bus->all);
}

void cw_bus_set_own_clocks(cw_bus *bus, bool own)
{
    bus->timed.requested = own && !bus->lean;
    cw_outlook_forget(bus);
}

void cw_bus_set_watching(cw_bus *bus, bool watching)
{
    bus->watching = watching;
    cw_outlook_forget(bus);
    if (watching && !bus->frame_step.seen)
        cw_wake_controllers(bus);
}

/* Returns the bits up to a tick in which the wire stays recessive, and nothing happens. */
static uint64_t quiet_bits(cw_bus *bus, uint64_t tick)
{
    const cw_held none = {.bits = 0};
    return cw_run_reach(bus, &none, tick);
}

uint64_t cw_bus_rests_until(cw_bus *bus, uint64_t tick)
{
    if (tick <= cw_now(bus) || bus->pending || !cw_bus_idle(bus))
        return cw_now(bus);
    return cw_wire_tick(&bus->time, cw_is_off_grid(bus) ? cw_timed_rest_reach(bus, tick)
                                                        : quiet_bits(bus, tick));
}

/* Events at the end of a bit show in that bit, so the last bit is left to be simulated. */
uint64_t cw_bus_quiet_until(cw_bus *bus, uint64_t tick)
{
    if (tick <= cw_now(bus) || bus->pending || bus->note.end != cw_now(bus))
        return cw_now(bus);
    if (bus->frame_step.active && bus->frame_step.seen)
        return cw_wire_tick(&bus->time, cw_frame_seen_alike(bus, tick));
    if (!cw_view_is_quiet(bus))
        return cw_now(bus);
    uint64_t bits = quiet_bits(bus, tick);
    return bits > 1 ? cw_wire_tick(&bus->time, bits - 1) : cw_now(bus);
}

void cw_bus_set_events(cw_bus *bus, uint32_t kinds)
{
    if (kinds == bus->wanted)
        return;
    cw_wake_controllers(bus); /* a frame step in progress relies on the kinds of events wanted
                                 before */
    bus->wanted = kinds;
    cw_outlook_forget(bus);
}
