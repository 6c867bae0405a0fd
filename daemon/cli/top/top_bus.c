/* SPDX-License-Identifier: MIT
 *
 * top_bus.c - a bus as canwire top asks it: one connection, made again when it is lost.
 *
 * The connection stays open, since the bus logs each client that comes.
 */
#include "cli/top/top_bus.h"

#include "base/text/plain.h"

#include <stdio.h>

void top_bus_begin(top_bus *b, const char *name)
{
    *b = (top_bus){.name = name};
    (void)snprintf(b->model.name, sizeof b->model.name, "%s", name);
    plain_make(b->model.name, '?');
}

static void disconnect(top_bus *b)
{
    if (b->connected)
        client_close(&b->connection);
    b->connected = false;
}

void top_bus_end(top_bus *b)
{
    disconnect(b);
}

static bool top_bus_connect_to(top_bus *b)
{
    if (!b->connected)
        b->connected = client_open(&b->connection, b->name);
    return b->connected;
}

bool top_bus_ask(top_bus *b)
{
    json_t *status =
        top_bus_connect_to(b) ? client_ask(&b->connection, client_request("status")) : NULL;
    json_t *faults = status ? client_ask(&b->connection, client_request("faults")) : NULL;
    if (faults)
        top_model_take(&b->model, json_object_get(status, "status"),
                       json_object_get(faults, "faults"));
    else
        disconnect(b);
    json_decref(status);
    json_decref(faults);
    return faults != NULL;
}

bool top_bus_send(top_bus *b, json_t *request)
{
    if (!top_bus_connect_to(b)) {
        json_decref(request);
        return false;
    }
    json_t *reply = client_ask(&b->connection, request);
    if (!reply)
        disconnect(b); /* or the next answer would be the late one */
    json_decref(reply);
    return reply != NULL;
}
