/* SPDX-License-Identifier: MIT
 *
 * sim_run.c - a bus in virtual time: releases handed in, time advanced, events and bits passed on.
 */
#include "sim_run.h"

#include <assert.h>
#include <stdlib.h>

#define INBOX_FRAMES 1024
#define EVENT_RING 4096
#define QUIET_LIMIT_S 10u     /* of bus time without a tx or a release */
#define END_RECESSIVE_BITS 11 /* after the last frame */

/* ---- Set-up ---------------------------------------------------------------------------------- */

bool sim_open(sim_run *s, cfg *config)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    *s = (sim_run){.config = config, .until = CW_NEVER};
    cfg_bus_config(&bus_config, nodes, config);
    bus_config.inbox = INBOX_FRAMES;
    bus_config.events = EVENT_RING;
    s->memory = malloc(cw_bus_size(&bus_config));
    s->plan = release_plan_new(config);
    if (!s->memory || !s->plan)
        return false;
    s->bus = cw_bus_init(s->memory, &bus_config);
    return s->bus != NULL;
}

void sim_close(sim_run *s)
{
    release_plan_free(s->plan);
    free(s->memory);
    s->plan = NULL;
    s->memory = NULL;
    s->bus = NULL;
}

void sim_add_sink(sim_run *s, const sim_sink *sink)
{
    assert(s->sink_count < SIM_SINKS_MAX);
    s->sinks[s->sink_count++] = *sink;
}

void sim_may_stop(sim_run *s)
{
    s->may_stop = true;
}

void sim_stop(sim_run *s, uint64_t tick)
{
    assert(s->may_stop);
    s->stopped = true;
    s->until = tick;
}

/* ---- The run --------------------------------------------------------------------------------- */

static void pass_on_events(sim_run *s)
{
    cw_event event;
    while (cw_bus_poll(s->bus, &event)) {
        if (event.tick > s->until)
            continue;
        if (event.kind == CW_EVENT_TX)
            s->last_activity = event.tick;
        for (unsigned i = 0; i < s->sink_count; i++)
            if (s->sinks[i].event)
                s->sinks[i].event(s->sinks[i].user, &event);
    }
}

static void advance_bus(sim_run *s, uint64_t tick)
{
    while (cw_bus_advance(s->bus, tick) == CW_FULL)
        pass_on_events(s);
    pass_on_events(s);
}

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* Start of the first bit from now on that a sink wants, or CW_NEVER. */
static uint64_t wanted_from(const sim_run *s, const sim_sink *sink)
{
    const uint64_t now = cw_bus_now(s->bus);
    uint64_t first = sink->bits_from - sink->bits_from % s->config->bit_ticks;
    uint64_t start = first > now ? first : now;
    bool over = sink->bits_to != 0 && start >= sink->bits_to;
    return sink->bit && !over ? start : CW_NEVER;
}

/* ... that any sink wants. */
static uint64_t next_wanted(const sim_run *s)
{
    uint64_t start = CW_NEVER;
    for (unsigned i = 0; i < s->sink_count; i++)
        start = least(start, wanted_from(s, &s->sinks[i]));
    return start;
}

static void set_stepping(sim_run *s, bool stepping)
{
    if (stepping != s->stepping)
        cw_bus_set_stepping(s->bus, stepping);
    s->stepping = stepping;
}

/* One bit, which may have been wanted. */
static void advance_bit(sim_run *s)
{
    uint64_t start = cw_bus_now(s->bus);
    bool wanted[SIM_SINKS_MAX];
    for (unsigned i = 0; i < s->sink_count; i++)
        wanted[i] = wanted_from(s, &s->sinks[i]) == start;
    advance_bus(s, start + s->config->bit_ticks);
    for (unsigned i = 0; i < s->sink_count; i++)
        if (wanted[i])
            s->sinks[i].bit(s->sinks[i].user, s->bus);
}

/* Bits that nobody looks at are left to the bus, which may skip them. */
static void advance(sim_run *s, uint64_t tick)
{
    const uint32_t bit_ticks = s->config->bit_ticks;
    while (!s->stopped && cw_bus_now(s->bus) + bit_ticks <= tick) {
        uint64_t wanted = next_wanted(s);
        bool now = wanted == cw_bus_now(s->bus);
        set_stepping(s, s->step || now);
        if (now || s->may_stop)
            advance_bit(s);
        else
            advance_bus(s, least(tick, wanted));
    }
    if (!s->stopped)
        advance_bus(s, tick);
}

/* When a run to the end of the traffic gives up waiting for something to happen. */
static uint64_t quiet_end(const sim_run *s)
{
    if (s->until != CW_NEVER)
        return CW_NEVER;
    return s->last_activity + (uint64_t)QUIET_LIMIT_S * CW_CLOCK_HZ;
}

/* Hands in all releases of one tick, which the bus has not reached, so that their events come among
 * the others of that tick. */
static void hand_in_due(sim_run *s, uint64_t tick)
{
    while (!s->stopped && release_next_tick(s->plan) == tick) {
        if (release_hand_in(s->plan, s->bus) == CW_FULL) /* to the end of the bit it comes up in */
            advance(s, cw_bus_inbox_first(s->bus) + s->config->bit_ticks - 1);
        else
            s->last_activity = tick;
    }
}

/* Up to the last release; false when the run is over before. */
static bool run_releases(sim_run *s)
{
    while (!s->stopped) {
        uint64_t tick = release_next_tick(s->plan);
        if (tick == CW_NEVER)
            return true;
        if (tick > s->until)
            break;
        /* a tx on the way moves the end of the quiet time, so it is asked for again */
        while (!s->stopped && cw_bus_now(s->bus) + s->config->bit_ticks < tick) {
            uint64_t target = least(tick - 1, quiet_end(s));
            if (target < cw_bus_now(s->bus) + s->config->bit_ticks)
                return false;
            advance(s, target);
        }
        if (tick > quiet_end(s))
            return false;
        hand_in_due(s, tick);
    }
    return true;
}

static bool traffic_is_over(const sim_run *s)
{
    return cw_bus_pending(s->bus) == 0 && cw_bus_recessive_bits(s->bus) >= END_RECESSIVE_BITS;
}

/* Bit by bit, so that the run ends in the very bit that the documentation names. */
static void run_out(sim_run *s)
{
    while (!s->stopped && !traffic_is_over(s) && cw_bus_now(s->bus) < quiet_end(s))
        advance(s, cw_bus_now(s->bus) + s->config->bit_ticks);
}

void sim_go(sim_run *s)
{
    bool goes_on = run_releases(s);
    if (s->until == CW_NEVER) {
        if (goes_on)
            run_out(s);
        return;
    }
    advance(s, s->until);
    if (!s->stopped && cw_bus_inbox_first(s->bus) <= s->until) /* amid a bit, which has to be run */
        advance(s, s->until + s->config->bit_ticks);
}
