/* SPDX-License-Identifier: MIT
 *
 * config.c - functions for the users of a configuration.
 */
#include "config/config.h"

#include <stdio.h>
#include <string.h>

#define BUS_INBOX 4096u  /* frames that are handed in for a later time */
#define BUS_EVENTS 1024u /* the library raises it to its minimum */

uint8_t cfg_find_node(const cfg *config, const char *name)
{
    for (size_t i = 0; *name && i < config->node_count; i++)
        if (strcmp(config->nodes[i].name, name) == 0)
            return (uint8_t)i;
    return CW_NO_NODE;
}

void cfg_guest_name(char out[CFG_GUEST_NAME_MAX], unsigned number)
{
    (void)snprintf(out, CFG_GUEST_NAME_MAX, "guest-%u", number & 0xFFu);
}

const char *cfg_guest_port(const cfg *config)
{
    return config->guest_count > 0 ? config->nodes[config->node_count - 1].port : NULL;
}

static uint8_t find_guest(const cfg *config, unsigned number)
{
    const size_t first = config->node_count - config->guest_count;
    return number <= config->guest_count ? (uint8_t)(first + number - 1) : CW_NO_NODE;
}

/* Guests are the same by number, others by name. A node in the list never goes on as a guest. */
static uint8_t match_node(const cfg_node *node, const cfg *old)
{
    if (node->guest > 0)
        return find_guest(old, node->guest);
    const uint8_t found = cfg_find_node(old, node->name);
    return found != CW_NO_NODE && old->nodes[found].guest > 0 ? CW_NO_NODE : found;
}

void cfg_match_nodes(uint8_t from[CW_NODES_MAX], const cfg *config, const cfg *old)
{
    for (size_t i = 0; i < CW_NODES_MAX; i++)
        from[i] = i < config->node_count ? match_node(&config->nodes[i], old) : CW_NO_NODE;
}

bool cfg_has_clocks(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++) {
        const cw_node_timing *t = &config->nodes[i].time.timing;
        if (t->bit.quantum || t->tx_delay[0] || t->tx_delay[1] || t->rx_delay[0] ||
            t->rx_delay[1] || t->place || t->stub || t->ringing)
            return true;
    }
    return false;
}

bool cfg_knows_fd(const cfg *config, const cfg_node *node)
{
    return node->kind == CFG_KIND_FD ||
           (node->kind == CFG_KIND_BY_BUS && config->dbitrate_bps > 0);
}

const char *cfg_kind_name(const cfg *config, const cfg_node *node)
{
    static const char *const names[] = {
        [CFG_KIND_BY_BUS] = "classical",
        [CFG_KIND_CLASSICAL] = "classical",
        [CFG_KIND_2_0A] = "2.0A",
        [CFG_KIND_2_0B_PASSIVE] = "2.0B-passive",
        [CFG_KIND_FD_TOLERANT] = "fd-tolerant",
        [CFG_KIND_FD] = "fd",
    };

    return cfg_knows_fd(config, node) ? names[CFG_KIND_FD] : names[node->kind];
}

bool cfg_is_old(const cfg_node *node)
{
    return node->kind == CFG_KIND_2_0A || node->kind == CFG_KIND_2_0B_PASSIVE;
}

bool cfg_has_fd(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (cfg_knows_fd(config, &config->nodes[i]))
            return true;
    return false;
}

/* Returns what frames the controller of a node knows, for the library. */
static uint8_t protocol_of(const cfg *config, const cfg_node *node)
{
    static const uint8_t of_kinds[] = {
        [CFG_KIND_BY_BUS] = CW_CLASSICAL,
        [CFG_KIND_CLASSICAL] = CW_CLASSICAL,
        [CFG_KIND_2_0A] = CW_CLASSICAL | CW_PROTOCOL_2_0A,
        [CFG_KIND_2_0B_PASSIVE] = CW_CLASSICAL | CW_PROTOCOL_2_0B_PASSIVE,
        [CFG_KIND_FD_TOLERANT] = CW_FD_TOLERANT,
        [CFG_KIND_FD] = CW_FD,
    };
    const unsigned protocol = cfg_knows_fd(config, node) ? CW_FD : of_kinds[node->kind];

    return (uint8_t)(protocol | (node->no_exception ? CW_PROTOCOL_NO_EXCEPTION : 0) |
                     (config->fd_non_iso ? CW_PROTOCOL_NON_ISO : 0));
}

/* One receive buffer takes the frame on the wire. Only the others hold frames for the host. */
static cw_host_config host_of(const cfg_controller *controller)
{
    const bool stores = controller->receive_buffers > 0 && controller->service_ticks > 0;

    return (cw_host_config){
        .filters = controller->filters,
        .filter_count = controller->filter_count,
        .receive_buffers = stores ? (uint16_t)(controller->receive_buffers - 1) : 0,
        .receive_bytes = (uint16_t)controller->receive_bytes,
        .service_ticks = controller->service_ticks,
        .mailboxes = controller->mailboxes,
        .mailbox_count = controller->mailbox_count,
        .receive_fifo = controller->receive_fifo,
        .transmit = controller->transmit,
        .overload_when_full = controller->overload_when_full,
    };
}

/* The triggers stay those of the configuration: the library copies them. */
static cw_schedule schedule_of(const cfg_schedule *s)
{
    return (cw_schedule){.reference = s->reference, .cycles = s->cycles,
                         .cycle_byte = s->cycle_byte, .trigger_count = s->trigger_count,
                         .triggers = s->triggers};
}

void cfg_bus_config(cw_bus_config *out, cw_node_config *nodes, const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        nodes[i] = (cw_node_config){
            .modes = node->modes,
            .order = node->order,
            .queue = node->queue,
            .warning_limit = node->warning_limit,
            .restart_ticks = node->restart_ms * (uint64_t)(CW_CLOCK_HZ / 1000),
            .protocol = protocol_of(config, node),
            .variants = node->controller.variants,
            .timing = node->time.timing,
            .host = host_of(&node->controller),
            .sleeps = node->sleeps,
            .sleep = node->sleep,
            .local = node->local,
            .schedule = schedule_of(&node->schedule),
        };
        nodes[i].local.unit = cfg_local_unit(node, node->time.ppm);
    }
    *out = (cw_bus_config){
        .bit_ticks = (uint32_t)cw_rate_ticks(config->rate, 1),
        .seed = config->seed,
        .node_count = (uint8_t)config->node_count,
        .inbox = BUS_INBOX,
        .events = BUS_EVENTS,
        .rule_count = (uint16_t)config->rule_count,
        .rule_room = (uint16_t)config->reply_count,
        .marks = cfg_has_clocks(config),
        .start_at_tick = config->start == CFG_START_TICK,
        .nodes = nodes,
        .rules = config->rules,
        .protection_count = config->protection_count,
        .protections = config->protections,
    };
}

cfg_where cfg_place_text(const cfg *config, cfg_place place)
{
    cfg_where where;
    (void)snprintf(where.text, sizeof where.text, "%.230s:%d:%d", config->file,
                   place.line ? place.line : 1, place.column ? place.column : 1);
    return where;
}
