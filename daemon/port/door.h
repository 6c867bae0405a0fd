/* SPDX-License-Identifier: MIT
 *
 * door.h - a socket at which programs ask for a node of their own, by the protocol of messages.h.
 *
 * It is a port without a node: port_fd() is readable when somebody comes, and port_read() reads the
 * hello, but no frame.
 */
#ifndef CANWIRE_PORT_DOOR_H
#define CANWIRE_PORT_DOOR_H

#include "port/port.h"

/* Opens a door, whose name is unix:PATH. Returns NULL after writing the reason. */
port *door_open(const char *name, char error[PORT_ERROR_TEXT_MAX]);

/* Returns the name that the first of those who wait has said, maybe ""; NULL: nobody waits. */
const char *door_next(const port *door);

/* Makes a port for the first of those who wait, and for nobody else. Its clients are over when it
 * has gone: port_is_over(). Returns NULL without memory or descriptors; it still waits. */
port *door_admit(port *door);

/* Answers the hello of the client of such a port, when its node is ready. */
void door_welcome(port *admitted);

/* Turns the first of those who wait away; code: an errno. */
void door_refuse(port *door, int code, const char *text);

#endif
