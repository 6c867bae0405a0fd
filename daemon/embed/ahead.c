/* SPDX-License-Identifier: MIT
 *
 * ahead.c - looks ahead for the next event, without going there.
 */
#include "embed/embed.h"

#include "base/least.h"
#include "base/text/number.h"

#include <stdlib.h>

#define AHEAD_MOST_S 10u

/* Returns the tick of the first event of these kinds that has come already and is not known yet. A
 * bit may have ended later than the time of a run. CW_NEVER without one. */
static uint64_t first_kept(const embed_bus *b, uint32_t kinds)
{
    uint64_t first = CW_NEVER;
    for (const embed_kept *kept = embed_kept_after(b, NULL); kept; kept = embed_kept_after(b, kept))
        if (kept->event.tick > b->sim->reached && (kinds >> kept->event.kind & 1u))
            first = least(first, kept->event.tick);
    return first;
}

/* Returns the tick up to which nothing is handed in by a bus of itself, after a bit when that is
 * now. A look goes so far at most. */
static uint64_t nothing_until(const embed_bus *b, uint64_t until)
{
    const uint64_t bit = cw_bus_tick_after(b->run.bus, 1);
    const release_plan *plan = b->run.plan;
    const uint64_t next = release_is_fast(plan) ? 0 : release_next_tick(plan);
    const uint64_t most = least(until, cw_bus_now(b->run.bus) + AHEAD_MOST_S * CW_CLOCK_HZ);
    return least(most, next > b->sim->reached ? next : bit);
}

/* Returns true for a bus on which nothing will happen, if nothing is handed in. */
static bool ahead_is_none(const embed_bus *b)
{
    return cw_bus_next(b->run.bus) == CW_NEVER && release_next_tick(b->run.plan) == CW_NEVER &&
           !release_is_fast(b->run.plan);
}

/* Makes room for a copy of a bus as it is now. Returns NULL without memory. */
static void *room_for_copy(embed_bus *b)
{
    const size_t size = cw_bus_copy_size(b->run.bus);
    if (size <= b->ahead_size)
        return b->ahead;
    free(b->ahead);
    b->ahead = malloc(size);
    b->ahead_size = b->ahead ? size : 0;
    return b->ahead;
}

/* Lowers *first to the tick of the next event of a bus, and *until to that up to which it is known.
 * Returns false without memory. */
static bool look_at_bus(embed_bus *b, uint32_t kinds, uint64_t *first, uint64_t *until)
{
    void *copy = ahead_is_none(b) ? NULL : room_for_copy(b);
    *first = least(*first, first_kept(b, kinds));
    if (!copy)
        return ahead_is_none(b);
    *until = nothing_until(b, *until);
    *first = least(*first, cw_bus_next_event(b->run.bus, copy, kinds, *until));
    return true;
}

/* Looks at all buses. A gateway may hand in a frame when any bus has one for it. */
static bool look_at_all(canwire_sim *sim, uint32_t kinds, uint64_t *first, uint64_t *until)
{
    bool good = true;
    for (size_t i = 0; good && i < sim->count; i++) {
        uint64_t carried = CW_NEVER;
        good = !sim_group_wants(&sim->group, i) ||
               look_at_bus(&sim->buses[i], 1u << CW_EVENT_RX, &carried, until);
        *until = least(*until, carried);
    }
    for (size_t i = 0; good && i < sim->count; i++)
        good = look_at_bus(&sim->buses[i], kinds, first, until);
    return good;
}

int canwire_sim_next_event(canwire_sim *sim, const char *text, int64_t until, int64_t *at)
{
    uint32_t kinds = 0;
    uint64_t first = CW_NEVER, known = until == CANWIRE_SIM_NEVER ? CW_NEVER
                                                                  : embed_tick_until(until);
    if (!embed_read_kinds(sim, &kinds, text))
        return CANWIRE_SIM_INVALID;
    if (known < sim->reached)
        return embed_fail(sim, CANWIRE_SIM_INVALID, "that time is over");
    if (kinds & ~sim->kinds)
        return embed_fail(sim, CANWIRE_SIM_INVALID, "'%s' has events that are not kept", text);
    if (!look_at_all(sim, kinds, &first, &known)) {
        sim->no_memory = true;
        return embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
    }
    const uint64_t tick = least(first, known);
    const uint64_t ns = text_ticks_ns(tick);
    *at = tick == CW_NEVER || ns > CANWIRE_SIM_NEVER ? CANWIRE_SIM_NEVER : (int64_t)ns;
    return first <= known && first != CW_NEVER;
}
