/* SPDX-License-Identifier: MIT
 *
 * look.c - the bits of a frame that rules look at in a frame step.
 *
 * A rule on a bit of a frame needs the frame only from that bit on, and only when its match becomes
 * a hit. So the step goes up to that bit, and past it when the rule passes over the match. No rule
 * is bound to a transmission before single bits go on. Rules that hold a level for a time need the
 * levels of all bits, but no controllers.
 */
#include "rule/private.h"

#include "format/bits.h"

/* ---- Rules and the frames that wait ---------------------------------------------------------- */

/* Finds the next rule that acts on the wire for a frame of that node. Returns false when there are
 * no more. */
static bool next_rule(cw_candidates *c, unsigned *rule, const cw_rule_set *set, unsigned node)
{
    while (cw_candidates_next(c, rule, set)) {
        const cw_rule_state *s = &set->rules[*rule];
        if (cw_rule_acts_on_wire(s) && cw_rule_names(s->rule.from, cw_node_bit(node)) &&
            !cw_rule_is_over(s))
            return true;
    }
    return false;
}

/* Returns true when a node that loses arbitration does not come to the bit of the rule. */
static bool acts_late(const cw_rule_state *s)
{
    const cw_rule *r = &s->rule;
    return cw_rule_is(s, CW_HAS_POSITION) && r->field >= CW_FIELD_R1 &&
           r->field <= CW_FIELD_OVERLOAD_DELIMITER;
}

/* Returns whether a match is a hit, or none, at whatever bit of a frame, but for the rule's time.
 * Bits between frames, and those that only the bits of a frame tell, are left out. */
static bool takes_any_bit(const cw_rule_state *s)
{
    const cw_rule *r = &s->rule;
    return cw_rule_is(s, CW_HAS_POSITION) && r->field != CW_FIELD_INTERMISSION &&
           r->field != CW_FIELD_SUSPEND && r->field != CW_FIELD_STUFF && r->field != CW_FIELD_BIT &&
           r->field != CW_FIELD_FIXED_STUFF &&
           r->hold_off == 0 && r->state_nodes == 0;
}

/* Adds a rule to those that wait for the frame. With several no short cut is left. */
static void add_watcher(cw_watch *w, const cw_rule_set *set, unsigned rule)
{
    const cw_rule_state *s = &set->rules[rule];
    bool only = w->rule == CW_NO_RULE;
    w->rule = only ? (uint16_t)rule : CW_SEVERAL_RULES;
    w->early = w->early || !acts_late(s);
    w->rough = only && takes_any_bit(s);
    w->counting = w->rough && s->open;
}

/* Returns whether a rule takes each frame of each node. */
static bool is_undemanding(const cw_rule *r)
{
    return r->filter_count == 0 && r->data_length == 0 && r->from == 0 &&
           r->rate == CW_RATE_ANY;
}

/* Finds what rules without filters mean for a frame. If they ask for nothing else, it is the same
 * for each one. */
static void find_usual(cw_rule_set *set)
{
    set->usual = (cw_watch){.rule = CW_NO_RULE};
    set->has_usual = true;
    for (unsigned i = 0; i < set->wildcard_count; i++) {
        const cw_rule_state *s = &set->rules[set->wildcards[i]];
        if (!cw_rule_acts_on_wire(s) || cw_rule_is_over(s))
            continue;
        set->has_usual = set->has_usual && is_undemanding(&s->rule);
        add_watcher(&set->usual, set, set->wildcards[i]);
    }
}

/* Notes the result of the comparison for a node, one bit in each set. */
static void note_watch(cw_rule_set *set, unsigned node, cw_watch w)
{
    const uint64_t self = cw_node_bit(node);
    set->watcher[node] = w.rule;
    set->watched = (set->watched & ~self) | (w.rule == CW_NO_RULE ? 0 : self);
    set->early = (set->early & ~self) | (w.early ? self : 0);
    set->rough = (set->rough & ~self) | (w.rough ? self : 0);
    set->counting = (set->counting & ~self) | (w.counting ? self : 0);
}

/* Watches all nodes anew after rules have changed. */
static void watch_anew(cw_rule_set *set)
{
    set->stale = false;
    find_usual(set);
    set->always_known = set->has_usual && set->key_count == 0 ? set->bus.all : 0;
    set->known = set->always_known;
    set->unusual = 0;
    for (unsigned i = 0; i < set->bus.node_count; i++)
        note_watch(set, i, set->usual);
}

/* Compares the frame with all rules that may match it. */
static cw_watch watch_closely(const cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    cw_watch w = {.rule = CW_NO_RULE};
    unsigned rule;
    cw_candidates c;
    cw_candidates_begin(&c, set, frame);
    while (next_rule(&c, &rule, set, node))
        add_watcher(&w, set, rule);
    return w;
}

uint64_t cw_rules_unknown(cw_rule_set *set, uint64_t nodes)
{
    if (set->stale)
        watch_anew(set);
    return nodes & ~set->known;
}

void cw_rules_watch(cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    const uint64_t self = cw_node_bit(node);
    bool usual = set->has_usual && !cw_rules_may_wait(set, frame);
    set->known |= self;
    if (usual && !(set->unusual & self))
        return; /* unchanged */
    note_watch(set, node, usual ? set->usual : watch_closely(set, node, frame));
    set->unusual = usual ? set->unusual & ~self : set->unusual | self;
}

/* ---- Rules that act at once ------------------------------------------------------------------ */

/* Returns true when the time of the rule is not within the longest frame from now on. */
static bool is_out_of_time(const cw_rule_set *set, const cw_rule *r)
{
    const unsigned most = set->bus.fd ? CW_BITS_MAX : CW_CLASSICAL_FRAME_BITS_MAX;
    uint64_t end = cw_wire_tick_or_never(set->bus.time, most);
    return r->time_end <= cw_rules_now(set) || r->time_begin >= end;
}

/* Returns true when the position comes after SOF. */
static bool has_later_position(const cw_rule_state *s)
{
    const cw_rule *r = &s->rule;
    bool sof = r->field == CW_FIELD_SOF || (r->field == CW_FIELD_BIT && r->index == 0);
    return cw_rule_is(s, CW_HAS_POSITION) && !sof;
}

bool cw_rules_act_at_start(const cw_rule_set *set, unsigned node, const cw_frame *frame)
{
    unsigned rule;
    cw_candidates c;
    cw_candidates_begin(&c, set, frame);
    while (next_rule(&c, &rule, set, node)) {
        const cw_rule_state *s = &set->rules[rule];
        if (!has_later_position(s) && !is_out_of_time(set, &s->rule))
            return true;
    }
    return false;
}

/* ---- Bits that rules look at ----------------------------------------------------------------- */

/* Finds the wire bit of a transmission that a rule looks at. Returns false when that bit does not
 * come. */
static bool find_bit(const cw_frame_view *view, unsigned *n, const cw_rule *r)
{
    if (r->field >= CW_FIELD_ERROR_FLAG && r->field <= CW_FIELD_OVERLOAD_DELIMITER)
        return false; /* not in a clean frame */
    if (r->field == CW_FIELD_INTERMISSION || r->field == CW_FIELD_SUSPEND) {
        *n = view->length;
        return view->last >= view->length;
    }
    if (!view->bits)
        return cw_frame_find(view->frame, n, r->field, r->index);
    return cw_bits_find_among(view->bits, view->stuffing, n, r->field, r->index) &&
           *n <= view->last;
}

/* Adds the look of one rule at a transmission, unless it lies before `from` or after one that has
 * been found. */
static void add_look(cw_look *look, const cw_rule_set *set, unsigned rule,
                     const cw_frame_view *view, unsigned from)
{
    const cw_rule_state *s = &set->rules[rule];
    const cw_rule *r = &s->rule;
    unsigned n;
    if (!cw_rule_is(s, CW_HAS_POSITION) || (!s->open && is_out_of_time(set, r)) ||
        !find_bit(view, &n, r) || n < from || n > look->bit)
        return;
    bool another = n == look->bit && look->rule != rule;
    look->rule = another ? CW_SEVERAL_RULES : (uint16_t)rule;
    look->bit = (uint16_t)n;
}

void cw_rules_add_looks(const cw_rule_set *set, cw_look *look, const cw_frame_view *view,
                        unsigned from)
{
    unsigned rule = set->watcher[view->node];
    cw_candidates c;
    if (rule != CW_SEVERAL_RULES) {
        add_look(look, set, rule, view, from);
        return;
    }
    cw_candidates_begin(&c, set, view->frame);
    while (next_rule(&c, &rule, set, view->node))
        add_look(look, set, rule, view, from);
}

/* ---- Consuming looks ------------------------------------------------------------------------- */

/* Returns the tick at which a bit of the frame begins. */
static uint64_t tick_of(const cw_rule_set *set, const cw_frame_view *view, unsigned n)
{
    return cw_wire_tick(set->bus.time, (uint64_t)n - view->at);
}

/* Decides a look whose bit is known. */
static bool consume_bit(cw_rule_set *set, const cw_look *look, const cw_frame_view *view)
{
    if (look->bit >= view->length || look->rule == CW_SEVERAL_RULES)
        return false;
    return cw_rule_passes_over(set, look->rule, tick_of(set, view, look->bit),
                               tick_of(set, view, look->bit + 1u));
}

/* Decides a look at some bit of a frame that begins now, or has begun, and is sent to its end. */
static bool consume_frame(cw_rule_set *set, const cw_look *look, const cw_frame_view *view)
{
    const cw_rule *r = &set->rules[look->rule].rule;
    uint64_t end = cw_wire_tick(set->bus.time, view->length);
    unsigned n;
    if (set->rules[look->rule].open)
        return cw_rule_passes_over(set, look->rule, cw_rules_now(set), cw_rules_bit_end(set));
    if (r->time_begin > cw_rules_now(set) || r->time_end < end)
        return false; /* the result depends on the bit */
    return !cw_frame_find(view->frame, &n, r->field, r->index) ||
           cw_rule_passes_over(set, look->rule, cw_rules_now(set), cw_rules_bit_end(set));
}

bool cw_rules_consume(cw_rule_set *set, uint64_t bits, const cw_look *look,
                      const cw_frame_view *view)
{
    if (bits > 0)
        cw_noise_pass(set, bits);
    if (!look)
        return true;
    return look->exact ? consume_bit(set, look, view) : consume_frame(set, look, view);
}

/* ---- Rules at work --------------------------------------------------------------------------- */

static const cw_rule_state *awake_rule(const cw_rule_set *set, unsigned i)
{
    return &set->rules[set->awake[i]];
}

/* Such a rule has neither a position nor a line, or its node sends what no other would. */
static inline unsigned touch_of(const cw_rule_state *s)
{
    if (s->for_attempt || cw_rule_is_raw(s) || cw_rule_is(s, CW_DEVIATES))
        return CW_TOUCH_CONTROLLERS | CW_TOUCH_MORE;
    unsigned touch = cw_rule_is_at_work(s) ? CW_TOUCH_LEVELS : 0;
    if (s->active && cw_rule_is(s, CW_ON_LINE))
        touch |= CW_TOUCH_LEVELS;
    if (s->active && cw_rule_is(s, CW_STEADY_TRAFFIC))
        return touch | CW_TOUCH_QUEUES;
    if (cw_rule_is_plain(s) && cw_rule_is(s, CW_RANDOM_BITS))
        return touch | CW_TOUCH_AT_RANDOM;
    if (cw_rule_is_plain(s) && cw_rule_is(s, CW_ON_LINE) && s->rule.level == CW_RECESSIVE)
        return touch | CW_TOUCH_DOMINANT;
    return touch | CW_TOUCH_MORE; /* a finished rule falls asleep with a single bit */
}

unsigned cw_rules_touch_now(const cw_rule_set *set)
{
    unsigned touch = 0;
    for (unsigned i = 0; i < set->awake_count; i++)
        touch |= touch_of(awake_rule(set, i));
    return touch;
}

uint64_t cw_rules_keep_quiet(const cw_rule_set *set, uint64_t bits, bool busy)
{
    return cw_noise_free(set, cw_traffic_free(set, bits, busy));
}

uint64_t cw_rules_stuck_lines(const cw_rule_set *set)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < set->awake_count; i++) {
        const cw_rule_state *s = awake_rule(set, i);
        if (s->active && cw_rule_is(s, CW_ON_LINE) && s->rule.line == CW_LINE_TX)
            nodes |= cw_node_bit(s->rule.node);
    }
    return nodes;
}
