/* SPDX-License-Identifier: MIT
 *
 * protections.c - random counters and checksums in the data of frames.
 */
#include "differential.h"

#include <string.h>

static cw_counter random_counter(diff_random *r)
{
    cw_counter c = {.bits = (uint8_t)diff_between(r, 1, diff_chance(r, 800) ? 8 : 32)};
    const uint32_t most = UINT32_MAX >> (32 - c.bits);
    c.bit = (uint16_t)(diff_magnitude(r, 1, diff_chance(r, 900) ? 33 : 481) - 1);
    c.max = diff_chance(r, 500) ? most : (uint32_t)diff_below(r, most + UINT64_C(1));
    c.start = diff_chance(r, 500) ? 0 : (uint32_t)diff_below(r, c.max + UINT64_C(1));
    return c;
}

static cw_checksum random_checksum(diff_random *r)
{
    cw_checksum c = {.kind = (cw_checksum_kind)diff_below(r, CW_CHECKSUM_COUNT)};
    c.at = (uint8_t)(diff_magnitude(r, 1, diff_chance(r, 900) ? 7 : CW_FRAME_DATA_MAX - 1) - 1);
    c.polynomial = (uint16_t)diff_draw(r);
    c.start = (uint16_t)diff_draw(r);
    c.inverted = (uint16_t)diff_draw(r);
    c.id_first = diff_chance(r, 500);
    c.id_by_counter = diff_chance(r, 500);
    c.id_length = (uint8_t)diff_below(r, CW_DATA_ID_MAX + 1);
    for (unsigned i = 0; i < c.id_length; i++)
        c.id[i] = (uint8_t)diff_draw(r);
    return c;
}

/* Puts a protection at its place among the others. One with the same identifier replaces it. */
static void put(diff_plan *plan, const cw_protection *p)
{
    cw_protection *list = plan->protections;
    unsigned place = 0;
    while (place < plan->config.protection_count &&
           (list[place].node < p->node || (list[place].node == p->node && list[place].id < p->id)))
        place++;
    const bool known = place < plan->config.protection_count && list[place].node == p->node &&
                       list[place].id == p->id;
    if (!known) {
        memmove(&list[place + 1], &list[place],
                (plan->config.protection_count - place) * sizeof list[0]);
        plan->config.protection_count++;
    }
    list[place] = *p;
}

void diff_random_protections(diff_maker *m, diff_plan *plan)
{
    diff_random *r = &m->random;
    const unsigned count = (unsigned)diff_between(r, 1, DIFF_PROTECTIONS_MAX);
    for (unsigned i = 0; i < count; i++) {
        cw_protection p = {.node = (uint8_t)diff_below(r, m->nodes)};
        const cw_frame frame =
            diff_owned_frame(m, &m->frames[diff_below(r, m->frame_count)], p.node);
        p.id = cw_frame_can_id(&frame) & ~CW_FILTER_REMOTE;
        if (diff_chance(r, 800))
            p.counter = random_counter(r);
        if (diff_chance(r, 800))
            p.checksum = random_checksum(r);
        put(plan, &p);
    }
}
