/* SPDX-License-Identifier: MIT
 *
 * find.c - buses and nodes by number, and the error when there is none.
 */
#include "embed/embed.h"

#include <stdlib.h>

/* ---- Errors ---------------------------------------------------------------------------------- */

int embed_fail(canwire_sim *sim, int status, const char *format, ...)
{
    va_list args;
    free(sim->message);
    va_start(args, format);
    if (vasprintf(&sim->message, format, args) < 0)
        sim->message = NULL;
    va_end(args);
    return status;
}

const char *canwire_sim_message(const canwire_sim *sim)
{
    return sim->message ? sim->message : "";
}

/* ---- Numbers and names ----------------------------------------------------------------------- */

embed_bus *embed_find_bus(canwire_sim *sim, int bus)
{
    if (bus >= 0 && (size_t)bus < sim->count)
        return &sim->buses[bus];
    (void)embed_fail(sim, CANWIRE_SIM_INVALID, "there is no bus number %d", bus);
    return NULL;
}

/* Returns the bus of a node, or NULL. */
static embed_bus *bus_with(const canwire_sim *sim, int node)
{
    for (size_t i = 0; i < sim->count; i++) {
        embed_bus *b = &sim->buses[i];
        if (node >= b->first_node && node < b->first_node + (int)b->config->node_count)
            return b;
    }
    return NULL;
}

embed_bus *embed_find_node(canwire_sim *sim, unsigned *number, int node)
{
    embed_bus *b = bus_with(sim, node);
    if (b)
        *number = (unsigned)(node - b->first_node);
    else
        (void)embed_fail(sim, CANWIRE_SIM_INVALID, "there is no node number %d", node);
    return b;
}

bool embed_is_meant(const embed_bus *b, unsigned node, int number)
{
    return number == CANWIRE_SIM_ANY_NODE || number == b->first_node + (int)node;
}

int canwire_sim_bus_count(const canwire_sim *sim)
{
    return (int)sim->count;
}

int canwire_sim_node_count(const canwire_sim *sim)
{
    const embed_bus *last = &sim->buses[sim->count - 1];
    return last->first_node + (int)last->config->node_count;
}

const char *canwire_sim_bus_name(const canwire_sim *sim, int bus)
{
    const bool there = bus >= 0 && (size_t)bus < sim->count;
    return there ? sim->buses[bus].config->bus_name : NULL;
}

const char *canwire_sim_node_name(const canwire_sim *sim, int node)
{
    const embed_bus *b = bus_with(sim, node);
    return b ? b->config->nodes[node - b->first_node].name : NULL;
}

int canwire_sim_bus_of_node(const canwire_sim *sim, int node)
{
    const embed_bus *b = bus_with(sim, node);
    return b ? (int)b->index : -1;
}

/* Returns CANWIRE_SIM_INVALID for a number without a bus. */
int canwire_sim_get_bus(const canwire_sim *sim, int bus, canwire_sim_bus *out)
{
    if (bus < 0 || (size_t)bus >= sim->count)
        return CANWIRE_SIM_INVALID;
    const embed_bus *b = &sim->buses[bus];
    *out = (canwire_sim_bus){.seed = b->config->seed,
                             .bitrate = b->config->bitrate_bps,
                             .dbitrate = b->config->dbitrate_bps,
                             .nodes = (int32_t)b->config->node_count,
                             .first_node = b->first_node,
                             .fd = cfg_has_fd(b->config),
                             .rules = (int32_t)b->config->rule_count};
    return CANWIRE_SIM_OK;
}
