/* SPDX-License-Identifier: MIT
 *
 * space.h - positions in frames: those of a pattern, and all faults of a space.
 */
#ifndef CANWIRE_CAMPAIGN_SPACE_H
#define CANWIRE_CAMPAIGN_SPACE_H

#include "campaign/campaign.h"

/* Texts that are added one after the other. */
typedef struct space_list {
    arena *memory;
    const char **texts;
    uint64_t count;
    uint64_t room;
    uint64_t pruned;
    bool no_memory;
    bool too_many; /* more than CAMPAIGN_VALUES_MAX; the others are left out */
} space_list;

/* Adds a text, which stays. */
void space_add(space_list *list, const char *text);

/* Adds the positions of a pattern as JSON: a position, `crc[0..14]`, `data[0..7].*`, `crc.*`. With
 * a frame, those that it lacks are counted as pruned. Returns NULL, or what is wrong. */
const char *space_add_positions(space_list *list, const char *pattern, const cw_frame *frame);

/* The faults of a space. */
typedef struct space {
    const char *name; /* of the rules */
    const char *from; /* JSON, or NULL */
    const char *at;   /* JSON, or NULL */
    uint64_t skip;
} space;

/* Adds a value and its rule for each wire bit of a frame. */
void space_add_bits(space_list *values, space_list *rules, const space *s, const cw_frame *frame);

/* Adds those for each pair of bits of a field of a frame; NULL: of the frame. Returns NULL, or what
 * is wrong. */
const char *space_add_pairs(space_list *values, space_list *rules, const space *s,
                            const cw_frame *frame, const char *field);

#endif
