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
        return e->state == CW_STATE_BUS_OFF ? 0x040 : 0x004;
    case CW_EVENT_RESTART:
        return 0x100;
    case CW_EVENT_FAULT:
    case CW_EVENT_LINK:
    case CW_EVENT_DROP:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_RX:
    case CW_EVENT_TX:
    case CW_EVENT_SKIP:
    case CW_EVENT_COUNT:
        break;
    }
    return 0;
}

/* One rule and errors of these classes. The same error at several nodes is one match. */
static void match_error(cw_bus *bus, unsigned rule, unsigned node, uint32_t classes)
{
    cw_rule_state *s = cw_rule_at(bus, rule);
    const cw_rule *r = &s->rule;
    if (!s->used || r->trigger != CW_TRIGGER_ERROR || !(r->error_mask & classes) ||
        !cw_rule_names(r->from, cw_node_bit(node)) || s->error_at == cw_now(bus))
        return;
    s->error_at = cw_now(bus);
    if (!cw_rule_begins(bus, rule, cw_now(bus), cw_now(bus)))
        return;
    if (!cw_rule_is(s, CW_RANDOM_BITS))
        cw_push_fault(bus, rule, cw_now(bus));
    cw_rule_act_later(bus, rule, cw_now(bus));
}

/* The event lies in the ring, which moves when a fault is told: look at it before. */
void cw_rules_error_now(cw_bus *bus, unsigned node, const cw_event *event)
{
    uint32_t classes = error_class(event);
    if (event->kind == CW_EVENT_STATE && bus->rules.off)
        cw_rules_apply_topology(bus); /* out of bus-off is not back on the bus */
    for (unsigned rule = 0; bus->rules.error_rules && rule < bus->rules.count; rule++)
        match_error(bus, rule, node, classes);
}
