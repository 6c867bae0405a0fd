/* SPDX-License-Identifier: MIT
 *
 * frame_look.c - finds the bits that rules look at in waiting frames and in those of a frame step.
 */
#include "step/frame.h"

#include "format/bits.h"

/* ---- Frames that wait ------------------------------------------------------------------------ */

void cw_watch_frames(cw_bus *bus, uint64_t nodes)
{
    for (uint64_t rest = cw_rules_unknown(&bus->rules, nodes); rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_rules_watch(&bus->rules, i, cw_next_frame(bus, i));
    }
}

bool cw_rules_act_first(const cw_bus *bus, uint64_t nodes)
{
    for (uint64_t rest = nodes & bus->rules.early; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        if (cw_rules_act_at_start(&bus->rules, i, cw_next_frame(bus, i)))
            return true;
    }
    return false;
}

/* ---- The frame on its way -------------------------------------------------------------------- */

/* Returns the view of a loser's frame. The loser began together with the winner, and its bits are
 * encoded. */
static cw_frame_view view_loser(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    return (cw_frame_view){.frame = cw_queue_at(&n->queue, n->offered_slot)->frame,
                           .bits = cw_mac_tx(&n->mac),
                           .node = (uint8_t)i,
                           .at = bus->frame_step.at,
                           .length = bus->frame_step.length,
                           .last = bus->frame_step.lost_at[i]};
}

bool cw_match_ahead(const cw_bus *bus, unsigned rule)
{
    const cw_frame_step *step = &bus->frame_step;
    const cw_rule *r = &bus->rules.rules[rule].rule;
    unsigned n;
    cw_bits room;
    return step->active && step->counted == rule &&
           cw_bits_find(cw_frame_step_bits(bus, &room), &n, r->field, r->index) && step->at <= n;
}

cw_look cw_frame_step_next_look(const cw_bus *bus, unsigned from)
{
    const cw_frame_step *step = &bus->frame_step;
    const uint64_t self = cw_node_bit(step->node);
    const cw_frame_view view = cw_frame_step_view(step);
    cw_look look = {.bit = CW_NO_LOOK, .rule = CW_NO_RULE, .exact = step->bits != NULL};
    if (from > 0 && step->watched == self && cw_rules_look_once(&bus->rules, step->node))
        return look; /* that was the last look */
    if (step->watched & self)
        cw_rules_add_looks(&bus->rules, &look, &view, from);
    for (uint64_t rest = step->watched & ~self; rest; rest &= rest - 1) {
        const cw_frame_view loser = view_loser(bus, cw_lowest_node(rest));
        cw_rules_add_looks(&bus->rules, &look, &loser, from);
    }
    return look;
}
