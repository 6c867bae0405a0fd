/* SPDX-License-Identifier: MIT
 *
 * error.c - rules that wait for errors, states, restarts and lost arbitrations.
 */
#include "rule/private.h"

/* Classes of linux/can/error.h. */
static uint32_t error_class(const cw_event *e)
{
    switch (e->kind) {
    case CW_EVENT_ARBITRATION_LOST:
        return 0x002;
    case CW_EVENT_ERROR:
        return e->error.type == CW_ERROR_ACK ? 0x0A8 : 0x088;
    case CW_EVENT_STATE:
        if (e->state == CW_STATE_SLEEPING || e->state_before == CW_STATE_SLEEPING)
            return 0; /* drivers do not report it */
        return e->state == CW_STATE_BUS_OFF ? 0x040 : 0x004;
    case CW_EVENT_RESTART:
        return 0x100;
    case CW_EVENT_OVERRUN:
        return 0x004;
    case CW_EVENT_FAULT:
    case CW_EVENT_LINK:
    case CW_EVENT_DROP:
    case CW_EVENT_IMPROPER:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_EXCEPTION:
    case CW_EVENT_RX:
    case CW_EVENT_TX:
    case CW_EVENT_WAKE:
    case CW_EVENT_SKIP:
    case CW_EVENT_SYNC:
    case CW_EVENT_CAPTURE:
    case CW_EVENT_COUNT:
        break;
    }
    return 0;
}

/* Matches one rule with errors of these classes. The same error at several nodes is one match. */
static void match_error(cw_rule_set *set, unsigned rule, unsigned node, uint32_t classes,
                        cw_phase_rate rate)
{
    cw_rule_state *s = cw_rule_at(set, rule);
    const cw_rule *r = &s->rule;
    if (!s->used || r->trigger != CW_TRIGGER_ERROR || !(r->error_mask & classes) ||
        (r->rate != CW_RATE_ANY && r->rate != rate) ||
        !cw_rule_names(r->from, cw_node_bit(node)) || s->error_at == cw_rules_now(set))
        return;
    s->error_at = cw_rules_now(set);
    if (!cw_rule_begins(set, rule, cw_rules_now(set), cw_rules_now(set)))
        return;
    if (!cw_rule_is(s, CW_RANDOM_BITS))
        cw_rule_report_hit(set, rule, cw_rules_now(set));
    cw_rule_act_later(set, rule, cw_rules_now(set));
}

/* The event lies in the ring, which moves when a fault is reported: read it before. */
void cw_rules_error_now(cw_rule_set *set, unsigned node, const cw_event *event)
{
    const uint32_t classes = error_class(event);
    const bool fast = event->kind == CW_EVENT_ERROR && event->fast;
    if (event->kind == CW_EVENT_STATE && set->off)
        cw_rules_rewire(set); /* a node that leaves bus-off is not yet back on the bus */
    for (unsigned rule = 0; set->error_rules && rule < set->count; rule++)
        match_error(set, rule, node, classes, fast ? CW_RATE_DATA : CW_RATE_NOMINAL);
}
