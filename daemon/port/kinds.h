/* SPDX-License-Identifier: MIT
 *
 * kinds.h - how each kind of ports is opened; open.c chooses one.
 */
#ifndef CANWIRE_PORT_KINDS_H
#define CANWIRE_PORT_KINDS_H

#include "port/port.h"

/* A raw CAN socket on a vcan or vxcan interface, for a bus of this name. */
port *port_socketcan_open(const char *interface, const char *bus, char error[PORT_ERROR_TEXT_MAX]);

/* A socket at a path, where one ECU at a time connects. */
port *port_unix_open(const char *path, char error[PORT_ERROR_TEXT_MAX]);

/* A connected socket that was inherited; it is the port's from now on. */
port *port_unix_adopt(int fd, char error[PORT_ERROR_TEXT_MAX]);

#endif
