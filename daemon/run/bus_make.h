/* SPDX-License-Identifier: MIT
 *
 * bus_make.h - makes the bus of a configuration, with room for later rules and settings.
 */
#ifndef CANWIRE_RUN_BUS_MAKE_H
#define CANWIRE_RUN_BUS_MAKE_H

#include "config/config.h"

/* Makes the bus, replies included. The caller frees *memory, also without a bus. Returns NULL with
 * errno: ENOMEM without memory, EINVAL when the library does not take the configuration. */
cw_bus *bus_make(void **memory, const cfg *config);

/* Makes a bus in memory that malloc() has given for its size, or has not. Returns NULL with errno,
 * as above. */
cw_bus *bus_init(void *memory, const cw_bus_config *config);

/* Returns why there is no bus, by errno. It is "out of memory" for ENOMEM alone. */
const char *bus_why_not(void);

/* Takes guests off a new bus, without events. */
void bus_take_guests_off(cw_bus *bus, const cfg *config);

#endif
