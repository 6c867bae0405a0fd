/* SPDX-License-Identifier: MIT
 *
 * valid.c - checks that a rule makes sense.
 */
#include "rule/private.h"

#include <string.h>

/* Returns true when the bus has all of these nodes. */
static bool nodes_exist(const cw_rule_set *set, uint64_t nodes)
{
    return set->bus.node_count == CW_NODES_MAX || nodes >> set->bus.node_count == 0;
}

/* Returns false for values that have no meaning at all. */
static bool kinds_exist(const cw_rule_set *set, const cw_rule *r)
{
    return (unsigned)r->trigger <= CW_TRIGGER_ERROR && (unsigned)r->action < CW_ACTION_COUNT &&
           (unsigned)r->field < CW_FIELD_COUNT &&
           (unsigned)r->rate <= CW_RATE_DATA && (unsigned)r->line <= CW_LINE_RX &&
           (unsigned)r->side <= CW_SIDE_RX && r->filter_count <= CW_RULE_FILTERS_MAX &&
           r->data_length <= (set->bus.fd ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX) && r->name;
}

/* Returns whether the rule has what its moment needs: a frame, a position in it. A pulse that waits
 * for no frame has no position. */
static bool moment_known(const cw_rule *r, unsigned traits)
{
    const bool pulse = r->action == CW_ACTION_PULSE;
    const bool none = pulse && r->trigger != CW_TRIGGER_FRAME;
    bool position = none || (r->field != CW_FIELD_NONE &&
                             (pulse || r->bits >= 1 || r->for_ticks > 0));
    return (!(traits & CW_NEEDS_FRAME) || r->trigger == CW_TRIGGER_FRAME) &&
           (!(traits & CW_IN_MAKING) || r->side == CW_SIDE_TX) &&
           (!(traits & CW_HAS_POSITION) || position);
}

/* Reads a number of the rule, of two or four bytes, as its row says. */
static uint32_t valid_read_number(const cw_rule *r, const cw_action_range *range)
{
    const unsigned char *at = (const unsigned char *)r + range->offset;
    uint32_t number = 0;
    uint16_t half = 0;
    if (range->bytes == sizeof number)
        memcpy(&number, at, sizeof number);
    else
        memcpy(&half, at, sizeof half);
    return range->bytes == sizeof number ? number : half;
}

/* CW_KEEP, where it is allowed, leaves the value as it is. */
static bool is_in_range(const cw_rule *r, const cw_action_range *range)
{
    if (range->bytes == 0)
        return true;
    const uint32_t number = valid_read_number(r, range);
    return (number >= range->least && number <= range->most) ||
           (range->may_keep && number == CW_KEEP);
}

/* Returns true when the node sends the frame that the rule gives it (D17). */
static bool sends_frame(const cw_rule_set *set, const cw_rule *r)
{
    return r->node < set->bus.node_count && cw_mac_knows(set->bus.macs[r->node], &r->frame);
}

/* Checks the numbers of single actions, and the frame that they send. */
static bool numbers_in_range(const cw_rule_set *set, const cw_rule *r, const cw_action_row *does)
{
    for (unsigned i = 0; i < CW_ACTION_RANGES; i++)
        if (!is_in_range(r, &does->ranges[i]))
            return false;
    return !(does->traits & CW_SENDS_FRAME) || sends_frame(set, r);
}

/* Checks the times of actions for parts of bits, and the bursts of noise. */
static bool spans_in_range(const cw_rule_set *set, const cw_rule *r)
{
    const cw_span bit = (cw_span)cw_least(cw_rate_ticks(cw_wire_rate(set->bus.time), 1),
                                          INT32_MAX) * CW_TICK;
    if (r->action == CW_ACTION_PULSE)
        return r->pulse_offset >= 0 && r->pulse_offset / 16 <= bit && r->pulse_length > 0 &&
               r->pulse_length <= INT64_MAX / 4;
    if (r->action == CW_ACTION_NOISE)
        return r->burst_least <= r->burst_most && (r->burst_least || !r->burst_most);
    if (r->action == CW_ACTION_JITTER)
        return r->jitter > 0 && r->jitter <= bit;
    return r->action != CW_ACTION_RAMP || r->for_ticks > 0;
}

/* The rule of `after` may be added later. The nodes know whether settings fit. */
bool cw_rule_valid(const cw_rule_set *set, const cw_rule *r)
{
    return kinds_exist(set, r) && moment_known(r, cw_actions[r->action].traits) &&
           numbers_in_range(set, r, &cw_actions[r->action]) && spans_in_range(set, r) &&
           nodes_exist(set, r->from | r->at | r->nodes | r->state_nodes) &&
           r->node < set->bus.node_count && cw_raw_valid(set, r) &&
           (!r->has_after || r->after < set->capacity) &&
           (r->again_ticks == 0 || r->trigger == CW_TRIGGER_TIME);
}

bool cw_rule_keeps_setup(const cw_rule *r)
{
    const uint32_t leaving = CW_SET_CLOCKS | CW_SET_SLEEP | CW_SET_WAKE;
    return !(cw_actions[r->action].traits & (CW_IN_TIME | CW_ON_LINE)) &&
           !(r->action == CW_ACTION_SET && (r->settings.which & leaving));
}
