/* SPDX-License-Identifier: MIT
 *
 * listen.h - a socket that listens at an address of TCP.
 */
#ifndef CANWIRE_PORT_LISTEN_H
#define CANWIRE_PORT_LISTEN_H

#include "config/node/address.h"

/* Returns a socket that listens and does not block; -1 with errno. An address that was in use a
 * moment ago is free: connections that have ended do not count. The caller owns the socket. */
int port_listen_at(const net_address *at);

#endif
