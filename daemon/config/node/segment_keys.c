/* SPDX-License-Identifier: MIT
 *
 * segment_keys.c - the keys of the segments of a bit, the same for each phase but for a prefix.
 */
#include "config/parts.h"

#include <stdio.h>

#define NAME_MAX_BYTES 24u

/* They are needed together. */
static const char *const names[] = {"brp", "prop-seg", "phase-seg1", "phase-seg2"};
#define NAMES (sizeof names / sizeof names[0])

/* Finds a key of a phase: its name with the prefix of that in front. */
static yaml_node_t *segment_keys_find_key(schema *self, const yaml_node_t *map, const char *prefix,
                                          const char *name)
{
    char full[NAME_MAX_BYTES];

    (void)snprintf(full, sizeof full, "%s%s", prefix, name);
    return schema_find(self, map, full);
}

/* Returns true when any key is there, so that the others must be, too. */
static bool has_segments(schema *self, const yaml_node_t *map, const char *prefix)
{
    bool any = false;

    for (size_t i = 0; i < NAMES; i++)
        any = any || segment_keys_find_key(self, map, prefix, names[i]);
    return any;
}

void cfg_check_together(schema *self, const yaml_node_t *map, const char *prefix)
{
    const yaml_node_t *point = segment_keys_find_key(self, map, prefix, "sample-point");

    if (!has_segments(self, map, prefix))
        return;
    for (size_t i = 0; i < NAMES; i++)
        if (!segment_keys_find_key(self, map, prefix, names[i])) {
            schema_complain(self, map, "%s%s is missing: %sbrp, %sprop-seg, %sphase-seg1 and "
                            "%sphase-seg2 are needed together", prefix, names[i], prefix, prefix,
                            prefix, prefix);
            return;
        }
    if (point)
        schema_complain(self, point,
                        "%ssample-point: the segments say where it is; use one or the other",
                        prefix);
}

bool cfg_gives_segments(schema *self, const yaml_node_t *item, const char *prefix)
{
    const cfg_walk *walk = self->user;

    if (has_segments(self, item, prefix))
        return true;
    return walk->default_map && has_segments(self, walk->default_map, prefix) &&
           !segment_keys_find_key(self, item, prefix, "sample-point");
}
