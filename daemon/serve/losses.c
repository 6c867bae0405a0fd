/* SPDX-License-Identifier: MIT
 *
 * losses.c - logs losses since the last call, since no loss is silent, and nodes that went bus-off.
 */
#include "serve/losses.h"

#include "base/log.h"
#include "config/portname.h"
#include "engine/reload.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define LINE_BYTES 600
#define REMEDY_BYTES 260

/* The texts by kind of loss; NULL: not logged. */
static const char *const texts[LOSS_KINDS] = {
    [CW_DROP_QUEUE_FULL] = "dropped, queue full",
    [CW_DROP_LISTEN_ONLY] = "dropped, listen-only",
    [CW_DROP_BAD_FRAME] = "dropped, no frame of a kind that the node knows",
    [CW_DROP_LINK_DOWN] = "dropped, link down",
    [CW_DROP_COUNT] = "received, not taken by the port",
    [CW_DROP_COUNT + 1] = "lost in the kernel before they could be read",
    [CW_DROP_COUNT + 2] = "error frames left out",
    [CW_DROP_COUNT + 3] = "messages that are no frames",
    [CW_DROP_COUNT + 4] = "connections refused",
    [CW_DROP_COUNT + 5] = "bus-off",
    [CW_DROP_COUNT + 6] = "restarts",
    [CW_DROP_COUNT + 7] = "sent without loopback (cangen -x) and lost, as on any vcan: use vxcan",
    [CW_DROP_COUNT + 8] = "not taken by single clients of the port",
    [CW_DROP_COUNT + 9] = "packets of the tunnel that have not come, or not yet",
    [CW_DROP_COUNT + 10] = "packets or connections of others than the peer",
    [CW_DROP_COUNT + 11] = "connections ended for new ones, since they had said nothing",
};

static void collect(uint64_t now[LOSS_KINDS], const cw_bus *bus, unsigned node,
                    const port_stats *interface)
{
    cw_node_stats stats;
    if (cw_node_get_stats(bus, node, &stats) != CW_OK)
        return;
    for (unsigned kind = 0; kind < CW_DROP_COUNT; kind++)
        now[kind] = stats.dropped[kind];
    now[CW_DROP_COUNT] = interface->write_failed;
    now[CW_DROP_COUNT + 1] = interface->kernel_dropped;
    now[CW_DROP_COUNT + 2] = interface->errors_left_out;
    now[CW_DROP_COUNT + 3] = interface->malformed;
    now[CW_DROP_COUNT + 4] = interface->refused;
    now[CW_DROP_COUNT + 5] = stats.bus_off;
    now[CW_DROP_COUNT + 6] = stats.restarts;
    now[CW_DROP_COUNT + 7] = interface->loopless;
    now[CW_DROP_COUNT + 8] = interface->clients_lost;
    now[CW_DROP_COUNT + 9] = interface->missing;
    now[CW_DROP_COUNT + 10] = interface->strangers;
    now[CW_DROP_COUNT + 11] = interface->gave_way;
}

/* Returns "" where the node's program cannot change anything. */
static const char *waiting_remedy(const cfg_node *node)
{
    bool possible = node->port && !portname_is_interface(node->port);
    return possible && node->when_full == CFG_WHEN_FULL_DROP ? ", or waits (when-full: wait)" : "";
}

/* Prints remedies for a full queue, since more room is not the only one; "" for other losses. */
static void print_remedy(char out[REMEDY_BYTES], unsigned kind, const cfg_node *node,
                         const cw_frame *overflowed)
{
    char frame[FRAME_TEXT_MAX];
    out[0] = '\0';
    if (kind != CW_DROP_QUEUE_FULL)
        return;
    text_print_frame(frame, overflowed);
    frame[strcspn(frame, "#")] = '\0';
    (void)snprintf(out, REMEDY_BYTES,
                   " (the last one %.8s): give it more room than queue: %u, or its "
                   "program writes in smaller bursts (ISO-TP: STmin or a block size)%s",
                   frame, node->queue, waiting_remedy(node));
}

static void log_node(uint64_t logged[LOSS_KINDS], const uint64_t now[LOSS_KINDS],
                     const cfg_node *node, const cw_frame *overflowed)
{
    char line[LINE_BYTES] = "";
    size_t used = 0;
    for (unsigned kind = 0; kind < LOSS_KINDS; kind++) {
        uint64_t added = now[kind] - logged[kind];
        logged[kind] = now[kind];
        if (added == 0 || !texts[kind] || used >= LINE_BYTES)
            continue;
        char remedy[REMEDY_BYTES];
        print_remedy(remedy, kind, node, overflowed);
        int length = snprintf(line + used, LINE_BYTES - used, "%s%" PRIu64 " %s%s",
                              used ? "; " : "", added, texts[kind], remedy);
        used += length > 0 ? (size_t)length : 0;
    }
    if (used > 0)
        log_node_warning(node->name, "%s", line);
}

void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX])
{
    reload_remap(l->logged, sizeof l->logged[0], from);
}

void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond)
{
    for (unsigned i = 0; i < config->node_count; i++) {
        uint64_t now[LOSS_KINDS] = {0};
        collect(now, bus, i, &beyond->nodes[i].interface);
        log_node(l->logged[i], now, &config->nodes[i], &beyond->nodes[i].overflowed);
    }
}
