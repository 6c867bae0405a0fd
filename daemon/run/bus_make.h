/* SPDX-License-Identifier: MIT
 *
 * bus_make.h - makes the bus of a configuration, with room for later rules and settings.
 */
#ifndef CANWIRE_RUN_BUS_MAKE_H
#define CANWIRE_RUN_BUS_MAKE_H

#include "config/config.h"

/* Makes the bus, replies included. The caller frees *memory, also without a bus. Returns NULL
 * without memory. */
cw_bus *bus_make(void **memory, const cfg *config);

/* Takes guests off a new bus, without events. */
void bus_take_guests_off(cw_bus *bus, const cfg *config);

#endif
