/* SPDX-License-Identifier: MIT
 *
 * sim_endless.h - what never ends, in a run without an end.
 */
#ifndef CANWIRE_CLI_SIM_SIM_ENDLESS_H
#define CANWIRE_CLI_SIM_SIM_ENDLESS_H

#include "config/config.h"

/* Complains about traffic, a rule or a time master that never ends. Does nothing where all ends. */
void sim_endless_tell(const cfg *config);

#endif
