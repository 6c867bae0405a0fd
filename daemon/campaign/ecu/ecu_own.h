/* SPDX-License-Identifier: MIT
 *
 * ecu_own.h - what has become of a row whose program is the bus by itself (`bus: own`).
 *
 * Such a program writes a scenario with all that it has done. Its first line is a comment, an
 * object of JSON. `until_ns` is the bus time of its end. `failed` says why it is a crash, and
 * `broken` why the scenario is not all of the run. These texts are "" else.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_OWN_H
#define CANWIRE_CAMPAIGN_ECU_ECU_OWN_H

#include "campaign/ecu/ecu_keeper.h"
#include "campaign/scenario.h"

/* Runs the scenario that a program has written, up to its end. The result then has that end, and
 * what the program tells. Returns NULL when there is none: the result has a verdict and a reason
 * then. */
scenario *ecu_own_replay(const char *file, const char *program, ecu_result *result);

#endif
