/* SPDX-License-Identifier: MIT
 *
 * open.h - opens a port by its name.
 */
#ifndef CANWIRE_PORT_OPEN_H
#define CANWIRE_PORT_OPEN_H

#include "port/port.h"

/* Whether a port of that name can be opened but for its own fault: of an interface, whether
 * there is one, of whatever kind; also when that cannot be told. */
bool port_exists(const char *name);

/* Opens a port by its name (portname.h): a vcan or vxcan interface for a bus, which has it alone
 * among all canwired, or a Unix socket in place of one, whose messages are struct can_frame.
 * NULL after writing why, with the remedy, to error. */
port *port_open(const char *name, const char *bus, char error[PORT_ERROR_TEXT_MAX]);

#endif
