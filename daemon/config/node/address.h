/* SPDX-License-Identifier: MIT
 *
 * address.h - the address of a port in a network: HOST:PORT.
 */
#ifndef CANWIRE_CONFIG_ADDRESS_H
#define CANWIRE_CONFIG_ADDRESS_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

#define ADDRESS_HOST_BYTES INET6_ADDRSTRLEN
#define ADDRESS_BYTES (ADDRESS_HOST_BYTES + 16u) /* of a whole text */

#define ADDRESS_WHY_BYTES 240u /* for a message about the name of a port */

typedef struct net_address {
    char host[ADDRESS_HOST_BYTES]; /* in numbers, without brackets */
    unsigned number;               /* of the port, 1 to 65535 */
} net_address;

/* Reads HOST:PORT, HOST or PORT. HOST is an IPv4 address, an IPv6 address in brackets, or
 * localhost; without it the address is 127.0.0.1. A missing PORT is `number`. */
bool address_parse(net_address *out, const char *text, size_t length, unsigned number);

/* Returns what is expected in place of the wrong part of an address that cannot be read. */
const char *address_expected(const char *text, size_t length);

/* Returns "broadcast" or "multicast" for an address of many, of which no program has one end; NULL
 * for others. The broadcast addresses of its networks are known to the machine alone. */
const char *address_of_many(const net_address *address);

/* Returns true for the address of a socket that stands for all addresses of the machine. */
bool address_of_all(const net_address *address);

/* Prints HOST:PORT, so that equal addresses have equal texts. */
void address_print(char out[ADDRESS_BYTES], const net_address *address);

/* Makes an address of sockets. Returns its size. */
socklen_t address_for_socket(struct sockaddr_storage *out, const net_address *address);

#endif
