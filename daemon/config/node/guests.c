/* SPDX-License-Identifier: MIT
 *
 * guests.c - nodes that are on the bus while a program is connected.
 */
#include "config/parts.h"

#include "config/change/live.h"
#include "config/values.h"

#include <stdio.h>
#include <string.h>

/* Keeps the map until the nodes are read. */
void cfg_read_guests(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_walk *walk = self->user;

    (void)key;
    (void)object;
    walk->guests = value;
}

/* The nodes of the list have been read, so all nodes of the bus are known. */
void cfg_read_guest_count(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg *config = cfg_of(self);
    const cfg_node *node = object;

    schema_read_uint(self, key, value, object);
    if (config->node_count + node->guest > CW_NODES_MAX)
        schema_complain(self, value, "count: a bus has at most %d nodes, and %zu are in the list",
                        CW_NODES_MAX, config->node_count);
}

/* Returns the own name of a guest, which no other node may have. */
static char *name_guest(schema *self, unsigned number)
{
    char name[CFG_GUEST_NAME_MAX];
    cfg_guest_name(name, number);
    const uint8_t other = cfg_find_node(cfg_of(self), name);
    const cfg_walk *walk = self->user;

    if (other != CW_NO_NODE)
        schema_complain(self, walk->guests, "guests: '%s' is the name of the node in line %d", name,
                        cfg_of(self)->nodes[other].line);
    return schema_copy(self, name);
}

void cfg_add_guest(schema *self, const schema_key *keys)
{
    cfg_walk *walk = self->user;
    cfg *config = cfg_of(self);
    cfg_node *first = &config->nodes[config->node_count];

    if (!walk->guests || config->node_count >= CW_NODES_MAX)
        return;
    *first = walk->defaults;
    first->line = (int)walk->guests->start_mark.line + 1;
    schema_map_in(self, "guests", walk->guests, keys, CFG_IN_GUESTS, first);
    config->guest_count = first->guest;
    first->guest = 1;
    first->name = name_guest(self, 1);
    config->node_count++;
}

void cfg_copy_guests(schema *self)
{
    cfg *config = cfg_of(self);
    if (config->node_count == 0)
        return; /* after errors */
    const cfg_node *first = &config->nodes[config->node_count - 1];
    for (unsigned i = 2; i <= config->guest_count && config->node_count < CW_NODES_MAX; i++) {
        cfg_node *node = &config->nodes[config->node_count];
        *node = *first;
        node->guest = (uint8_t)i;
        node->name = name_guest(self, i);
        config->node_count++;
    }
}
