/* SPDX-License-Identifier: MIT
 *
 * simulate.h - what the fuzz targets for configurations do with one that is good.
 */
#ifndef CANWIRE_FUZZ_SIMULATE_H
#define CANWIRE_FUZZ_SIMULATE_H

#include "config/config.h"

/* The bus of a configuration in virtual time, its traffic handed in, as `canwire sim` does it. */
void fuzz_simulate(const cfg *config);

#endif
