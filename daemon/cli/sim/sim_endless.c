/* SPDX-License-Identifier: MIT
 *
 * sim_endless.c - what never ends, in a run without an end.
 */
#include "cli/sim/sim_endless.h"

#include "base/plain.h"

#include <stdio.h>

void sim_endless_tell(const cfg *config)
{
    const char *what;
    const cfg_place *place = cfg_find_unending(config, &what);
    if (place)
        plain_print(stderr, "%s:%d:%d: %s never ends: give %s--until TIME or --until-event EVENT\n",
                    config->file, place->line, place->column, what,
                    cfg_find_endless(config) ? "`count`, " : "");
}
