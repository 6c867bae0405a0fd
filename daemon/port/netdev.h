/* SPDX-License-Identifier: MIT
 *
 * netdev.h - how many packets network interfaces have carried, as /proc/net/dev has it.
 *
 * rtnetlink tells the same, but whoever asks it waits for all that changes the network at the
 * time; this does not.
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

/* The interfaces of this process's network namespace. NULL with errno set; to be closed. */
FILE *netdev_open(void);

/* The next one; false: there are no more. */
bool netdev_next(netdev_counters *out, FILE *in);

#endif
