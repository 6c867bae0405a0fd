/* SPDX-License-Identifier: MIT
 *
 * beacon.h - tells a local network of a port for programs that speak as to socketcand.
 *
 * The beacon is a UDP broadcast to port 42000, as doc/protocol.md of socketcand has it.
 */
#ifndef CANWIRE_PORT_BEACON_H
#define CANWIRE_PORT_BEACON_H

#include <stddef.h>

#define BEACON_BYTES 4096u

typedef struct beacon {
    char buses[BEACON_BYTES];
    size_t bytes;
} beacon;

void beacon_begin(beacon *b);

/* Adds the name of a bus. */
void beacon_add(beacon *b, const char *bus);

/* Sends it from an IPv4 address, or from all of the machine for 0.0.0.0, to the broadcast address
 * of each network. Beacons that get lost come again. */
void beacon_send(const beacon *b, const char *host, unsigned number);

#endif
