/* SPDX-License-Identifier: MIT
 *
 * present.c - the present moment, of the machine or of virtual time.
 */
#include "engine/core.h"

clock_pair engine_now(const engine *e)
{
    return e->virtual_time ? clock_at(e->clock, e->virtual_time->now_ns) : clock_read();
}

bool engine_is_held(const engine *e)
{
    return e->virtual_time && e->virtual_time->begun && !turns_all_wait(e->virtual_time->turns);
}
