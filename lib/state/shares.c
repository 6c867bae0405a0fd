/* SPDX-License-Identifier: MIT
 *
 * shares.c - statistics that many nodes have in common, each counted once.
 *
 * All nodes that wait count the same for a clean frame, and so do all listeners. So each of the two
 * groups is counted once. A node gets its share when its statistics are read, or when it leaves the
 * group.
 */
#include "state/state.h"

#include "format/bitset.h"

#include <assert.h>

/* Returns the attempts that a node has lost since its last share. */
static uint64_t lost_share(const cw_bus *bus, unsigned i)
{
    bool takes_part = bus->shares.contenders >> i & 1u;
    return takes_part ? bus->shares.lost - bus->nodes[i].lost_before : 0;
}

/* The first attempt of a frame is not a retransmission. */
static uint64_t retransmissions(const cw_bus *bus, unsigned i, uint64_t attempts)
{
    const cw_queue *q = &bus->nodes[i].queue;
    return attempts && !cw_queue_at(q, cw_queue_first(q))->tried ? attempts - 1 : attempts;
}

/* Adds the frames that all listeners have received. A node subtracted them when it began to listen,
 * so its own share is left. The counters may wrap below 0 and back. */
static void add_received(const cw_shares *c, cw_node_stats *stats)
{
    stats->rx_accepted += c->rx_frames;
    stats->rx_frames += c->rx_frames;
    stats->rx_bytes += c->rx_bytes;
}

/* Does the reverse, when a node begins to listen. */
static void subtract_received(const cw_shares *c, cw_node_stats *stats)
{
    stats->rx_accepted -= c->rx_frames;
    stats->rx_frames -= c->rx_frames;
    stats->rx_bytes -= c->rx_bytes;
}

void cw_share_stats(const cw_bus *bus, unsigned i, cw_node_stats *stats)
{
    uint64_t lost = lost_share(bus, i);
    stats->arbitration_lost += lost;
    stats->retransmissions += retransmissions(bus, i, lost);
    if (bus->shares.listeners >> i & 1u)
        add_received(&bus->shares, stats);
}

void cw_share_lost_now(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    uint64_t lost = lost_share(bus, i);
    n->lost_before = bus->shares.lost;
    if (lost == 0)
        return;
    n->stats.arbitration_lost += lost;
    n->stats.retransmissions += retransmissions(bus, i, lost);
    cw_queue_at(&n->queue, cw_queue_first(&n->queue))->tried = true;
}

void cw_set_contenders(cw_bus *bus, uint64_t nodes)
{
    if (nodes == bus->shares.contenders)
        return;
    for (uint64_t rest = nodes ^ bus->shares.contenders; rest; rest &= rest - 1)
        cw_share_lost(bus, cw_lowest_node(rest));
    bus->shares.contenders = nodes;
    bus->shares.contender_count = cw_count_bits(nodes);
}

void cw_set_listeners(cw_bus *bus, uint64_t nodes)
{
    const uint64_t changed = nodes ^ bus->shares.listeners;
    if (changed == 0)
        return;
    for (uint64_t rest = changed & nodes; rest; rest &= rest - 1)
        subtract_received(&bus->shares, &bus->nodes[cw_lowest_node(rest)].stats);
    for (uint64_t rest = changed & ~nodes; rest; rest &= rest - 1)
        add_received(&bus->shares, &bus->nodes[cw_lowest_node(rest)].stats);
    bus->shares.listeners = nodes;
}

void cw_count_received(cw_bus *bus, unsigned sender, unsigned bytes)
{
    cw_node_stats *stats = &bus->nodes[sender].stats;
    bus->shares.rx_frames++;
    bus->shares.rx_bytes += bytes;
    stats->rx_accepted--; /* the sender does not receive its own frame */
    stats->rx_frames--;
    stats->rx_bytes -= bytes;
}

void cw_assert_shares(const cw_bus *bus)
{
    const cw_shares *s = &bus->shares;
    assert(s->contender_count == cw_count_bits(s->contenders));
    for (unsigned i = 0; i < bus->node_count; i++)
        assert(bus->nodes[i].lost_before <= s->lost);
}
