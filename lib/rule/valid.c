/* SPDX-License-Identifier: MIT
 *
 * valid.c - whether a rule makes sense.
 */
#include "rule/private.h"

#include "mac/confinement.h"

static bool nodes_exist(const cw_bus *bus, uint64_t nodes)
{
    return bus->node_count == CW_NODES_MAX || nodes >> bus->node_count == 0;
}

/* Values that have no meaning at all. */
static bool kinds_exist(const cw_rule *r)
{
    return (unsigned)r->trigger <= CW_TRIGGER_ERROR && (unsigned)r->action < CW_ACTION_COUNT &&
           (unsigned)r->field < CW_FIELD_COUNT && (unsigned)r->line <= CW_LINE_RX &&
           (unsigned)r->side <= CW_SIDE_RX && r->filter_count <= CW_RULE_FILTERS_MAX &&
           r->data_length <= 8 && r->name;
}

/* What is needed to know the moment: a frame, a position in it. */
static bool moment_known(const cw_rule *r)
{
    bool needs_frame = cw_is_position_action(r->action) || cw_is_host_action(r->action) ||
                       r->action == CW_ACTION_REPLY || r->action == CW_ACTION_WRONG_CRC;
    bool position = r->field != CW_FIELD_NONE && (r->bits >= 1 || r->for_ticks > 0) &&
                    (r->bits <= CW_PATTERN_MAX || r->action != CW_ACTION_GLITCH);
    return (!needs_frame || r->trigger == CW_TRIGGER_FRAME) &&
           (!cw_is_position_action(r->action) || position);
}

/* Numbers of single actions. */
static bool numbers_in_range(const cw_rule *r)
{
    bool sends = r->action == CW_ACTION_SEND || r->action == CW_ACTION_BABBLE ||
                 r->action == CW_ACTION_REPLY;
    bool counters = (r->tec <= CW_TEC_MAX || r->tec == CW_KEEP) &&
                    (r->rec <= CW_REC_MAX || r->rec == CW_KEEP);
    return (!sends || cw_frame_valid(&r->frame)) &&
           (r->action != CW_ACTION_COUNTERS || counters) &&
           (r->action != CW_ACTION_OVERLOAD || (r->number >= 1 && r->number <= 2)) &&
           (r->action != CW_ACTION_DUPLICATE || r->number <= CW_COPIES_MAX) &&
           (r->action != CW_ACTION_LOAD || r->load_permille <= 1000);
}

static bool settings_fit(const cw_bus *bus, const cw_rule *r)
{
    for (unsigned i = 0; r->action == CW_ACTION_SET && i < bus->node_count; i++)
        if ((r->nodes & cw_node_bit(i)) && !cw_settings_valid(&bus->nodes[i], &r->settings))
            return false;
    return true;
}

/* The rule that it comes after may be added later. */
bool cw_rule_valid(const cw_bus *bus, const cw_rule *r)
{
    return kinds_exist(r) && moment_known(r) && numbers_in_range(r) &&
           nodes_exist(bus, r->from | r->at | r->nodes | r->state_nodes) &&
           r->node < bus->node_count && settings_fit(bus, r) &&
           (!r->has_after || r->after < bus->faults.capacity);
}
