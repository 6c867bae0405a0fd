/* SPDX-License-Identifier: MIT
 *
 * ifmap.h - the CAN interfaces that a preloaded program sees: nodes of buses.
 *
 * `canwire run` puts them into an environment variable, a line for each, with tabs between the
 * fields. These are its names with a comma between them, its MTU, `node` or `guest`, the name of
 * the node, and the path of the socket.
 */
#ifndef CANWIRE_PRELOAD_IFMAP_H
#define CANWIRE_PRELOAD_IFMAP_H

#include <net/if.h>
#include <stdbool.h>
#include <sys/un.h>

#define IFMAP_VARIABLE "CANWIRE_SOCKETCAN"
#define IFMAP_MAX 16
#define IFMAP_NAMES_MAX 3
#define IFMAP_NODE_BYTES 33
#define IFMAP_BASE 900001 /* the index of the first one, beyond those of the kernel */

typedef struct iface {
    int index;
    char names[IFMAP_NAMES_MAX][IF_NAMESIZE]; /* the first one is told to programs */
    int mtu;    /* CANFD_MTU for a node that knows CAN FD, otherwise CAN_MTU */
    bool guest; /* each connection is a node of its own */
    char node[IFMAP_NODE_BYTES];
    char path[sizeof((struct sockaddr_un *)0)->sun_path];
} iface;

/* Reads the environment; the first call counts. */
void ifmap_read(void);

int ifmap_count(void);

/* Returns number i of them, from 0. */
const iface *ifmap_at(int i);

/* Returns the one of that index or name, NULL when there is none. */
const iface *ifmap_of_index(int index);
const iface *ifmap_of_name(const char *name);

/* Returns the number of an interface, from 0. */
int ifmap_number(const iface *in);

#endif
