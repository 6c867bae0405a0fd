/* SPDX-License-Identifier: MIT
 *
 * bitpart.h - describes a bit for traces: its part of the frame, hits of rules.
 */
#ifndef CANWIRE_RECORD_BITPART_H
#define CANWIRE_RECORD_BITPART_H

#include "canwire.h"

#define BIT_PART_TEXT_MAX 24 /* bytes of a printed part with its final 0 */

/* The part of a frame, equal for all its bits. Each byte of data is a part. */
typedef struct bit_part {
    cw_field field; /* CW_FIELD_NONE where the phase suffices, as in idle */
    cw_mac_phase phase;
    unsigned byte; /* of CW_FIELD_DATA */
} bit_part;

/* Returns the part of a node in a bit. No delimiter begins while other nodes still send their
 * flags; the sampled level shows that. */
bit_part bit_part_at(const cw_place *place, cw_mac_phase phase, bool sampled);

/* Returns the part of node `node` in a bit. */
bit_part bit_part_of(const cw_bit_view *bit, unsigned node);

/* Returns true for a phase whose part depends on the sampled level. */
static inline bool bit_part_waits(cw_mac_phase phase)
{
    return phase == CW_MAC_ERROR_WAIT || phase == CW_MAC_OVERLOAD_WAIT;
}

static inline bool bit_part_same(const bit_part *a, const bit_part *b)
{
    return a->field == b->field && a->phase == b->phase && a->byte == b->byte;
}

/* Prints the name of the field as in events and fault rules, data with its byte ("crc", "data[2]").
 * Other parts are "idle", "integrating", "off", "bus-off", "recovering", "error-wait",
 * "overload-wait". */
void bit_part_print(char out[BIT_PART_TEXT_MAX], const bit_part *part);

/* Returns true when the rule hits in the bit that ends at the event's tick. Other rules hit from
 * that tick on. */
bool bit_has_hit(const cw_rule *rule);

#endif
