/* SPDX-License-Identifier: MIT
 *
 * meeting.c - advances the buses of a rig together, so that gateways hand over frames in time.
 */
#include "run/meeting.h"

#include "base/least.h"
#include "run/due.h"

#define FRAME_BITS_MIN 25 /* nominal bits of any frame, SOF to its reception, at any data rate */
#define CLASSICAL_BITS_MIN 43
#define JOINED_BITS 3 /* of a frame that joins the SOF of another one (M6) */

/* Returns the first tick at which the bus expects an event. Off the grid, and where there is a data
 * rate, one may come up to a bit before it says. */
static uint64_t next_event(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    if (cw_bus_is_on_grid(bus) && config->dbitrate_bps == 0)
        return due_tick(bus, plan, config);
    const uint64_t next = cw_bus_next(bus);
    const uint64_t bit = cw_rate_ticks(config->rate, 1);
    return least(next == CW_NEVER || next < bit ? next : next - bit, release_next_tick(plan));
}

/* Returns a tick before which nobody receives a frame. It may be within the bit in progress. */
static uint64_t next_reception(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    const uint64_t next = next_event(bus, plan, config);
    /* rules, replies and fast replays send frames that the bus does not know yet */
    if (config->rule_count > 0 || config->reply_count > 0 || release_is_fast(plan))
        return least(next, cw_bus_tick_after(bus, FRAME_BITS_MIN));
    return next;
}

uint64_t meeting_next(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    return most(next_reception(bus, plan, config), cw_bus_tick_after(bus, 1));
}

/* Tells the gateways of a bus which of their nodes hear what they send (M15). */
static uint64_t hear_own(const gateways_bus *place, const cw_bus *bus)
{
    uint64_t own = 0;
    for (uint64_t rest = gateways_nodes(place->gateways, place->bus); rest; rest &= rest - 1) {
        const unsigned node = (unsigned)__builtin_ctzll(rest);
        if (cw_node_modes(bus, node) & CW_MODE_LOOPBACK)
            own |= UINT64_C(1) << node;
    }
    gateways_hear_own(place->gateways, place->bus, own);
    return own;
}

/* Returns true when a frame may make other nodes send. */
static bool has_answers(const cfg *config)
{
    return config->has_answers || config->rule_count > 0 || config->reply_count > 0;
}

/* Returns true when one node is all that gateways have on a bus. It does not carry on what it
 * sends. */
static bool is_end(const gateways_bus *place, uint64_t own, const cfg *config)
{
    const uint64_t nodes = gateways_nodes(place->gateways, place->bus);
    return (nodes & (nodes - 1)) == 0 && own == 0 && !has_answers(config);
}

/* Returns the same as next_reception(), for frames that gateways carry. */
static uint64_t next_carried(const gateways_bus *place, const cw_bus *bus, release_plan *plan,
                             const cfg *config, uint64_t reaction)
{
    if (config->rule_count > 0 || config->reply_count > 0 || release_is_fast(plan))
        return next_reception(bus, plan, config);
    const bool plain = cw_bus_is_on_grid(bus) && config->dbitrate_bps == 0;
    const uint64_t early = plain ? 0 : cw_rate_ticks(config->rate, 1);
    uint64_t next = cw_bus_next_rx(bus, gateways_want, place);
    next = next == CW_NEVER || next < early ? next : next - early;
    return least(next, release_next_rx(plan, gateways_want, place, reaction));
}

meeting_outlook meeting_find(const gateways_bus *place, const cw_bus *bus, release_plan *plan,
                             const cfg *config)
{
    const bool plain = cw_bus_is_on_grid(bus) && config->dbitrate_bps == 0;
    const unsigned bits = (plain ? CLASSICAL_BITS_MIN : FRAME_BITS_MIN) - JOINED_BITS;
    if (!(gateways_feeds(place->gateways) >> place->bus & 1u))
        return (meeting_outlook){.next = CW_NEVER, .reaction = CW_NEVER};
    const uint64_t own = hear_own(place, bus);
    gateways_answer(place->gateways, place->bus, has_answers(config));
    const uint64_t reaction = cw_rate_ticks(config->rate, bits);
    const uint64_t first = next_carried(place, bus, plan, config, reaction);
    const uint64_t next = most(first, cw_bus_tick_after(bus, 1));
    return (meeting_outlook){.next = next,
                             .early = plain ? 0 : next - most(first, cw_bus_now(bus)),
                             .reaction = is_end(place, own, config) ? CW_NEVER : reaction};
}

void meeting_look(meeting *m, size_t bus)
{
    m->outlook[bus] = m->calls->look(m->user, bus);
}

/* Returns a tick before which gateways get no other frame of a bus than those that wait. */
static uint64_t next_of(const meeting *m, size_t bus)
{
    const meeting_outlook *o = &m->outlook[bus];
    return least(o->next, cw_after(m->limit[bus], o->reaction));
}

/* Returns a tick before which no further frame comes over a way. With too short a delay it may come
 * before that, for a bus that waited longer would not let others go on. */
static uint64_t comes_at(const meeting *m, const gateways_way *way)
{
    const meeting_outlook *o = &m->outlook[way->from];
    const uint64_t own = o->next - least(o->early, way->delay);
    const uint64_t next = least(own, cw_after(m->limit[way->from], o->reaction));
    return cw_after(least(next, gateways_first(m->gateways)[way->from]), way->delay);
}

/* Lowers limits by the ways that begin at a set of buses. Returns the buses of which gateways may
 * get another frame earlier by that. */
static uint32_t lower_limits(meeting *m, uint32_t from)
{
    size_t count;
    uint32_t earlier = 0;
    const gateways_way *ways = gateways_ways(m->gateways, &count);
    for (const gateways_way *way = ways; way < ways + count; way++) {
        if (!(from >> way->from & 1u))
            continue;
        const uint64_t tick = comes_at(m, way);
        if (tick >= m->limit[way->to])
            continue;
        m->limit[way->to] = tick;
        earlier |= (uint32_t)(m->outlook[way->to].reaction != CW_NEVER) << way->to;
    }
    return earlier;
}

/* A frame may go from bus to bus. */
void meeting_find_limits(meeting *m)
{
    for (size_t i = 0; i < m->bus_count; i++)
        m->limit[i] = CW_NEVER;
    uint32_t from = gateways_feeds(m->gateways);
    while (from != 0)
        from = lower_limits(m, from);
}

/* Returns the tick before which all receptions are known. */
static uint64_t known(const meeting *m)
{
    const uint32_t feeds = gateways_feeds(m->gateways);
    uint64_t tick = CW_NEVER;
    for (size_t i = 0; i < m->bus_count; i++)
        if (feeds >> i & 1u)
            tick = least(tick, next_of(m, i));
    return tick;
}

/* Finds the limits, and passes on what is known. A frame that waits for that may come back. */
static void meeting_pass_on(meeting *m)
{
    uint64_t given[RIG_BUSES_MAX];
    uint64_t before;
    while (meeting_find_limits(m), before = known(m), gateways_wait(m->gateways, before)) {
        gateways_meet(m->gateways, before, given);
        for (size_t i = 0; i < m->bus_count; i++)
            if (given[i] != CW_NEVER)
                m->outlook[i].next = least(m->outlook[i].next,
                                           cw_after(given[i], m->outlook[i].reaction));
    }
}

static bool go(meeting *m, size_t bus, uint64_t tick)
{
    const bool good = m->calls->go(m->user, bus, tick);
    meeting_look(m, bus);
    return good;
}

/* Returns true when the next frame of a bus comes early enough: before others may give it one, or
 * at that very tick. */
static bool may_tell(const meeting *m, size_t bus, uint64_t end, bool tie)
{
    const uint64_t next = m->outlook[bus].next;
    return next <= end && (tie ? next == m->limit[bus] : next < m->limit[bus]);
}

/* Lets buses go on that may tell about a frame. At its limit a frame may come in, before the
 * traffic of that tick, so it stays before that if others can go. The bus with the first frame
 * always can. */
static bool meeting_go_on(meeting *m, uint64_t end, bool tie, bool *good)
{
    bool went = false;
    for (size_t i = 0; i < m->bus_count; i++) {
        if (!may_tell(m, i, end, tie))
            continue;
        const uint64_t last = m->limit[i] == CW_NEVER || tie ? m->limit[i] : m->limit[i] - 1;
        *good = go(m, i, least(last, end)) && *good;
        went = true;
    }
    return went;
}

bool meeting_run(meeting *m, uint64_t end, uint32_t buses)
{
    bool good = true;
    meeting_pass_on(m);
    while (good && (meeting_go_on(m, end, false, &good) || meeting_go_on(m, end, true, &good)))
        meeting_pass_on(m);
    const bool free = good; /* no gateway gets a frame before the end any more */
    for (size_t i = 0; i < m->bus_count; i++)
        if (free && (buses >> i & 1u))
            good = go(m, i, end) && good;
    meeting_pass_on(m);
    return good;
}
