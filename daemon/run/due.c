/* SPDX-License-Identifier: MIT
 *
 * due.c - finds the tick of the next event that is visible outside of the bus.
 */
#include "run/due.h"

#include "base/least.h"

#define FRAME_BITS_MIN 43u /* to EOF, of an empty frame without stuff bits, whose SOF another node
                              may have sent (M6) */

/* Returns the tick of a reception (M7): receivers have a frame at the end of its last bit but one.
 * Its bits begin with the first whole bit. */
static uint64_t reception(const cfg *config, uint64_t tick, unsigned bits)
{
    return cw_after(cw_rate_next_bit(config->rate, tick), cw_rate_ticks(config->rate, bits - 1));
}

/* Returns true when the node will surely queue the frame, which causes no event. */
static bool will_queue(const cw_bus *bus, unsigned node, const cw_frame *frame)
{
    return cw_frame_valid(frame) && cw_node_takes_frames(bus, node) && cw_node_room(bus, node) > 0;
}

uint64_t due_tick(const cw_bus *bus, const release_plan *plan, const cfg *config)
{
    unsigned node;
    const uint64_t next = cw_bus_next(bus);
    const uint64_t release = release_next_tick(plan);
    if (release >= next || config->rule_count > 0 || release_is_fast(plan))
        return least(next, release);
    const cw_frame *frame = release_first(plan, &node);
    if (!frame || config->dbitrate_bps > 0 || !will_queue(bus, node, frame))
        return release; /* with a data rate not all bits have one length */
    /* With nothing before it, the frame is received when it ends. A counter changes its stuff bits.
     * One that is released later may overtake it, or be sent beside one in loopback (M15). */
    const bool first =
        next == CW_NEVER && cw_bus_pending(bus) == 0 && release_is_as_written(plan);
    const uint64_t later = reception(config, release_second_tick(plan), FRAME_BITS_MIN);
    const unsigned bits = first ? cw_frame_wire_bits(frame) : FRAME_BITS_MIN;
    return least(least(next, later), reception(config, release, bits));
}
