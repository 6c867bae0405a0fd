/* SPDX-License-Identifier: MIT
 *
 * rig_loop.c - finds gateways that send a frame round in a circle.
 *
 * A set of frames is a filter without inversion: the bits of the mask are known. Each rule keeps
 * all bits of an identifier or sets all of them. So frames that a way leads back to its begin, and
 * that may take it once more, stay as they are from then on.
 */
#include "config/rig_loop.h"

#include "canwire.h"

#define STEPS_MAX 10000000u /* of a search; more rules than people write */

typedef struct hop {
    const rig_gateway *gateway;
    const rig_rule *rule;
    const cw_filter *filter; /* NULL: any frame */
    unsigned end; /* that receives */
} hop;

/* A place in the list of all filters of all rules. */
typedef struct cursor {
    size_t gateway;
    unsigned end;
    size_t rule;
    unsigned filter;
} cursor;

typedef struct search {
    const rig *rig;
    unsigned steps;
    unsigned count;
    hop way[RIG_LOOP_MAX];
    cw_filter sets[RIG_LOOP_MAX + 1]; /* the frames before each hop */
    cursor next[RIG_LOOP_MAX + 1];    /* hops that have not been tried */
} search;

/* Reduces a set to the frames that a filter matches; returns false when there are none. */
static bool narrow(cw_filter *set, const cw_filter *filter)
{
    if (!filter)
        return true;
    const uint32_t common = set->mask & filter->mask;
    const bool differs = (set->value ^ filter->value) & common;
    if (filter->inverted)
        return differs || (filter->mask & ~set->mask) != 0;
    set->value |= filter->value & filter->mask & ~set->mask;
    set->mask |= filter->mask;
    return !differs;
}

/* Returns true when a filter matches all frames of a set. */
static bool takes_all(const cw_filter *set, const cw_filter *filter)
{
    const bool known = (filter->mask & ~set->mask) == 0;
    const bool equal = ((set->value ^ filter->value) & filter->mask) == 0;
    const bool differs = (set->value ^ filter->value) & filter->mask & set->mask;
    return filter->inverted ? differs : known && equal;
}

static bool pass(cw_filter *set, const hop *h)
{
    if (!narrow(set, h->filter))
        return false;
    if (h->rule->has_id) {
        const uint32_t all = CW_FILTER_EXTENDED | CW_EXTENDED_ID_MAX;
        set->value = (set->value & ~all) | h->rule->id;
        set->mask |= all;
    }
    return true;
}

/* Returns true when frames that have come round take the same way again. */
static bool closes(const search *s, cw_filter set)
{
    for (unsigned i = 0; i < s->count; i++)
        if (!pass(&set, &s->way[i]))
            return false;
    return true;
}

/* Returns true when earlier rules take all frames of a set. */
static bool is_shadowed(const cw_filter *set, const hop *h)
{
    for (const rig_rule *r = h->gateway->rules; r < h->rule; r++) {
        if (!(r->direction >> h->end & 1u))
            continue;
        if (r->filter_count == 0)
            return true;
        for (unsigned f = 0; f < r->filter_count; f++)
            if (takes_all(set, &r->filters[f]))
                return true;
    }
    return false;
}

/* Returns true when a node receives what the last gateway of the way has sent. */
static bool is_reached(const search *s, const hop *h)
{
    if (s->count == 0)
        return true;
    const hop *last = &s->way[s->count - 1];
    const rig_end from = last->gateway->ends[1 - last->end];
    const rig_end to = h->gateway->ends[h->end];
    return to.bus == from.bus && to.node != from.node;
}

/* Takes the hop at a cursor, which then goes on. Returns false behind the last one. */
static bool take_hop(const search *s, hop *out, cursor *at)
{
    while (at->gateway < s->rig->gateway_count) {
        const rig_gateway *gateway = &s->rig->gateways[at->gateway];
        const rig_rule *rule = &gateway->rules[at->rule];
        if (at->end == 2) {
            *at = (cursor){.gateway = at->gateway + 1};
        } else if (at->rule == gateway->rule_count) {
            *at = (cursor){.gateway = at->gateway, .end = at->end + 1};
        } else if (at->filter > 0 && at->filter >= rule->filter_count) {
            at->rule++;
            at->filter = 0;
        } else {
            *out = (hop){.gateway = gateway, .rule = rule, .end = at->end};
            if (rule->filter_count > 0)
                out->filter = &rule->filters[at->filter];
            at->filter++;
            return true;
        }
    }
    return false;
}

static bool is_on_way(const search *s, const hop *h)
{
    for (unsigned i = 0; i < s->count; i++)
        if (s->way[i].rule == h->rule && s->way[i].end == h->end)
            return true;
    return false;
}

/* Goes over a hop, if any of the frames can. Returns true when that closes a loop. A loop that does
 * not begin with the first hop is found from its own begin. */
static bool go_over(search *s, const hop *h)
{
    cw_filter set = s->sets[s->count];
    if (!(h->rule->direction >> h->end & 1u) || !is_reached(s, h) || is_shadowed(&set, h))
        return false;
    const hop *first = &s->way[0];
    if (s->count > 0 && h->rule == first->rule && h->end == first->end)
        return h->filter == first->filter && closes(s, set);
    if (is_on_way(s, h) || s->count == RIG_LOOP_MAX || !pass(&set, h))
        return false;
    s->way[s->count++] = *h;
    s->sets[s->count] = set;
    s->next[s->count] = (cursor){.gateway = 0};
    return false;
}

static bool find(search *s)
{
    while (s->steps++ < STEPS_MAX) {
        hop h;
        if (take_hop(s, &h, &s->next[s->count])) {
            if (go_over(s, &h))
                return true;
        } else if (s->count == 0) {
            return false;
        } else {
            s->count--;
        }
    }
    return false;
}

/* Returns the frames that go round on the way that has been found. */
static cw_filter frames_of(const search *s)
{
    cw_filter set = {.mask = 0};
    (void)narrow(&set, s->way[0].filter);
    return set;
}

bool rig_find_loop(rig_loop *loop, const rig *self)
{
    search s = {.rig = self};
    if (!find(&s))
        return false;
    *loop = (rig_loop){.count = s.count, .rule = s.way[0].rule, .frame = frames_of(&s)};
    for (unsigned i = 0; i < s.count; i++)
        loop->gateways[i] = s.way[i].gateway;
    return true;
}
