/* SPDX-License-Identifier: MIT
 *
 * gateways_text.c - prints the gateways of a rig.
 */
#include "cli/status/gateways_text.h"

#include "base/text/jsonput.h"

#include <inttypes.h>

/* Prints a direction of a gateway; `at` is the node that receives. */
static void print_direction(FILE *out, const json_t *gateway, const char *direction, size_t at)
{
    const json_t *counts = json_object_get(gateway, direction);
    const json_t *rules = json_object_get(counts, "rules");
    const json_t *nodes = json_object_get(gateway, "between");
    intmax_t forwarded = 0;
    intmax_t lost = 0;
    for (size_t i = 0; i < json_array_size(rules); i++) {
        forwarded += get_number(json_array_get(rules, i), "forwarded");
        lost += get_number(json_array_get(rules, i), "lost");
    }
    fprintf(out, "gateway %s: %s to %s: forwarded %jd lost %jd dropped %jd\n",
            get_text(gateway, "name"), json_string_value(json_array_get(nodes, at)),
            json_string_value(json_array_get(nodes, 1 - at)), forwarded, lost,
            get_number(counts, "dropped"));
}

void gateways_print(FILE *out, const json_t *gateways)
{
    for (size_t i = 0; i < json_array_size(gateways); i++) {
        print_direction(out, json_array_get(gateways, i), "forward", 0);
        print_direction(out, json_array_get(gateways, i), "backward", 1);
    }
}
