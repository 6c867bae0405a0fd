/* SPDX-License-Identifier: MIT
 *
 * rules.h - fault rules for unit tests: made, added to a bus, and what they have done.
 */
#ifndef CANWIRE_TEST_RULES_H
#define CANWIRE_TEST_RULES_H

#include "rig.h"

/* The members that are given take precedence over those of each rule. */
#pragma GCC diagnostic ignored "-Woverride-init"

/* A rule that acts on each match; it is harmless unless it has further members. */
#define ANY_RULE(title, when, what, ...)                                                           \
    ((cw_rule){.name = (title), .trigger = (when), .action = (what), .time_end = CW_NEVER,         \
               .every = 1, .probability = UINT64_MAX, .bits = 1, .tec = CW_KEEP, .rec = CW_KEEP,   \
               .number = 1, .frame = {.id = 0x7F0}, ##__VA_ARGS__})

/* Adds one to a bus that has not begun: ADD_RULE(r, "off", TIME, BUS_OFF, .nodes = NODE(1)). */
#define ADD_RULE(r, title, when, what, ...)                                                        \
    rig_rule(r, ANY_RULE(title, CW_TRIGGER_##when, CW_ACTION_##what, ##__VA_ARGS__))

static inline cw_rule new_rule(const char *name, cw_trigger trigger, cw_action action)
{
    return ANY_RULE(name, trigger, action);
}

/* Shows when it acts and does nothing else: the counters are what they are. */
static inline cw_rule probe(const char *name, cw_trigger trigger)
{
    cw_rule rule = new_rule(name, trigger, CW_ACTION_COUNTERS);
    rule.nodes = NODE(0);
    return rule;
}

static inline void exactly(cw_rule *rule, uint32_t id)
{
    rule->filters[0] = (cw_filter){.value = id, .mask = CW_FILTER_EXTENDED | 0x1FFFFFFFu};
    rule->filter_count = 1;
}

static inline cw_rule *rig_rule(rig *r, cw_rule rule)
{
    assert_in_range(r->config.rule_count, 0, RIG_RULES_MAX - 1);
    r->rules[r->config.rule_count] = rule;
    return &r->rules[r->config.rule_count++];
}

static inline unsigned add(rig *r, cw_rule rule)
{
    unsigned index = UINT32_MAX;
    assert_int_equal(cw_bus_add_rule(r->bus, &index, &rule), CW_OK);
    return index;
}

static inline cw_rule_stats rule_stats(const rig *r, unsigned rule)
{
    cw_rule_stats stats;
    assert_int_equal(cw_rule_get_stats(r->bus, rule, &stats), CW_OK);
    return stats;
}

static inline uint64_t hits(const rig *r, unsigned rule)
{
    return rule_stats(r, rule).hits;
}

/* Sends `count` frames of node 0, one every `every` bits from bit JOIN on. */
static inline void send_every(rig *r, const cw_frame *frame, unsigned every, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        rig_send(r, 0, frame, (JOIN + (uint64_t)every * i) * BIT);
}

#endif
