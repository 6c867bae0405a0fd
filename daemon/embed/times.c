/* SPDX-License-Identifier: MIT
 *
 * times.c - nanoseconds of programs and ticks of the bus.
 */
#include "embed/embed.h"

#include "base/text/number.h"

uint64_t embed_tick_at(int64_t ns)
{
    const cfg_time time = {.ns = ns > 0 ? (uint64_t)ns : 0};
    return text_time_ticks(time, cw_rate_of(1));
}

uint64_t embed_tick_until(int64_t ns)
{
    const cfg_time beyond = {.ns = 1};
    const cfg_time time = {.ns = ns > 0 ? (uint64_t)ns : 0};
    return text_time_ticks_sum(time, 1, beyond, cw_rate_of(1)) - 1;
}

int64_t canwire_sim_now(const canwire_sim *sim)
{
    return (int64_t)text_ticks_ns(sim->reached);
}

int64_t canwire_sim_time(canwire_sim *sim, int bus, const char *text)
{
    cfg_time time;
    const embed_bus *b = embed_find_bus(sim, bus);
    if (!b)
        return CANWIRE_SIM_INVALID;
    const char *wrong = text_parse_time(&time, text);
    if (wrong)
        return embed_fail(sim, CANWIRE_SIM_INVALID, "%s: %s", text, wrong);
    /* bits may end between nanoseconds; events there have the truncated time */
    const uint64_t ticks = cw_rate_ticks_or_never(b->config->rate, time.bits);
    const uint64_t most = (uint64_t)CANWIRE_SIM_NEVER - 1;
    if (ticks == CW_NEVER || ticks / 80 > most / 1000 || time.ns > most - text_ticks_ns(ticks))
        return embed_fail(sim, CANWIRE_SIM_INVALID, "%s: at most 292 years are expected", text);
    return (int64_t)(time.ns + text_ticks_ns(ticks));
}
