/* SPDX-License-Identifier: MIT
 *
 * invariants.c - asserts the invariants of a bus between any two steps.
 *
 * Stored sums equal the sums of their parts. Stored properties of nodes equal those that a look at
 * the nodes finds. Nodes that share a controller may do so.
 */
#include "bus/invariants.h"

#include "bus/bus_private.h"
#include "format/parts.h"
#include "mac/confinement.h"

#include <assert.h>

#define EVENTS_CHECKED 8u /* the newest events, at each step */

static bool is_subset(uint64_t part, uint64_t whole)
{
    return (part & ~whole) == 0;
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

/* Of the order it checks the frames that go first, since a long queue would cost too much. */
static void assert_queue(const cw_queue *q, unsigned limit)
{
    assert(q->count <= q->capacity && limit <= q->capacity);
    assert(q->boxed <= q->count);
    for (unsigned i = 0; i + 1 < q->count && i < 2 && i + 1 != q->boxed; i++)
        assert(q->order[q->count - 2 - i].key >= q->order[q->count - 1 - i].key);
}

/* R8 to R11, R13. */
static void assert_confinement(const cw_confinement *c)
{
    cw_confinement again = *c;
    cw_confinement_set_warning_limit(&again, c->warning_limit);
    assert(again.state == c->state);
    assert(c->rec <= CW_REC_MAX);
}

/* Sets of the bus must agree with the node, nothing due may be missed, and each frame be accounted
 * for. */
static void assert_node(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    cw_node_stats stats;
    assert_queue(&n->queue, n->queue_limit);
    assert_confinement(&n->mac.confinement);
    assert(n->mac.phase < CW_MAC_PHASE_COUNT);
    assert((n->queue.count > 0 && !(bus->asleep >> i & 1u)) == (bus->waiting >> i & 1u));
    assert(bus->lean || bus->node_due <= bus->sleeps[i].awake_at);
    assert(!(bus->waiting >> i & 1u) || !(bus->detached >> i & 1u));
    assert(!(bus->unplugged >> i & 1u) || n->mac.phase == CW_MAC_OFF);
    assert(bus->node_due <= bus->restarts[i].at && bus->node_due <= cw_buffers_due(bus, i));
    assert(bus->node_due <= cw_tt_due(bus, i));
    (void)cw_node_get_stats(bus, i, &stats);
    assert(cw_node_stats_balance(&stats));
    assert((cw_mailbox_replies(bus, i) > 0) == (bus->replying >> i & 1u));
    assert(!bus->buffers || !bus->buffers[i].boxes || (n->queue.count > 0) == (n->queue.boxed > 0));
}

/* Sums over all nodes are kept by hand; here they must be right. */
static void assert_sums(const cw_bus *bus)
{
    uint64_t queued = 0, handed_in = 0, stored = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        queued += bus->nodes[i].queue.count;
        handed_in += bus->nodes[i].inbox;
        stored += cw_buffers_count(bus, i);
    }
    assert(bus->stored == stored && stored <= bus->stored_most);
    assert(bus->queued == queued);
    assert(bus->inbox.count == handed_in + cw_count_bits(bus->inbox.triggered) &&
           bus->inbox.count <= bus->inbox.capacity);
    assert(bus->load.unit > 1 || bus->load.bits <= bus->stats.bits); /* less: see takeover.c */
    assert(bus->load.bits <= cw_now(bus));
    assert(bus->time.short_by == 0);
    assert(bus->inbox.next == CW_NEVER || bus->inbox.count > 0);
    assert(bus->inbox.count == 0 ||
           cw_inbox_at(&bus->inbox, 0)->at_tick == bus->inbox.next);
    assert(is_subset(bus->removed, bus->detached) && is_subset(bus->detached, bus->all));
}

/* Asserts that each node is on exactly one wire. */
static void assert_wires(const cw_bus *bus)
{
    uint64_t seen = 0;
    for (unsigned g = 0; g < bus->group_count; g++) {
        assert((seen & bus->groups[g]) == 0);
        seen |= bus->groups[g];
    }
    assert(is_subset(bus->all, seen));
}

/* ---- Shared and stored state ----------------------------------------------------------------- */

/* A follower's own controller looks idle, and nothing about it differs from other followers. */
static void assert_followers(const cw_bus *bus)
{
    assert(is_subset(bus->followers, bus->all) && (!bus->stepping || bus->followers == 0));
    for (uint64_t rest = bus->followers; rest; rest &= rest - 1) {
        const cw_mac *m = &bus->nodes[cw_lowest_node(rest)].mac;
        assert(m->phase == CW_MAC_IDLE && m->role == CW_ROLE_NONE);
        assert(!m->no_ack && m->overloads_wanted == 0 && !m->no_long_dlc);
        assert(!(m->modes & CW_MODES_APART));
        assert(m->protocol == bus->common.protocol);
        assert(!cw_confinement_passive(&m->confinement));
    }
}

/* In a frame step the controllers rest, and the frame is at a possible place. */
static void assert_frame(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    if (!step->active)
        return;
    assert(!bus->stepping && bus->group_count == 1);
    assert(step->at < step->length + CW_INTERMISSION_BITS && step->node < bus->node_count);
    assert(is_subset(step->undecided, step->contenders));
    assert(is_subset(step->contenders, step->listeners) && is_subset(step->listeners, bus->all));
    assert(step->contenders >> step->node & 1u);
    for (uint64_t rest = bus->all & ~bus->outlook.away; rest; rest &= rest - 1)
        assert(bus->nodes[cw_lowest_node(rest)].mac.phase == CW_MAC_IDLE);
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* Asserts that controllers do to the wire what has been noted, see step/quantum_time.c. */
static void assert_view(const cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    if (t->active && t->steady_at == cw_now(bus) && t->touched == 0)
        assert(t->view == cw_view_wire(bus));
}

/* The newest events must be in the order of time. */
static void assert_ring(const cw_event_ring *ring)
{
    assert(ring->count <= ring->capacity && ring->first < ring->capacity);
    for (unsigned i = 1; i < ring->count && i <= EVENTS_CHECKED; i++) {
        unsigned place = (ring->first + ring->count - i) % ring->capacity;
        unsigned before = (place + ring->capacity - 1) % ring->capacity;
        assert(cw_ring_at(ring, before)->tick <= cw_ring_at(ring, place)->tick);
    }
}

void cw_assert_bus(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++)
        assert_node(bus, i);
    assert_sums(bus);
    assert_wires(bus);
    assert_followers(bus);
    assert_frame(bus);
    cw_assert_outlook(bus);
    cw_assert_arbiter(bus);
    cw_assert_shares(bus);
    assert_view(bus);
    assert_ring(&bus->ring);
}
