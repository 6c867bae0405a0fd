/* SPDX-License-Identifier: MIT
 *
 * bus_make.h - the bus of a configuration as canwired runs it, with room for what comes later.
 */
#ifndef CANWIRE_RUN_BUS_MAKE_H
#define CANWIRE_RUN_BUS_MAKE_H

#include "config/config.h"

/* Makes the bus, replies included, in memory that the caller frees, also when there is no bus.
 * NULL: no memory. */
cw_bus *bus_make(void **memory, const cfg *config);

#endif
