/* SPDX-License-Identifier: MIT
 *
 * status.c - reads the state of a bus: time, statistics, and the tick of the next event.
 */
#include "bus/bus_private.h"

#include "format/bitset.h"
#include "format/layout.h"

uint64_t cw_bus_now(const cw_bus *bus)
{
    return cw_now(bus);
}

bool cw_bus_is_on_grid(const cw_bus *bus)
{
    return !cw_is_off_grid(bus);
}

uint64_t cw_bus_tick_after(const cw_bus *bus, uint64_t bits)
{
    const uint64_t saved = bits > 0 ? cw_wire_tick(&bus->time, 1) - cw_next_bit_end(bus) : 0;
    const uint64_t tick = cw_wire_tick_or_never(&bus->time, bits);
    return tick == CW_NEVER ? tick : tick - saved;
}

uint64_t cw_bus_recessive_bits(const cw_bus *bus)
{
    return bus->frame_step.active ? cw_frame_step_recessive_bits(bus) : bus->recessive_bits;
}

size_t cw_bus_pending(const cw_bus *bus)
{
    return (size_t)bus->queued + bus->inbox.count + bus->rules.held_count + bus->stored;
}

bool cw_bus_idle(const cw_bus *bus)
{
    if (bus->frame_step.active)
        return false;
    if (bus->timed.clean.parked)
        return cw_clean_is_idle(bus);
    bool busy = bus->followers && cw_mac_is_busy(&bus->common);
    for (uint64_t rest = cw_single_nodes(bus); !busy && rest; rest &= rest - 1)
        busy = cw_mac_is_busy(&bus->nodes[cw_lowest_node(rest)].mac);
    return !busy;
}

/* When the end of a frame or a flag is unknown, look again after this many bits. When faults act on
 * the wire, look again after more bits. */
#define LOOK_AGAIN_BITS 6u
#define LOOK_AT_FAULTS_BITS (CW_FRAME_BITS_MIN - 1) /* faults may send, too */

/* Returns true when a node may still read a frame whose transmitters have left it with a passive
 * flag. A node that sends on another wire, or in loopback, does not send that frame. */
static bool is_orphaned(const cw_bus *bus)
{
    bool read = bus->followers && bus->common.phase == CW_MAC_FRAME;
    for (uint64_t rest = cw_single_nodes(bus); rest; rest &= rest - 1) {
        const cw_mac *m = &bus->nodes[cw_lowest_node(rest)].mac;
        bool sends = cw_mac_is_sending(m);
        if (sends && bus->group_count == 1 && !(m->modes & CW_MODE_LOOPBACK))
            return false;
        read = read || (m->phase == CW_MAC_FRAME && !sends);
    }
    return read;
}

/* Returns the bits until a controller may have something to report. */
static uint64_t horizon(const cw_bus *bus)
{
    uint64_t bits = CW_QUIET_FOREVER;
    if (bus->frame_step.active)
        return cw_frame_step_horizon(bus);
    if (bus->followers)
        bits = cw_mac_horizon(&bus->common, (bus->waiting & bus->followers) != 0);
    for (uint64_t rest = cw_single_nodes(bus); rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool waits = bus->waiting >> i & 1u;
        bits = cw_least(bits, cw_mac_horizon(&bus->nodes[i].mac, waits));
    }
    return bits;
}

/* Returns true when the controller does nothing by itself until it is idle, or gets a frame. */
static bool comes_to_rest(const cw_mac *m)
{
    return !cw_mac_is_busy(m) || (m->phase == CW_MAC_INTERMISSION && m->overloads_wanted == 0);
}

/* Returns true when all controllers come to rest in this way. A frame step knows the ends of its
 * frame. */
static bool bus_comes_to_rest(const cw_bus *bus)
{
    bool rests = !bus->followers || comes_to_rest(&bus->common);
    for (uint64_t rest = cw_single_nodes(bus); rests && rest; rest &= rest - 1)
        rests = comes_to_rest(&bus->nodes[cw_lowest_node(rest)].mac);
    return rests || bus->frame_step.active;
}

/* Returns bit times of the bus in which no node ends that many bits by its own clock. Edges shorten
 * bits by at most SJW each. */
static uint64_t bit_times_of(const cw_bus *bus, uint64_t bits)
{
    const uint64_t sure = bits > 3 ? bits - bits / 8 - 2 : 1;
    if (cw_timed_has_report(bus))
        return 1;
    if (bits == CW_QUIET_FOREVER)
        return bits;
    return sure * bus->timed.fastest_permille / 1000 + 1;
}

/* Returns the tick at which that many bits to come will have passed. */
static uint64_t tick_after(const cw_bus *bus, uint64_t bits)
{
    const cw_frame_step *step = &bus->frame_step;
    if (step->active && step->fast.to && bits < CW_BITS_MAX)
        return cw_frame_step_tick(bus, step->at + (unsigned)bits);
    return cw_wire_tick_or_never(&bus->time, bits);
}

uint64_t cw_bus_next(const cw_bus *bus)
{
    if (bus->pending)
        return cw_now(bus);
    uint64_t bits = horizon(bus);
    bool unknown = bits == CW_QUIET_FOREVER && !bus_comes_to_rest(bus);
    if (unknown || (!bus->frame_step.active && is_orphaned(bus)))
        bits = cw_least(bits, LOOK_AGAIN_BITS);
    const unsigned acts = CW_TOUCH_MORE | CW_TOUCH_QUEUES | CW_TOUCH_AT_RANDOM;
    const bool calm = bits == CW_QUIET_FOREVER && !(cw_rules_touch(&bus->rules) & acts);
    if (bus->rules.awake_count && !calm)
        bits = cw_least(bits, LOOK_AT_FAULTS_BITS);
    if (cw_is_off_grid(bus) || (bus->timed.rates && !bus->frame_step.active))
        bits = bit_times_of(bus, bits); /* of bits that may be shorter */
    uint64_t tick = tick_after(bus, bits);
    tick = cw_least(tick, cw_least(bus->node_due, bus->rules.next_due));
    return cw_least(tick, cw_inbox_first(bus));
}

/* ---- Receptions of some frames --------------------------------------------------------------- */

/* Returns true when hosts may get frames that no queue has: from buffers, mailboxes and rules. A
 * node in loopback gets them at other times than the rest of the bus (M15). */
static bool may_surprise(const cw_bus *bus)
{
    bool may = bus->rules.count > 0 || bus->tt || bus->stored > 0;
    for (unsigned i = 0; !may && i < bus->node_count; i++)
        may = bus->nodes[i].mac.modes & CW_MODE_LOOPBACK;
    for (unsigned i = 0; !may && bus->buffers && i < bus->node_count; i++)
        may = bus->buffers[i].boxes;
    return may;
}

#define NO_LENGTH UINT16_MAX /* of wire bits */

/* Returns the wire bits of the shortest frame in the queues that passes. */
static unsigned least_of_queues(const cw_bus *bus, cw_frame_test *test, const void *user)
{
    unsigned bits = NO_LENGTH;
    for (uint64_t rest = bus->waiting | bus->asleep; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        const cw_queue *q = &bus->nodes[i].queue;
        for (unsigned n = 0; n < q->count; n++) {
            const cw_queue_slot *slot = cw_queue_at(q, cw_queue_nth(q, n));
            if (slot->wire_bits < bits && test(user, i, slot->frame))
                bits = slot->wire_bits;
        }
    }
    return bits;
}

/* Returns a tick before which no frame of the inbox that passes is received. */
static uint64_t next_of_inbox(const cw_bus *bus, cw_frame_test *test, const void *user)
{
    for (unsigned n = 0; n < bus->inbox.count; n++) {
        const cw_inbox_entry *entry = cw_inbox_at(&bus->inbox, n);
        const uint64_t tick = entry->at_tick > cw_now(bus) ? entry->at_tick : cw_now(bus);
        if (!test(user, entry->node, entry->frame))
            continue;
        const uint64_t bits = cw_to_reception(bus, CW_FRAME_BITS_MIN);
        return cw_is_off_grid(bus)
                   ? tick : cw_after(tick, cw_rate_ticks(cw_wire_rate(&bus->time), bits));
    }
    return CW_NEVER;
}

/* Returns the same for the frame on the wire, and those in queues. */
static uint64_t next_of_queues(const cw_bus *bus, cw_frame_test *test, const void *user)
{
    const unsigned least = least_of_queues(bus, test, user);
    if (least == NO_LENGTH)
        return CW_NEVER;
    const uint64_t bits = cw_to_reception(bus, least);
    if (bus->frame_step.active)
        return tick_after(bus, cw_frame_step_to_rx(bus, bits, test, user));
    const uint64_t next = cw_bus_next(bus);
    if (cw_is_off_grid(bus))
        return cw_least(next, tick_after(bus, bits * 3 / 4)); /* its bits may be shorter */
    /* an error may make room for a frame other than the one on the wire */
    const uint64_t begun_now = tick_after(bus, bits);
    return (next > begun_now) == bus_comes_to_rest(bus) ? next : begun_now;
}

/* Returns the same for any frame. An error on the wire may make room for a shorter one. */
static uint64_t next_of_any(const cw_bus *bus)
{
    const uint64_t next = cw_bus_next(bus);
    if (bus->pending || bus->frame_step.active || bus_comes_to_rest(bus))
        return next;
    const uint64_t bits = cw_to_reception(bus, CW_FRAME_BITS_MIN);
    return cw_least(next, tick_after(bus, cw_is_off_grid(bus) ? bits * 3 / 4 : bits));
}

uint64_t cw_bus_next_rx(const cw_bus *bus, cw_frame_test *test, const void *user)
{
    const bool orphaned = !bus->frame_step.active && is_orphaned(bus); /* no queue has its frame */
    if (bus->pending || orphaned || may_surprise(bus))
        return next_of_any(bus);
    return cw_least(next_of_queues(bus, test, user), next_of_inbox(bus, test, user));
}

/* ---- Statistics ------------------------------------------------------------------------------ */

void cw_bus_get_stats(const cw_bus *bus, cw_bus_stats *stats)
{
    *stats = bus->stats;
    stats->arbitration_lost -= cw_count_bits(cw_losses_ahead(bus));
    stats->ticks = cw_now(bus);
    stats->pending = (uint32_t)(bus->queued + bus->rules.held_count) + bus->stored;
    stats->busy_ticks = cw_rate_ticks(cw_wire_rate(&bus->time), stats->busy_bits) -
                        bus->timed.short_ticks;
    stats->load_permille = (uint16_t)cw_load_second_permille(&bus->load);
}

cw_status cw_node_get_stats(const cw_bus *bus, unsigned i, cw_node_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    const cw_bus_node *n = &bus->nodes[i];
    *stats = n->stats;
    cw_share_stats(bus, i, stats);
    stats->arbitration_lost -= cw_losses_ahead(bus) >> i & 1u;
    stats->inbox = n->inbox;
    stats->queue = n->queue.count;
    cw_rules_count_held(&bus->rules, i, &stats->held, &stats->rx_held);
    stats->rx_held += cw_buffers_count(bus, i);
    stats->tec = n->mac.confinement.tec;
    stats->rec = n->mac.confinement.rec;
    stats->state = cw_node_state(bus, i);
    return CW_OK;
}

cw_status cw_node_get_host_stats(const cw_bus *bus, unsigned i, cw_host_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (!bus->buffers)
        return CW_REFUSED;
    *stats = bus->buffers[i].stats;
    return CW_OK;
}

cw_status cw_node_get_sleep_stats(const cw_bus *bus, unsigned i, cw_sleep_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    *stats = (cw_sleep_stats){.wake_ups = 0};
    if (!bus->lean)
        *stats = bus->sleeps[i].stats;
    if (bus->asleep >> i & 1u)
        stats->ticks += cw_now(bus) - bus->sleeps[i].since;
    return CW_OK;
}

cw_status cw_node_get_data_stats(const cw_bus *bus, unsigned i, cw_data_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (!bus->timed.rates)
        return CW_REFUSED;
    *stats = bus->timed.rates[i].stats;
    return CW_OK;
}

void cw_bus_set_sync_records(cw_bus *bus, cw_sync_record *records)
{
    cw_wake_controllers(bus);
    bus->timed.records = records;
    bus->timed.counts = false;
    for (unsigned i = 0; records && i < bus->node_count; i++)
        records[i] = (cw_sync_record){.stats.margin = CW_NO_MARGIN};
}

cw_status cw_node_get_sync_stats(const cw_bus *bus, unsigned i, cw_sync_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    if (!bus->timed.records)
        return CW_REFUSED;
    *stats = bus->timed.records[i].stats;
    cw_clean_add_counts(bus, i, stats);
    return CW_OK;
}
