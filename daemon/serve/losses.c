/* SPDX-License-Identifier: MIT
 *
 * losses.c - logs losses since the last call, since no loss is silent, and nodes that went bus-off.
 */
#include "serve/losses.h"

#include "base/text/chars.h"
#include "base/text/jsonput.h"
#include "base/log.h"
#include "config/node/portname.h"
#include "engine/reload.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define LINE_BYTES 600
#define REMEDY_BYTES 260

/* A frame on its way onto the bus was "dropped, bus-off". */
#define DROP(reason, text)                                                                         \
    [reason] = "dropped, " text, [LOSS_RECEIVED + (reason)] = "received and dropped, " text

static const char *const texts[LOSS_KINDS] = {
    DROP(CW_DROP_QUEUE_FULL, "queue full"),
    DROP(CW_DROP_ONE_SHOT, "one-shot"),
    DROP(CW_DROP_BUS_OFF, "bus-off"),
    DROP(CW_DROP_LISTEN_ONLY, "listen-only"),
    DROP(CW_DROP_BAD_FRAME, "no frame of a kind that the node knows"),
    DROP(CW_DROP_FAULT, "by a rule"),
    DROP(CW_DROP_REMOVED, "node removed"),
    DROP(CW_DROP_LINK_DOWN, "link down"),
    DROP(CW_DROP_SLOT_MISSED, "slot missed"),
    [LOSS_NOT_TAKEN] = "received, not taken by the port",
    [LOSS_KERNEL] = "lost in the kernel before they could be read",
    [LOSS_ERROR_FRAMES] = "error frames left out",
    [LOSS_MALFORMED] = "messages that are no frames",
    [LOSS_REFUSED] = "connections refused",
    [LOSS_BUS_OFF] = "bus-off",
    [LOSS_RESTARTS] = "restarts",
    [LOSS_LOOPLESS] = "sent without loopback (cangen -x) and lost, as on any vcan: use vxcan",
    [LOSS_CLIENTS] = "not taken by single clients of the port",
    [LOSS_MISSING] = "packets of the tunnel that have not come, or not yet",
    [LOSS_STRANGERS] = "packets or connections of others than the peer",
    [LOSS_GAVE_WAY] = "connections ended for new ones, since they had said nothing",
};

/* Those of a single one, where they differ. */
static const char *const single_texts[LOSS_KINDS] = {
    [LOSS_ERROR_FRAMES] = "error frame left out",
    [LOSS_MALFORMED] = "message that is no frame",
    [LOSS_REFUSED] = "connection refused",
    [LOSS_RESTARTS] = "restart",
    [LOSS_MISSING] = "packet of the tunnel that has not come, or not yet",
    [LOSS_STRANGERS] = "packet or connection of others than the peer",
    [LOSS_GAVE_WAY] = "connection ended for a new one, since it had said nothing",
};

/* Those that nobody has asked for, by a rule or a setting, and that no state explains. */
static const loss_kind unwanted[LOSSES_UNWANTED] = {
    (loss_kind)CW_DROP_QUEUE_FULL, LOSS_RECEIVED + CW_DROP_QUEUE_FULL, LOSS_NOT_TAKEN, LOSS_KERNEL};

const char *losses_text(loss_kind kind, uint64_t count)
{
    return count == 1 && single_texts[kind] ? single_texts[kind] : texts[kind];
}

/* Collects the counters of a node that stand for something lost, by the kinds of losses. */
static void collect(uint64_t now[LOSS_KINDS], const cw_bus *bus, unsigned node,
                    const port_stats *interface)
{
    cw_node_stats stats;
    if (cw_node_get_stats(bus, node, &stats) != CW_OK)
        return;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++) {
        now[why] = stats.dropped[why];
        now[LOSS_RECEIVED + why] = stats.rx_dropped[why];
    }
    now[LOSS_NOT_TAKEN] = interface->write_failed;
    now[LOSS_KERNEL] = interface->kernel_dropped;
    now[LOSS_ERROR_FRAMES] = interface->errors_left_out;
    now[LOSS_MALFORMED] = interface->malformed;
    now[LOSS_REFUSED] = interface->refused;
    now[LOSS_BUS_OFF] = stats.bus_off;
    now[LOSS_RESTARTS] = stats.restarts;
    now[LOSS_LOOPLESS] = interface->loopless;
    now[LOSS_CLIENTS] = interface->clients_lost;
    now[LOSS_MISSING] = interface->missing;
    now[LOSS_STRANGERS] = interface->strangers;
    now[LOSS_GAVE_WAY] = interface->gave_way;
}

/* Returns "" where the node's program cannot change anything. */
static const char *waiting_remedy(const cfg_node *node)
{
    bool possible = node->port && !portname_is_interface(node->port);
    return possible && node->when_full == CFG_WHEN_FULL_DROP ? ", or waits (when-full: wait)" : "";
}

/* Prints remedies for a full queue, since more room is not the only one. A node with traffic of its
 * own has no program. */
static void print_queue_remedy(char out[REMEDY_BYTES], const cfg_node *node,
                               const cw_frame *overflowed)
{
    char frame[FRAME_TEXT_MAX];
    text_print_frame(frame, overflowed);
    frame[strcspn(frame, "#")] = '\0';
    if (node->traffic_count > 0)
        (void)snprintf(out, REMEDY_BYTES,
                       " (the last one %.8s): queue: more than %u, offsets or less traffic", frame,
                       node->queue);
    else
        (void)snprintf(out, REMEDY_BYTES,
                       " (the last one %.8s): give it more room than queue: %u, or its "
                       "program writes in smaller bursts (ISO-TP: STmin or a block size)%s",
                       frame, node->queue, waiting_remedy(node));
}

/* Prints what would prevent such losses; "" when it is not known. */
static void print_remedy(char out[REMEDY_BYTES], unsigned kind, const cfg_node *node,
                         const report_node *beyond)
{
    const bool interface = node->port && portname_is_interface(node->port);
    out[0] = '\0';
    if (kind == CW_DROP_QUEUE_FULL)
        print_queue_remedy(out, node, &beyond->overflowed);
    else if (kind == LOSS_KERNEL && interface && beyond->port &&
             port_buffer_bytes(beyond->port) < PORT_BUFFER_BYTES)
        (void)snprintf(out, REMEDY_BYTES,
                       " (it has room for %u KiB: sysctl net.core.rmem_max=%d, then restart)",
                       port_buffer_bytes(beyond->port) / 1024u, PORT_BUFFER_BYTES);
}

bool losses_due(losses_node *node, uint64_t kinds)
{
    const bool other = kinds & ~node->kinds;
    node->passed += node->passed <= LOSSES_WAIT_MAX;
    if (kinds == 0 && node->passed > LOSSES_WAIT_MAX) {
        node->kinds = 0;
        node->wait = 0;
    }
    if (kinds == 0 || (!other && node->passed < node->wait))
        return false;
    const unsigned longer = 2 * node->wait < LOSSES_WAIT_MAX ? 2 * node->wait : LOSSES_WAIT_MAX;
    node->wait = other ? 1 : longer;
    node->kinds |= kinds;
    node->passed = 0;
    return true;
}

/* Returns the kinds of losses that have grown since the log has told of them, as a set. */
static uint64_t kinds_added(const uint64_t logged[LOSS_KINDS], const uint64_t now[LOSS_KINDS])
{
    uint64_t kinds = 0;
    for (unsigned kind = 0; kind < LOSS_KINDS; kind++)
        kinds |= (uint64_t)(now[kind] != logged[kind]) << kind;
    return kinds;
}

/* Warns of what a node has lost since the last warning, on one line, with what helps. */
static void log_node(uint64_t logged[LOSS_KINDS], const uint64_t now[LOSS_KINDS],
                     const cfg_node *node, const report_node *beyond, unsigned seconds)
{
    char line[LINE_BYTES] = "";
    size_t used = 0;
    if (seconds > 1)
        used = chars_print(line, sizeof line, 0, "in %u s: ", seconds);
    const size_t begin = used;
    for (unsigned kind = 0; kind < LOSS_KINDS; kind++) {
        uint64_t added = now[kind] - logged[kind];
        logged[kind] = now[kind];
        if (added == 0)
            continue;
        char remedy[REMEDY_BYTES];
        print_remedy(remedy, kind, node, beyond);
        used = chars_print(line, sizeof line, used, "%s%" PRIu64 " %s%s", used > begin ? "; " : "",
                           added, losses_text(kind, added), remedy);
    }
    log_node_warning(node->name, "%s", line);
}

/* Counts the seconds down for which something is reported, from the last time on. */
static void count_lately(unsigned *lately, uint64_t *seen, uint64_t now)
{
    *lately = now > *seen ? LOSSES_LATELY_S : *lately - (*lately > 0);
    *seen = now;
}

void losses_note(losses_node *node, const uint64_t now[LOSS_KINDS])
{
    for (size_t n = 0; n < LOSSES_UNWANTED; n++)
        count_lately(&node->lately[n], &node->seen[n], now[unwanted[n]]);
}

/* Puts a loss of the last minutes, for monitoring. node NULL: it is one of the bus. */
static void put_one_lately(json_t *all, const char *node, const char *what)
{
    json_t *one = json_object();
    put_text(one, "node", node);
    put_text(one, "what", what);
    put_last(all, one);
}

void losses_put_lately(const losses *l, const cfg *config, json_t *status)
{
    json_t *all = json_array();
    if (l->skipped_lately > 0)
        put_one_lately(all, NULL, "fell behind real time and has skipped some");
    for (unsigned i = 0; i < config->node_count; i++)
        for (size_t n = 0; n < LOSSES_UNWANTED; n++)
            if (l->nodes[i].lately[n] > 0)
                put_one_lately(all, config->nodes[i].name, losses_text(unwanted[n], 2));
    put(status, "lately", all);
}

_Static_assert(sizeof(losses_node) <= RELOAD_REMAP_BYTES_MAX, "a reload moves it");

void losses_remap(losses *l, const uint8_t from[CW_NODES_MAX])
{
    reload_remap(l->nodes, sizeof l->nodes[0], from);
}

void losses_log(losses *l, const cfg *config, const cw_bus *bus, const report *beyond, bool last)
{
    count_lately(&l->skipped_lately, &l->skipped_ns, beyond->skipped_ns);
    for (unsigned i = 0; i < config->node_count; i++) {
        uint64_t now[LOSS_KINDS] = {0};
        losses_node *node = &l->nodes[i];
        collect(now, bus, i, &beyond->nodes[i].interface);
        losses_note(node, now);
        const uint64_t kinds = kinds_added(node->logged, now);
        const unsigned seconds = node->wait > 0 ? node->passed + 1 : 0;
        if (losses_due(node, kinds) || (last && kinds))
            log_node(node->logged, now, &config->nodes[i], &beyond->nodes[i], seconds);
    }
}
