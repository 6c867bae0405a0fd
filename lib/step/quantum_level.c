/* SPDX-License-Identifier: MIT
 *
 * quantum_level.c - the level of the wire at single moments of a clean frame.
 *
 * Between two bit times the bus asks whether any node sees a dominant level.
 */
#include "step/quantum_clean.h"

#include "format/bits.h"

#define NO_KEY (INT64_MIN / 2) /* no edge comes so early */

/* ---- The end of the ACK slot ----------------------------------------------------------------- */

/* Takes an edge for the last one that goes to an end of the line, if it is. */
static void take_release(cw_last_release *r, unsigned end, cw_span key, unsigned node)
{
    if (key > r->key[end]) {
        r->other[end] = r->key[end];
        r->key[end] = key;
        r->node[end] = node;
    } else if (key > r->other[end]) {
        r->other[end] = key;
    }
}

void cw_clean_find_release(cw_last_release *r, const cw_clean *clean, const cw_clean_frame *f)
{
    *r = (cw_last_release){.found = true, .key = {NO_KEY, NO_KEY}, .other = {NO_KEY, NO_KEY}};
    for (uint64_t rest = f->drivers; rest; rest &= rest - 1) {
        const cw_clean_node *c = cw_clean_at(clean, cw_lowest_node(rest));
        const cw_span key = cw_clean_end_of_slot(clean, f->slots, c) + c->out[CW_RECESSIVE];
        take_release(r, 0, key - c->place, c->node);
        take_release(r, 1, key + c->place, c->node);
    }
}

cw_span cw_clean_released_at(const cw_clean *clean, const cw_last_release *r, unsigned slots,
                             const cw_clean_node *c)
{
    const bool drives = clean->slots[slots].drivers >> c->node & 1u;
    const cw_span up = (r->node[0] == c->node ? r->other[0] : r->key[0]) + c->place;
    const cw_span down = (r->node[1] == c->node ? r->other[1] : r->key[1]) - c->place;
    const cw_span others = (up > down ? up : down) + c->in[CW_RECESSIVE];
    const cw_span own = drives ? cw_clean_end_of_slot(clean, slots, c) + c->own[CW_RECESSIVE]
                               : NO_KEY;
    return own > others ? own : others;
}

/* ---- Levels ---------------------------------------------------------------------------------- */

/* Returns the level of the last edge of the sender that has come to a node before a moment. */
static bool sent_level(const cw_bus *bus, const cw_clean_frame *f, const cw_bits *bits, unsigned i,
                       cw_span moment)
{
    const cw_span passed = (moment - f->begin) / f->bit;
    for (unsigned n = passed < f->slot ? (unsigned)passed + 1 : f->slot; n-- > 0;) {
        const bool level = cw_bits_level(bits, n), before = n == 0 || cw_bits_level(bits, n - 1);
        const cw_span driven = f->begin + (cw_span)n * f->bit;
        if (level != before &&
            driven + cw_cable_delay(&bus->timed.cable, f->sender, i, level) < moment)
            return level;
    }
    return CW_RECESSIVE;
}

/* Returns true when any node sees a dominant level at a moment. */
static bool is_dominant(const cw_bus *bus, const cw_clean_frame *f, const cw_bits *bits,
                        const cw_last_release *release, cw_span moment)
{
    const cw_clean *clean = &bus->timed.clean;
    for (unsigned i = 0; i < bus->node_count && moment > f->begin; i++) {
        const cw_clean_node *c = cw_clean_at(clean, i);
        const cw_span arrival = c->slot[f->slots].ack + cw_clean_behind(clean, f->slots, c);
        if (arrival < moment ? moment <= cw_clean_released_at(clean, release, f->slots, c)
                             : sent_level(bus, f, bits, i, moment) == CW_DOMINANT)
            return true;
    }
    return false;
}

uint64_t cw_clean_recessive_bits(const cw_bus *bus, const cw_clean_frame *f, uint64_t bit_times)
{
    cw_bits bits;
    cw_last_release release;
    (void)cw_bits_encode(&bits, f->frame);
    cw_clean_find_release(&release, &bus->timed.clean, f);
    for (uint64_t n = bit_times; n > 0; n--)
        if (is_dominant(bus, f, &bits, &release, f->now + (cw_span)n * bus->timed.bit_time))
            return bit_times - n;
    return bus->recessive_bits + bit_times;
}
