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
#include <string.h>

/* ---- The tournament -------------------------------------------------------------------------- */

/* An entry: the key, the node, and a hash of the key. NO_ENTRY is behind all keys. */
#define NO_ENTRY (UINT64_C(1) << 63)
#define KEY_SHIFT 16
#define NODE_SHIFT 10
#define NODE_MASK 0x3Fu
#define HASH_MASK (CW_ARBITER_HASHES - 1)
#define HASH_SHIFT 22 /* leaves so much of 32 bits */

_Static_assert(CW_NODES_MAX == 64, "the leaves");
_Static_assert(CW_ARBITER_HASHES == UINT64_C(1) << (32 - HASH_SHIFT), "a hash of each value");

/* Returns the entry of a node: its first frame, or NO_ENTRY. */
static uint64_t entry_of(const cw_bus *bus, unsigned i)
{
    const cw_queue *q = &bus->nodes[i].queue;
    if (!(bus->waiting >> i & 1u))
        return NO_ENTRY;
    const uint32_t key = cw_arbitration_key(cw_queue_at(q, cw_queue_first(q))->frame);
    return (uint64_t)key << KEY_SHIFT | i << NODE_SHIFT | (key * 0x9E3779B1u) >> HASH_SHIFT;
}

/* Returns the entry that wins: the lower one. */
static inline uint64_t play(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* Plays the match at a place, of the four entries below it. */
static inline uint64_t play_match(const cw_arbiter *c, size_t place)
{
    const uint64_t *four = &c->entries[4 * place + 1];
    return play(play(four[0], four[1]), play(four[2], four[3]));
}

void cw_arbiter_init(cw_arbiter *c, unsigned nodes)
{
    *c = (cw_arbiter){.leaves = nodes > 16 ? 1 + 4 + 16 : nodes > 4 ? 1 + 4 : 1};
    for (unsigned i = 0; i < sizeof c->entries / sizeof c->entries[0]; i++)
        c->entries[i] = NO_ENTRY;
    c->hashes[NO_ENTRY & HASH_MASK] = (uint8_t)nodes;
}

/* Repeats the matches of a node whose first frame is another one. */
static void play_again(cw_bus *bus, unsigned i)
{
    cw_arbiter *c = &bus->arbiter;
    uint64_t entry = entry_of(bus, i);
    size_t place = c->leaves + i;
    if (c->entries[place] == entry)
        return;
    c->hashes[c->entries[place] & HASH_MASK]--;
    c->hashes[entry & HASH_MASK]++;
    c->entries[place] = entry;
    do { /* up to the final, since the processor cannot foresee whether a result changes */
        place = (place - 1) / 4;
        c->entries[place] = play_match(c, place);
    } while (place > 0);
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
    uint8_t hashes[CW_ARBITER_HASHES] = {0};
    for (unsigned i = 0; i < bus->node_count; i++) {
        assert(a->stale >> i & 1u || a->entries[a->leaves + i] == entry_of(bus, i));
        hashes[a->entries[a->leaves + i] & HASH_MASK]++;
    }
    for (unsigned place = 0; place < a->leaves; place++)
        assert(a->entries[place] == play_match(a, place));
    /* In one call, since this is half of the work of a program with sanitizers otherwise. */
    assert(memcmp(a->hashes, hashes, sizeof hashes) == 0);
}

/* ---- The winner ------------------------------------------------------------------------------ */

/* Returns true when some of these nodes, besides the winner, have its key. */
static __attribute__((noinline)) bool is_tied(const cw_arbiter *c, uint64_t nodes, uint64_t winner)
{
    unsigned same = 0;
    for (; nodes; nodes &= nodes - 1) {
        const uint64_t entry = c->entries[c->leaves + cw_lowest_node(nodes)];
        same += (entry ^ winner) >> KEY_SHIFT == 0;
    }
    return same > 1;
}

/* Plays among some of the nodes that wait; the others may not take part. */
static uint64_t play_among(const cw_arbiter *c, uint64_t nodes)
{
    uint64_t winner = NO_ENTRY;
    for (; nodes; nodes &= nodes - 1)
        winner = play(winner, c->entries[c->leaves + cw_lowest_node(nodes)]);
    return winner;
}

bool cw_arbiter_winner(const cw_bus *bus, uint64_t nodes, unsigned *winner)
{
    const cw_arbiter *c = &bus->arbiter;
    const uint64_t entry = nodes == bus->waiting ? c->entries[0] : play_among(c, nodes);
    *winner = entry >> NODE_SHIFT & NODE_MASK;
    return c->hashes[entry & HASH_MASK] == 1 || !is_tied(c, nodes, entry);
}
