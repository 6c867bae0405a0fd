/* SPDX-License-Identifier: MIT
 *
 * top_bus.h - a bus as canwire top asks it: one connection, made again when it is lost.
 */
#ifndef CANWIRE_CLI_TOP_TOP_BUS_H
#define CANWIRE_CLI_TOP_TOP_BUS_H

#include "cli/client.h"
#include "cli/top/top_model.h"

#include <stdbool.h>

typedef struct top_bus {
    const char *name; /* as given by the user */
    client connection;
    bool connected;
    top_model model;
} top_bus;

void top_bus_begin(top_bus *b, const char *name);
void top_bus_end(top_bus *b);

/* Asks for the present numbers. Returns false when the bus does not answer, after a message to the
 * teller of the client. The next call tries again. */
bool top_bus_ask(top_bus *b);

/* Sends a request, which is taken over. Returns true when it was carried out. */
bool top_bus_send(top_bus *b, json_t *request);

#endif
