/* SPDX-License-Identifier: MIT
 *
 * frame_read.c - what can be read of the frame of a frame step on its way.
 */
#include "step/frame.h"

#define LEAST_NOMINAL_BITS 25u /* of an FD frame, up to where it is received; others may be short */
#define JOINED_BITS 3u /* of a frame that another one's SOF begins, in an intermission (M6) */

uint64_t cw_to_reception(const cw_bus *bus, unsigned wire_bits)
{
    const unsigned all = bus->timed.rates ? LEAST_NOMINAL_BITS : wire_bits - CW_AFTER_ACCEPT_BITS;
    return all - JOINED_BITS;
}

uint64_t cw_frame_step_recessive_bits(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    unsigned n = step->at;
    const unsigned acknowledged = cw_frame_step_acknowledged(step);
    if (n >= acknowledged)
        return n - acknowledged;
    cw_bits room;
    const cw_bits *bits = cw_frame_step_bits(bus, &room);
    while (n > 0 && cw_bits_level(bits, n - 1))
        n--;
    return step->at - n;
}

/* Returns the horizon without hits of rules. */
static uint64_t clean_horizon(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    if (cw_frame_step_is_broken(bus))
        return 1; /* the step ends then */
    if (step->at < step->length - CW_AFTER_ACCEPT_BITS)
        return step->length - CW_AFTER_ACCEPT_BITS - step->at;
    if (step->at < step->length)
        return step->length - step->at;
    const unsigned least = bus->timed.rates ? LEAST_NOMINAL_BITS : CW_FRAME_BITS_MIN - 1;
    return bus->waiting ? least : CW_QUIET_FOREVER;
}

uint64_t cw_frame_step_horizon(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    uint64_t bits = clean_horizon(bus);
    return step->look.bit == CW_NO_LOOK ? bits
                                        : cw_least(bits, step->look.bit + 1u - step->at);
}

uint64_t cw_frame_step_to_rx(const cw_bus *bus, uint64_t bits, cw_frame_test *test,
                             const void *user)
{
    const cw_frame_step *step = &bus->frame_step;
    const unsigned received = step->length - CW_AFTER_ACCEPT_BITS;
    if (cw_frame_step_is_broken(bus))
        return 1;
    if (step->at <= 1) /* a node that joins its SOF may destroy it */
        return bits;
    if (step->at < received && test(user, step->node, &step->frame))
        return received - step->at;
    return step->length - step->at + bits;
}
