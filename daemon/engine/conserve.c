/* SPDX-License-Identifier: MIT
 *
 * conserve.c - checks that all frames between ports and bus are accounted for.
 */
#include "engine/conserve.h"

#include "base/log.h"
#include "engine/reload.h"

#include <inttypes.h>

#define COUNTERS (sizeof(port_stats) / sizeof(uint64_t))

/* Adds counters: port_stats has no other members. */
static void conserve_add(port_stats *sum, const port_stats *more, bool subtract)
{
    uint64_t *to = (uint64_t *)sum;
    const uint64_t *from = (const uint64_t *)more;
    for (size_t i = 0; i < COUNTERS; i++)
        to[i] = subtract ? to[i] - from[i] : to[i] + from[i];
}

/* Counters of a port that ends are kept. One that opens may have counted before; that is left
 * out. */
static void move_port(conserve *c, unsigned node, port *moved, bool opened)
{
    port_stats stats;
    if (!moved)
        return;
    port_get_stats(moved, &stats);
    conserve_add(&c->nodes[node].past, &stats, opened);
}

void conserve_opened(conserve *c, unsigned node, port *opened)
{
    move_port(c, node, opened, true);
}

void conserve_closing(conserve *c, unsigned node, port *closing)
{
    move_port(c, node, closing, false);
}

void conserve_missed(conserve *c, unsigned node, bool has_port)
{
    if (has_port)
        c->nodes[node].past.write_failed++;
    else
        c->nodes[node].unheard++;
}

void conserve_remap(conserve *c, const uint8_t from[CW_NODES_MAX])
{
    reload_remap(c->nodes, sizeof c->nodes[0], from);
}

void conserve_get_stats(port_stats *out, const conserve *c, unsigned node, port *own_port)
{
    *out = c->nodes[node].past;
    if (!own_port)
        return;
    port_stats now;
    port_get_stats(own_port, &now);
    conserve_add(out, &now, false);
}

/* ---- Balance --------------------------------------------------------------------------------- */

typedef struct books {
    cw_node_stats bus;
    port_stats interface;
    uint64_t came; /* from the interface and the node's own traffic */
    uint64_t went; /* to the interface, or to no receiver */
} books;

/* Notes all frames that have come to a node and gone from it, by both sides. */
static void open_books(books *b, const conserve *c, const cw_bus *bus, unsigned node,
                       port *own_port)
{
    const conserve_node *n = &c->nodes[node];
    (void)cw_node_get_stats(bus, node, &b->bus);
    conserve_get_stats(&b->interface, c, node, own_port);
    b->came = b->interface.read + n->released;
    b->went = b->interface.written + b->interface.write_failed + b->interface.unheard + n->unheard;
}

static bool balance(const books *b)
{
    return b->came == b->bus.handed_in + b->bus.inbox && b->bus.rx_frames == b->went &&
           cw_node_stats_balance(&b->bus);
}

bool conserve_balances(const conserve *c, const cw_bus *bus, unsigned node, port *own_port)
{
    books b;
    open_books(&b, c, bus, node, own_port);
    return balance(&b);
}

/* Adds up drops of all kinds. */
static uint64_t conserve_sum(const uint64_t counters[CW_DROP_COUNT])
{
    uint64_t total = 0;
    for (unsigned i = 0; i < CW_DROP_COUNT; i++)
        total += counters[i];
    return total;
}

/* Tells all counters of a node whose frames do not add up. That is a bug of canwire. */
static void log_books(const char *name, const books *b)
{
    const cw_node_stats *s = &b->bus;
    log_node_error(name,
                   "frames are unaccounted for: came %" PRIu64 ", handed in %" PRIu64
                   ", inbox %" PRIu32 ", by rules %" PRIu64 ", transmitted %" PRIu64
                   ", stored %" PRIu64 ", queued %" PRIu32 ", held %" PRIu32 ", dropped %" PRIu64
                   "; accepted %" PRIu64 ", by rules %" PRIu64 ", received %" PRIu64
                   ", held %" PRIu32 ", dropped %" PRIu64 ", went %" PRIu64,
                   b->came, s->handed_in, s->inbox, s->made_by_rules, s->tx_frames, s->stored,
                   s->queue, s->held, conserve_sum(s->dropped), s->rx_accepted, s->rx_made_by_rules,
                   s->rx_frames, s->rx_held, conserve_sum(s->rx_dropped), b->went);
}

unsigned conserve_check(const conserve *c, const cfg *config, const cw_bus *bus, port *const *ports)
{
    unsigned wrong = 0;
    for (unsigned i = 0; i < config->node_count; i++) {
        books b;
        open_books(&b, c, bus, i, ports[i]);
        if (balance(&b))
            continue;
        wrong++;
        log_books(config->nodes[i].name, &b);
    }
    return wrong;
}
