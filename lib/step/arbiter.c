/* SPDX-License-Identifier: MIT
 *
 * arbiter.c - the winner of the bus among the frames that wait.
 *
 * The first frames of all nodes play a tournament by their arbitration fields. A node with a new
 * first frame repeats its matches when the winner is needed; all others stay as they are.
 */
#include "step/step.h"

#include "format/head.h"

#include <assert.h>

/* ---- The tournament -------------------------------------------------------------------------- */

/* An entry: the key, the node, and the number of its matches that were ties. NO_ENTRY is behind all
 * keys, and ties only with another NO_ENTRY. */
#define NO_ENTRY (UINT64_C(1) << 63)
#define KEY_SHIFT 16
#define NODE_SHIFT 8
#define NODE_MASK 0x3Fu
#define TIES_MASK 0xFFu

/* Returns the entry of a node: its first frame, or NO_ENTRY. */
static uint64_t entry_of(const cw_bus *bus, unsigned i)
{
    const cw_queue *q = &bus->nodes[i].queue;
    if (!(bus->waiting >> i & 1u))
        return NO_ENTRY;
    return (uint64_t)cw_arbitration_key(cw_queue_at(q, cw_queue_first(q))->frame) << KEY_SHIFT |
           i << NODE_SHIFT;
}

/* Returns the entry that wins, with one more tie if the keys are equal. */
static uint64_t play(uint64_t a, uint64_t b)
{
    const bool tie = (a ^ b) >> KEY_SHIFT == 0;
    return (a < b ? a : b) + tie;
}

void cw_arbiter_init(cw_arbiter *c, unsigned nodes)
{
    *c = (cw_arbiter){.leaves = 1};
    while (c->leaves < nodes)
        c->leaves *= 2;
    for (unsigned i = c->leaves; i < 2 * c->leaves; i++)
        c->entries[i] = NO_ENTRY;
    for (unsigned i = c->leaves - 1; i > 0; i--)
        c->entries[i] = play(c->entries[2 * i], c->entries[2 * i + 1]);
}

/* Repeats the matches of a node whose first frame is another one. */
static void play_again(cw_bus *bus, unsigned i)
{
    cw_arbiter *c = &bus->arbiter;
    uint64_t entry = entry_of(bus, i);
    size_t place = c->leaves + i;
    if (c->entries[place] == entry)
        return;
    c->entries[place] = entry;
    for (; place > 1; place /= 2) { /* up to the final, since the processor cannot foresee whether a
                                       result changes */
        entry = play(entry, c->entries[place ^ 1]);
        c->entries[place / 2] = entry;
    }
}

void cw_arbiter_update(cw_bus *bus)
{
    for (uint64_t rest = bus->arbiter.stale; rest; rest &= rest - 1)
        play_again(bus, cw_lowest_node(rest));
    bus->arbiter.stale = 0;
}

void cw_assert_arbiter(const cw_bus *bus)
{
    const cw_arbiter *a = &bus->arbiter;
    for (unsigned i = 0; i < bus->node_count; i++)
        assert(a->stale >> i & 1u || a->entries[a->leaves + i] == entry_of(bus, i));
    for (unsigned place = a->leaves - 1; place > 0; place--)
        assert(a->entries[place] == play(a->entries[2 * place], a->entries[2 * place + 1]));
}

/* Plays among some of the nodes that wait; the others may not take part. */
static uint64_t play_among(const cw_bus *bus, uint64_t nodes)
{
    uint64_t winner = NO_ENTRY;
    for (; nodes; nodes &= nodes - 1)
        winner = play(winner, bus->arbiter.entries[bus->arbiter.leaves + cw_lowest_node(nodes)]);
    return winner;
}

bool cw_arbiter_winner(const cw_bus *bus, uint64_t nodes, unsigned *winner)
{
    uint64_t entry = nodes == bus->waiting ? bus->arbiter.entries[1] : play_among(bus, nodes);
    *winner = entry >> NODE_SHIFT & NODE_MASK;
    return (entry & TIES_MASK) == 0;
}
