/* SPDX-License-Identifier: MIT
 *
 * failed_units.h - the units of canwire that have failed, and those that systemd tries again.
 */
#ifndef CANWIRE_CLI_FAILED_UNITS_H
#define CANWIRE_CLI_FAILED_UNITS_H

#include "cli/status/status_check.h"

/* Adds the failed units of the bus `name`, or of all with NULL, each of which is critical. So is
 * one that systemd tries again, since its bus does not run. Without an answer of systemd that is
 * unknown. Nothing is added where systemd does not run, and for buses of another folder than that
 * of the service. */
void check_failed_units(check *c, const char *name);

#endif
