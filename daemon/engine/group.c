/* SPDX-License-Identifier: MIT
 *
 * group.c - the buses of a rig in real time: an engine each, with one clock and one timer.
 *
 * Ports only note that they are readable. The wake-up follows when the loop has called all of them.
 * So no bus is advanced beyond a frame that its port has already got.
 */
#include "engine/group.h"

#include "base/log.h"
#include "engine/core.h"
#include "run/meeting.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

struct engine_group {
    struct ev_loop *loop;
    const rig *rig;
    engine_clock clock;
    catchup catchup;
    ev_io timer;
    wake_alarm alarm;
    ev_prepare before_wait;
    meeting meeting;
    engine *buses[RIG_BUSES_MAX];
    clock_pair now;   /* the moment of a wake-up */
    bool running;     /* a wake-up is under way */
    uint32_t awake;   /* buses that take part in this or the next one */
    uint32_t read;    /* of these, the ones whose ports have been read */
    uint32_t changed; /* buses whose timer has to be set */
};

static uint32_t bit_of(const engine *e)
{
    return UINT32_C(1) << e->place;
}

static uint32_t all_of(const engine_group *g)
{
    return (UINT32_C(1) << g->rig->bus_count) - 1;
}

static void enter(const engine *e)
{
    (void)log_enter(e->name);
}

/* ---- Timer ----------------------------------------------------------------------------------- */

/* Sets the one timer of all buses to the first of their wake-ups. */
static void set_alarm(engine_group *g)
{
    int64_t wake_ns = INT64_MAX;
    for (size_t i = 0; i < g->rig->bus_count; i++)
        if (g->buses[i]->wake_ns < wake_ns)
            wake_ns = g->buses[i]->wake_ns;
    if (!alarm_set(&g->alarm, wake_ns))
        engine_fail(g->buses[0], "timer", strerror(errno));
}

static void group_arm(engine *e)
{
    if (!e->group->running)
        set_alarm(e->group);
}

/* ---- Meetings -------------------------------------------------------------------------------- */

/* Reads the ports of a bus, once in a wake-up. */
static void read_ports(engine_group *g, engine *e)
{
    if (g->read & bit_of(e))
        return;
    g->read |= bit_of(e);
    g->changed |= bit_of(e);
    engine_start_turn(e);
    engine_read_ports(e, &g->now);
    engine_start_turn(e); /* the bus has a time limit of its own, independent of the ports */
}

/* Lets a bus go on to a tick. False: there is more to do than fits into one turn. */
static bool go(void *user, size_t bus, uint64_t tick)
{
    engine_group *g = user;
    engine *e = g->buses[bus];
    enter(e);
    g->changed |= bit_of(e);
    if (e->stopping) {
        engine_run_out(e, tick);
        return true;
    }
    read_ports(g, e);
    return engine_go(e, tick);
}

/* Returns how far the others may go on before a frame of this bus can come to them. */
static meeting_outlook group_look(void *user, size_t bus)
{
    engine_group *g = user;
    engine *e = g->buses[bus];
    const gateways_bus place = {.gateways = g->meeting.gateways, .bus = bus};
    const meeting_outlook found = meeting_find(&place, e->now.bus, e->now.plan, e->config);
    if (e->stopping)
        return (meeting_outlook){.next = CW_NEVER, .reaction = found.reaction};
    return found;
}

/* Hands in a frame that a gateway passes on. When there is no room, the bus goes on a little
 * first. */
static cw_status group_send_frame(void *user, size_t bus, unsigned node, const cw_frame *frame,
                                  uint64_t received, uint64_t at_tick)
{
    engine_group *g = user;
    engine *e = g->buses[bus];
    cw_status status = inputs_send(&e->inputs, node, frame, at_tick);
    if (status == CW_FULL && go(g, bus, received))
        status = inputs_send(&e->inputs, node, frame, at_tick);
    e->books.nodes[node].released += status == CW_OK;
    g->changed |= bit_of(e);
    return status;
}

static void carry(engine *e, const cw_event *event)
{
    if (!gateways_note(e->group->meeting.gateways, e->place, event))
        engine_fail(e, "gateways", "out of memory");
}

/* Advances the buses that take part to the present. Those without gateways go first, since others
 * may need all the time of this wake-up. */
static void group_advance(engine_group *g, uint64_t now)
{
    uint32_t waiting = g->awake;
    for (size_t i = 0; i < g->rig->bus_count; i++) {
        engine *e = g->buses[i];
        if (!(g->awake & bit_of(e)))
            continue;
        if (e->carried == 0 || e->stopping) {
            (void)go(g, i, now);
            waiting &= ~bit_of(e);
        } else {
            enter(e);
            read_ports(g, e);
        }
        meeting_look(&g->meeting, i);
    }
    (void)meeting_run(&g->meeting, now, waiting);
}

/* ---- Wake-ups -------------------------------------------------------------------------------- */

/* Skips time when a bus is too far behind. It is the time of all. */
static void skip_missed_time(engine_group *g)
{
    int64_t boot_ns = clock_ns(CLOCK_BOOTTIME);
    int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    uint64_t now = clock_tick(&g->clock, now_ns);
    uint64_t excess = 0;
    for (size_t i = 0; i < g->rig->bus_count; i++) {
        const engine *e = g->buses[i];
        if (e->stopping)
            return;
        if (e->wake_ns > now_ns && !(g->awake & bit_of(e)))
            continue;
        uint64_t own = catchup_excess(engine_next_tick(e), now, e->catch_up_ticks);
        excess = own > excess ? own : excess;
    }
    uint64_t skipped_ns = excess / 2 * 25;
    g->clock.epoch_ns += (int64_t)skipped_ns;
    skipped_ns += catchup_suspended(&g->catchup, boot_ns, now_ns);
    for (size_t i = 0; skipped_ns > 0 && i < g->rig->bus_count; i++)
        engine_skip(g->buses[i], skipped_ns, excess);
    if (skipped_ns > 0) {
        catchup_note(&g->catchup, skipped_ns);
        g->awake = all_of(g);
    }
    (void)log_enter(NULL);
    catchup_log(&g->catchup, now_ns);
}

/* Finds the buses that take part. One with gateways does when others must not go beyond what it
 * does, or when its ports are not watched. */
static void wake_due(engine_group *g)
{
    for (size_t i = 0; i < g->rig->bus_count; i++) {
        const engine *e = g->buses[i];
        int64_t due_ns = e->carried && e->due_ns < e->wake_ns ? e->due_ns : e->wake_ns;
        if (due_ns <= g->now.monotonic_ns || e->stopping || (e->carried && e->ticking))
            g->awake |= bit_of(e);
    }
}

/* Brings all buses of a rig up to the present. */
static void wake_group(engine_group *g)
{
    if (g->running)
        return;
    const char *before = log_enter(NULL);
    g->running = true;
    g->read = 0;
    g->changed = 0;
    skip_missed_time(g);
    g->now = clock_read();
    clock_follow(&g->clock, &g->now);
    wake_due(g);
    group_advance(g, clock_tick(&g->clock, g->now.monotonic_ns));
    for (size_t i = 0; i < g->rig->bus_count; i++)
        if (g->changed & bit_of(g->buses[i]))
            engine_arm_timer(g->buses[i]);
    g->awake = 0;
    g->running = false;
    set_alarm(g);
    (void)log_enter(before);
}

static void wake(engine *e)
{
    e->group->awake |= bit_of(e);
    wake_group(e->group);
}

/* Only notes the bus: on_before_wait() wakes all when the loop has called the other ports. */
static void on_port(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = ((port_watch *)io)->engine;
    if (engine_port_wakes(e, events))
        e->group->awake |= bit_of(e);
}

/* The loop is about to wait: all ports that are readable have been noted. */
static void on_before_wait(struct ev_loop *loop, ev_prepare *watcher, int events)
{
    (void)loop;
    (void)events;
    engine_group *g = watcher->data;
    if (g->awake)
        wake_group(g);
}

/* The timer has run out. Those buses are looked at for ticking whose time it was. */
static void group_on_timer(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine_group *g = io->data;
    uint64_t read_before[RIG_BUSES_MAX];
    if (!engine_is_watched(g->buses[0], events, "timer") || !alarm_take(&g->alarm))
        return;
    int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    uint32_t due = 0;
    for (size_t i = 0; i < g->rig->bus_count; i++) {
        const engine *e = g->buses[i];
        if (e->wake_ns > now_ns)
            continue;
        engine_spin(e);
        due |= bit_of(e);
        read_before[i] = e->frames_read;
    }
    wake_group(g);
    for (size_t i = 0; i < g->rig->bus_count; i++) {
        engine *e = g->buses[i];
        if (!(due & bit_of(e)) || !e->ticking || e->frames_read != read_before[i])
            continue;
        engine_stop_ticking(e);
        engine_arm_timer(e);
    }
}

/* Ends the loop when all buses have stopped. */
static void over(engine *e)
{
    for (size_t i = 0; i < e->group->rig->bus_count; i++)
        if (!e->group->buses[i]->stopped)
            return;
    ev_break(e->loop, EVBREAK_ALL);
}

/* ---- Reload ---------------------------------------------------------------------------------- */

/* Returns whether a gateway still has its node in a new configuration, without a port. */
static bool may_take_end(const engine_group *g, const rig_gateway *gateway, const rig_end *end,
                         const cfg *config, FILE *errors)
{
    unsigned node = cfg_find_node(config, end->name);
    if (node == CW_NO_NODE) {
        fprintf(errors, "%s:1:1: there is no node %s any more: gateway %s of %s has it\n",
                config->file, end->name, gateway->name, g->rig->file);
        return false;
    }
    const cfg_place place = config->nodes[node].port_place;
    if (config->nodes[node].port)
        fprintf(errors, "%s:%d:%d: node %s: gateway %s of %s has it: it can have no port\n",
                config->file, place.line, place.column, end->name, gateway->name, g->rig->file);
    return !config->nodes[node].port;
}

/* Returns whether a new configuration of one bus suits the gateways of the rig. */
static bool may_take(engine *e, const cfg *config, FILE *errors)
{
    bool good = true;
    const rig *r = e->group->rig;
    for (size_t i = 0; i < r->gateway_count; i++)
        for (unsigned end = 0; end < 2; end++)
            if (r->gateways[i].ends[end].bus == e->place)
                good = may_take_end(e->group, &r->gateways[i], &r->gateways[i].ends[end], config,
                                    errors) && good;
    return good;
}

static void moved(engine *e, const uint8_t from[CW_NODES_MAX])
{
    gateways_remap(e->group->meeting.gateways, e->place, from);
    e->carried = gateways_nodes(e->group->meeting.gateways, e->place);
}

/* ---- Start and end --------------------------------------------------------------------------- */

static const group_calls calls = {.carry = carry, .may_take = may_take, .moved = moved};

/* Opens a bus of the group, which has the clock and the timer of the group. */
static bool group_open_bus(engine_group *g, size_t place, live *config)
{
    (void)log_enter(g->rig->names[place]);
    engine *e = engine_open(g->loop, config);
    g->buses[place] = e;
    if (!e)
        return false;
    e->group = g;
    e->group_calls = &calls;
    e->place = place;
    e->name = g->rig->names[place];
    e->carried = gateways_nodes(g->meeting.gateways, place);
    e->clock = &g->clock;
    e->wake = wake;
    e->on_port = on_port;
    e->arm = group_arm;
    e->over = over;
    e->wake_ns = INT64_MAX;
    return true;
}

/* Opens all buses of a rig, and the gateways before them, which need to know their nodes. */
static bool open_all(engine_group *g, live *const *lives)
{
    static const meeting_calls meeting_of = {.go = go, .look = group_look};
    g->meeting = (meeting){.gateways = gateways_new(g->rig, group_send_frame, g),
                           .calls = &meeting_of,
                           .user = g,
                           .bus_count = g->rig->bus_count};
    if (!g->meeting.gateways) {
        log_error("out of memory");
        return false;
    }
    bool good = true;
    for (size_t i = 0; good && i < g->rig->bus_count; i++)
        good = group_open_bus(g, i, lives[i]);
    (void)log_enter(NULL);
    if (good && !alarm_open(&g->alarm)) {
        log_error("timerfd: %s", strerror(errno));
        good = false;
    }
    return good;
}

engine_group *engine_group_start(struct ev_loop *loop, const rig *config, live *const *lives)
{
    engine_group *g = calloc(1, sizeof *g);
    if (!g) {
        log_error("out of memory");
        return NULL;
    }
    g->loop = loop;
    g->rig = config;
    g->alarm = ALARM_CLOSED;
    if (!open_all(g, lives)) {
        engine_group_free(g);
        return NULL;
    }
    clock_begin(&g->clock);
    catchup_begin(&g->catchup, clock_ns(CLOCK_BOOTTIME), g->clock.epoch_ns);
    ev_io_init(&g->timer, group_on_timer, g->alarm.fd, EV_READ);
    g->timer.data = g;
    ev_io_start(loop, &g->timer);
    ev_prepare_init(&g->before_wait, on_before_wait);
    g->before_wait.data = g;
    ev_prepare_start(loop, &g->before_wait);
    for (size_t i = 0; i < config->bus_count; i++) {
        enter(g->buses[i]);
        engine_begin(g->buses[i]);
        meeting_look(&g->meeting, i);
    }
    (void)log_enter(NULL);
    return g;
}

void engine_group_free(engine_group *g)
{
    if (!g)
        return;
    if (g->alarm.fd >= 0) {
        ev_io_stop(g->loop, &g->timer);
        ev_prepare_stop(g->loop, &g->before_wait);
    }
    alarm_close(&g->alarm);
    for (size_t i = 0; i < g->rig->bus_count; i++)
        engine_free(g->buses[i]);
    gateways_free(g->meeting.gateways);
    free(g);
}

engine *engine_group_bus(const engine_group *g, size_t bus)
{
    return g->buses[bus];
}

const gateways *engine_group_gateways(const engine_group *g)
{
    return g->meeting.gateways;
}
