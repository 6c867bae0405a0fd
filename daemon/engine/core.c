/* SPDX-License-Identifier: MIT
 *
 * core.c - advances the bus, with its inputs, to a tick.
 */
#include "engine/core.h"

#define RELEASES_AT_ONCE 16u /* between two readings of the clock */
#define RELEASES_OF_A_TICK 1024u /* in the same way, within one tick */

/* Hands in the releases up to a tick. Returns the tick up to which all are handed in, since there
 * may be more than the machine can do. A tick is not divided, if possible. */
static uint64_t run_releases(engine *e, uint64_t now)
{
    uint64_t last = CW_NEVER;
    unsigned count = 0; /* since the clock was read */
    uint64_t tick;
    while ((tick = release_next_tick(e->now.plan)) <= now) {
        bool look = count >= (tick == last ? RELEASES_OF_A_TICK : RELEASES_AT_ONCE);
        if (look && engine_turn_is_over(e)) {
            now = tick > 0 ? tick - 1 : 0;
            break;
        }
        count = look ? 1 : count + 1;
        last = tick;
        unsigned node;
        bool frame = release_first(e->now.plan, &node) != NULL;
        if (inputs_release(&e->inputs, e->now.plan) == CW_OK) {
            e->books.nodes[node].released += frame;
        } else if (!engine_make_room(e)) {
            now = tick > 0 ? tick - 1 : 0;
            break;
        }
    }
    if (now > e->released)
        e->released = now;
    return now;
}

/* Returns the limit of one step. A replay at full speed checks after each bit if it may send. A
 * port with waiting frames checks for room at the end of each frame. */
static uint64_t next_look(const engine *e)
{
    uint64_t bit = cw_bus_tick_after(e->now.bus, 1);
    if (release_is_fast(e->now.plan))
        return bit;
    if (!e->pushed_back)
        return CW_NEVER;
    uint64_t next = cw_bus_next(e->now.bus);
    return next > bit ? next : bit;
}

uint64_t engine_run_to(engine *e, uint64_t tick)
{
    uint64_t end;
    uint64_t reached;
    release_look(e->now.plan, e->now.bus);
    do {
        end = next_look(e);
        if (end > tick)
            end = tick;
        reached = run_releases(e, end);
        if (!engine_advance(e, reached))
            return cw_bus_now(e->now.bus);
        if (e->pushed_back)
            engine_read_pushed_back(e);
        release_look(e->now.plan, e->now.bus);
    } while (reached == end && end < tick);
    return reached;
}

void engine_read_limits(engine *e)
{
    e->catch_up_ticks = text_time_ticks(e->config->catch_up, e->config->rate);
}
