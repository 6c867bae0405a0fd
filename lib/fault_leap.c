/* SPDX-License-Identifier: MIT
 *
 * fault_leap.c - what fault rules want of a frame that could be leapt over.
 *
 * A rule on a bit of a frame needs the frame only from that bit on, and only when its match becomes
 * a hit. So a leap goes up to that bit, and over it when the rule passes over the match. Rules that
 * hold a level for a time need the levels of all bits, but no controllers.
 */
#include "bus_private.h"

#include "codec.h"

/* ---- Rules and the frames that wait ---------------------------------------------------------- */

static const cw_frame *next_frame(const bus_node *n)
{
    return &n->queue.slots[cw_queue_first(&n->queue)].frame;
}

/* The next rule on the wire for a frame of that node. */
static const cw_fault *next_rule(cw_candidates *c, const cw_bus *bus, unsigned node)
{
    unsigned rule;
    while (cw_candidates_next(c, &rule, bus)) {
        const cw_fault *f = &bus->faults.faults[rule];
        if (cw_acts_on_wire(f->rule.action) && cw_fault_names(f->rule.from, cw_node_bit(node)) &&
            !cw_fault_is_over(f))
            return f;
    }
    return NULL;
}

/* Its bit of a frame is one that a node which loses arbitration does not come to. */
static bool acts_late(const cw_rule *r)
{
    return cw_is_position_action(r->action) && r->field >= CW_FIELD_R1 &&
           r->field <= CW_FIELD_OVERLOAD_DELIMITER;
}

static void watch(cw_bus *bus, unsigned node)
{
    cw_fault_set *set = &bus->faults;
    uint64_t self = cw_node_bit(node);
    const cw_fault *f;
    cw_candidates c;
    set->watched &= ~self;
    set->early &= ~self;
    cw_candidates_begin(&c, bus, next_frame(&bus->nodes[node]));
    while ((f = next_rule(&c, bus, node))) {
        set->watched |= self;
        if (!acts_late(&f->rule))
            set->early |= self;
    }
}

uint64_t cw_fault_watched(cw_bus *bus, uint64_t nodes, unsigned winner)
{
    cw_fault_set *set = &bus->faults;
    if (set->exact_count + set->wild_count == 0)
        return 0;
    for (uint64_t rest = nodes & ~set->known; rest; rest &= rest - 1)
        watch(bus, cw_lowest_node(rest));
    set->known |= nodes;
    return nodes & (set->early | (set->watched & cw_node_bit(winner)));
}

/* ---- Rules that act at once ------------------------------------------------------------------ */

/* Its time is not within the longest frame from now on. */
static bool is_out_of_time(const cw_bus *bus, const cw_rule *r)
{
    uint64_t end = cw_after(bus->now, (uint64_t)CW_BITS_MAX * bus->bit_ticks);
    return r->time_end <= bus->now || r->time_begin >= end;
}

static bool has_later_position(const cw_rule *r)
{
    bool sof = r->field == CW_FIELD_SOF || (r->field == CW_FIELD_BIT && r->index == 0);
    return cw_is_position_action(r->action) && !sof;
}

bool cw_fault_acts_at_start(const cw_bus *bus, uint64_t nodes)
{
    for (uint64_t rest = nodes & bus->faults.early; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        const cw_fault *f;
        cw_candidates c;
        cw_candidates_begin(&c, bus, next_frame(&bus->nodes[i]));
        while ((f = next_rule(&c, bus, i)))
            if (!has_later_position(&f->rule) && !is_out_of_time(bus, &f->rule))
                return true;
    }
    return false;
}

/* ---- Bits that rules look at ----------------------------------------------------------------- */

/* The wire bit of a node's transmission that a rule looks at; false when that bit does not come. */
static bool find_bit(const cw_bus *bus, unsigned *n, const cw_rule *r, unsigned node)
{
    const cw_leap *leap = &bus->leap;
    bool loser = node != leap->node;
    if (r->field >= CW_FIELD_ERROR_FLAG && r->field <= CW_FIELD_OVERLOAD_DELIMITER)
        return false; /* not in a clean frame */
    if (r->field == CW_FIELD_INTERMISSION || r->field == CW_FIELD_SUSPEND) {
        *n = leap->length;
        return !loser;
    }
    return cw_bits_find(&bus->nodes[node].mac.tx, n, r->field, r->index) &&
           (!loser || *n <= leap->lost_at[node]);
}

/* The first bit from `from` on that one rule looks at. */
static unsigned rule_stop(const cw_bus *bus, const cw_fault *f, unsigned from)
{
    unsigned stop = CW_NO_STOP;
    uint64_t nodes = f->bound & bus->leap.contenders;
    for (uint64_t rest = nodes; rest; rest &= rest - 1) {
        unsigned n;
        if (find_bit(bus, &n, &f->rule, cw_lowest_node(rest)) && n >= from && n < stop)
            stop = n;
    }
    return stop;
}

/* One rule has one bit in one transmission. */
static bool is_last_stop(const cw_bus *bus, unsigned from)
{
    const cw_fault_set *set = &bus->faults;
    uint64_t bound = set->faults[set->awake[0]].bound;
    return from > 0 && set->awake_count == 1 && (bound & (bound - 1)) == 0;
}

void cw_fault_find_stop(cw_bus *bus, unsigned from)
{
    const cw_fault_set *set = &bus->faults;
    cw_leap *leap = &bus->leap;
    leap->stop = CW_NO_STOP;
    for (unsigned i = 0; i < set->awake_count && !is_last_stop(bus, from); i++) {
        const cw_fault *f = &set->faults[set->awake[i]];
        if (is_out_of_time(bus, &f->rule) || cw_fault_is_over(f))
            continue;
        unsigned n = rule_stop(bus, f, from);
        if (n == leap->stop)
            leap->stop_rule = CW_SEVERAL_RULES;
        if (n >= leap->stop)
            continue;
        leap->stop = (uint16_t)n;
        leap->stop_rule = set->awake[i];
    }
}

/* A match that is passed over changes no more than this. */
typedef struct match_state {
    cw_prng prng;
    uint64_t matches;
    uint64_t passed;
    uint32_t armed;
} match_state;

static bool passes_over(cw_bus *bus, unsigned rule)
{
    cw_fault *f = &bus->faults.faults[rule];
    const match_state s = {f->prng, f->matches, f->passed, f->armed};
    if (!cw_fault_takes_match(bus, rule, bus->now, bus->now + bus->bit_ticks))
        return true;
    f->prng = s.prng; /* it is a hit: as if nobody had asked, the bit itself will */
    f->matches = s.matches;
    f->passed = s.passed;
    f->armed = s.armed;
    return false;
}

bool cw_fault_lets_pass(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    if (leap->at >= leap->length || leap->stop_rule == CW_SEVERAL_RULES)
        return false;
    return passes_over(bus, leap->stop_rule);
}

/* ---- Rules at work --------------------------------------------------------------------------- */

static const cw_fault *awake_fault(const cw_bus *bus, unsigned i)
{
    return &bus->faults.faults[bus->faults.awake[i]];
}

bool cw_fault_needs_controllers(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++)
        if (awake_fault(bus, i)->for_attempt)
            return true;
    return false;
}

bool cw_fault_is_at_work(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        const cw_fault *f = awake_fault(bus, i);
        if (f->bits_left > 0 || (f->active && f->rule.action == CW_ACTION_STUCK))
            return true;
    }
    return false;
}

bool cw_fault_has_traffic(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        cw_action action = awake_fault(bus, i)->rule.action;
        if (action == CW_ACTION_BABBLE || action == CW_ACTION_LOAD)
            return true;
    }
    return false;
}

uint64_t cw_fault_stuck_lines(const cw_bus *bus)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        const cw_fault *f = awake_fault(bus, i);
        if (f->active && f->rule.action == CW_ACTION_STUCK && f->rule.line == CW_LINE_TX)
            nodes |= cw_node_bit(f->rule.node);
    }
    return nodes;
}

void cw_fault_unbind(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++)
        bus->faults.faults[bus->faults.awake[i]].bound = 0;
    cw_fault_fall_asleep(bus);
}
