/* SPDX-License-Identifier: MIT
 *
 * protect.c - writes the counters and checksums of frames that hosts hand in, with the faults that
 * rules make in them.
 */
#include "rule/private.h"

#include "format/protect.h"

#include <string.h>

/* Compares by node, then by identifier: the order of the list. */
static bool comes_before(const cw_protection *p, unsigned node, uint32_t id)
{
    return p->node < node || (p->node == node && p->id < id);
}

cw_protected *cw_rules_protection(const cw_rule_set *set, unsigned node, uint32_t id)
{
    unsigned low = 0;
    unsigned high = set->protection_count;
    while (low < high) {
        const unsigned middle = low + (high - low) / 2;
        if (comes_before(&set->protections[middle].what, node, id))
            low = middle + 1;
        else
            high = middle;
    }
    if (low == set->protection_count) /* the list of a bus without any is NULL */
        return NULL;
    cw_protected *p = &set->protections[low];
    return p->what.node == node && p->what.id == id ? p : NULL;
}

/* Returns the value after one, from the greatest on to 0. */
static uint32_t next_value(const cw_protected *p, uint32_t value)
{
    return value < p->what.counter.max ? value + 1 : 0;
}

/* Writes counter and checksum, wrong ones where a fault asks for it. */
static void write(const cw_protected *p, cw_frame *frame)
{
    cw_protection_write(&p->what, frame, p->value);
    if (p->wrong)
        cw_protection_invert(&p->what, frame);
}

cw_protected *cw_rules_protect(const cw_rule_set *set, unsigned node, cw_frame *frame)
{
    cw_protected *p = cw_rules_protection(set, node, cw_frame_can_id(frame));
    if (!p || !cw_protection_fits(&p->what, frame))
        return NULL;
    p->before = p->next;
    p->last = p->sent ? p->value : p->next;
    p->sent = true;
    p->value = p->next;
    p->next = next_value(p, p->value);
    p->wrong = false;
    write(p, frame);
    return p;
}

/* COUNTER: gives the counter a wrong value, see cw_counter_fault, and decides how it counts on. */
bool cw_fault_counter(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    (void)set;
    cw_protected *is = p->made_by;
    const cw_counter_fault fault = (cw_counter_fault)rule->number;
    const uint32_t own = next_value(is, is->before); /* of the next frame, without the fault */
    is->value = fault == CW_COUNTER_SKIP ? own : is->last;
    is->next = own;
    if (fault == CW_COUNTER_STUCK)
        is->next = is->before;
    if (fault == CW_COUNTER_SKIP)
        is->next = next_value(is, own);
    write(is, p->frame);
    return true;
}

/* CHECKSUM: inverts all bits of the checksum. */
bool cw_fault_checksum(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    (void)set;
    (void)rule;
    p->made_by->wrong = true;
    write(p->made_by, p->frame);
    return true;
}

bool cw_rule_is_for(const cw_rule_state *s, const cw_protected *made_by)
{
    if (!cw_rule_is(s, CW_IN_MAKING) || !made_by)
        return !made_by && !cw_rule_is(s, CW_IN_MAKING);
    return s->rule.action == CW_ACTION_COUNTER ? made_by->what.counter.bits > 0
                                               : made_by->what.checksum.kind != CW_CHECKSUM_NONE;
}

/* Returns true when a counter counts on in the place of another one. */
static bool goes_on(const cw_protected *p, const cw_protected *was)
{
    const uint32_t max = p->what.counter.max;
    return was->what.counter.bits > 0 && was->what.counter.bits == p->what.counter.bits &&
           was->what.counter.bit == p->what.counter.bit && was->next <= max && was->value <= max;
}

void cw_rules_take_over_protections(cw_rule_set *set, const cw_rule_set *old, const uint8_t *from)
{
    for (unsigned i = 0; i < set->protection_count; i++) {
        cw_protected *p = &set->protections[i];
        const unsigned node = from[p->what.node];
        const cw_protected *was =
            node == CW_NO_NODE ? NULL : cw_rules_protection(old, node, p->what.id);
        if (!was || !goes_on(p, was))
            continue;
        p->next = was->next;
        p->value = was->value;
        p->sent = was->sent;
    }
}
