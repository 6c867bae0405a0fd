/* SPDX-License-Identifier: MIT
 *
 * advance.c - advances the bus to a tick and passes its events to ECUs and observers.
 */
#include "engine/core.h"

#include "trace/errframe.h"

#define WAKE_MAX_NS 50000000 /* of a wake-up that has much to catch up with */
#define WORK_AT_ONCE 256u /* of the bus, between two readings of the clock */
#define CALM_SHOWN_BITS 24 /* behind an event: a recording has shown all of it by then */

/* ---- Events ---------------------------------------------------------------------------------- */

/* Returns the modes, which decide the error frames of the ECU and may change while the bus runs. */
static unsigned modes_of(const engine *e, unsigned node)
{
    return cw_node_modes(e->now.bus, node);
}

/* Tells the clients of a port how a frame of theirs has ended. A controller that is in a program
 * also gets the state of its node. */
static void tell_clients(const engine *e, unsigned node, const cw_event *event)
{
    port *p = e->now.ports[node];
    const bool controlled = port_has_controller(p);
    port_set_time(p, event->tick, (int64_t)clock_realtime_ns(e->clock, event->tick));
    if (controlled)
        engine_tell_state(e, node, event);
    if (event->kind == CW_EVENT_TX || event->kind == CW_EVENT_DROP)
        port_ended(p, event);
    if (controlled)
        engine_settle(e, node, event);
}

/* Gives an event to the ECU of a node: a received frame, or the error frame that stands for it. */
static void advance_deliver(engine *e, unsigned node, const cw_event *event)
{
    errframe error;
    bool received = event->kind == CW_EVENT_RX;
    if (e->now.ports[node] && port_is_shared(e->now.ports[node]))
        tell_clients(e, node, event);
    if (!e->now.ports[node] && received)
        conserve_missed(&e->books, node, e->config->nodes[node].port != NULL);
    if (!e->now.ports[node])
        return;
    port_gather(e->now.ports[node]);
    if (received)
        (void)port_write(e->now.ports[node], &event->frame); /* the port counts a failure */
    else if (errframe_from_event(&error, event, modes_of(e, node),
                                 e->config->nodes[node].controller.driver))
        (void)port_write_error(e->now.ports[node], &error, event->tick);
}

/* Keeps the last lost frame of a node, since its identifier shows which program sent it. */
static void note_overflow(engine *e, const cw_event *event)
{
    if (event->kind != CW_EVENT_DROP || event->why != CW_DROP_QUEUE_FULL)
        return;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (event->nodes >> i & 1u)
            e->overflowed[i] = event->frame;
}

void engine_notify(engine *e, const cw_event *event)
{
    note_overflow(e, event);
    if (e->observer)
        e->observer(e->observer_user, event);
}

/* Writes what the ports of a set of nodes have gathered. */
static void flush_ports(const engine *e, uint64_t nodes)
{
    for (; nodes; nodes &= nodes - 1) {
        port *p = e->now.ports[__builtin_ctzll(nodes)];
        if (p)
            port_flush(p);
    }
}

void engine_handle_events(void *user)
{
    engine *e = user;
    cw_event event;
    uint64_t nodes = 0;
    while (cw_bus_poll(e->now.bus, &event)) {
        e->calm_bits = 0;
        nodes |= event.nodes;
        for (unsigned i = 0; i < e->config->node_count; i++)
            if (event.nodes >> i & 1u)
                advance_deliver(e, i, &event);
        if (event.nodes & e->carried)
            e->group_calls->carry(e, &event);
        engine_notify(e, &event);
    }
    flush_ports(e, nodes);
}

/* ---- Bus ------------------------------------------------------------------------------------- */

void engine_start_turn(engine *e)
{
    e->deadline_ns = clock_ns(CLOCK_MONOTONIC) + WAKE_MAX_NS;
    e->looked_at = cw_bus_work(e->now.bus);
}

/* Returns true when this wake-up has lasted for long enough. */
bool engine_turn_is_over(const engine *e)
{
    return clock_ns(CLOCK_MONOTONIC) >= e->deadline_ns;
}

static uint64_t work_since_look(const engine *e)
{
    return cw_bus_work(e->now.bus) - e->looked_at;
}

/* Returns true while this wake-up may go on. It reads the clock only after some work: a millisecond
 * of the bus, or one frame, may be any amount of work. */
static bool has_time(engine *e)
{
    if (work_since_look(e) < WORK_AT_ONCE)
        return true;
    e->looked_at = cw_bus_work(e->now.bus);
    return !engine_turn_is_over(e);
}

/* Advances to a tick; returns false when the time of this wake-up ends before. */
static bool go_to(engine *e, uint64_t tick)
{
    while (has_time(e))
        if (inputs_advance_some(&e->inputs, tick, WORK_AT_ONCE - work_since_look(e)))
            return true;
    return false;
}

/* Advances bit by bit and shows each bit. The bits of an idle bus, which show nothing, are one
 * step. */
static bool show_bits(engine *e, uint64_t tick)
{
    while (cw_bus_tick_after(e->now.bus, 1) <= tick) {
        bool calm = e->calm_bits >= CALM_SHOWN_BITS;
        uint64_t now = cw_bus_now(e->now.bus);
        uint64_t quiet = calm ? cw_bus_quiet_until(e->now.bus, tick) : now;
        cw_bus_set_watching(e->now.bus, quiet == now);
        if (!go_to(e, quiet > now ? quiet : cw_bus_tick_after(e->now.bus, 1)))
            return false;
        if (quiet == now) {
            e->bit_observer(e->bit_user, e->now.bus);
            e->calm_bits++;
        }
    }
    return true;
}

/* Advances to a tick; returns false when the time of this wake-up ends before. */
bool engine_advance(engine *e, uint64_t tick)
{
    return (!e->bit_observer || show_bits(e, tick)) && go_to(e, tick);
}
