/* SPDX-License-Identifier: MIT
 *
 * open.c - opens a port by its name: the one place that knows all kinds.
 */
#include "port/open.h"

#include "config/node/portname.h"
#include "port/door.h"
#include "port/kinds.h"

#include <errno.h>
#include <net/if.h>
#include <stdio.h>

bool port_exists(const char *name)
{
    return !portname_is_interface(name) || if_nametoindex(name) != 0 || errno != ENODEV;
}

port *door_open(const char *name, char error[PORT_ERROR_TEXT_MAX])
{
    return port_unix_open_door(portname_parse(name).path, error);
}

port *port_open(const char *text, const char *bus, char error[PORT_ERROR_TEXT_MAX])
{
    const portname name = portname_parse(text);
    switch (name.kind) {
    case PORTNAME_INTERFACE:
        return port_socketcan_open(text, bus, error);
    case PORTNAME_UNIX:
        return port_unix_open(name.path, error);
    case PORTNAME_USB:
        return port_unix_open_usb(name.path, error);
    case PORTNAME_FD:
        return port_unix_adopt(name.fd, error);
    case PORTNAME_TCP:
        return port_tcp_open(&name, text, error);
    case PORTNAME_TUNNEL:
        return port_tunnel_open(text, error);
    case PORTNAME_INVALID:
        break;
    }
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: expected %s", text, PORTNAME_EXPECTED);
    return NULL;
}
