/* SPDX-License-Identifier: MIT
 *
 * releases.c - hands in the traffic of the configuration.
 */
#include "engine/core.h"

#define RELEASES_AT_ONCE 16u /* between two readings of the clock */
#define RELEASES_OF_A_TICK 1024u /* in the same way, within one tick */

/* Makes room in the inbox, whose first frame leaves at the latest in the bit that holds its tick.
 * Returns false when the time of this wake-up ends before. */
static bool releases_make_room(engine *e)
{
    const uint64_t bit = cw_rate_ticks(e->config->rate, 1);
    return engine_advance(e, cw_bus_inbox_first(e->now.bus) + bit);
}

/* Hands in the releases up to a tick. Returns the tick up to which all are handed in, since there
 * may be more than the machine can do. A tick is not divided, if possible. */
uint64_t engine_release_to(engine *e, uint64_t now)
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
        const cw_status status = inputs_release(&e->inputs, e->now.plan);
        if (status == CW_OK) {
            e->books.nodes[node].released += frame;
        } else if (status == CW_FULL && !releases_make_room(e)) {
            now = tick > 0 ? tick - 1 : 0;
            break;
        }
    }
    if (now > e->released)
        e->released = now;
    return now;
}
