/* SPDX-License-Identifier: MIT
 *
 * kinds.h - opens each kind of ports; open.c chooses one.
 */
#ifndef CANWIRE_PORT_KINDS_H
#define CANWIRE_PORT_KINDS_H

#include "config/node/portname.h"
#include "port/port.h"

/* Opens a raw CAN socket on a vcan or vxcan interface, for a bus of this name. */
port *port_socketcan_open(const char *interface, const char *bus, char error[PORT_ERROR_TEXT_MAX]);

/* Opens a socket at a path, where one ECU at a time connects. */
port *port_unix_open(const char *path, char error[PORT_ERROR_TEXT_MAX]);

/* Opens a socket at a path, where clients ask for nodes of their own: a door, see door.h. */
port *port_unix_open_door(const char *path, char error[PORT_ERROR_TEXT_MAX]);

/* Opens a socket at a path, where the controller of the node connects. */
port *port_unix_open_usb(const char *path, char error[PORT_ERROR_TEXT_MAX]);

/* Opens a port on a connected socket that was inherited; the port takes it over. */
port *port_unix_adopt(int fd, char error[PORT_ERROR_TEXT_MAX]);

/* Opens a port at a TCP address, for programs that speak as to socketcand. text: its name. */
port *port_tcp_open(const portname *name, const char *text, char error[PORT_ERROR_TEXT_MAX]);

/* Opens the end of a tunnel to another machine, by its name (tunnelname.h). */
port *port_tunnel_open(const char *text, char error[PORT_ERROR_TEXT_MAX]);

#endif
