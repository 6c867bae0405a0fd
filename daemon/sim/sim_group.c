/* SPDX-License-Identifier: MIT
 *
 * sim_group.c - runs one bus, or the buses of a rig, in one virtual time.
 */
#include "sim/sim_group.h"

#include "base/divisor.h"
#include "base/least.h"
#include "base/text/plain.h"

#define SLICE_TICKS (CW_CLOCK_HZ / 100u)
#define COMMON_BIT_MAX (CW_CLOCK_HZ / 100u) /* ticks; bits of odd rates hardly ever meet */

static uint64_t until_of(const sim_group *g)
{
    return g->count > 0 ? g->runs[0]->until : 0;
}

/* Frames of gateways come before the traffic of their tick, and both before what the bus does at
 * it. So traffic of the tick waits when gateways may give the bus a frame then. */
static bool go(void *user, size_t bus, uint64_t tick)
{
    sim_group *g = user;
    if (g->meeting.limit[bus] > tick)
        sim_release_to(g->runs[bus], tick);
    else
        sim_release_before(g->runs[bus], tick);
    return true;
}

/* Returns how far others may go before a frame of this bus can come to them. */
static meeting_outlook sim_group_look(void *user, size_t bus)
{
    sim_group *g = user;
    sim_run *run = g->runs[bus];
    return meeting_find(&(gateways_bus){.gateways = g->meeting.gateways, .bus = bus}, run->bus,
                        run->plan, run->config);
}

/* Hands in a frame of a gateway. Without room the bus first takes what came before. */
static cw_status sim_group_send_frame(void *user, size_t bus, unsigned node, const cw_frame *frame,
                                      uint64_t received, uint64_t at_tick)
{
    sim_group *g = user;
    sim_run *run = g->runs[bus];
    cw_status status = cw_node_send(run->bus, node, frame, at_tick);
    if (status != CW_FULL)
        return status;
    sim_release_to(run, received);
    return cw_node_send(run->bus, node, frame, at_tick);
}

bool sim_group_open(sim_group *g, const rig *config)
{
    static const meeting_calls calls = {.go = go, .look = sim_group_look};
    g->rest_from = CW_NEVER;
    g->meeting = (meeting){.calls = &calls, .user = g, .bus_count = config ? config->bus_count : 1};
    if (config)
        g->meeting.gateways = gateways_new(config, sim_group_send_frame, g);
    return !config || g->meeting.gateways;
}

void sim_group_close(sim_group *g)
{
    gateways_free(g->meeting.gateways);
    g->meeting.gateways = NULL;
}

void sim_group_note(sim_group *g, size_t bus, const cw_event *event)
{
    const bool looked_at = event->kind == CW_EVENT_RX || event->kind == CW_EVENT_DROP;
    if (looked_at && g->meeting.gateways && !gateways_note(g->meeting.gateways, bus, event))
        g->no_memory = true;
}

bool sim_group_wants(const sim_group *g, size_t bus)
{
    return g->meeting.gateways && gateways_nodes(g->meeting.gateways, bus);
}

/* ---- Time ------------------------------------------------------------------------------------ */

uint64_t sim_group_now(const sim_group *g)
{
    uint64_t now = CW_NEVER;
    for (size_t i = 0; i < g->count; i++)
        now = least(now, cw_bus_now(g->runs[i]->bus));
    return now;
}

uint64_t sim_group_known(const sim_group *g, uint64_t tick)
{
    uint64_t last = 0;
    uint64_t sure = tick;
    for (size_t i = 0; i < g->count; i++) {
        const uint64_t now = cw_bus_now(g->runs[i]->bus);
        last = now > last ? now : last;
        if (sim_has_own_bits(g->runs[i]))
            sure = least(sure, now);
    }
    return least(last, sure);
}

uint64_t sim_group_bit(const sim_group *g)
{
    uint64_t bit = CW_NEVER;
    for (size_t i = 0; i < g->count; i++)
        bit = least(bit, cw_bus_tick_after(g->runs[i]->bus, 1));
    return bit;
}

/* Returns the end of the longest bit that is next on a bus. */
static uint64_t longest_bit(const sim_group *g)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < g->count; i++) {
        const uint64_t bit = cw_bus_tick_after(g->runs[i]->bus, 1);
        bits = bit > bits ? bit : bits;
    }
    return bits;
}

static uint64_t next_reception(const sim_group *g, size_t bus)
{
    const sim_run *run = g->runs[bus];
    return meeting_next(run->bus, run->plan, run->config);
}

uint64_t sim_group_next(const sim_group *g)
{
    uint64_t next = CW_NEVER;
    for (size_t i = 0; i < g->count; i++)
        next = least(next, next_reception(g, i));
    return next;
}

/* Returns the end of the wait for anything to happen on any bus. */
static uint64_t quiet_end(const sim_group *g)
{
    uint64_t last = 0;
    for (size_t i = 0; i < g->count; i++)
        if (sim_last_activity(g->runs[i]) > last)
            last = sim_last_activity(g->runs[i]);
    return cw_after(last, (uint64_t)RELEASE_QUIET_S * CW_CLOCK_HZ);
}

/* The run ends when all buses are done: one that rests may get frames from others. */
static bool traffic_is_over(const sim_group *g)
{
    bool over = true;
    for (size_t i = 0; i < g->count; i++)
        over = over && sim_traffic_is_over(g->runs[i]);
    return over;
}

bool sim_group_is_over(const sim_group *g)
{
    return traffic_is_over(g) || sim_group_now(g) >= quiet_end(g);
}

bool sim_group_failed(const sim_group *g)
{
    bool failed = g->no_memory;
    for (size_t i = 0; i < g->count; i++)
        failed = failed || release_failed(g->runs[i]->plan);
    return failed;
}

/* ---- Strides --------------------------------------------------------------------------------- */

static uint32_t all_buses(const sim_group *g)
{
    return (UINT32_C(1) << g->count) - 1;
}

static void tell_reached(const sim_group *g)
{
    if (g->reached)
        g->reached(g->user);
}

static void release_to(sim_group *g, uint64_t tick, uint32_t buses)
{
    for (size_t i = 0; i < g->count; i++)
        if (buses >> i & 1u)
            sim_release_to(g->runs[i], tick);
}

/* Goes up to a tick in strides. */
static void stride(sim_group *g, uint64_t tick, uint32_t buses)
{
    for (size_t i = 0; i < g->count; i++)
        meeting_look(&g->meeting, i);
    (void)meeting_run(&g->meeting, tick, buses);
    release_to(g, tick, buses);
    tell_reached(g);
}

/* Returns a tick up to which all buses may go at once: some traffic is still to come then, and the
 * run has not ended. */
static uint64_t sure_tick(const sim_group *g)
{
    uint64_t now = 0;
    uint64_t release = 0;
    const bool ends = until_of(g) != CW_NEVER;
    for (size_t i = 0; i < g->count; i++) {
        const sim_run *run = g->runs[i];
        const uint64_t sure = ends ? 0 : release_sure_tick(run->plan);
        now = cw_bus_now(run->bus) > now ? cw_bus_now(run->bus) : now;
        release = sure > release ? sure : release;
    }
    const uint64_t slice = now + SLICE_TICKS;
    return least(slice, ends ? until_of(g) : least(release, quiet_end(g)));
}

/* ---- Small steps ----------------------------------------------------------------------------- */

/* Returns the end of the next bit of a bus, or of a rest, in which nobody receives a frame. */
static uint64_t next_step(const sim_group *g, size_t bus, uint64_t tick)
{
    const sim_run *run = g->runs[bus];
    const uint64_t bit = cw_bus_tick_after(run->bus, 1);
    const uint64_t busy = least(tick, release_next_tick(run->plan));
    const bool fast = release_is_fast(run->plan);
    return fast ? bit : most(bit, cw_bus_rests_until(run->bus, busy));
}

/* With `step` the buses meet at each bit, up to a tick. So only what comes within a bit depends on
 * what the buses expect. */
static uint64_t step_of(const sim_group *g, uint64_t tick)
{
    const uint32_t feeds = gateways_feeds(g->meeting.gateways);
    uint64_t next = tick;
    for (size_t i = 0; i < g->count; i++)
        if (feeds >> i & 1u)
            next = least(next, next_step(g, i, tick));
    return next;
}

/* Behind the last release the buses meet at each reception. */
static uint64_t next_for_gateways(const sim_group *g)
{
    uint64_t next = CW_NEVER;
    for (size_t i = 0; i < g->count; i++)
        if (gateways_nodes(g->meeting.gateways, i))
            next = least(next, next_reception(g, i));
    return next;
}

/* Returns the tick of the next meeting. Each bus goes on by one bit while all of them rest. */
static uint64_t next_meeting(const sim_group *g)
{
    uint64_t next = next_for_gateways(g);
    const uint64_t bits = longest_bit(g);
    if (next < until_of(g))
        return next;
    next = least(next, sim_group_next(g));
    return least(next == CW_NEVER && until_of(g) == CW_NEVER ? bits : next, until_of(g));
}

/* ---- Rest ------------------------------------------------------------------------------------ */

/* Returns the ticks after which bits of all buses begin together again; 0: too many. */
static uint64_t common_bit(const sim_group *g)
{
    uint64_t common = 1;
    for (size_t i = 0; i < g->count && common <= COMMON_BIT_MAX; i++) {
        const uint64_t bit = cw_rate_ticks(g->runs[i]->config->rate, 1);
        common = common / common_divisor(common, bit) * bit;
    }
    return common <= COMMON_BIT_MAX ? common : 0;
}

/* Returns the tick up to which all buses rest, at most the given one. */
static uint64_t rests_until(const sim_group *g, uint64_t tick)
{
    for (size_t i = 0; i < g->count; i++)
        tick = least(tick, sim_rests_until(g->runs[i], tick));
    return tick;
}

/* Returns the ticks after which meetings of buses that rest repeat, since bits of all buses are
 * where they were. 0: not known yet. A meeting near the end of a rest does not count: what ends the
 * rest may have brought it forward. */
static uint64_t rest_period(sim_group *g, uint64_t tick, uint64_t common)
{
    const bool rested = g->rest_from != CW_NEVER && tick + 2 * common <= g->rest_until;
    g->rest_until = rests_until(g, quiet_end(g));
    if (g->rest_until <= tick)
        g->rest_from = CW_NEVER;
    else if (!rested)
        g->rest_from = tick;
    if (g->rest_from == CW_NEVER || (tick - g->rest_from) % common != 0)
        return 0;
    return tick - g->rest_from;
}

/* Skips meetings in which nothing can happen, behind the one at a tick, with which the run has not
 * ended. Some periods are left, so that what ends the rest comes as it does without a skip. */
static void skip_meetings(sim_group *g, uint64_t tick)
{
    const uint64_t common = g->step ? 0 : common_bit(g);
    const uint64_t period = common > 0 ? rest_period(g, tick, common) : 0;
    const uint64_t periods = period > 0 ? (g->rest_until - tick) / period : 0;
    if (periods < 4)
        return;
    tick += (periods - 3) * period;
    release_to(g, tick, all_buses(g));
    tell_reached(g);
}

/* ---- The run --------------------------------------------------------------------------------- */

void sim_group_go_to(sim_group *g, uint64_t tick)
{
    if (g->meeting.gateways)
        stride(g, tick, all_buses(g));
    else
        sim_release_to(g->runs[0], tick);
}

void sim_group_settle(sim_group *g, uint64_t tick)
{
    for (size_t i = 0; i < g->count; i++) {
        sim_run *run = g->runs[i];
        if (!sim_owes_events(run, tick))
            continue;
        const uint64_t end = cw_bus_tick_after(run->bus, 1);
        if (g->meeting.gateways)
            stride(g, end, UINT32_C(1) << i);
        else
            sim_release_to(run, end);
    }
}

void sim_group_do_due(sim_group *g, uint64_t tick)
{
    for (size_t i = 0; i < g->count; i++)
        sim_do_due(g->runs[i], tick);
}

void sim_group_begin(sim_group *g)
{
    for (size_t i = 0; i < g->count; i++)
        sim_begin(g->runs[i]);
}

bool sim_group_restart(sim_group *g, const rig *config)
{
    bool good = true;
    sim_group_close(g);
    g->no_memory = false;
    for (size_t i = 0; i < g->count; i++)
        good = sim_restart(g->runs[i]) && good;
    if (!good || !sim_group_open(g, config))
        return false;
    sim_group_begin(g);
    return true;
}

static void tell_quiet(const sim_group *g)
{
    if (g->messages)
        plain_print(g->messages, "canwire sim: ended after %u s of bus time without a frame "
                    "(--until TIME waits longer)\n", RELEASE_QUIET_S);
}

/* Goes on to a tick and returns it. CW_NEVER: nothing is to be expected. */
static uint64_t sim_group_go_on(sim_group *g)
{
    const uint64_t sure = sure_tick(g);
    const uint64_t far = g->step ? step_of(g, sure) : sure;
    const uint64_t tick = sure > longest_bit(g) ? far : next_meeting(g);
    if (until_of(g) == CW_NEVER && tick > quiet_end(g))
        return CW_NEVER;
    stride(g, tick, all_buses(g));
    return tick;
}

void sim_group_simulate(sim_group *g)
{
    uint64_t tick = 0;
    g->rest_from = CW_NEVER;
    /* an awaited event lowers `until` */
    while (!sim_group_failed(g) && tick < until_of(g) &&
           !(until_of(g) == CW_NEVER && traffic_is_over(g))) {
        if (until_of(g) == CW_NEVER)
            skip_meetings(g, tick);
        tick = sim_group_go_on(g);
    }
    const uint64_t until = until_of(g);
    if (until == CW_NEVER && tick == CW_NEVER)
        tell_quiet(g);
    for (size_t i = 0; i < g->count && until != CW_NEVER && !sim_group_failed(g); i++)
        (void)sim_advance(g->runs[i], CW_NEVER); /* ends bits that have begun */
}
