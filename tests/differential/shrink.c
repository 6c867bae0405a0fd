/* SPDX-License-Identifier: MIT
 *
 * shrink.c - makes a failing scenario smaller while it fails in the same way.
 *
 * Each kind of simplification has a number of places where it can be tried. All are tried again
 * and again until none of them helps any more.
 */
#include "differential.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define TRIALS_MAX 10000u

typedef struct shrinking {
    diff_scenario *best;
    diff_outcome outcome;
    unsigned trials;
} shrinking;

/* Takes the candidate over when it fails, too; frees it in any case. */
static bool keep_if_fails(shrinking *k, diff_scenario *candidate)
{
    uint64_t tick;
    bool fails = k->trials < TRIALS_MAX && diff_try(candidate, &tick, false) == k->outcome;
    k->trials++;
    if (fails) {
        diff_scenario_free(k->best);
        *k->best = *candidate;
    } else {
        diff_scenario_free(candidate);
    }
    return fails;
}

/* ---- Operations ------------------------------------------------------------------------------ */

static void remove_ops(diff_scenario *s, unsigned first, unsigned count)
{
    memmove(&s->ops[first], &s->ops[first + count],
            (s->op_count - first - count) * sizeof s->ops[0]);
    s->op_count -= count;
}

/* Drops long runs of operations first, then shorter ones. */
static bool drop_operations(shrinking *k)
{
    static diff_scenario candidate;
    bool helped = false;
    for (unsigned size = k->best->op_count; size > 0; size /= 2) {
        for (unsigned first = 0; first + size <= k->best->op_count;) {
            diff_scenario_copy(&candidate, k->best);
            remove_ops(&candidate, first, size);
            bool fails = keep_if_fails(k, &candidate);
            helped = helped || fails;
            first += fails ? 0 : size;
        }
    }
    return helped;
}

static void cut_end(shrinking *k, uint64_t tick)
{
    static diff_scenario candidate;
    unsigned kept = 0;
    uint64_t bit = k->best->plans[0].config.bit_ticks;
    diff_scenario_copy(&candidate, k->best);
    while (kept < candidate.op_count && candidate.ops[kept].tick <= tick)
        kept++;
    candidate.op_count = kept;
    candidate.end = tick + 2 * bit;
    (void)keep_if_fails(k, &candidate);
}

/* ---- Places ---------------------------------------------------------------------------------- */

/* Changes something at a place; returns false when there is nothing to change. */
typedef bool change(diff_scenario *s, unsigned place);

typedef struct simplification {
    unsigned (*places)(const diff_scenario *s);
    change *apply;
} simplification;

static bool simplify(shrinking *k, const simplification *by)
{
    static diff_scenario candidate;
    bool helped = false;
    for (unsigned place = by->places(k->best); place-- > 0;) {
        diff_scenario_copy(&candidate, k->best);
        if (by->apply(&candidate, place))
            helped = keep_if_fails(k, &candidate) || helped;
        else
            diff_scenario_free(&candidate);
    }
    return helped;
}

/* ---- The whole ------------------------------------------------------------------------------- */

static unsigned whole_places(const diff_scenario *s)
{
    (void)s;
    return 7;
}

static bool simplify_whole(diff_scenario *s, unsigned place)
{
    const diff_scenario before = *s;
    if (place == 5)
        s->drains = 1000;
    if (place == 4)
        s->fast = DIFF_WHOLE;
    if (place == 3)
        s->reference = DIFF_WHOLE;
    if (place == 2)
        s->peeks = false;
    for (unsigned i = 0; i < s->plan_count; i++) {
        if (place == 1)
            s->plans[i].config.events = 8192;
        if (place == 6)
            s->plans[i].config.start_at_tick = false;
        if (place == 0)
            s->plans[i].config.inbox = 1024;
    }
    return memcmp(&before, s, sizeof before) != 0;
}

/* ---- Configurations -------------------------------------------------------------------------- */

static unsigned plan_places(const diff_scenario *s)
{
    return s->plan_count;
}

/* Lets the bus begin with a later configuration, without a take-over. */
static bool begin_with_plan(diff_scenario *s, unsigned plan)
{
    unsigned kept = 0;
    bool taken = false;
    for (unsigned i = 0; i < s->op_count; i++) {
        bool takes = s->ops[i].kind == DIFF_TAKE_OVER;
        taken = taken || takes;
        if (!takes)
            s->ops[kept++] = s->ops[i];
    }
    s->op_count = kept;
    s->plans[0] = s->plans[plan];
    return taken;
}

/* ---- Rules ----------------------------------------------------------------------------------- */

static unsigned rule_places(const diff_scenario *s)
{
    return s->plan_count * DIFF_RULES_MAX;
}

/* Removes a rule. Later ones move up, and references by index change. */
static bool remove_rule(diff_scenario *s, unsigned place)
{
    unsigned at = place % DIFF_RULES_MAX;
    diff_plan *plan = &s->plans[place / DIFF_RULES_MAX];
    if (at >= plan->config.rule_count)
        return false;
    plan->config.rule_count--;
    memmove(&plan->rules[at], &plan->rules[at + 1],
            (plan->config.rule_count - at) * sizeof plan->rules[0]);
    for (unsigned i = 0; i < plan->config.rule_count; i++)
        if (plan->rules[i].rule.after > at)
            plan->rules[i].rule.after--;
    for (unsigned i = 0; i < s->op_count; i++) {
        diff_op *op = &s->ops[i];
        if (op->kind >= DIFF_CLEAR_RULE && op->kind <= DIFF_FIRE_RULE && op->target > at)
            op->target--;
    }
    return true;
}

/* Fields of a rule that are simplest when they are zero. */
#define FIELD(name)                                                                                \
    {                                                                                              \
        offsetof(cw_rule, name), sizeof(((cw_rule *)0)->name)                                      \
    }

static const struct {
    size_t offset;
    size_t size;
} fields[] = {
    FIELD(filter_count),
    FIELD(error_mask),
    FIELD(data_length),
    FIELD(data_mask),
    FIELD(data_value),
    FIELD(from),
    FIELD(state_nodes),
    FIELD(state_mask),
    FIELD(time_begin),
    FIELD(again_ticks),
    FIELD(has_after),
    FIELD(manual),
    FIELD(after),
    FIELD(after_delay),
    FIELD(skip),
    FIELD(every),
    FIELD(count),
    FIELD(hold_off),
    FIELD(index),
    FIELD(for_ticks),
    FIELD(at),
    FIELD(node),
    FIELD(level),
    FIELD(line),
    FIELD(side),
    FIELD(dominant_timeout),
    FIELD(pulse_offset),
    FIELD(pulse_permille),
    FIELD(pattern_level),
    FIELD(pattern_mask),
    FIELD(number),
    FIELD(load_permille),
    FIELD(deviations),
    FIELD(raw_when_idle),
    FIELD(raw),
    FIELD(period_ticks),
    FIELD(group),
    FIELD(settings),
    FIELD(change),
    FIELD(frame),
    FIELD(nodes),
};

#define FIELDS (sizeof fields / sizeof fields[0])
#define RULE_CHANGES (FIELDS + 3)

static bool simplify_rule(cw_rule *r, unsigned what)
{
    const cw_rule before = *r;
    if (what < FIELDS)
        memset((unsigned char *)r + fields[what].offset, 0, fields[what].size);
    else if (what == FIELDS)
        r->probability = UINT64_MAX;
    else if (what == FIELDS + 1)
        r->time_end = CW_NEVER;
    else if (r->bits > 1)
        r->bits = 1;
    return memcmp(&before, r, sizeof before) != 0;
}

static unsigned field_places(const diff_scenario *s)
{
    return (s->plan_count + 1) * DIFF_RULES_MAX * RULE_CHANGES;
}

static bool simplify_field(diff_scenario *s, unsigned place)
{
    unsigned rule = place / RULE_CHANGES % DIFF_RULES_MAX;
    unsigned plan = (unsigned)(place / (RULE_CHANGES * DIFF_RULES_MAX));
    bool added = plan == s->plan_count;
    unsigned count = added ? s->added_count : s->plans[plan].config.rule_count;
    diff_rule *rules = added ? s->added : s->plans[plan].rules;
    return rule < count && simplify_rule(&rules[rule].rule, place % RULE_CHANGES);
}

/* ---- Protections ----------------------------------------------------------------------------- */

static unsigned protection_places(const diff_scenario *s)
{
    return s->plan_count * DIFF_PROTECTIONS_MAX;
}

static void drop_protection(diff_plan *plan, unsigned at)
{
    plan->config.protection_count--;
    memmove(&plan->protections[at], &plan->protections[at + 1],
            (plan->config.protection_count - at) * sizeof plan->protections[0]);
}

static bool remove_protection(diff_scenario *s, unsigned place)
{
    diff_plan *plan = &s->plans[place / DIFF_PROTECTIONS_MAX];
    const unsigned at = place % DIFF_PROTECTIONS_MAX;
    if (at >= plan->config.protection_count)
        return false;
    drop_protection(plan, at);
    return true;
}

static void remove_protections_of(diff_plan *plan, unsigned node)
{
    for (unsigned i = plan->config.protection_count; i-- > 0;) {
        cw_protection *p = &plan->protections[i];
        if (p->node == node)
            drop_protection(plan, i);
        else
            p->node = (uint8_t)(p->node - (p->node > node));
    }
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

static unsigned node_places(const diff_scenario *s)
{
    return s->plans[0].config.node_count;
}

static void squeeze(uint64_t *nodes, unsigned at)
{
    uint64_t low = *nodes & ((UINT64_C(1) << at) - 1);
    uint64_t high = at == 63 ? 0 : *nodes >> (at + 1);
    *nodes = low | high << at;
}

static void remove_from_rule(cw_rule *r, unsigned at)
{
    squeeze(&r->from, at);
    squeeze(&r->at, at);
    squeeze(&r->nodes, at);
    squeeze(&r->state_nodes, at);
    r->node = (uint8_t)(r->node - (r->node > at));
    memmove(&r->group[at], &r->group[at + 1], CW_NODES_MAX - 1 - at);
}

static bool is_about_node(const diff_op *op)
{
    return op->kind == DIFF_SEND || op->kind == DIFF_RESTART || op->kind == DIFF_SET ||
           op->kind == DIFF_FLUSH || op->kind == DIFF_ATTACH;
}

/* Removes a node, but only of a bus that is the same throughout. */
static bool remove_node(diff_scenario *s, unsigned at)
{
    diff_plan *plan = &s->plans[0];
    if (plan->config.node_count < 2)
        return false;
    for (unsigned i = 0; i < s->op_count; i++)
        if (s->ops[i].kind == DIFF_TAKE_OVER)
            return false;
    plan->config.node_count--;
    memmove(&plan->nodes[at], &plan->nodes[at + 1],
            (plan->config.node_count - at) * sizeof plan->nodes[0]);
    remove_protections_of(plan, at);
    for (unsigned i = 0; i < DIFF_RULES_MAX; i++) {
        remove_from_rule(&plan->rules[i].rule, at);
        remove_from_rule(&s->added[i].rule, at);
    }
    for (unsigned i = 0; i < s->op_count; i++)
        if (is_about_node(&s->ops[i]) && s->ops[i].target > at)
            s->ops[i].target--;
    return true;
}

#define SETTINGS 12u

static unsigned setting_places(const diff_scenario *s)
{
    return s->plan_count * CW_NODES_MAX * SETTINGS;
}

static bool simplify_setting(diff_scenario *s, unsigned place)
{
    const unsigned node = place / SETTINGS % CW_NODES_MAX;
    diff_plan *plan = &s->plans[place / SETTINGS / CW_NODES_MAX];
    cw_node_config *n = &plan->nodes[node];
    const cw_node_config before = *n;
    if (place % SETTINGS == 0)
        n->modes = 0;
    else if (place % SETTINGS == 1)
        n->order = CW_ORDER_PRIORITY;
    else if (place % SETTINGS == 2)
        n->queue = 16;
    else if (place % SETTINGS == 3)
        n->warning_limit = 96;
    else if (place % SETTINGS == 4)
        n->restart_ticks = 0;
    else if (place % SETTINGS == 5)
        memset(&n->host, 0, sizeof n->host);
    else if (place % SETTINGS == 6)
        n->variants = 0;
    else if (place % SETTINGS == 7)
        n->sleeps = false;
    else if (place % SETTINGS == 8)
        memset(&n->sleep, 0, sizeof n->sleep);
    else if (place % SETTINGS == 9)
        memset(&n->schedule, 0, sizeof n->schedule);
    else if (place % SETTINGS == 10 && n->schedule.triggers == diff_slave)
        n->schedule.trigger_count /= 2;
    else if (place % SETTINGS == 11 && n->schedule.cycles == 0)
        memset(&n->local, 0, sizeof n->local);
    return node < plan->config.node_count && memcmp(&before, n, sizeof before) != 0;
}

/* ---- Values of operations -------------------------------------------------------------------- */

#define OP_CHANGES 7u

static unsigned op_places(const diff_scenario *s)
{
    return s->op_count * OP_CHANGES;
}

static bool simplify_send(diff_op *op, unsigned what, uint64_t bit)
{
    cw_frame *f = &op->send.frame;
    if (what == 0)
        memset(f->data, 0, sizeof f->data);
    else if (what == 1)
        f->dlc = 0;
    else if (what == 2 && f->flags)
        *f = (cw_frame){.id = f->id & 0x7FF, .dlc = f->dlc};
    else if (what == 3)
        op->send.at_tick = op->tick;
    else if (what == 4)
        op->send.at_tick -= op->send.at_tick % bit;
    return true;
}

static bool simplify_op(diff_scenario *s, unsigned place)
{
    diff_op *op = &s->ops[place / OP_CHANGES];
    const diff_op before = *op;
    uint64_t bit = s->plans[0].config.bit_ticks;
    unsigned what = place % OP_CHANGES;
    if (what == 6)
        op->at_once = place >= OP_CHANGES && op->tick == s->ops[place / OP_CHANGES - 1].tick;
    else if (what == 5)
        op->tick = place < OP_CHANGES ? 0 : s->ops[place / OP_CHANGES - 1].tick;
    else if (op->kind == DIFF_SEND)
        simplify_send(op, what, bit);
    return memcmp(&before, op, sizeof before) != 0;
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* Counts all points in time of a scenario: those of operations and frames, and the end. */
static unsigned time_count(const diff_scenario *s)
{
    return 2 * s->op_count + 1;
}

static uint64_t time_at(const diff_scenario *s, unsigned i)
{
    if (i >= 2 * s->op_count)
        return s->end;
    const diff_op *op = &s->ops[i / 2];
    return i % 2 && op->kind == DIFF_SEND ? op->send.at_tick : op->tick;
}

static uint64_t time_before(const diff_scenario *s, uint64_t tick)
{
    uint64_t before = 0;
    for (unsigned i = 0; i < time_count(s); i++)
        if (time_at(s, i) < tick && time_at(s, i) > before)
            before = time_at(s, i);
    return before;
}

static void come_earlier(uint64_t *tick, uint64_t from, uint64_t less)
{
    if (*tick >= from && *tick != CW_NEVER)
        *tick -= less;
}

static void rules_come_earlier(diff_rule *rules, uint64_t from, uint64_t less)
{
    for (unsigned i = 0; i < DIFF_RULES_MAX; i++) {
        come_earlier(&rules[i].rule.time_begin, from, less);
        come_earlier(&rules[i].rule.time_end, from, less);
    }
}

static void all_come_earlier(diff_scenario *s, uint64_t from, uint64_t less)
{
    for (unsigned i = 0; i < s->op_count; i++) {
        come_earlier(&s->ops[i].tick, from, less);
        if (s->ops[i].kind == DIFF_SEND)
            come_earlier(&s->ops[i].send.at_tick, from, less);
    }
    for (unsigned i = 0; i < s->plan_count; i++)
        rules_come_earlier(s->plans[i].rules, from, less);
    rules_come_earlier(s->added, from, less);
    come_earlier(&s->end, from, less);
}

#define TIME_CHANGES 5u

static unsigned time_places(const diff_scenario *s)
{
    return time_count(s) * TIME_CHANGES;
}

/* Leaves out whole bits of the time before a point: all that is later comes earlier. */
static bool leave_out_time(diff_scenario *s, unsigned place)
{
    static const unsigned keep_bits[TIME_CHANGES] = {200, 50, 12, 1, 0};
    uint64_t bit = s->plans[0].config.bit_ticks;
    uint64_t from = time_at(s, place / TIME_CHANGES);
    uint64_t gap = (from - time_before(s, from)) / bit;
    unsigned keep = keep_bits[place % TIME_CHANGES];
    if (gap <= keep)
        return false;
    all_come_earlier(s, from, (gap - keep) * bit);
    return true;
}

/* ---- All ------------------------------------------------------------------------------------- */

void diff_shrink(diff_scenario *s, diff_outcome outcome, uint64_t tick)
{
    static const simplification all[] = {
        {whole_places, simplify_whole},     {plan_places, begin_with_plan},
        {rule_places, remove_rule},         {node_places, remove_node},
        {protection_places, remove_protection},
        {setting_places, simplify_setting}, {field_places, simplify_field},
        {op_places, simplify_op},           {time_places, leave_out_time},
    };
    shrinking k = {.best = s, .outcome = outcome};
    bool helped = true;
    if (outcome == DIFF_DIFFERS)
        cut_end(&k, tick);
    while (helped && k.trials < TRIALS_MAX) {
        helped = drop_operations(&k);
        for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
            helped = simplify(&k, &all[i]) || helped;
    }
    printf("%u operations, after %u trials\n", s->op_count, k.trials);
}
