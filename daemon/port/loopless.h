/* SPDX-License-Identifier: MIT
 *
 * loopless.h - finds frames that never come: a vcan gives what a program sends without loopback
 * (CAN_RAW_LOOPBACK 0, cangen -x) to nobody, and no error to the program.
 *
 * A vcan counts each frame that it is given as sent, and as received only when it is looped back
 * (drivers/net/can/vcan.c). So the difference is what nobody has got; whose frames the others are,
 * and what becomes of them, makes no difference.
 */
#ifndef CANWIRE_PORT_LOOPLESS_H
#define CANWIRE_PORT_LOOPLESS_H

#include "config/config.h"
#include "port/port.h"

/* Looks at the interfaces of all nodes and counts for their ports what is new since each was
 * opened (port_count_loopless()). vcans: the nodes whose ports are such; no others are counted.
 * False with errno set when the kernel does not tell. */
bool loopless_look(const cfg *config, port *const ports[], uint64_t vcans);

#endif
