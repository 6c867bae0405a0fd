/* SPDX-License-Identifier: MIT
 *
 * loopless.h - counts frames that nobody receives. A vcan drops frames that a program sends without
 * loopback (CAN_RAW_LOOPBACK 0, cangen -x), and reports no error.
 *
 * A vcan counts each frame as sent, and as received only when it is looped back
 * (drivers/net/can/vcan.c). So the difference is the number of dropped frames. It does not depend
 * on the senders and receivers of the other frames.
 */
#ifndef CANWIRE_PORT_LOOPLESS_H
#define CANWIRE_PORT_LOOPLESS_H

#include "config/config.h"
#include "port/port.h"

#include <net/if.h>
#include <stdio.h>

/* The packet counters of /proc/net/dev. rtnetlink has the same ones, but a request waits for all
 * changes of the network in progress; this file does not wait. */
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

/* Counts new dropped frames of the ports of all nodes (port_count_loopless()). vcans: the nodes
 * with vcan ports; others are not counted. Returns false with errno set when the kernel has no
 * counters. */
bool loopless_look(const cfg *config, port *const ports[], uint64_t vcans);

#endif
