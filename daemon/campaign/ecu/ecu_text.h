/* SPDX-License-Identifier: MIT
 *
 * ecu_text.h - the scenario of a row as canwired runs it: with a port for each program.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_TEXT_H
#define CANWIRE_CAMPAIGN_ECU_ECU_TEXT_H

#include "campaign/campaign.h"
#include "base/text/buffer.h"

#include <stdint.h>

/* The differences to the scenario. */
typedef struct ecu_changes {
    const ecu_plan *plan;
    const char *sockets;   /* the folder of all sockets */
    const char *control;   /* path of the control socket, in that folder */
    const char *directory; /* absolute, of relative paths in the scenario */
    uint64_t until_ns;     /* virtual time goes no further; UINT64_MAX: it has no end */
} ecu_changes;

#define ECU_SOCKET_MAX 108 /* bytes of a path of a socket with its final 0 */

/* Writes the path of the port of a program. Programs of the same node share it. */
void ecu_port_path(char out[ECU_SOCKET_MAX], const ecu_changes *changes, size_t program);

/* Puts ports, control socket and absolute paths of files into a text, in its place. A
 * program that is the bus by itself needs only the paths. Returns NULL, or what is wrong, in
 * memory of the arena. */
const char *ecu_text_change(buffer *text, const ecu_changes *changes, arena *memory);

#endif
