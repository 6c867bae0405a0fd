/* SPDX-License-Identifier: MIT
 *
 * intake.c - moves frames of ECUs from their ports into the inbox of the bus.
 */
#include "engine/core.h"

#include "base/log.h"

#include <string.h>

#define READS_MAX 64 /* batches of one port at one wake-up, so that no port starves the others */
#define KEPT_FREE 1024u /* of the inbox, for traffic of the configuration */

/* Returns the arrival of a frame in bus time. Somebody may have set the clock: a time stamp from
 * the future counts as now. The bus itself moves one from before the last wake-up to now. The
 * frames of a port keep the order in which they are read. */
static uint64_t arrival_tick(engine *e, unsigned node, const port_frame *frame,
                             const clock_pair *now)
{
    int64_t age_ns = now->realtime_ns - frame->realtime_ns;
    if (frame->realtime_ns == 0 || age_ns < 0)
        age_ns = 0;
    uint64_t tick = clock_tick(e->clock, now->monotonic_ns - age_ns);
    if (tick > e->arrived[node])
        e->arrived[node] = tick;
    return e->arrived[node];
}

/* Makes room in the inbox. Traffic that is due until then is handed in, too. Returns false when the
 * time of this wake-up ends before. */
static bool intake_make_room(engine *e)
{
    const uint64_t bit = cw_rate_ticks(e->config->rate, 1);
    release_look(e->now.plan, e->now.bus);
    const uint64_t release = release_next_tick(e->now.plan);
    uint64_t tick = cw_bus_inbox_first(e->now.bus);
    tick = (release < tick ? release : tick) + bit;
    if (release_is_fast(e->now.plan))
        tick = cw_bus_tick_after(e->now.bus, 1); /* it may send after each bit */
    const uint64_t reached = engine_release_to(e, tick);
    return engine_advance(e, reached) && reached == tick;
}

/* Lets the other programs of a port see a frame that one of them has sent. */
static void share_frame(engine *e, port *p, const port_frame *frame, uint64_t tick)
{
    const uint64_t now = cw_bus_now(e->now.bus);
    port_set_time(p, tick > now ? tick : now, frame->realtime_ns);
    port_handed_in(p, frame);
}

/* Hands in frames that have been read, each at the tick of its arrival. */
static void hand_in_batch(engine *e, unsigned node, unsigned count, const clock_pair *now)
{
    for (unsigned i = 0; i < count; i++) {
        uint64_t tick = arrival_tick(e, node, &e->batch[i], now);
        if (e->virtual_time)
            e->batch[i].realtime_ns = now->realtime_ns;
        if (port_is_shared(e->now.ports[node]))
            share_frame(e, e->now.ports[node], &e->batch[i], tick);
        if (e->batch[i].is_error)
            continue;
        e->frames_read++;
        (void)inputs_send(&e->inputs, node, &e->batch[i].frame, tick); /* there is room for the
                                                                          frame */
    }
}

/* Returns the number of frames that the inbox has room for, up to a batch, after the bus has made
 * some. */
static unsigned inbox_room(engine *e)
{
    while (cw_bus_inbox_room(e->now.bus) < KEPT_FREE + PORT_BATCH && intake_make_room(e))
        continue;
    unsigned room = cw_bus_inbox_room(e->now.bus);
    room = room > KEPT_FREE ? room - KEPT_FREE : 0;
    return room < PORT_BATCH ? room : PORT_BATCH;
}

/* Returns the number of frames that a port's node takes at once; 0: its queue is full, and they
 * wait. */
static unsigned node_room(const engine *e, unsigned node, bool waits)
{
    unsigned room = waits ? cw_node_room(e->now.bus, node) : PORT_BATCH;
    return room < PORT_BATCH ? room : PORT_BATCH;
}

/* Tells when a port can no longer be read, and when it can again. */
static void report_failure(const engine *e, unsigned node)
{
    const char *name = e->config->nodes[node].name;
    int error;
    if (!port_reading_changed(e->now.ports[node], &error))
        return;
    if (error != 0)
        log_node_warning(name, "its port cannot be read: %s", strerror(error));
    else
        log_node_info(name, "its port can be read again");
}

/* Reads a port. Returns true when its node has room for more. With a full inbox, on a bus far
 * behind, frames stay in the port; all ports are read again soon. */
static bool read_port(engine *e, unsigned node, const clock_pair *now, bool waits)
{
    bool more = true;
    unsigned max = 1;
    for (unsigned reads = 0; more && reads < READS_MAX; reads++) {
        max = node_room(e, node, waits);
        unsigned room = max > 0 ? inbox_room(e) : 0;
        if (room == 0)
            break;
        unsigned count = port_read(e->now.ports[node], e->batch, max < room ? max : room, &more);
        hand_in_batch(e, node, count, now);
    }
    report_failure(e, node);
    port_report_overflow(e->now.ports[node], cw_bus_now(e->now.bus));
    return max > 0;
}

void engine_read_rest(engine *e, unsigned node)
{
    clock_pair now = engine_now(e);
    (void)read_port(e, node, &now, false);
    if (cw_bus_inbox_room(e->now.bus) <= KEPT_FREE)
        log_node_warning(e->config->nodes[node].name,
                         "what its ECU has written last is lost: the bus is too far behind");
}

/* Reads a port. A port that waits for room in its node's queue is not watched, or it would wake the
 * loop for ever. The bus makes room, and is checked until then. */
static void read_or_push_back(engine *e, unsigned node, const clock_pair *now)
{
    const uint64_t bit = UINT64_C(1) << node;
    bool waits = e->config->nodes[node].when_full == CFG_WHEN_FULL_WAIT;
    const bool room = read_port(e, node, now, waits);
    if (e->config->nodes[node].guest > 0 && port_is_over(e->now.ports[node]))
        e->guests.gone |= bit;
    if (room) {
        e->pushed_back &= ~bit;
        if (!e->ticking)
            engine_watch_port(e, node);
        return;
    }
    if (!(e->pushed_back & bit))
        port_pushed_back(e->now.ports[node]);
    e->pushed_back |= bit;
    engine_unwatch_port(e, node);
}

void engine_read_ports(engine *e, const clock_pair *now)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (e->now.ports[i])
            read_or_push_back(e, i, now);
}

/* Reads frames that have waited for room as soon as there is some. */
void engine_read_pushed_back(engine *e)
{
    clock_pair now = engine_now(e);
    for (unsigned i = 0; i < e->config->node_count; i++)
        if ((e->pushed_back >> i & 1u) && e->now.ports[i] && cw_node_room(e->now.bus, i) > 0)
            read_or_push_back(e, i, &now);
}

/* ---- Watching -------------------------------------------------------------------------------- */

void engine_watch_port(engine *e, unsigned node)
{
    if (!e->now.ports[node] || ev_is_active(&e->watches[node].io))
        return;
    e->watches[node].engine = e;
    ev_io_init(&e->watches[node].io, e->on_port, port_fd(e->now.ports[node]), EV_READ);
    ev_io_start(e->loop, &e->watches[node].io);
}

void engine_unwatch_port(engine *e, unsigned node)
{
    if (e->now.ports[node])
        ev_io_stop(e->loop, &e->watches[node].io);
}
