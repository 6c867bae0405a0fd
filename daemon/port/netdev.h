/* SPDX-License-Identifier: MIT
 *
 * netdev.h - reads the packet counters of network interfaces from /proc/net/dev.
 *
 * rtnetlink has the same counters, but a request waits for all changes of the network in progress;
 * this file does not wait.
 */
#ifndef CANWIRE_PORT_NETDEV_H
#define CANWIRE_PORT_NETDEV_H

#include <net/if.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct netdev_counters {
    char name[IF_NAMESIZE];
    uint64_t received; /* packets */
    uint64_t sent;
} netdev_counters;

/* Opens the counters of this process's network namespace, to be closed. Returns NULL with errno
 * set. */
FILE *netdev_open(void);

/* Reads the next interface; returns false at the end. */
bool netdev_next(netdev_counters *out, FILE *in);

#endif
