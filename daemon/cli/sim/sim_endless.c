/* SPDX-License-Identifier: MIT
 *
 * sim_endless.c - what never ends, in a run without an end.
 */
#include "cli/sim/sim_endless.h"

#include "base/text/plain.h"

#include <stdio.h>

void sim_endless_tell(const cfg *config)
{
    cfg_unending found;
    if (cfg_find_unending(config, &found))
        plain_print(stderr, "%s:%d:%d: %s never ends: give %s--until TIME or --until-event EVENT\n",
                    found.file, found.place.line, found.place.column, found.what, found.remedy);
}
