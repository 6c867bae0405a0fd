/* SPDX-License-Identifier: MIT
 *
 * bus.c - up to 64 controllers on one wire, in ticks: hand-in, arbitration by the wired-AND, faults,
 * events and statistics.
 *
 * Time goes on from the end of one bit to the end of the next. In each bit all nodes drive, frames
 * handed in meanwhile go to their queues, then all nodes sample; so the order of the nodes cannot
 * matter but for the order of events. While nothing is on the wire and nobody wants to send, bits
 * are skipped in one go.
 */
#include "canwire.h"

#include "codec.h"
#include "fault.h"
#include "mac.h"
#include "queue.h"
#include "stats.h"

#include <assert.h>
#include <string.h>

/* Events that one node can have in one bit besides drops of frames it has queued. */
#define EVENTS_PER_NODE 8u

typedef struct bus_node {
    cw_mac mac;
    cw_queue queue;
    uint64_t restart_ticks;
    uint64_t restart_at;   /* tick of the next restart request, or CW_NEVER */
    uint16_t offered_slot; /* valid while mac.offered */
    cw_node_stats stats;
} bus_node;

typedef struct inbox_entry {
    uint64_t at_tick;
    uint8_t node;
    cw_frame frame;
} inbox_entry;

/* A ring, sorted by tick, then node, then arrival. */
typedef struct inbox {
    inbox_entry *entries;
    unsigned capacity;
    unsigned first;
    unsigned count;
} inbox;

typedef struct event_ring {
    cw_event *events;
    unsigned capacity;
    unsigned first;
    unsigned count;
} event_ring;

/* The first flag of one kind since the last own SOF of anybody. */
typedef struct flag_watch {
    bool now;        /* some node is in such a flag in the present bit */
    bool over;       /* the first flag of this attempt has ended */
    uint64_t length; /* bits of it so far, the present one not included */
} flag_watch;

struct cw_bus {
    uint32_t bit_ticks;
    unsigned node_count;
    unsigned rule_count;
    uint64_t now;
    uint64_t next_restart; /* the earliest restart_at */
    uint64_t recessive_bits;
    uint64_t queued;       /* frames in all queues */
    flag_watch error_flag;
    flag_watch overload_flag;
    cw_load load;
    cw_bus_stats stats;
    inbox inbox;
    event_ring ring;
    bus_node *nodes;
    const cw_mac **macs;
    cw_fault *faults;
};

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool node_config_valid(const cw_node_config *c)
{
    return c->queue >= 1 && c->queue <= CW_QUEUE_MAX && c->warning_limit >= 1 &&
           c->warning_limit <= 255;
}

static bool config_valid(const cw_bus_config *c)
{
    if (c->bit_ticks == 0 || c->node_count == 0 || c->node_count > CW_NODES_MAX || c->inbox == 0 ||
        c->rule_count > CW_RULES_MAX)
        return false;
    for (unsigned i = 0; i < c->node_count; i++)
        if (!node_config_valid(&c->nodes[i]))
            return false;
    return true;
}

/* Where things lie in the caller's memory. With base NULL only the size is counted. */
typedef struct arena {
    unsigned char *base;
    size_t used;
} arena;

static void *carve(arena *a, size_t count, size_t size)
{
    size_t offset = a->used;
    a->used += (count * size + 15) & ~(size_t)15;
    return a->base ? a->base + offset : NULL;
}

static unsigned least_events(const cw_bus_config *c)
{
    unsigned events = c->node_count * EVENTS_PER_NODE + c->rule_count + c->inbox;
    for (unsigned i = 0; i < c->node_count; i++)
        events += c->nodes[i].queue;
    return events;
}

static void carve_queues(arena *a, bus_node *nodes, const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++) {
        uint16_t capacity = c->nodes[i].queue;
        cw_queue_slot *slots = carve(a, capacity, sizeof *slots);
        uint16_t *order = carve(a, capacity, sizeof *order);
        if (nodes)
            cw_queue_init(&nodes[i].queue, slots, order, capacity, c->nodes[i].order);
    }
}

static cw_bus *lay_out(arena *a, const cw_bus_config *c)
{
    cw_bus *bus = carve(a, 1, sizeof *bus);
    bus_node *nodes = carve(a, c->node_count, sizeof *nodes);
    const cw_mac **macs = carve(a, c->node_count, sizeof(const cw_mac *));
    cw_fault *faults = carve(a, c->rule_count, sizeof *faults);
    inbox_entry *entries = carve(a, c->inbox, sizeof *entries);
    unsigned events = c->events > least_events(c) ? c->events : least_events(c);
    cw_event *ring = carve(a, events, sizeof *ring);
    if (bus) {
        memset(bus, 0, sizeof *bus);
        memset(nodes, 0, c->node_count * sizeof *nodes);
        bus->nodes = nodes;
        bus->macs = macs;
        bus->faults = faults;
        bus->inbox = (inbox){.entries = entries, .capacity = c->inbox};
        bus->ring = (event_ring){.events = ring, .capacity = events};
    }
    carve_queues(a, nodes, c);
    return bus;
}

size_t cw_bus_size(const cw_bus_config *config)
{
    arena a = {.base = NULL};
    if (!config_valid(config))
        return 0;
    (void)lay_out(&a, config);
    return a.used;
}

cw_bus *cw_bus_init(void *memory, const cw_bus_config *config)
{
    if (!config_valid(config))
        return NULL;
    arena a = {.base = memory};
    cw_bus *bus = lay_out(&a, config);
    bus->bit_ticks = config->bit_ticks;
    bus->node_count = config->node_count;
    bus->rule_count = config->rule_count;
    bus->next_restart = CW_NEVER;
    cw_load_init(&bus->load, config->bit_ticks);
    for (unsigned i = 0; i < config->node_count; i++) {
        const cw_node_config *c = &config->nodes[i];
        cw_mac_init(&bus->nodes[i].mac, c->modes, c->warning_limit);
        bus->nodes[i].restart_ticks = c->restart_ticks;
        bus->nodes[i].restart_at = CW_NEVER;
        bus->macs[i] = &bus->nodes[i].mac;
    }
    for (unsigned i = 0; i < config->rule_count; i++)
        cw_fault_init(&bus->faults[i], &config->rules[i], config->seed);
    return bus;
}

/* ---- Events ---------------------------------------------------------------------------------- */

static uint64_t node_bit(unsigned i)
{
    return UINT64_C(1) << i;
}

/* Whether the worst that can happen up to the end of the next bit fits. */
static bool has_room(const cw_bus *bus)
{
    uint64_t worst = (uint64_t)bus->node_count * EVENTS_PER_NODE + bus->rule_count +
                     bus->inbox.count + bus->queued;
    return bus->ring.capacity - bus->ring.count >= worst;
}

static cw_event *newest_event(event_ring *ring)
{
    return &ring->events[(ring->first + ring->count - 1) % ring->capacity];
}

static cw_event *push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes)
{
    event_ring *ring = &bus->ring;
    assert(ring->count < ring->capacity);
    ring->count++;
    cw_event *e = newest_event(ring);
    memset(e, 0, sizeof *e);
    e->kind = kind;
    e->tick = tick;
    e->nodes = nodes;
    return e;
}

static cw_event *push_node_event(cw_bus *bus, cw_event_kind kind, unsigned i)
{
    cw_event *e = push_event(bus, kind, bus->now, node_bit(i));
    e->tec = bus->nodes[i].mac.confinement.tec;
    e->rec = bus->nodes[i].mac.confinement.rec;
    return e;
}

bool cw_bus_poll(cw_bus *bus, cw_event *event)
{
    event_ring *ring = &bus->ring;
    if (ring->count == 0)
        return false;
    *event = ring->events[ring->first];
    ring->first = (ring->first + 1) % ring->capacity;
    ring->count--;
    return true;
}

/* ---- Hand-in --------------------------------------------------------------------------------- */

static inbox_entry *inbox_at(const inbox *box, unsigned i)
{
    return &box->entries[(box->first + i) % box->capacity];
}

static bool comes_after(const inbox_entry *a, uint64_t at_tick, unsigned node)
{
    return a->at_tick > at_tick || (a->at_tick == at_tick && a->node > node);
}

cw_status cw_node_send(cw_bus *bus, unsigned i, const cw_frame *frame, uint64_t at_tick)
{
    inbox *box = &bus->inbox;
    if (i >= bus->node_count)
        return CW_INVALID;
    if (box->count == box->capacity)
        return CW_FULL;
    if (at_tick < bus->now)
        at_tick = bus->now;
    unsigned place = box->count++;
    for (; place > 0 && comes_after(inbox_at(box, place - 1), at_tick, i); place--)
        *inbox_at(box, place) = *inbox_at(box, place - 1);
    *inbox_at(box, place) = (inbox_entry){.at_tick = at_tick, .node = (uint8_t)i, .frame = *frame};
    return CW_OK;
}

uint64_t cw_bus_inbox_first(const cw_bus *bus)
{
    return bus->inbox.count ? inbox_at(&bus->inbox, 0)->at_tick : CW_NEVER;
}

static void drop(cw_bus *bus, unsigned i, const cw_frame *frame, cw_drop why, uint64_t tick)
{
    cw_event *e = push_event(bus, CW_EVENT_DROP, tick, node_bit(i));
    e->why = why;
    e->frame = *frame;
    bus->nodes[i].stats.dropped[why]++;
}

static void take_in(cw_bus *bus, const inbox_entry *entry)
{
    bus_node *n = &bus->nodes[entry->node];
    n->stats.handed_in++;
    if (!cw_frame_valid(&entry->frame))
        drop(bus, entry->node, &entry->frame, CW_DROP_BAD_FRAME, entry->at_tick);
    else if (n->mac.modes & CW_MODE_LISTEN_ONLY)
        drop(bus, entry->node, &entry->frame, CW_DROP_LISTEN_ONLY, entry->at_tick);
    else if (cw_mac_state(&n->mac) == CW_STATE_BUS_OFF)
        drop(bus, entry->node, &entry->frame, CW_DROP_BUS_OFF, entry->at_tick);
    else if (!cw_queue_put(&n->queue, &entry->frame, entry->at_tick))
        drop(bus, entry->node, &entry->frame, CW_DROP_QUEUE_FULL, entry->at_tick);
    else
        bus->queued++;
    if (n->queue.count > n->stats.queue_peak)
        n->stats.queue_peak = n->queue.count;
}

static void take_first(cw_bus *bus)
{
    inbox *box = &bus->inbox;
    take_in(bus, inbox_at(box, 0));
    box->first = (box->first + 1) % box->capacity;
    box->count--;
}

static void remove_slot(cw_bus *bus, bus_node *n, uint16_t slot)
{
    cw_queue_remove(&n->queue, slot);
    bus->queued--;
}

/* ---- Restart (R12) --------------------------------------------------------------------------- */

static void schedule_restart(cw_bus *bus, bus_node *n, uint64_t tick)
{
    n->restart_at = tick;
    if (tick < bus->next_restart)
        bus->next_restart = tick;
}

cw_status cw_node_restart(cw_bus *bus, unsigned i)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    bus_node *n = &bus->nodes[i];
    if (n->mac.phase != CW_MAC_BUS_OFF || n->restart_ticks != 0 || n->restart_at != CW_NEVER)
        return CW_REFUSED;
    schedule_restart(bus, n, bus->now);
    return CW_OK;
}

static void restart(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    n->restart_at = CW_NEVER;
    while (n->queue.count > 0) {
        uint16_t slot = cw_queue_first(&n->queue);
        drop(bus, i, &n->queue.slots[slot].frame, CW_DROP_BUS_OFF, bus->now);
        remove_slot(bus, n, slot);
    }
    if (cw_mac_request_restart(&n->mac) == CW_OK) {
        n->stats.restarts++;
        (void)push_node_event(bus, CW_EVENT_RESTART, i);
    }
}

static void find_next_restart(cw_bus *bus)
{
    bus->next_restart = CW_NEVER;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (bus->nodes[i].restart_at < bus->next_restart)
            bus->next_restart = bus->nodes[i].restart_at;
}

/* What is due for a node now: its frames that were handed in, its restart. */
static void run_due(cw_bus *bus, unsigned i)
{
    while (bus->inbox.count && inbox_at(&bus->inbox, 0)->at_tick <= bus->now &&
           inbox_at(&bus->inbox, 0)->node == i)
        take_first(bus);
    if (bus->nodes[i].restart_at <= bus->now)
        restart(bus, i);
}

static bool anything_due(const cw_bus *bus)
{
    return cw_bus_inbox_first(bus) <= bus->now || bus->next_restart <= bus->now;
}

static void run_all_due(cw_bus *bus)
{
    if (!anything_due(bus))
        return;
    for (unsigned i = 0; i < bus->node_count; i++)
        run_due(bus, i);
    find_next_restart(bus);
}

/* ---- One bit: drive -------------------------------------------------------------------------- */

/* The frame is chosen anew at each start (M1), but encoded only when it is another one. */
static void offer_first(bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (n->mac.offered && n->offered_slot == slot)
        return;
    n->offered_slot = slot;
    cw_status status = cw_mac_offer(&n->mac, &n->queue.slots[slot].frame);
    assert(status == CW_OK);
    (void)status;
}

static void note_start(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    if (slot->attempts++ > 0)
        n->stats.retransmissions++;
    for (unsigned r = 0; r < bus->rule_count; r++)
        cw_fault_bind(&bus->faults[r], i, &slot->frame);
    bus->error_flag = (flag_watch){.now = false};
    bus->overload_flag = (flag_watch){.now = false};
}

/* The wired-AND of all nodes. */
static bool drive_all(cw_bus *bus)
{
    bool wire = CW_RECESSIVE;
    for (unsigned i = 0; i < bus->node_count; i++) {
        bus_node *n = &bus->nodes[i];
        if (n->queue.count > 0 && cw_mac_can_start(&n->mac))
            offer_first(n);
        wire = cw_mac_drive(&n->mac) && wire;
        if (n->mac.started)
            note_start(bus, i);
    }
    return wire;
}

/* ---- One bit: what is on the wire, faults ---------------------------------------------------- */

static void watch_flag(flag_watch *w, bool now, uint64_t *frames)
{
    if (now && !w->now)
        (*frames)++;
    if (w->now) {
        w->length++;
        w->over = w->over || !now;
    }
    w->now = now;
}

/* Load and flags, by what the nodes are doing in this bit. */
static void watch_wire(cw_bus *bus)
{
    bool busy = false;
    bool error = false;
    bool overload = false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_mac *m = bus->macs[i];
        busy = busy || cw_mac_is_busy(m);
        error = error || m->phase == CW_MAC_ERROR_ACTIVE || m->phase == CW_MAC_ERROR_PASSIVE;
        overload = overload || m->phase == CW_MAC_OVERLOAD_FLAG;
    }
    watch_flag(&bus->error_flag, error, &bus->stats.error_frames);
    watch_flag(&bus->overload_flag, overload, &bus->stats.overload_frames);
    bus->stats.busy_bits += busy;
    cw_load_add(&bus->load, 1, busy);
}

static uint64_t flag_bit(const flag_watch *w)
{
    return w->now && !w->over ? w->length : CW_NEVER;
}

static cw_disturbance run_faults(cw_bus *bus, bool wire)
{
    cw_disturbance out = {.wire = false, .nodes = 0};
    const cw_bit_context context = {
        .macs = bus->macs,
        .node_count = bus->node_count,
        .start_tick = bus->now,
        .wire = wire,
        .error_flag_bit = flag_bit(&bus->error_flag),
        .overload_flag_bit = flag_bit(&bus->overload_flag),
    };
    for (unsigned r = 0; r < bus->rule_count; r++)
        if (cw_fault_is_awake(&bus->faults[r]))
            cw_fault_apply(&bus->faults[r], &out, &context);
    return out;
}

static void emit_faults(cw_bus *bus)
{
    for (unsigned r = 0; r < bus->rule_count; r++) {
        cw_fault *fault = &bus->faults[r];
        if (!fault->hit_now)
            continue;
        fault->hit_now = false;
        bus->stats.faults++;
        cw_event *e = push_event(bus, CW_EVENT_FAULT, bus->now, 0);
        e->rule = (uint16_t)r;
        e->hit = (uint32_t)fault->hits;
    }
}

/* ---- One bit: what the nodes report ---------------------------------------------------------- */

/* The frame that a report is about has left the queue, or will be tried again. */
static void settle_frame(cw_bus *bus, unsigned i, const cw_mac_report *r, cw_frame *about)
{
    const unsigned own = CW_REPORT_ARBITRATION_LOST | CW_REPORT_TX | CW_REPORT_DROPPED;
    bus_node *n = &bus->nodes[i];
    if (!(r->what & own))
        return;
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    *about = slot->frame;
    if (r->what & CW_REPORT_TX) {
        n->stats.tx_frames++;
        n->stats.tx_bytes += cw_frame_length(about);
        n->stats.tx_bits += n->mac.tx.length;
        bus->stats.frames++;
        bus->stats.frame_bits += n->mac.tx.length;
        cw_delay_add(&n->stats.delay, bus->now - slot->handed_in);
    }
    if (r->what & (CW_REPORT_TX | CW_REPORT_DROPPED))
        remove_slot(bus, n, n->offered_slot);
    if (r->what & CW_REPORT_DROPPED)
        drop(bus, i, about, CW_DROP_ONE_SHOT, bus->now);
}

static void report_arbitration_lost(cw_bus *bus, unsigned i, uint8_t bit, const cw_frame *frame)
{
    cw_event *e = push_node_event(bus, CW_EVENT_ARBITRATION_LOST, i);
    e->lost_bit = bit;
    e->frame = *frame;
    bus->nodes[i].stats.arbitration_lost++;
    bus->stats.arbitration_lost++;
}

/* A frame accepted with a content that none of its transmitters sent (section 6 of the digest). */
static bool is_corrupted(const cw_bus *bus, const cw_frame *frame)
{
    bool sent = false;
    for (unsigned i = 0; i < bus->node_count; i++) {
        const bus_node *n = &bus->nodes[i];
        if (!cw_mac_is_sending(&n->mac) || (n->mac.modes & CW_MODE_LOOPBACK))
            continue;
        if (cw_frame_equal(&n->queue.slots[n->offered_slot].frame, frame))
            return false;
        sent = true;
    }
    return sent;
}

/* Nodes that receive the same frame in the same bit share one event, as long as no other event
 * comes between them. */
static void report_rx(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    const cw_frame *frame = cw_mac_received(&n->mac);
    n->stats.rx_frames++;
    n->stats.rx_bytes += cw_frame_length(frame);
    if (!(n->mac.modes & CW_MODE_LOOPBACK) && is_corrupted(bus, frame)) {
        n->stats.undetected_errors++;
        bus->stats.undetected_errors++;
    }
    cw_event *e = bus->ring.count ? newest_event(&bus->ring) : NULL;
    if (e && e->kind == CW_EVENT_RX && e->tick == bus->now && cw_frame_equal(&e->frame, frame))
        e->nodes |= node_bit(i);
    else
        push_node_event(bus, CW_EVENT_RX, i)->frame = *frame;
}

static void report_state(cw_bus *bus, unsigned i, cw_state before)
{
    bus_node *n = &bus->nodes[i];
    cw_state after = cw_mac_state(&n->mac);
    cw_event *e = push_node_event(bus, CW_EVENT_STATE, i);
    e->state = after;
    e->state_before = before;
    if (before < CW_STATE_ERROR_WARNING && after == CW_STATE_ERROR_WARNING)
        n->stats.error_warning++;
    if (before < CW_STATE_ERROR_PASSIVE && after == CW_STATE_ERROR_PASSIVE)
        n->stats.error_passive++;
    if (after != CW_STATE_BUS_OFF)
        return;
    n->stats.bus_off++;
    if (n->restart_ticks)
        schedule_restart(bus, n, bus->now + n->restart_ticks);
}

/* Events of one node at the end of a bit, in the order of cw_event_kind. */
static void settle_node(cw_bus *bus, unsigned i, const cw_mac_report *r, cw_state before)
{
    bus_node *n = &bus->nodes[i];
    cw_frame about = {.id = 0};
    settle_frame(bus, i, r, &about);
    run_due(bus, i);
    if (r->what & CW_REPORT_ARBITRATION_LOST)
        report_arbitration_lost(bus, i, r->lost_bit, &about);
    if (r->what & CW_REPORT_ERROR) {
        push_node_event(bus, CW_EVENT_ERROR, i)->error = r->error;
        n->stats.errors[r->error.type]++;
    }
    if (r->what & CW_REPORT_TOLERATED)
        push_node_event(bus, CW_EVENT_TOLERATED, i)->error = r->error;
    if (r->what & CW_REPORT_OVERLOAD) {
        (void)push_node_event(bus, CW_EVENT_OVERLOAD, i);
        n->stats.overloads++;
    }
    if (r->what & CW_REPORT_RX)
        report_rx(bus, i);
    if (r->what & CW_REPORT_TX)
        push_node_event(bus, CW_EVENT_TX, i)->frame = about;
    if (r->what & CW_REPORT_STATE)
        report_state(bus, i, before);
}

/* ---- One bit --------------------------------------------------------------------------------- */

/* Returns whether there is anything to settle. */
static bool sample_all(cw_bus *bus, bool wire, const cw_disturbance *disturbance,
                       cw_mac_report *reports, cw_state *before)
{
    unsigned what = 0;
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_mac *m = &bus->nodes[i].mac;
        bool inverted = disturbance->nodes >> i & 1u;
        before[i] = (cw_state)m->told_state;
        cw_mac_sample(m, wire != inverted, &reports[i]);
        what |= reports[i].what;
    }
    return what & ~CW_REPORT_STARTED;
}

static void end_bit(cw_bus *bus, bool wire)
{
    bus->now += bus->bit_ticks;
    bus->stats.bits++;
    bus->recessive_bits = wire ? bus->recessive_bits + 1 : 0;
}

static void step(cw_bus *bus)
{
    cw_mac_report reports[CW_NODES_MAX];
    cw_state before[CW_NODES_MAX];
    bool wire = drive_all(bus);
    watch_wire(bus);
    cw_disturbance disturbance = {.wire = false};
    if (bus->rule_count)
        disturbance = run_faults(bus, wire);
    while (cw_bus_inbox_first(bus) < bus->now + bus->bit_ticks)
        take_first(bus);
    wire = wire != disturbance.wire;
    bool news = sample_all(bus, wire, &disturbance, reports, before);
    end_bit(bus, wire);
    if (bus->rule_count)
        emit_faults(bus);
    if (!news)
        return;
    for (unsigned i = 0; i < bus->node_count; i++)
        settle_node(bus, i, &reports[i], before[i]);
}

/* ---- Idle time ------------------------------------------------------------------------------- */

/* Whole bits between two ticks, rounded up or down. */
static uint64_t bits_between(const cw_bus *bus, uint64_t from, uint64_t to, bool up)
{
    if (to == CW_NEVER)
        return CW_QUIET_FOREVER;
    uint64_t ticks = to > from ? to - from : 0;
    return ticks / bus->bit_ticks + (up && ticks % bus->bit_ticks != 0);
}

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static bool faults_asleep(const cw_bus *bus)
{
    for (unsigned r = 0; r < bus->rule_count; r++)
        if (cw_fault_is_awake(&bus->faults[r]))
            return false;
    return true;
}

/* Bits that can be skipped now: nobody drives or reports anything, nothing comes in. */
static uint64_t quiet_bits(const cw_bus *bus, uint64_t tick)
{
    uint64_t bits = bits_between(bus, bus->now, tick, false);
    bits = least(bits, bits_between(bus, bus->now, cw_bus_inbox_first(bus), false));
    bits = least(bits, bits_between(bus, bus->now, bus->next_restart, true));
    for (unsigned i = 0; bits > 0 && i < bus->node_count; i++) {
        const bus_node *n = &bus->nodes[i];
        if (n->queue.count > 0 && cw_mac_can_start(&n->mac))
            return 0;
        bits = least(bits, cw_mac_quiet_bits(&n->mac));
    }
    return bits > 0 && faults_asleep(bus) ? bits : 0;
}

static void skip(cw_bus *bus, uint64_t bits)
{
    for (unsigned i = 0; i < bus->node_count; i++)
        cw_mac_skip(&bus->nodes[i].mac, bits);
    bus->error_flag.now = false;
    bus->overload_flag.now = false;
    bus->now += bits * bus->bit_ticks;
    bus->stats.bits += bits;
    bus->recessive_bits += bits;
    cw_load_add(&bus->load, bits, false);
}

cw_status cw_bus_advance(cw_bus *bus, uint64_t tick)
{
    for (;;) {
        if (!has_room(bus))
            return CW_FULL;
        run_all_due(bus);
        if (tick < bus->now || tick - bus->now < bus->bit_ticks)
            return CW_OK;
        uint64_t bits = quiet_bits(bus, tick);
        if (bits > 0)
            skip(bus, bits);
        else
            step(bus);
    }
}

/* ---- Reading --------------------------------------------------------------------------------- */

uint64_t cw_bus_now(const cw_bus *bus)
{
    return bus->now;
}

uint64_t cw_bus_recessive_bits(const cw_bus *bus)
{
    return bus->recessive_bits;
}

size_t cw_bus_pending(const cw_bus *bus)
{
    return bus->queued + bus->inbox.count;
}

bool cw_bus_idle(const cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++)
        if (cw_mac_is_busy(bus->macs[i]))
            return false;
    return true;
}

/* When nobody knows when a frame or a flag ends, look again after this many bits. */
#define LOOK_AGAIN_BITS 6u

uint64_t cw_bus_next(const cw_bus *bus)
{
    uint64_t bits = CW_QUIET_FOREVER;
    for (unsigned i = 0; i < bus->node_count; i++)
        bits = least(bits, cw_mac_horizon(bus->macs[i], bus->nodes[i].queue.count > 0));
    if (bits == CW_QUIET_FOREVER && !cw_bus_idle(bus))
        bits = LOOK_AGAIN_BITS;
    uint64_t tick = bits == CW_QUIET_FOREVER ? CW_NEVER : bus->now + bits * bus->bit_ticks;
    return least(tick, least(cw_bus_inbox_first(bus), bus->next_restart));
}

void cw_bus_get_stats(const cw_bus *bus, cw_bus_stats *stats)
{
    *stats = bus->stats;
    stats->ticks = bus->now;
    stats->pending = (uint32_t)bus->queued;
    stats->load_permille = (uint16_t)cw_load_second_permille(&bus->load);
}

cw_status cw_node_get_stats(const cw_bus *bus, unsigned i, cw_node_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    const bus_node *n = &bus->nodes[i];
    *stats = n->stats;
    stats->queue = n->queue.count;
    stats->tec = n->mac.confinement.tec;
    stats->rec = n->mac.confinement.rec;
    stats->state = cw_mac_state(&n->mac);
    return CW_OK;
}

cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats)
{
    if (rule >= bus->rule_count)
        return CW_INVALID;
    stats->matches = bus->faults[rule].matches;
    stats->hits = bus->faults[rule].hits;
    return CW_OK;
}
