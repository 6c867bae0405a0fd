/* SPDX-License-Identifier: MIT
 *
 * bitpart.c - describes a bit for traces: its part of the frame, hits of rules.
 */
#include "record/bitpart.h"

#include "base/text/chars.h"

#include <assert.h>

bit_part bit_part_at(const cw_place *place, cw_mac_phase phase, bool sampled)
{
    bit_part part = {.field = place->field, .phase = phase};
    if (bit_part_waits(phase) && sampled == CW_DOMINANT)
        part.field = CW_FIELD_NONE;
    else if (phase == CW_MAC_ERROR_WAIT) /* the first bit of the delimiter */
        part.phase = CW_MAC_ERROR_DELIMITER;
    else if (phase == CW_MAC_OVERLOAD_WAIT)
        part.phase = CW_MAC_OVERLOAD_DELIMITER;
    if (part.field == CW_FIELD_DATA)
        part.byte = place->index / 8u;
    return part;
}

bit_part bit_part_of(const cw_bit_view *bit, unsigned node)
{
    const cw_bit_node *n = &bit->nodes[node];
    return bit_part_at(&n->place, n->phase, bit->sampled >> node & 1u);
}

/* Names a phase that has no field of a frame. Each such phase has a name. */
static const char *phase_name(cw_mac_phase phase)
{
    static const char *const names[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_OFF] = "off",
        [CW_MAC_INTEGRATING] = "integrating",
        [CW_MAC_IDLE] = "idle",
        [CW_MAC_ERROR_WAIT] = "error-wait",
        [CW_MAC_OVERLOAD_WAIT] = "overload-wait",
        [CW_MAC_BUS_OFF] = "bus-off",
        [CW_MAC_RECOVERING] = "recovering",
        [CW_MAC_ASLEEP] = "asleep",
    };
    assert(names[phase]);
    return names[phase];
}

void bit_part_print(char out[BIT_PART_TEXT_MAX], const bit_part *part)
{
    bool phase = part->field == CW_FIELD_NONE;
    char *end = chars_text(out, phase ? phase_name(part->phase) : cw_field_name(part->field));
    if (part->field == CW_FIELD_DATA) {
        *end++ = '[';
        end = chars_decimal(end, part->byte);
        *end++ = ']';
    }
    *end = '\0';
}

bool bit_has_hit(const cw_rule *rule)
{
    return rule->trigger == CW_TRIGGER_FRAME || rule->action == CW_ACTION_NOISE;
}
