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

/* Counts new dropped frames of the ports of all nodes (port_count_loopless()). vcans: the nodes
 * with vcan ports; others are not counted. Returns false with errno set when the kernel has no
 * counters. */
bool loopless_look(const cfg *config, port *const ports[], uint64_t vcans);

#endif
