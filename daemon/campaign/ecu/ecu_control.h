/* SPDX-License-Identifier: MIT
 *
 * ecu_control.h - asks the canwired of a row at its control socket, without waiting for it.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_CONTROL_H
#define CANWIRE_CAMPAIGN_ECU_ECU_CONTROL_H

#include "base/text/buffer.h"

#include <jansson.h>

/* All zeros but for fd -1 is not connected. */
typedef struct ecu_control {
    int fd; /* -1: not connected, or the other end has gone */
    buffer in;
} ecu_control;

/* Connects to a socket. Returns false with errno. */
bool ecu_control_open(ecu_control *c, const char *path);

/* Sends a request, a line of JSON with its end. Returns false when the other end has gone. */
bool ecu_control_ask(const ecu_control *c, const char *request);

/* Reads what has come. Closes the connection when the other end has gone. */
void ecu_control_read(ecu_control *c);

/* Returns the next whole line as JSON, to be released; NULL: there is none. */
json_t *ecu_control_next(ecu_control *c);

void ecu_control_close(ecu_control *c);

#endif
