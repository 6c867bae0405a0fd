/* SPDX-License-Identifier: MIT
 *
 * engine.c - the bus in real time.
 *
 * Each wake-up, by a port or by the timer, reads all ports and hands in frames at their arrival
 * times. It then advances the bus to the present and delivers. So a late wake-up delays a delivery
 * but does not shift the bus.
 */
#include "engine/core.h"

#include "base/log.h"
#include "run/bus_make.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)

/* ---- Timer ----------------------------------------------------------------------------------- */

static void engine_arm(engine *e)
{
    if (!alarm_set(&e->alarm, e->wake_ns))
        engine_fail(e, "timer", strerror(errno));
}

/* The first frame after a pause starts this. */
static void start_ticking(engine *e)
{
    e->ticking = true;
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_unwatch_port(e, i);
    engine_arm_timer(e);
}

void engine_stop_ticking(engine *e)
{
    e->ticking = false;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (!(e->pushed_back >> i & 1u))
            engine_watch_port(e, i);
}

bool engine_port_wakes(engine *e, int events)
{
    if (!engine_is_watched(e, events, "port"))
        return false;
    if (e->config->pacing != CFG_PACING_TICK || e->stopping)
        return true;
    start_ticking(e);
    return false;
}

/* ---- Wake-ups -------------------------------------------------------------------------------- */

void engine_skip(engine *e, uint64_t skipped_ns, uint64_t excess)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        e->arrived[i] -= e->arrived[i] < excess ? e->arrived[i] : excess;
    const cw_event event = inputs_skip(&e->inputs, skipped_ns / 25 * 2, excess);
    catchup_note(&e->catchup, skipped_ns);
    engine_notify(e, &event);
}

/* Skips time when the bus is too far behind: bus time stands still, and frames that have arrived
 * meanwhile move forward with it. */
static void skip_missed_time(engine *e)
{
    int64_t boot_ns = clock_ns(CLOCK_BOOTTIME); /* this clock goes on while the machine is
                                                   suspended */
    int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    uint64_t now = clock_tick(e->clock, now_ns);
    uint64_t excess = catchup_excess(engine_next_tick(e), now, e->catch_up_ticks);
    uint64_t skipped_ns = excess / 2 * 25;
    e->clock->epoch_ns += (int64_t)skipped_ns;
    skipped_ns += catchup_suspended(&e->catchup, boot_ns, now_ns);
    if (skipped_ns > 0)
        engine_skip(e, skipped_ns, excess);
    catchup_log(&e->catchup, now_ns);
}

static void break_loop(engine *e)
{
    ev_break(e->loop, EVBREAK_ALL);
}

/* ---- Wake-ups -------------------------------------------------------------------------------- */

/* Brings the bus up to the present: clocks first, then what ECUs have written, then the bus
 * itself. */
static void wake(engine *e)
{
    if (!e->stopping)
        skip_missed_time(e);
    clock_pair clocks = clock_read();
    clock_follow(e->clock, &clocks);
    engine_start_turn(e);
    uint64_t now = clock_tick(e->clock, clocks.monotonic_ns);
    if (e->stopping) {
        engine_run_out(e, now);
    } else {
        engine_read_ports(e, &clocks);
        engine_start_turn(e); /* the bus has a time limit of its own, independent of the ports */
        (void)engine_go(e, now);
    }
    engine_arm_timer(e);
}

/* A port is readable, or has failed. */
static void on_port(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = ((port_watch *)io)->engine;
    if (engine_port_wakes(e, events))
        wake(e);
}

/* The timer has run out. Ticking ends with the first wake-up that finds nothing to read. */
static void engine_on_timer(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = io->data;
    if (!engine_is_watched(e, events, "timer") || !alarm_take(&e->alarm))
        return;
    engine_spin(e);
    uint64_t read_before = e->frames_read;
    e->wake(e);
    if (e->ticking && e->frames_read == read_before) {
        engine_stop_ticking(e);
        engine_arm_timer(e);
    }
}

/* ---- Start and stop -------------------------------------------------------------------------- */

/* Makes the timer that wakes the bus. */
static bool make_timer(engine *e)
{
    if (!alarm_open(&e->alarm)) {
        log_error("timerfd: %s", strerror(errno));
        return false;
    }
    ev_io_init(&e->timer, engine_on_timer, e->alarm.fd, EV_READ);
    e->timer.data = e;
    return true;
}

engine *engine_open(struct ev_loop *loop, live *config)
{
    engine *e = calloc(1, sizeof *e);
    if (!e) {
        log_error("out of memory");
        return NULL;
    }
    e->loop = loop;
    e->live = config;
    e->config = live_config(config);
    e->clock = &e->own_clock;
    e->wake = wake;
    e->on_port = on_port;
    e->arm = engine_arm;
    e->over = break_loop;
    e->alarm = ALARM_CLOSED;
    if (e->config->pacing == CFG_PACING_VIRTUAL && !engine_open_virtual(e)) {
        engine_free(e);
        return NULL;
    }
    const bool made = setup_make(&e->now, e->config);
    inputs_init(&e->inputs, config, e->now.bus, engine_handle_events, e);
    if (!made)
        log_error("%s", bus_why_not());
    if (made && engine_open_ports(e) && engine_open_door(e) && engine_watch_links(e))
        return e;
    engine_free(e);
    return NULL;
}

void engine_begin(engine *e)
{
    engine_read_limits(e);
    engine_choose_events(e);
    release_look(e->now.plan, e->now.bus);
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_watch_port(e, i);
    engine_watch_door(e);
    engine_arm_timer(e);
}

engine *engine_start(struct ev_loop *loop, live *config)
{
    engine *e = engine_open(loop, config);
    if (!e)
        return NULL;
    if (!make_timer(e)) {
        engine_free(e);
        return NULL;
    }
    if (!e->virtual_time)
        clock_begin(e->clock);
    catchup_begin(&e->catchup, clock_ns(CLOCK_BOOTTIME), e->clock->epoch_ns);
    ev_io_start(loop, &e->timer);
    engine_begin(e);
    if (e->virtual_time)
        engine_begin_virtual(e);
    return e;
}

/* No port, interface or guest wakes the bus from here on. */
static void unwatch_all(engine *e)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_unwatch_port(e, i);
    engine_unwatch_links(e);
    engine_unwatch_door(e);
}

void engine_stop(engine *e)
{
    if (e->stopping)
        return;
    e->wake(e); /* frames that have arrived up to now still count */
    e->stopping = true;
    e->ticking = false;
    if (!e->group)
        catchup_log(&e->catchup, INT64_MAX);
    e->stop_tick = cw_bus_tick_after(e->now.bus, BOUNDARY_BITS);
    e->stop_ns = clock_ns(CLOCK_MONOTONIC) + NS_PER_S +
                 2 * (int64_t)text_ticks_ns(cw_rate_ticks(e->config->rate, BOUNDARY_BITS));
    reload_free(e->next);
    e->next = NULL;
    unwatch_all(e);
    e->wake(e);
}

void engine_free(engine *e)
{
    if (!e)
        return;
    unwatch_all(e);
    if (e->alarm.fd >= 0)
        ev_io_stop(e->loop, &e->timer);
    alarm_close(&e->alarm);
    reload_free(e->next);
    engine_close_virtual(e);
    setup_free(&e->now);
    free(e);
}

void engine_update(engine *e)
{
    e->wake(e);
}

int64_t engine_time_ns(const engine *e, uint64_t tick)
{
    return clock_monotonic_ns(e->clock, tick);
}

inputs *engine_change(engine *e)
{
    e->wake(e);
    return &e->inputs;
}

inputs *engine_inputs(engine *e)
{
    return &e->inputs;
}

void engine_on_change(engine *e, engine_changed *changed, void *user)
{
    e->changed = changed;
    e->changed_user = user;
}

void engine_observe(engine *e, engine_observer *observer, void *user)
{
    e->observer = observer;
    e->observer_user = user;
}

void engine_set_events(engine *e, uint32_t kinds)
{
    e->kinds = kinds;
    engine_choose_events(e);
}

void engine_observe_bits(engine *e, engine_bit_observer *observer, void *user)
{
    e->bit_observer = observer;
    e->bit_user = user;
    e->calm_bits = 0; /* a new observer sees the present state first */
    if (!observer)
        cw_bus_set_watching(e->now.bus, false);
}

uint64_t engine_realtime_ns(const engine *e, uint64_t tick)
{
    return clock_realtime_ns(e->clock, tick);
}

const cw_bus *engine_bus(const engine *e)
{
    return e->now.bus;
}

/* Returns how late the bus is for its next bit, in ns; 0: it is on time. A tick is 25/2 ns. */
static uint64_t lag_ns(const engine *e)
{
    if (e->virtual_time)
        return 0;
    uint64_t now = clock_tick(e->clock, clock_ns(CLOCK_MONOTONIC));
    uint64_t due = engine_next_tick(e);
    return due < now ? (now - due) / 2 * 25 : 0;
}

void engine_report(const engine *e, report *out)
{
    memset(out, 0, sizeof *out);
    out->epoch_ns = engine_realtime_ns(e, 0);
    out->lag_ns = lag_ns(e);
    out->skips = e->catchup.skips;
    out->skipped_ns = e->catchup.skipped_ns;
    engine_report_virtual(e, out);
    for (unsigned i = 0; i < e->config->node_count; i++) {
        port *own = e->now.ports[i];
        out->nodes[i].link = e->links.state[i];
        out->nodes[i].port = own;
        conserve_get_stats(&out->nodes[i].interface, &e->books, i, own);
        out->nodes[i].pushed_back = e->pushed_back >> i & 1u;
        out->nodes[i].overflowed = e->overflowed[i];
        out->nodes[i].conserved = conserve_balances(&e->books, e->now.bus, i, own);
    }
}

unsigned engine_check_books(const engine *e)
{
    return conserve_check(&e->books, e->config, e->now.bus, e->now.ports);
}
