/* SPDX-License-Identifier: MIT
 *
 * simulate.h - what the fuzz targets for configurations do with one that is good.
 */
#ifndef CANWIRE_FUZZ_SIMULATE_H
#define CANWIRE_FUZZ_SIMULATE_H

#include "config/config.h"

/* Runs the bus of a configuration in virtual time with its traffic, as `canwire sim` does. */
void fuzz_simulate(const cfg *config);

#endif
