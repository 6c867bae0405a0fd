/* SPDX-License-Identifier: MIT
 *
 * bus.c - up to 64 controllers on one wire, in ticks.
 *
 * Time goes on from the end of one bit to the end of the next. In each bit all nodes drive, frames
 * handed in meanwhile go to their queues, then all nodes sample; so the order of the nodes cannot
 * matter but for the order of events. Bits in which the wire keeps its level and no controller has
 * anything to tell, on an idle bus or in a flag or delimiter, are skipped in one go.
 */
#include "bus_private.h"

#include "format/layout.h"

#include <assert.h>
#include <string.h>

/* ---- Set-up ---------------------------------------------------------------------------------- */

static bool node_config_valid(const cw_node_config *c)
{
    return c->queue >= 1 && c->queue <= CW_QUEUE_MAX && c->queue_room <= CW_QUEUE_MAX &&
           c->warning_limit >= 1 && c->warning_limit <= 255;
}

static bool config_valid(const cw_bus_config *c)
{
    if (c->bit_ticks == 0 || c->node_count == 0 || c->node_count > CW_NODES_MAX || c->inbox == 0 ||
        (unsigned)c->rule_count + c->rule_room > CW_RULES_MAX)
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

uint16_t cw_queue_room(const cw_bus_config *c, unsigned node)
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
    return room;
}

static void carve_queues(arena *a, bus_node *nodes, const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++) {
        uint16_t capacity = cw_queue_room(c, i);
        cw_queue_slot *slots = carve(a, capacity, sizeof *slots);
        cw_queue_place *order = carve(a, capacity, sizeof *order);
        if (nodes)
            cw_queue_init(&nodes[i].queue, slots, order, capacity, c->nodes[i].order);
    }
}

static void carve_faults(arena *a, cw_fault_set *set, const cw_bus_config *c)
{
    size_t capacity = (size_t)c->rule_count + c->rule_room;
    cw_fault *faults = carve(a, capacity, sizeof *faults);
    cw_fault_key *exact = carve(a, capacity, sizeof *exact);
    uint16_t *wild = carve(a, capacity, sizeof *wild);
    uint16_t *awake = carve(a, capacity, sizeof *awake);
    if (set)
        *set = (cw_fault_set){.faults = faults, .exact = exact, .wild = wild, .awake = awake,
                              .capacity = (unsigned)capacity, .stale = true,
                              .next_due = CW_NEVER};
}

static cw_bus *lay_out(arena *a, const cw_bus_config *c)
{
    unsigned events = c->events > cw_ring_least(c) ? c->events : cw_ring_least(c);
    cw_bus *bus = carve(a, 1, sizeof *bus);
    bus_node *nodes = carve(a, c->node_count, sizeof *nodes);
    inbox_entry *entries = carve(a, c->inbox, sizeof *entries);
    held_frame *held = carve(a, CW_HELD_FRAMES, sizeof *held);
    cw_event *ring = carve(a, events, sizeof *ring);
    if (bus) {
        memset(bus, 0, sizeof *bus);
        memset(nodes, 0, c->node_count * sizeof *nodes);
        bus->nodes = nodes;
        bus->held = held;
        bus->inbox = (inbox){.entries = entries, .capacity = c->inbox};
        bus->ring = (event_ring){.events = ring, .capacity = events};
    }
    carve_faults(a, bus ? &bus->faults : NULL, c);
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

static void init_node(bus_node *n, const cw_node_config *c)
{
    cw_mac_init(&n->mac, c->modes, c->warning_limit);
    n->restart_ticks = c->restart_ticks;
    n->restart_at = CW_NEVER;
    n->queue_limit = c->queue;
}

cw_bus *cw_bus_init(void *memory, const cw_bus_config *config)
{
    if (!config_valid(config))
        return NULL;
    arena a = {.base = memory};
    cw_bus *bus = lay_out(&a, config);
    bus->time = cw_wire_begin(cw_rate_of(config->bit_ticks));
    bus->node_count = config->node_count;
    bus->all = UINT64_MAX >> (CW_NODES_MAX - config->node_count);
    bus->seed = config->seed;
    bus->next_restart = CW_NEVER;
    bus->groups[0] = UINT64_MAX;
    bus->group_count = 1;
    bus->wanted = UINT32_MAX;
    cw_load_init(&bus->load, cw_wire_rate(&bus->time));
    cw_contest_init(&bus->contest, config->node_count);
    for (unsigned i = 0; i < config->node_count; i++)
        init_node(&bus->nodes[i], &config->nodes[i]);
    cw_ring_find_enough(bus);
    for (unsigned i = 0; i < config->rule_count; i++) {
        unsigned index;
        if (cw_bus_add_rule(bus, &index, &config->rules[i]) != CW_OK)
            return NULL;
    }
    return bus;
}

/* ---- What is due ----------------------------------------------------------------------------- */

/* States that rules or settings have changed. */
static void tell_news(cw_bus *bus)
{
    bus->news = false;
    for (unsigned i = 0; i < bus->node_count; i++)
        cw_tell_state(bus, i);
}

static void run_due_nodes(cw_bus *bus)
{
    if (bus->next_restart > cw_now(bus)) {
        cw_take_inbox_before(bus, cw_now(bus) + 1); /* sorted by node, too */
        return;
    }
    for (unsigned i = 0; i < bus->node_count; i++)
        cw_run_due_node(bus, i);
    /* behind cw_bus_bring_forward() nodes have no order */
    cw_take_inbox_before(bus, cw_now(bus) + 1);
    cw_find_next_restart(bus);
}

/* Rules may set each other off, but at a tick each one acts only once by that: this ends. When it
 * has, nothing is left to be told of this tick. A leap goes on when nothing but frames come. */
static void run_due(cw_bus *bus)
{
    do {
        bus->work += bus->faults.awake_count;
        if (bus->news || bus->faults.next_due <= cw_now(bus) || bus->next_restart <= cw_now(bus))
            cw_leap_end(bus);
        cw_fault_run_due(bus);
        run_due_nodes(bus);
        if (bus->news)
            tell_news(bus);
    } while (bus->news || bus->faults.next_due <= cw_now(bus));
}

static void run_all_due(cw_bus *bus)
{
    uint64_t due = cw_least(cw_least(bus->next_restart, bus->faults.next_due), cw_inbox_first(bus));
    if (due <= cw_now(bus) || bus->news || bus->faults.awake_count)
        run_due(bus);
}

/* ---- One bit: drive -------------------------------------------------------------------------- */

/* The frame is chosen anew at each start (M1), but encoded only when it is another one. */
void cw_offer_first(bus_node *n)
{
    uint16_t slot = cw_queue_first(&n->queue);
    if (!n->mac.offered || n->offered_slot != slot)
        cw_offer_slot(n, slot);
}

void cw_offer_slot(bus_node *n, uint16_t slot)
{
    n->offered_slot = slot;
    n->wrong_crc = false;
    cw_status status = cw_mac_offer(&n->mac, &n->queue.slots[slot].frame);
    assert(status == CW_OK);
    (void)status;
}

static void note_start(cw_bus *bus, unsigned i)
{
    bus_node *n = &bus->nodes[i];
    cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    cw_share_lost(bus, i);
    n->stats.retransmissions += slot->tried;
    slot->tried = true;
    if (n->mac.modes & CW_MODE_LOOPBACK) /* M15: nothing of it is on the wire */
        return;
    bus->error_flag = (flag_watch){.now = false};
    bus->overload_flag = (flag_watch){.now = false};
    cw_fault_transmission(bus, i, &slot->frame);
}

/* The levels that all nodes put onto their wires; recessive beyond the last node. */
static uint64_t drive_all(cw_bus *bus)
{
    uint64_t levels = UINT64_MAX;
    if (bus->followers && cw_mac_can_start(&bus->common))
        cw_leave(bus, bus->waiting);
    if (bus->followers && cw_mac_drive(&bus->common) == CW_DOMINANT)
        levels &= ~bus->followers;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bus_node *n = &bus->nodes[i];
        if (n->queue.count > 0 && cw_mac_can_start(&n->mac))
            cw_offer_first(n);
        if (cw_mac_drive(&n->mac) == CW_DOMINANT)
            levels &= ~cw_node_bit(i);
        if (n->mac.started)
            note_start(bus, i);
    }
    return levels;
}

/* The wired-AND of each wire, as its nodes see it. */
static uint64_t wired_and(const cw_bus *bus, uint64_t driven)
{
    uint64_t levels = UINT64_MAX;
    for (unsigned g = 0; g < bus->group_count; g++)
        if ((driven & bus->groups[g]) != bus->groups[g])
            levels &= ~bus->groups[g];
    return levels;
}

/* ---- One bit: what is on the wire ------------------------------------------------------------ */

/* A flag that is there, or not, in so many bits; in none that are skipped it begins or ends. */
static void watch_flag(flag_watch *w, bool now, uint64_t bits, uint64_t *frames)
{
    if (now && !w->now)
        (*frames)++;
    if (w->now) {
        w->length++;
        w->over = w->over || !now;
    }
    w->now = now;
    if (now)
        w->length += bits - 1;
}

#define WIRE_BUSY 0x1u
#define WIRE_ERROR 0x2u    /* an error flag */
#define WIRE_OVERLOAD 0x4u /* an overload flag */

/* What a node is doing to the wire. Nothing of one in loopback is there, nor are the flags of one
 * that only listens (M11, M15). */
static unsigned view_mac(const cw_mac *m)
{
    static const uint8_t views[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_FRAME] = WIRE_BUSY,
        [CW_MAC_ERROR_ACTIVE] = WIRE_BUSY | WIRE_ERROR,
        [CW_MAC_ERROR_PASSIVE] = WIRE_BUSY | WIRE_ERROR,
        [CW_MAC_ERROR_WAIT] = WIRE_BUSY,
        [CW_MAC_ERROR_DELIMITER] = WIRE_BUSY,
        [CW_MAC_OVERLOAD_FLAG] = WIRE_BUSY | WIRE_OVERLOAD,
        [CW_MAC_OVERLOAD_WAIT] = WIRE_BUSY,
        [CW_MAC_OVERLOAD_DELIMITER] = WIRE_BUSY,
        [CW_MAC_INTERMISSION] = WIRE_BUSY,
    };
    if (m->modes & CW_MODE_LOOPBACK)
        return 0;
    return m->modes & CW_MODE_LISTEN_ONLY ? views[m->phase] & WIRE_BUSY : views[m->phase];
}

/* Load and flags, by what the nodes are doing in this bit and those that are skipped with it. */
static void watch_wire(cw_bus *bus, uint64_t bits)
{
    unsigned view = bus->followers ? view_mac(&bus->common) : 0;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1)
        view |= view_mac(&bus->nodes[cw_lowest_node(rest)].mac);
    watch_flag(&bus->error_flag, view & WIRE_ERROR, bits, &bus->stats.error_frames);
    watch_flag(&bus->overload_flag, view & WIRE_OVERLOAD, bits, &bus->stats.overload_frames);
    bus->stats.busy_bits += view & WIRE_BUSY ? bits : 0;
    cw_load_add(&bus->load, bits, view & WIRE_BUSY);
}

/* ---- One bit --------------------------------------------------------------------------------- */

typedef struct bit_reports {
    uint64_t together; /* nodes for which `common` holds */
    uint64_t news;     /* nodes for which there is something to settle */
    cw_mac_report common;
    cw_mac_report own[CW_NODES_MAX];
} bit_reports;

static void sample_all(cw_bus *bus, uint64_t levels, bit_reports *reports)
{
    cw_split_followers(bus, levels);
    reports->together = bus->followers;
    reports->news = 0;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac_sample(&bus->nodes[i].mac, levels >> i & 1u, &reports->own[i]);
        if (reports->own[i].what & ~CW_REPORT_STARTED)
            reports->news |= cw_node_bit(i);
    }
    if (bus->followers && cw_sample_common(bus, levels, &reports->common))
        reports->news |= reports->together;
}

static void settle(cw_bus *bus, const bit_reports *reports)
{
    bool reception = reports->news == reports->together && reports->common.what == CW_REPORT_RX;
    if (reception && cw_settle_reception(bus))
        return;
    for (uint64_t rest = reports->news; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool together = reports->together >> i & 1u;
        cw_settle_node(bus, i, together ? &reports->common : &reports->own[i]);
    }
}

/* Nodes that have come to where the others are: between frames, or as losers of an arbitration. */
static void gather(cw_bus *bus, const bit_reports *reports)
{
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool lost = !(reports->together >> i & 1u) &&
                    (reports->own[i].what & CW_REPORT_ARBITRATION_LOST);
        if (lost || bus->nodes[i].mac.phase == CW_MAC_IDLE)
            cw_join(bus, i);
    }
}

static void end_bit(cw_bus *bus)
{
    cw_wire_pass(&bus->time, 1);
    bus->stats.bits++;
    bus->recessive_bits = bus->wire ? bus->recessive_bits + 1 : 0;
}

void cw_find_levels(cw_bus *bus, cw_levels *levels)
{
    if (bus->faults.awake_count)
        cw_fault_driven(bus, levels);
    bus->driven = levels->driven;
    levels->clean = levels->wire = levels->sampled = wired_and(bus, levels->driven);
    bus->wire = levels->sampled == UINT64_MAX;
    if (bus->faults.awake_count)
        cw_fault_sampled(bus, levels);
}

static void finish_bit(cw_bus *bus, const cw_levels *levels)
{
    bit_reports reports;
    cw_take_inbox_before(bus, cw_bit_end(bus));
    sample_all(bus, levels->sampled, &reports);
    end_bit(bus);
    if (bus->faults.awake_count)
        cw_fault_emit(bus);
    if (reports.news)
        settle(bus, &reports);
    if (!bus->stepping)
        gather(bus, &reports);
}

static void step(cw_bus *bus)
{
    bus->crowd.valid = false;
    cw_levels levels = {.driven = drive_all(bus)};
    watch_wire(bus, 1);
    cw_find_levels(bus, &levels);
    if (bus->stepping || bus->watching)
        cw_view_note(bus, &levels);
    finish_bit(bus, &levels);
}

void cw_step_with(cw_bus *bus, const cw_levels *levels)
{
    (void)drive_all(bus);
    watch_wire(bus, 1);
    finish_bit(bus, levels);
}

/* ---- Several bits of one level --------------------------------------------------------------- */

/* Whether some node has a frame that it may begin to send in the next bit. */
static bool can_start(const cw_bus *bus)
{
    uint64_t own = bus->waiting & ~bus->followers;
    if (bus->waiting != own && cw_mac_can_start(&bus->common))
        return true;
    for (; own; own &= own - 1)
        if (cw_mac_can_start(&bus->nodes[cw_lowest_node(own)].mac))
            return true;
    return false;
}

/* The level of the wire as long as nobody begins or ends to drive it. */
static bool held_level(const cw_bus *bus)
{
    bool held = bus->followers && cw_mac_holds_wire(&bus->common);
    for (uint64_t rest = bus->all & ~bus->followers; !held && rest; rest &= rest - 1)
        held = cw_mac_holds_wire(&bus->nodes[cw_lowest_node(rest)].mac);
    return held ? CW_DOMINANT : CW_RECESSIVE;
}

/* Bits in which all controllers drive what they do now, and have nothing to report. */
static uint64_t steady_bits(const cw_bus *bus, bool level)
{
    uint64_t bits = CW_QUIET_FOREVER;
    if (bus->group_count > 1 && !level)
        return 0;
    if (bus->followers)
        bits = cw_mac_steady_bits(&bus->common, level);
    for (uint64_t rest = bus->all & ~bus->followers; bits > 0 && rest; rest &= rest - 1)
        bits = cw_least(bits, cw_mac_steady_bits(&bus->nodes[cw_lowest_node(rest)].mac, level));
    return bits > 0 && can_start(bus) ? 0 : bits;
}

/* A frame that comes amid a bit changes nothing before the next one, unless rules look at it. */
static uint64_t bits_up_to_inbox(const cw_bus *bus)
{
    uint64_t tick = cw_inbox_first(bus);
    return cw_host_side_acts(bus) ? cw_wire_bits_before(&bus->time, tick)
                                  : cw_wire_bits_until(&bus->time, tick);
}

/* Bits that can be skipped now: no controller does anything new, nothing comes in. */
static uint64_t bits_to_skip(cw_bus *bus, bool level, uint64_t tick)
{
    if (bus->faults.awake_count && !cw_fault_is_steady(bus, level))
        return 0;
    uint64_t bits = steady_bits(bus, level);
    if (bits == 0)
        return 0;
    bits = cw_least(bits, cw_wire_bits_to(&bus->time, tick));
    bits = cw_least(bits, bits_up_to_inbox(bus));
    bits = cw_least(bits, cw_wire_bits_until(&bus->time, bus->next_restart));
    bits = cw_least(bits, cw_wire_bits_until(&bus->time, bus->faults.next_due));
    if (bus->faults.awake_count == 0)
        return bits;
    return cw_fault_noise_free(bus, cw_fault_traffic_free(bus, bits, false));
}

static void skip(cw_bus *bus, uint64_t bits, bool level)
{
    watch_wire(bus, bits);
    if (bus->faults.awake_count)
        cw_fault_pass_noise(bus, bits);
    if (bus->followers)
        cw_mac_skip(&bus->common, bits, level);
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        cw_mac *m = &bus->nodes[i].mac;
        unsigned phase = m->phase;
        cw_mac_skip(m, bits, level);
        bus->crowd.valid = bus->crowd.valid && m->phase == phase;
        cw_join(bus, i);
    }
    cw_wire_pass(&bus->time, bits);
    bus->stats.bits += bits;
    bus->recessive_bits = level ? bus->recessive_bits + bits : 0;
    cw_take_inbox_before(bus, cw_now(bus)); /* before what is due now, as in a single bit */
}

/* Some bits, at least one. */
static void go_on(cw_bus *bus, uint64_t tick)
{
    if (bus->stepping || bus->watching) {
        step(bus);
        return;
    }
    if (bus->leap.active) {
        cw_leap_on(bus, tick);
        return;
    }
    if (cw_leap_begin(bus, tick) || cw_leap_resume(bus, tick))
        return;
    bool level = held_level(bus);
    uint64_t bits = bits_to_skip(bus, level, tick);
    if (bits > 0)
        skip(bus, bits, level);
    else
        step(bus);
}

/* Up to a tick, or until there is so much work, with the events that are there; at least a bit. */
static cw_status go_to(cw_bus *bus, uint64_t tick, uint64_t enough)
{
    if (!cw_ring_has_room(bus))
        return CW_FULL;
    run_all_due(bus);
    const uint64_t begin = cw_now(bus);
    for (bool more = cw_wire_fits_bit(&bus->time, tick); more;) {
        if (!cw_ring_has_room(bus))
            return CW_FULL;
        go_on(bus, tick);
        run_all_due(bus);
        bus->work++;
        more = cw_wire_fits_bit(&bus->time, tick);
        if (more && bus->work + bus->ring.count >= enough && cw_now(bus) > begin)
            return CW_AGAIN;
    }
    return CW_OK;
}

static cw_status advance(cw_bus *bus, uint64_t tick, uint64_t work)
{
    const unsigned events = bus->ring.count;
    cw_status status = go_to(bus, tick, cw_after(bus->work + events, work));
    bus->work += bus->ring.count - events;
    return status;
}

cw_status cw_bus_advance(cw_bus *bus, uint64_t tick)
{
    return advance(bus, tick, UINT64_MAX);
}

cw_status cw_bus_advance_some(cw_bus *bus, uint64_t tick, uint64_t work)
{
    return advance(bus, tick, work);
}

uint64_t cw_bus_work(const cw_bus *bus)
{
    return bus->work;
}

void cw_bus_set_stepping(cw_bus *bus, bool stepping)
{
    bus->stepping = stepping;
    if (!stepping)
        return;
    cw_leap_end(bus);
    cw_leave(bus, bus->all);
}

void cw_bus_set_watching(cw_bus *bus, bool watching)
{
    bus->watching = watching;
    if (watching)
        cw_leap_end(bus);
}

/* What happens at the end of a bit is seen in it: so the last one is not left out. */
uint64_t cw_bus_quiet_until(cw_bus *bus, uint64_t tick)
{
    if (tick <= cw_now(bus) || bus->news || !cw_view_is_quiet(bus))
        return cw_now(bus);
    uint64_t bits = bits_to_skip(bus, CW_RECESSIVE, tick);
    return bits > 1 ? cw_wire_tick(&bus->time, bits - 1) : cw_now(bus);
}

void cw_bus_set_events(cw_bus *bus, uint32_t kinds)
{
    bus->wanted = kinds;
}

/* ---- Reading --------------------------------------------------------------------------------- */

uint64_t cw_bus_now(const cw_bus *bus)
{
    return cw_now(bus);
}

uint64_t cw_bus_recessive_bits(const cw_bus *bus)
{
    return bus->leap.active ? cw_leap_recessive_bits(bus) : bus->recessive_bits;
}

size_t cw_bus_pending(const cw_bus *bus)
{
    return (size_t)bus->queued + bus->inbox.count + bus->held_count;
}

bool cw_bus_idle(const cw_bus *bus)
{
    if (bus->leap.active)
        return false;
    bool busy = bus->followers && cw_mac_is_busy(&bus->common);
    for (uint64_t rest = bus->all & ~bus->followers; !busy && rest; rest &= rest - 1)
        busy = cw_mac_is_busy(&bus->nodes[cw_lowest_node(rest)].mac);
    return !busy;
}

/* When nobody knows when a frame or a flag ends, look again after this many bits; when faults
 * are at work on the wire, after more. */
#define LOOK_AGAIN_BITS 6u
#define LOOK_AT_FAULTS_BITS (CW_FRAME_BITS_MIN - 1) /* they may send, too */

/* Whether a node may read on in a frame whose transmitters have left it, with a passive flag. Who
 * sends on another wire, or in loopback, does not send that frame. */
static bool is_orphaned(const cw_bus *bus)
{
    bool read = bus->followers && bus->common.phase == CW_MAC_FRAME;
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        const cw_mac *m = &bus->nodes[cw_lowest_node(rest)].mac;
        bool sends = cw_mac_is_sending(m);
        if (sends && bus->group_count == 1 && !(m->modes & CW_MODE_LOOPBACK))
            return false;
        read = read || (m->phase == CW_MAC_FRAME && !sends);
    }
    return read;
}

/* Bits until a controller may have something to report. */
static uint64_t horizon(const cw_bus *bus)
{
    uint64_t bits = CW_QUIET_FOREVER;
    if (bus->leap.active)
        return cw_leap_horizon(bus);
    if (bus->followers)
        bits = cw_mac_horizon(&bus->common, (bus->waiting & bus->followers) != 0);
    for (uint64_t rest = bus->all & ~bus->followers; rest; rest &= rest - 1) {
        unsigned i = cw_lowest_node(rest);
        bool waits = bus->waiting >> i & 1u;
        bits = cw_least(bits, cw_mac_horizon(&bus->nodes[i].mac, waits));
    }
    return bits;
}

/* Whether the controller does nothing by itself until it is idle, or gets a frame. */
static bool comes_to_rest(const cw_mac *m)
{
    return !cw_mac_is_busy(m) || (m->phase == CW_MAC_INTERMISSION && m->overloads_wanted == 0);
}

/* Whether all of them do, after a frame. In a leap the ends of its frame are known. */
static bool bus_comes_to_rest(const cw_bus *bus)
{
    bool rests = !bus->followers || comes_to_rest(&bus->common);
    for (uint64_t rest = bus->all & ~bus->followers; rests && rest; rest &= rest - 1)
        rests = comes_to_rest(&bus->nodes[cw_lowest_node(rest)].mac);
    return rests || bus->leap.active;
}

uint64_t cw_bus_next(const cw_bus *bus)
{
    if (bus->news)
        return cw_now(bus);
    uint64_t bits = horizon(bus);
    bool unknown = bits == CW_QUIET_FOREVER && !bus_comes_to_rest(bus);
    if (unknown || (!bus->leap.active && is_orphaned(bus)))
        bits = cw_least(bits, LOOK_AGAIN_BITS);
    const bool calm = bits == CW_QUIET_FOREVER && cw_fault_rests(bus);
    if (bus->faults.awake_count && !calm)
        bits = cw_least(bits, LOOK_AT_FAULTS_BITS);
    uint64_t tick = cw_wire_tick_or_never(&bus->time, bits);
    tick = cw_least(tick, cw_least(bus->next_restart, bus->faults.next_due));
    return cw_least(tick, cw_inbox_first(bus));
}

void cw_bus_get_stats(const cw_bus *bus, cw_bus_stats *stats)
{
    *stats = bus->stats;
    stats->ticks = cw_now(bus);
    stats->pending = (uint32_t)(bus->queued + bus->held_count);
    stats->load_permille = (uint16_t)cw_load_second_permille(&bus->load);
}

cw_status cw_node_get_stats(const cw_bus *bus, unsigned i, cw_node_stats *stats)
{
    if (i >= bus->node_count)
        return CW_INVALID;
    const bus_node *n = &bus->nodes[i];
    *stats = n->stats;
    cw_share_stats(bus, i, stats);
    stats->inbox = n->inbox;
    stats->queue = n->queue.count;
    cw_fault_count_held(bus, i, &stats->held, &stats->rx_held);
    stats->tec = n->mac.confinement.tec;
    stats->rec = n->mac.confinement.rec;
    stats->state = cw_mac_state(&n->mac);
    return CW_OK;
}
