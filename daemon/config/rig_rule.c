/* SPDX-License-Identifier: MIT
 *
 * rig_rule.c - which rule of a gateway decides about a frame.
 */
#include "config/rig.h"

const rig_rule *rig_find_rule(const rig_gateway *gateway, unsigned end, const cw_frame *frame)
{
    for (size_t i = 0; i < gateway->rule_count; i++) {
        const rig_rule *rule = &gateway->rules[i];
        if (rule->direction >> end & 1u &&
            cw_frame_matches(frame, rule->filters, rule->filter_count))
            return rule;
    }
    return NULL;
}
