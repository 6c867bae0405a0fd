/* SPDX-License-Identifier: MIT
 *
 * bitpart.h - what belongs to a bit, for traces: the part of a frame that it is, hits of rules.
 */
#ifndef CANWIRE_RECORD_BITPART_H
#define CANWIRE_RECORD_BITPART_H

#include "canwire.h"

#define BIT_PART_TEXT_MAX 24 /* bytes of a printed part with its final 0 */

/* The same for all bits of a part. Each byte of data is a part. */
typedef struct bit_part {
    cw_field field; /* CW_FIELD_NONE where phase alone says it, as in idle */
    cw_mac_phase phase;
    unsigned byte; /* of CW_FIELD_DATA */
} bit_part;

/* Of node `node` in a bit. While others still send their flags there is no delimiter yet: that is
 * told by what the node sampled. */
bit_part bit_part_of(const cw_bit_view *bit, unsigned node);

bool bit_part_same(const bit_part *a, const bit_part *b);

/* The name of the field as in events and fault rules, data with its byte ("crc", "data[2]"); else
 * "idle", "integrating", "off", "bus-off", "recovering", "error-wait", "overload-wait". */
void bit_part_print(char out[BIT_PART_TEXT_MAX], const bit_part *part);

/* When a hit of a rule takes place: in the bit that ends at the event's tick, else from that tick
 * on. */
bool bit_has_hit(const cw_rule *rule);

#endif
