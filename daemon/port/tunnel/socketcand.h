/* SPDX-License-Identifier: MIT
 *
 * socketcand.h - a program at a port that speaks the protocol of socketcand over TCP, see
 * canwire-ports(7).
 */
#ifndef CANWIRE_PORT_SOCKETCAND_H
#define CANWIRE_PORT_SOCKETCAND_H

#include "port/member.h"

extern const member_kind member_socketcand;

/* Returns the name of the bus that a program has asked for by `open`, "" before. */
const char *socketcand_bus(const member *c);

#endif
