/* SPDX-License-Identifier: MIT
 *
 * open.h - opens a port by its name.
 */
#ifndef CANWIRE_PORT_OPEN_H
#define CANWIRE_PORT_OPEN_H

#include "port/port.h"

/* Returns true unless the interface of that name is missing, so that opening fails only for its own
 * reasons. It also returns true when this is unknown. */
bool port_exists(const char *name);

/* Opens a port by its name (portname.h): a vcan or vxcan interface, exclusively for this bus, or a
 * Unix socket. Messages of the socket are struct can_frame. Returns NULL after writing the reason,
 * with the remedy, to error. */
port *port_open(const char *name, const char *bus, char error[PORT_ERROR_TEXT_MAX]);

#endif
