/* SPDX-License-Identifier: MIT
 *
 * memory.c - a bus in its caller's memory: its size by the configuration, and its state at tick 0.
 *
 * Its state at tick 0 lies in front, so that a copy of it takes the bus back to there. Behind it
 * lies room that is empty at tick 0, and the memo of lengths, which stays true.
 */
#include "bus/bus_private.h"
#include "format/layout.h"

#include <assert.h>
#include <string.h>

/* Returns true when some node has anything between its controller and its host. */
static bool has_buffers(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++)
        if (c->nodes[i].host.filter_count || c->nodes[i].host.receive_buffers ||
            c->nodes[i].host.mailbox_count ||
            (c->nodes[i].protocol & CW_PROTOCOL_2_0B_PASSIVE))
            return true;
    return false;
}

/* Returns true when some node knows FD frames. */
static bool has_fd(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++)
        if ((c->nodes[i].protocol & CW_PROTOCOL_MASK) == CW_FD)
            return true;
    return false;
}

/* The layout of the caller's memory. With base NULL only the sizes are counted. */
typedef struct arena {
    unsigned char *base;
    size_t state; /* bytes used in front */
    size_t room;  /* ... and behind them, where that begins at `behind` */
    size_t behind;
} arena;

/* Returns the next part of the bytes at `offset` of the memory, of which `used` grows. Without
 * memory it only counts, and returns NULL. */
static void *take(const arena *a, size_t *used, size_t offset, size_t count, size_t size)
{
    const size_t place = offset + *used;
    *used += (count * size + 15) & ~(size_t)15;
    return a->base ? a->base + place : NULL;
}

/* Returns the next part of the state. */
static void *carve(arena *a, size_t count, size_t size)
{
    return take(a, &a->state, 0, count, size);
}

/* Returns the next part of the room. */
static void *carve_room(arena *a, size_t count, size_t size)
{
    return take(a, &a->room, a->behind, count, size);
}

/* Returns the mailboxes of a use, as bits. */
static uint64_t boxes_for(const cw_host_config *h, cw_mailbox_use use)
{
    uint64_t boxes = 0;
    for (unsigned i = 0; i < h->mailbox_count; i++)
        if (h->mailboxes[i].use == use)
            boxes |= UINT64_C(1) << i;
    return boxes;
}

/* Returns true when received frames go into mailboxes. */
static bool is_boxed(const cw_host_config *h)
{
    return h->mailbox_count > 0 && !h->receive_fifo;
}

/* Returns the frames that may wait for the host of a node. */
static unsigned stored_limit(const cw_host_config *h)
{
    if (!is_boxed(h))
        return h->receive_buffers;
    return h->service_ticks ? cw_count_bits(boxes_for(h, CW_MAILBOX_RECEIVE)) : 0;
}

/* Returns the room in a node's queue. It is enough for the settings of its configuration, of the
 * rules from the start, and for the replies of mailboxes. */
static uint16_t queue_room(const cw_bus_config *c, unsigned node)
{
    const cw_node_config *n = &c->nodes[node];
    uint16_t room = n->queue > n->queue_room ? n->queue : n->queue_room;
    for (unsigned i = 0; i < c->rule_count; i++) {
        const cw_rule *r = &c->rules[i];
        bool sets = r->action == CW_ACTION_SET && (r->nodes & cw_node_bit(node)) &&
                    (r->settings.which & CW_SET_QUEUE) && r->settings.queue <= CW_QUEUE_MAX;
        if (sets && r->settings.queue > room)
            room = r->settings.queue;
    }
    return (uint16_t)(room + cw_count_bits(boxes_for(&n->host, CW_MAILBOX_REPLY)));
}

/* Returns how many nodes have a schedule; each can have one frame of it in the inbox. */
static unsigned nodes_with_triggers(const cw_bus_config *c)
{
    unsigned nodes = 0;
    for (unsigned i = 0; i < c->node_count; i++)
        nodes += c->nodes[i].schedule.trigger_count > 0;
    return nodes;
}

/* Returns the smallest ring with which the bus never has to stop. */
static unsigned least_ring(const cw_bus_config *c)
{
    const unsigned rules = (unsigned)c->rule_count + c->rule_room;
    const unsigned bits = cw_bits_of_bit_time(c);
    unsigned events = bits * c->node_count * CW_EVENTS_PER_NODE + (bits + 1) * rules +
                      2u * (c->inbox + nodes_with_triggers(c)) + CW_HELD_FRAMES + c->node_count;
    for (unsigned i = 0; i < c->node_count; i++)
        events += queue_room(c, i) + stored_limit(&c->nodes[i].host) +
                  c->nodes[i].schedule.trigger_count;
    return events;
}

/* The functions that follow lay out the parts of a bus. Without memory they only count. */
static void carve_queues(arena *a, cw_bus_node *nodes, const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++) {
        uint16_t capacity = queue_room(c, i);
        void *slots = carve_room(a, capacity, cw_queue_slot_size(has_fd(c)));
        cw_queue_place *order = carve_room(a, capacity, sizeof *order);
        if (nodes)
            cw_queue_init(&nodes[i].queue, slots, order, capacity, c->nodes[i].order, has_fd(c));
    }
}

/* Lays out filters, buffers and mailboxes, if any node has some (memory for all nodes then). */
static void carve_buffers(arena *a, cw_bus *bus, const cw_bus_config *c)
{
    if (!has_buffers(c))
        return;
    cw_buffers *buffers = carve(a, c->node_count, sizeof *buffers);
    if (bus)
        bus->buffers = buffers;
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_host_config *h = &c->nodes[i].host;
        const unsigned limit = stored_limit(h);
        cw_filter *filters = carve(a, h->filter_count, sizeof *filters);
        cw_stored_frame *stored = carve_room(a, limit + 1u, sizeof *stored);
        cw_mailbox *boxes = h->mailbox_count ? carve(a, h->mailbox_count, sizeof *boxes) : NULL;
        if (!bus)
            continue;
        bus->stored_most += limit ? limit + 1u : 0;
        if (h->filter_count)
            memcpy(filters, h->filters, h->filter_count * sizeof *filters);
        if (boxes)
            memcpy(boxes, h->mailboxes, h->mailbox_count * sizeof *boxes);
        buffers[i] = (cw_buffers){.filters = filters, .filter_count = h->filter_count,
                                  .limit = limit, .stored = stored,
                                  .byte_limit = h->receive_bytes,
                                  .service_ticks = h->service_ticks,
                                  .overload = h->overload_when_full,
                                  .boxes = boxes, .boxed = is_boxed(h),
                                  .receive_boxes = boxes_for(h, CW_MAILBOX_RECEIVE),
                                  .transmit_boxes = boxes_for(h, CW_MAILBOX_TRANSMIT),
                                  .reply_boxes = boxes_for(h, CW_MAILBOX_REPLY),
                                  .transmit = (uint8_t)h->transmit};
        bus->overload_when_full = bus->overload_when_full || h->overload_when_full;
    }
}

/* Returns true when some node has local time. */
static bool has_local_time(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++)
        if (c->nodes[i].local.bits)
            return true;
    return false;
}

/* Begins local time and schedule of a node (L2, L5). */
static void init_tt(cw_tt *tt, const cw_bus_config *c, unsigned node)
{
    const cw_node_config *n = &c->nodes[node];
    const cw_span quantum = cw_bit_timing_of(c, node).quantum;
    *tt = (cw_tt){.config = n->local, .schedule = n->schedule,
                  .clock = cw_local_begin(n->local.unit, quantum, n->local.start),
                  .base = n->local.start, .pending = {.due = CW_NEVER}, .deadline = CW_NEVER,
                  .hand_in = CW_NEVER};
}

/* Lays out local times and schedules, if any node has local time (L2, L5). */
static void carve_tt(arena *a, cw_bus *bus, const cw_bus_config *c)
{
    if (!has_local_time(c))
        return;
    cw_tt *tt = carve(a, c->node_count, sizeof *tt);
    if (bus)
        bus->tt = tt;
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_schedule *s = &c->nodes[i].schedule;
        cw_time_trigger *triggers = carve(a, s->trigger_count, sizeof *triggers);
        cw_trigger_stats *stats = carve(a, s->trigger_count, sizeof *stats);
        if (!bus)
            continue;
        init_tt(&tt[i], c, i);
        bus->triggers += s->trigger_count;
        for (unsigned k = 0; k < s->trigger_count; k++) {
            triggers[k] = s->triggers[k];
            stats[k] = (cw_trigger_stats){.slots = 0};
        }
        tt[i].schedule.triggers = triggers;
        tt[i].stats = stats;
    }
}

/* Lays out the rules, their index, and the frames that they hold back. */
static void carve_rules(arena *a, cw_rule_set *set, const cw_bus_config *c)
{
    size_t capacity = (size_t)c->rule_count + c->rule_room;
    cw_rule_state *rules = carve_room(a, capacity, sizeof *rules);
    cw_rule_key *keys = carve_room(a, capacity * CW_RULE_FILTERS_MAX, sizeof *keys);
    uint16_t *wildcards = carve_room(a, capacity, sizeof *wildcards);
    uint16_t *awake = carve_room(a, capacity, sizeof *awake);
    const size_t held_size = cw_held_frame_size(has_fd(c));
    void *held = carve_room(a, CW_HELD_FRAMES, held_size);
    if (set)
        *set = (cw_rule_set){.rules = rules, .keys = keys, .wildcards = wildcards,
                             .awake = awake, .held = held, .held_size = (unsigned)held_size,
                             .capacity = (unsigned)capacity,
                             .stale = true, .next_due = CW_NEVER};
}

/* Lays out counters and checksums, each with the first value of its counter. */
static void carve_protections(arena *a, cw_rule_set *set, const cw_bus_config *c)
{
    if (c->protection_count == 0)
        return;
    cw_protected *protections = carve(a, c->protection_count, sizeof *protections);
    if (!set)
        return;
    for (unsigned i = 0; i < c->protection_count; i++)
        protections[i] = (cw_protected){.what = c->protections[i],
                                        .next = c->protections[i].counter.start};
    set->protections = protections;
    set->protection_count = c->protection_count;
    set->hand_in_rules = 1;
}

/* Returns the edges that nodes may look at. Each bit of a node in the longest delay and ringing can
 * have one, and so can a few more bits. The delays may be changed later. */
static unsigned edges_looked_at(const cw_bus_config *c)
{
    const uint64_t ringing = (uint64_t)(cw_longest_ringing(c) / cw_shortest_bit(c));
    const uint64_t least = 2 * CW_DELAY_BITS_MAX; /* bits may become shorter */
    const uint64_t bits = 4 * cw_bits_of_bit_time(c) + CW_DELAY_BITS_MAX +
                          (ringing > least ? ringing : least);
    unsigned room = 64;
    while (room < bits * c->node_count)
        room *= 2;
    return room;
}

static unsigned room_for_disturbances(const cw_bus_config *c)
{
    return 64 + 4u * (c->rule_count + c->rule_room);
}

/* Returns the room for marks. A node begins and drives its bits, with a level of the controller, of
 * its line and of its wire. It samples them at one or two moments, and sees an edge before and one
 * after each sample point. A rule begins and ends to change a line, or all wires. */
static unsigned mark_room(const cw_bus_config *c)
{
    const unsigned bits = 1 + cw_bits_of_bit_time(c);
    const unsigned by_rules = 2u * room_for_disturbances(c) * (c->node_count + 1u);
    return c->marks ? 8u * bits * c->node_count + by_rules : 0;
}

/* Lays out what nodes with clocks of their own need: delays, edges, disturbances, marks. */
static void carve_clocks(arena *a, cw_timed *t, const cw_bus_config *c)
{
    const size_t pairs = (size_t)c->node_count * c->node_count;
    const unsigned room = room_for_disturbances(c);
    cw_bit_timing *next_timings = carve(a, c->node_count, sizeof *next_timings);
    cw_timed_rates *rates = cw_has_data_rate(c) ? carve(a, c->node_count, sizeof *rates) : NULL;
    cw_span *delays = carve(a, 2 * pairs, sizeof *delays);
    cw_way *way = carve(a, (size_t)CW_WAYS_KEPT * c->node_count, sizeof *way);
    cw_ringing *ringing = carve(a, c->node_count, sizeof *ringing);
    cw_clean_node *clean = carve(a, c->node_count, sizeof *clean);
    uint8_t *at = carve(a, c->node_count, sizeof *at);
    cw_edge *edges = carve_room(a, edges_looked_at(c), sizeof *edges);
    cw_disturbance *list = carve_room(a, room, sizeof *list);
    cw_mark *marks = carve_room(a, mark_room(c), sizeof *marks);
    if (!t)
        return;
    if (rates)
        memset(rates, 0, c->node_count * sizeof *rates);
    *t = (cw_timed){.nodes = t->nodes, .next_timings = next_timings, .rates = rates,
                    .ringing = ringing, .clean = {.nodes = clean, .at = at},
                    .cable = {.edges = edges, .capacity = edges_looked_at(c),
                              .delays = delays, .way = way, .node_count = c->node_count},
                    .disturbances = {.list = list, .capacity = room},
                    .marks = marks, .mark_room = mark_room(c)};
}

/* Lays out the bit timings of the nodes, and unless the bus is lean what goes with them. */
static void carve_timed(arena *a, cw_timed *t, const cw_bus_config *c)
{
    cw_timed_node *nodes = carve(a, c->node_count, sizeof *nodes);
    if (t) {
        memset(nodes, 0, c->node_count * sizeof *nodes);
        t->nodes = nodes;
    }
    if (!cw_is_lean(c))
        carve_clocks(a, t, c);
    if (t)
        t->steady_at = CW_NEVER;
}

/* Lays out a bus and all of its parts. Without memory it counts the bytes and returns NULL. */
static cw_bus *lay_out(arena *a, const cw_bus_config *c)
{
    unsigned events = c->events > least_ring(c) ? c->events : least_ring(c);
    cw_bus *bus = carve(a, 1, sizeof *bus);
    cw_bus_node *nodes = carve(a, c->node_count, sizeof *nodes);
    cw_lengths *lengths = carve_room(a, 1, sizeof *lengths);
    cw_restart_times *restarts = carve(a, c->node_count, sizeof *restarts);
    cw_start *starts = carve(a, c->node_count, sizeof *starts);
    cw_error_frame *error_frames = carve(a, c->node_count + 1u, sizeof *error_frames);
    cw_sleep *sleeps = cw_is_lean(c) ? NULL : carve(a, c->node_count, sizeof *sleeps);
    const size_t entry_size = cw_inbox_entry_size(has_fd(c));
    const size_t event_size = cw_ring_event_size(has_fd(c));
    const unsigned inbox_room = c->inbox + nodes_with_triggers(c);
    void *entries = carve_room(a, inbox_room, entry_size);
    void *ring = carve_room(a, events, event_size);
    cw_fd_part *fd_parts = has_fd(c) ? carve(a, c->node_count + 1u, sizeof *fd_parts) : NULL;
    if (bus) {
        memset(bus, 0, sizeof *bus);
        memset(nodes, 0, c->node_count * sizeof *nodes);
        memset(starts, 0, c->node_count * sizeof *starts);
        memset(error_frames, 0, (c->node_count + 1u) * sizeof *error_frames);
        cw_lengths_clear(lengths);
        bus->lengths = lengths;
        bus->nodes = nodes;
        bus->restarts = restarts;
        bus->starts = starts;
        bus->error_frames = error_frames;
        bus->sleeps = sleeps;
        bus->lean = cw_is_lean(c);
        bus->fd = has_fd(c);
        bus->fd_parts = fd_parts;
        bus->inbox = (cw_inbox){.entries = entries,
                                .entry_size = (unsigned)entry_size,
                                .capacity = inbox_room,
                                .kept_free = inbox_room - c->inbox,
                                .next = CW_NEVER};
        bus->ring =
            (cw_event_ring){.events = ring, .event_size = (unsigned)event_size, .capacity = events};
    }
    carve_rules(a, bus ? &bus->rules : NULL, c);
    carve_protections(a, bus ? &bus->rules : NULL, c);
    carve_timed(a, bus ? &bus->timed : NULL, c);
    carve_queues(a, nodes, c);
    carve_buffers(a, bus, c);
    carve_tt(a, bus, c);
    return bus;
}

size_t cw_bus_size(const cw_bus_config *config)
{
    arena a = {.base = NULL};
    if (!cw_bus_is_valid(config))
        return 0;
    (void)lay_out(&a, config);
    return a.state + a.room;
}

/* Makes the controller of a node, off the bus, and its times. */
static void init_node(cw_bus *bus, unsigned i, const cw_node_config *c)
{
    cw_bus_node *n = &bus->nodes[i];
    const bool fd = (c->protocol & CW_PROTOCOL_MASK) == CW_FD;
    cw_mac_init(&n->mac, c->modes, c->warning_limit);
    n->mac.tells_won = true;
    (void)cw_mac_set_protocol(&n->mac, c->protocol, fd ? &bus->fd_parts[1 + i] : NULL);
    n->queue_limit = c->queue;
    if (c->protocol & CW_PROTOCOL_2_0A)
        bus->old |= cw_node_bit(i);
    (void)cw_mac_set_variants(&n->mac, c->variants);
    bus->strict |= n->mac.no_long_dlc ? cw_node_bit(i) : 0;
    bus->silent |= c->variants & CW_VARIANT_SILENT_PASSIVE ? cw_node_bit(i) : 0;
    bus->formats_differ = bus->fd || bus->old || bus->strict;
    bus->restarts[i] = (cw_restart_times){.ticks = c->restart_ticks, .at = CW_NEVER};
    if (!bus->lean)
        bus->sleeps[i] = (cw_sleep){.settings = c->sleep, .awake_at = CW_NEVER};
}

cw_bus *cw_bus_init(void *memory, const cw_bus_config *config)
{
    if (!cw_bus_is_valid(config))
        return NULL;
    assert(memory);
    arena sizes = {.base = NULL};
    (void)lay_out(&sizes, config);
    arena a = {.base = memory, .behind = sizes.state};
    cw_bus *bus = lay_out(&a, config);
    bus->state_size = a.state;
    bus->size = a.state + a.room;
    bus->time = cw_wire_begin(cw_rate_of(config->bit_ticks));
    bus->node_count = config->node_count;
    bus->all = UINT64_MAX >> (CW_NODES_MAX - config->node_count);
    bus->node_due = CW_NEVER;
    bus->groups[0] = UINT64_MAX;
    bus->group_count = 1;
    bus->start_at_tick = config->start_at_tick;
    bus->error_at = CW_NEVER;
    bus->wanted = CW_EVENTS_USUAL;
    bus->frame_step.after_ack = CW_AFTER_ACK_BITS; /* other ones only on a bus with FD */
    cw_load_init(&bus->load, cw_wire_rate(&bus->time),
                 bus->timed.rates || config->start_at_tick);
    cw_arbiter_init(&bus->arbiter, config->node_count);
    for (unsigned i = 0; i < config->node_count; i++)
        init_node(bus, i, &config->nodes[i]);
    cw_init_timing(bus, config);
    cw_link_rules(bus, config->seed);
    cw_ring_find_enough(bus);
    for (unsigned i = 0; bus->tt && i < config->node_count; i++)
        cw_tt_start(bus, i);
    for (unsigned i = 0; i < config->rule_count; i++) {
        unsigned index;
        if (cw_bus_add_rule(bus, &index, &config->rules[i]) != CW_OK)
            return NULL;
    }
    for (unsigned i = 0; i < config->node_count; i++)
        if (config->nodes[i].sleeps) {
            cw_sleep_request(bus, i);
            bus->pending = true;
        }
    return bus;
}
