/* SPDX-License-Identifier: MIT
 *
 * clients.c - the programs that share a node's port.
 */
#include "config/parts.h"

#include "config/node/portname.h"
#include "config/values.h"

#include <string.h>

static const schema_range max_range = {1, CFG_CLIENTS_MAX, sizeof(uint8_t)};

static const schema_choice echoes[] = {
    {.name = "at-once", .value = CFG_ECHO_AT_ONCE},
    {.name = "sent", .value = CFG_ECHO_SENT},
    {.name = NULL},
};

static const schema_key max_key = {.name = "clients",
                                   .read = schema_read_uint,
                                   .offset = offsetof(cfg_node, clients.max),
                                   .arg = &max_range};

const schema_key cfg_clients_keys[] = {
    {.name = "max", .read = schema_read_uint, .offset = offsetof(cfg_node, clients.max),
     .arg = &max_range,
     .preset = "16",
     .help = "Clients at the same time, beside a plain ECU."},
    {.name = "echo", .read = schema_read_choice, .offset = offsetof(cfg_node, clients.echo),
     .arg = echoes,
     .preset = "at-once",
     .help = "When the other programs of the port see a frame of one of them: when it is handed "
             "in, or when the bus has sent it."},
    {.name = "beacon", .read = schema_read_bool, .offset = offsetof(cfg_node, clients.beacon),
     .preset = "false",
     .help = "Of a port tcp:PORT with an IPv4 address: it tells the local network of itself, as "
             "socketcand does."},
    {.name = NULL},
};

/* Reads `clients: 8`, short for `clients: { max: 8 }`. */
void cfg_read_clients(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    if (value->type == YAML_SCALAR_NODE)
        schema_read_uint(self, &max_key, value, object);
    else
        schema_map(self, key->name, value, cfg_clients_keys, object);
}

/* A beacon is an IPv4 broadcast. */
static bool can_tell(const char *port)
{
    const portname name = portname_parse(port ? port : "");
    return name.kind == PORTNAME_TCP && !strchr(name.address.host, ':');
}

/* Reads `clients` of a node, whose port must be one that programs share. */
void cfg_read_port_clients(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_node *node = object;

    if (!portname_is_shared(node->port))
        schema_complain(self, value, "%s: only a port unix:PATH or tcp:PORT has clients",
                        key->name);
    cfg_read_clients(self, key, value, object);
    if (node->clients.beacon && !can_tell(node->port))
        schema_complain(self, value, "beacon: only a port tcp:PORT with an IPv4 address has one");
}
