/* SPDX-License-Identifier: MIT
 *
 * rig_loop.c - finds gateways that send a frame round in a circle.
 *
 * Each rule keeps the identifier of a frame or sets all of it. So there are two kinds of loops. In
 * one of them a rule sets the identifier: it is followed from each such rule, frame by frame. In
 * the other one the identifier stays. There all frames that can take a way are followed at once: a
 * set of frames, which each filter on the way makes smaller.
 */
#include "config/rig.h"

#include "canwire.h"

#include <stdlib.h>

#define STEPS_MAX 10000000u  /* of a search; more rules than people write */
#define EXCLUDED_MAX 2048u   /* filters that the frames of a way must not match */
#define VISITS_MAX 8192u     /* frames at gateways, on the ways from one rule */
#define CAN_ID_BITS (CW_FILTER_EXTENDED | CW_EXTENDED_ID_MAX)
#define ERROR_BIT 0x20000000u /* no frame on a bus has it */

/* A gateway that takes frames from the bus of one of its ends to that of the other one. */
typedef struct hop {
    const rig_gateway *gateway;
    const rig_rule *rule;
    unsigned end; /* that receives */
} hop;

static const cfg_node *node_at(const rig *r, const rig_end *end)
{
    return &r->buses[end->bus]->nodes[end->node];
}

/* Returns true when a node receives what another one sends. A node in loopback hears itself. */
static bool hears(const rig *r, const rig_end *from, const rig_end *to)
{
    const bool apart = node_at(r, to)->modes & CW_MODE_LOOPBACK;
    if (from->bus != to->bus || from->node == to->node)
        return from->bus == to->bus && apart;
    return !apart && !(node_at(r, from)->modes & CW_MODE_LOOPBACK);
}

/* Returns true when a hop comes after another one: its gateway hears what that one sends. */
static bool follows(const rig *r, const hop *h, const hop *last)
{
    return hears(r, &last->gateway->ends[1 - last->end], &h->gateway->ends[h->end]);
}

/* ---- What lets frames pass ------------------------------------------------------------------- */

/* A frame must match one filter of each gate that is there. */
typedef enum gate {
    GATE_RULE,
    GATE_FILTER,   /* of the node that receives */
    GATE_RECEIVE,  /* its mailboxes */
    GATE_TRANSMIT, /* those of the node that sends */
    GATES
} gate;

/* Returns the filter of mailbox `number` among those with this use; NULL: there are fewer. */
static const cw_filter *filter_of_box(const cfg_controller *c, cw_mailbox_use use, unsigned number)
{
    for (unsigned i = 0; i < c->mailbox_count; i++)
        if (c->mailboxes[i].use == use && number-- == 0)
            return &c->mailboxes[i].filter;
    return NULL;
}

static const cfg_controller *controller_at(const rig *r, const hop *h, bool sends)
{
    return &node_at(r, &h->gateway->ends[sends ? 1 - h->end : h->end])->controller;
}

/* Returns true when a gate lets all frames pass. */
static bool is_open(const rig *r, const hop *h, gate g)
{
    const cfg_controller *in = controller_at(r, h, false);
    if (g == GATE_RULE)
        return h->rule->filter_count == 0;
    if (g == GATE_FILTER)
        return in->filter_count == 0;
    if (g == GATE_RECEIVE)
        return in->mailbox_count == 0 || in->receive_fifo;
    return controller_at(r, h, true)->mailbox_count == 0;
}

/* Returns a filter of a gate, numbered from 0; NULL behind the last one. */
static const cw_filter *filter_at(const rig *r, const hop *h, gate g, unsigned number)
{
    const cfg_controller *in = controller_at(r, h, false);
    if (g == GATE_RULE)
        return number < h->rule->filter_count ? &h->rule->filters[number] : NULL;
    if (g == GATE_FILTER)
        return number < in->filter_count ? &in->filters[number] : NULL;
    if (g == GATE_RECEIVE)
        return filter_of_box(in, CW_MAILBOX_RECEIVE, number);
    return filter_of_box(controller_at(r, h, true), CW_MAILBOX_TRANSMIT, number);
}

/* Returns true when a gate has the same filter before that one: mailboxes often are alike. */
static bool is_known_filter(const rig *r, const hop *h, gate g, unsigned number)
{
    const cw_filter *b = filter_at(r, h, g, number);
    for (unsigned i = 0; i < number; i++) {
        const cw_filter *a = filter_at(r, h, g, i);
        if (a && b && a->value == b->value && a->mask == b->mask && a->inverted == b->inverted)
            return true;
    }
    return false;
}

/* Returns true when any filter of the gate matches the frame. */
static bool lets_pass(const rig *r, const hop *h, gate g, const cw_frame *frame)
{
    const cw_filter *filter;
    if (is_open(r, h, g))
        return true;
    for (unsigned i = 0; (filter = filter_at(r, h, g, i)); i++)
        if (cw_frame_matches(frame, filter, 1))
            return true;
    return false;
}

/* ---- Frames whose identifier is set ---------------------------------------------------------- */

typedef struct visit {
    hop hop;
    cw_frame frame; /* as the gateway sends it */
    unsigned from;  /* the visit before */
} visit;

typedef struct visits {
    const rig *rig;
    unsigned count;
    visit list[VISITS_MAX];
} visits;

/* Makes a frame of an identifier with the flags of filters. Data never decide at gateways. */
static cw_frame frame_of(uint32_t can_id)
{
    const bool extended = can_id & CW_FILTER_EXTENDED, remote = can_id & CW_FILTER_REMOTE;
    return (cw_frame){.id = can_id & CW_EXTENDED_ID_MAX,
                      .flags = (uint8_t)((extended ? CW_FRAME_EXTENDED : 0) |
                                         (remote ? CW_FRAME_REMOTE : 0))};
}

static bool same_frame(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags;
}

/* Returns true when this frame has been at this end of the gateway: from there all is known. */
static bool is_known(const visits *v, const visit *next)
{
    for (unsigned i = 0; i < v->count; i++)
        if (v->list[i].hop.gateway == next->hop.gateway && v->list[i].hop.end == next->hop.end &&
            same_frame(&v->list[i].frame, &next->frame))
            return true;
    return false;
}

/* Finds out what a gateway makes of a frame. Returns false when it stays. */
static bool hand_over(const rig *r, visit *next, const rig_gateway *gateway, unsigned end,
                      const cw_frame *frame)
{
    const cfg_node *in = node_at(r, &gateway->ends[end]);
    const cfg_node *out = node_at(r, &gateway->ends[1 - end]);
    const rig_rule *rule = rig_find_rule(gateway, end, frame);
    next->hop = (hop){.gateway = gateway, .rule = rule, .end = end};
    if (!rule || !lets_pass(r, &next->hop, GATE_FILTER, frame) ||
        !lets_pass(r, &next->hop, GATE_RECEIVE, frame))
        return false;
    next->frame = *frame;
    if (rule->has_id)
        next->frame = frame_of(rule->id | (frame->flags & CW_FRAME_REMOTE ? CW_FILTER_REMOTE : 0));
    return lets_pass(r, &next->hop, GATE_TRANSMIT, &next->frame) &&
           !(cfg_is_old(in) && cw_frame_can_id(frame) & CW_FILTER_EXTENDED) &&
           !(cfg_is_old(out) && cw_frame_can_id(&next->frame) & CW_FILTER_EXTENDED);
}

/* Describes the loop that ends with a visit, for the message. It may be longer than there is
 * room. */
static void rig_loop_describe(rig_loop *loop, const visits *v, unsigned last, const cw_frame *frame)
{
    unsigned count = 1;
    for (unsigned i = last; i != 0; i = v->list[i].from)
        count++;
    *loop = (rig_loop){.count = count < RIG_LOOP_MAX ? count : RIG_LOOP_MAX,
                       .rule = v->list[0].hop.rule, .frame = *frame};
    loop->gateways[0] = v->list[0].hop.gateway;
    for (unsigned i = last, n = count; i != 0; i = v->list[i].from)
        if (--n < RIG_LOOP_MAX)
            loop->gateways[n] = v->list[i].hop.gateway;
}

/* Goes on from a visit. Returns true when the first rule gets the frame again. */
static bool rig_loop_go_on(visits *v, rig_loop *loop, unsigned at)
{
    const rig *r = v->rig;
    for (size_t g = 0; g < r->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++) {
            const rig_gateway *gateway = &r->gateways[g];
            const visit *here = &v->list[at];
            visit next = {.from = at};
            if (!hears(r, &here->hop.gateway->ends[1 - here->hop.end], &gateway->ends[end]) ||
                !hand_over(r, &next, gateway, end, &here->frame))
                continue;
            if (next.hop.rule == v->list[0].hop.rule && end == v->list[0].hop.end &&
                same_frame(&next.frame, &v->list[0].frame)) {
                rig_loop_describe(loop, v, at, &here->frame);
                return true;
            }
            if (!is_known(v, &next) && v->count < VISITS_MAX)
                v->list[v->count++] = next;
        }
    return false;
}

/* Follows the frames of a rule that sets their identifier. */
static bool comes_back(visits *v, rig_loop *loop, const hop *first, uint32_t remote)
{
    v->list[0] = (visit){.hop = *first, .frame = frame_of(first->rule->id | remote)};
    v->count = 1;
    for (unsigned at = 0; at < v->count; at++)
        if (rig_loop_go_on(v, loop, at))
            return true;
    return false;
}

/* Looks for a loop that begins with a rule that sets the identifier: then it is known. */
static bool find_set_loop(visits *v, rig_loop *loop, const rig_gateway *gateway)
{
    for (const rig_rule *rule = gateway->rules; rule < gateway->rules + gateway->rule_count; rule++)
        for (unsigned end = 0; end < 2; end++) {
            const hop first = {.gateway = gateway, .rule = rule, .end = end};
            if (rule->has_id && rule->direction >> end & 1u &&
                (comes_back(v, loop, &first, 0) || comes_back(v, loop, &first, CW_FILTER_REMOTE)))
                return true;
        }
    return false;
}

/* ---- Sets of frames whose identifier stays --------------------------------------------------- */

/* The frames that match one filter and none of the others. */
typedef struct frames {
    cw_filter known;
    unsigned excluded; /* the first ones of search.excluded */
} frames;

/* A place in the list of all rules with all combinations of filters, one of each gate. */
typedef struct cursor {
    size_t gateway;
    unsigned end;
    size_t rule;
    unsigned filter[GATES];
} cursor;

typedef struct search {
    const rig *rig;
    unsigned steps;
    unsigned count;
    hop way[RIG_LOOP_MAX];
    frames sets[RIG_LOOP_MAX + 1]; /* before each hop */
    cursor next[RIG_LOOP_MAX + 1]; /* hops that have not been tried */
    cw_filter excluded[EXCLUDED_MAX];
} search;

/* Keeps the frames that match a filter; returns false when there are none. */
static bool match(search *s, frames *set, const cw_filter *filter)
{
    const uint32_t differs = (set->known.value ^ filter->value) & filter->mask & set->known.mask;
    if (filter->inverted && set->excluded < EXCLUDED_MAX)
        s->excluded[set->excluded++] = *filter;
    if (filter->inverted)
        return differs || (filter->mask & ~set->known.mask);
    set->known.value |= filter->value & filter->mask & ~set->known.mask;
    set->known.mask |= filter->mask;
    return differs == 0;
}

static bool match_not(search *s, frames *set, const cw_filter *filter)
{
    const cw_filter other = {
        .value = filter->value, .mask = filter->mask, .inverted = !filter->inverted};
    return match(s, set, &other);
}

/* A bit is chosen that makes a frame differ from an excluded filter. */
typedef struct choice {
    cw_filter known;
    unsigned from; /* the first filter that the frame may match yet */
    uint32_t rest; /* bits that have not been tried */
} choice;

/* Finds the first excluded filter that the frame may still match, and the bits that can make it
 * differ. */
static choice find_choice(const search *s, const cw_filter *known, unsigned from, unsigned count)
{
    const cw_filter *e = s->excluded;
    while (from < count && ((known->value ^ e[from].value) & e[from].mask & known->mask))
        from++;
    return (choice){.known = *known, .from = from,
                    .rest = from < count ? e[from].mask & ~known->mask : 0};
}

/* Finds bits that are not known yet, so that the frame matches none of the excluded filters. Each
 * choice makes one more bit known. */
static bool complete(search *s, cw_filter *known, unsigned count)
{
    choice choices[33] = {find_choice(s, known, 0, count)};
    unsigned depth = 0;
    while (s->steps++ < STEPS_MAX) {
        choice *c = &choices[depth];
        if (c->from == count) {
            *known = c->known;
            return true;
        }
        if (c->rest == 0 && depth-- == 0)
            return false;
        if (c->rest == 0)
            continue;
        const uint32_t bit = c->rest & -c->rest;
        const cw_filter tried = {.value = c->known.value | (~s->excluded[c->from].value & bit),
                                 .mask = c->known.mask | bit};
        c->rest ^= bit;
        choices[++depth] = find_choice(s, &tried, c->from + 1, count);
    }
    return false;
}

/* Keeps the frames that no earlier rule takes. */
static bool pass_earlier_rules(search *s, frames *set, const hop *h)
{
    for (const rig_rule *r = h->gateway->rules; r < h->rule; r++) {
        if (!(r->direction >> h->end & 1u))
            continue;
        if (r->filter_count == 0)
            return false;
        for (unsigned f = 0; f < r->filter_count; f++)
            if (!match_not(s, set, &r->filters[f]))
                return false;
    }
    return true;
}

/* Keeps the frames that both nodes know. */
static bool pass_nodes(search *s, frames *set, const hop *h)
{
    static const cw_filter base = {.mask = CW_FILTER_EXTENDED};
    const bool old = cfg_is_old(node_at(s->rig, &h->gateway->ends[0])) ||
                     cfg_is_old(node_at(s->rig, &h->gateway->ends[1]));
    return !old || match(s, set, &base);
}

/* Goes to the next combination of filters, or to the next rule. */
static void go_to_next(const rig *r, const hop *h, cursor *at, bool has_more)
{
    for (unsigned i = 0; has_more && i < GATES; i++) {
        const gate g = GATES - 1 - i;
        unsigned *number = &at->filter[g];
        ++*number;
        while (is_known_filter(r, h, g, *number))
            ++*number;
        if (!is_open(r, h, g) && filter_at(r, h, g, *number))
            return;
        *number = 0;
    }
    *at = (cursor){.gateway = at->gateway, .end = at->end, .rule = at->rule + 1};
}

/* Finds the filters at a cursor; NULL: of an open gate. Returns false when a gate lets no frame
 * pass. */
static bool find_filters(const rig *r, const hop *h, const cw_filter *filters[GATES],
                         const cursor *at)
{
    for (unsigned g = 0; g < GATES; g++) {
        const bool open = is_open(r, h, g);
        filters[g] = open ? NULL : filter_at(r, h, g, at->filter[g]);
        if (!open && !filters[g])
            return false;
    }
    return true;
}

/* Returns true when a rule keeps the identifier, and its gateway hears the last one of the way. */
static bool can_go(const search *s, const hop *h)
{
    return !h->rule->has_id && (h->rule->direction >> h->end & 1u) &&
           (s->count == 0 || follows(s->rig, h, &s->way[s->count - 1]));
}

/* Takes the next hop that can go on from the end of the way, and its filters. The cursor goes on.
 * Returns false behind the last one. */
static bool take_hop(const search *s, hop *out, const cw_filter *filters[GATES], cursor *at)
{
    while (at->gateway < s->rig->gateway_count) {
        const rig_gateway *gateway = &s->rig->gateways[at->gateway];
        if (at->end == 2) {
            *at = (cursor){.gateway = at->gateway + 1};
        } else if (at->rule == gateway->rule_count) {
            *at = (cursor){.gateway = at->gateway, .end = at->end + 1};
        } else {
            *out = (hop){.gateway = gateway, .rule = &gateway->rules[at->rule], .end = at->end};
            const bool good = can_go(s, out) && find_filters(s->rig, out, filters, at);
            go_to_next(s->rig, out, at, good);
            if (good)
                return true;
        }
    }
    return false;
}

/* The first hop is left out: coming back to it is the loop that is looked for. */
static bool is_on_way(const search *s, const hop *h)
{
    for (unsigned i = 1; i < s->count; i++)
        if (s->way[i].gateway == h->gateway && s->way[i].end == h->end)
            return true;
    return false;
}

/* Goes over a hop, if any of the frames can. Returns true when that closes a loop. A loop that does
 * not begin with the first hop is found from its own start. */
static bool rig_loop_go_over(search *s, const hop *h, const cw_filter *const filters[GATES])
{
    frames set = s->sets[s->count];
    const hop *first = &s->way[0];
    if (s->count > 0 && h->gateway == first->gateway && h->end == first->end) {
        cw_filter known = set.known;
        return h->rule == first->rule && complete(s, &known, set.excluded);
    }
    if (is_on_way(s, h) || s->count == RIG_LOOP_MAX || !pass_nodes(s, &set, h) ||
        !pass_earlier_rules(s, &set, h))
        return false;
    for (unsigned g = 0; g < GATES; g++)
        if (filters[g] && !match(s, &set, filters[g]))
            return false;
    s->way[s->count++] = *h;
    s->sets[s->count] = set;
    s->next[s->count] = (cursor){.gateway = 0};
    return false;
}

/* Searches from a set of frames on. */
static bool find_way(search *s, const cw_filter *begin)
{
    s->count = 0;
    s->sets[0] = (frames){.known = *begin};
    s->next[0] = (cursor){.gateway = 0};
    while (s->steps++ < STEPS_MAX) {
        hop h;
        const cw_filter *filters[GATES];
        if (take_hop(s, &h, filters, &s->next[s->count])) {
            if (rig_loop_go_over(s, &h, filters))
                return true;
        } else if (s->count == 0) {
            return false;
        } else {
            s->count--;
        }
    }
    return false;
}

/* Looks for a loop in which no rule sets the identifier, for base frames and for extended ones. */
static bool find_kept_loop(search *s, rig_loop *loop)
{
    static const cw_filter base = {.mask = CAN_ID_BITS & ~CW_BASE_ID_MAX},
                           extended = {.value = CW_FILTER_EXTENDED, .mask = CW_FILTER_EXTENDED};
    cw_filter begin[2] = {base, extended};
    for (unsigned i = 0; i < 2; i++) {
        begin[i].mask |= ERROR_BIT;
        if (!find_way(s, &begin[i]))
            continue;
        cw_filter known = s->sets[s->count].known;
        (void)complete(s, &known, s->sets[s->count].excluded);
        *loop = (rig_loop){
            .count = s->count, .rule = s->way[0].rule, .frame = frame_of(known.value)};
        for (unsigned n = 0; n < s->count; n++)
            loop->gateways[n] = s->way[n].gateway;
        return true;
    }
    return false;
}

/* ---- Both ------------------------------------------------------------------------------------ */

bool rig_find_loop(rig_loop *loop, const rig *self)
{
    search *s = calloc(1, sizeof *s);
    visits *v = malloc(sizeof *v);
    bool found = false;
    if (s && v) {
        s->rig = v->rig = self;
        found = find_kept_loop(s, loop);
        for (size_t g = 0; g < self->gateway_count && !found; g++)
            found = find_set_loop(v, loop, &self->gateways[g]);
    }
    free(s);
    free(v);
    return found;
}
