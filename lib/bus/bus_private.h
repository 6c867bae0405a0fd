/* SPDX-License-Identifier: MIT
 *
 * bus_private.h - the state that the parts of the bus share, and the functions of each part.
 *
 *   bus.c      time: what is due, which step comes next; memory.c the caller's memory
 *   host.c     frames from and to the hosts: inbox, queues, restart, settings
 *   rules.c    what rules see of the bus and have it do; control.c topology.c what they do to nodes
 *   ring.c     the ring of events; commit.c makes events and statistics of reports
 *   status.c   what can be read; view.c the last bit, for traces
 *   takeover.c a bus goes on as another one
 *   step/      how time moves: frame*.c clean frames without controllers, arbiter.c their winners
 *              and the shares of all nodes, run.c equal bits, shared.c one controller for all nodes
 *              that do the same, bit.c one bit of all nodes
 *   rule/      rules: when they act, what they do, see rule/rule.h
 */
#ifndef CANWIRE_BUS_PRIVATE_H
#define CANWIRE_BUS_PRIVATE_H

#include "canwire.h"
#include "format/bitset.h"
#include "step/arbiter.h"
#include "step/outlook.h"
#include "rule/rule.h"
#include "mac/mac.h"
#include "bus/queue.h"
#include "bus/stats.h"
#include "time/wire.h"

typedef struct bus_node {
    cw_mac mac;
    cw_queue queue;
    uint64_t restart_ticks;
    uint64_t restart_at;   /* tick of the next restart request, or CW_NEVER */
    uint64_t off_at;       /* tick of the last bus-off */
    uint16_t offered_slot; /* valid while mac.offered */
    uint16_t queue_limit;  /* at most the queue's capacity */
    uint32_t inbox;        /* its frames in the inbox */
    bool wrong_crc;        /* mac.tx carries an inverted CRC bit */
    uint8_t told_state;    /* cw_state of the last event */
    uint64_t lost_before;  /* the `lost` of cw_arbiter at the node's last share */
    cw_node_stats stats;   /* without the shares that arbiter.c still owes */
} bus_node;

typedef struct inbox_entry {
    uint64_t at_tick;
    uint8_t node;
    cw_frame frame;
} inbox_entry;

/* A ring, sorted by tick, then node (not after cw_bus_bring_forward()), then arrival. */
typedef struct inbox {
    inbox_entry *entries;
    unsigned capacity;
    unsigned first;
    unsigned count;
    uint64_t next; /* tick of the first one, or CW_NEVER */
} inbox;

typedef struct event_ring {
    cw_event *events;
    unsigned capacity;
    unsigned first;
    unsigned count;
    uint64_t newest_tick; /* of the last event in it */
    uint64_t enough; /* room for the worst possible bit, whatever waits at present */
} event_ring;

/* The part of cw_bit_view that is known only while the bit is simulated. */
typedef struct bit_note {
    uint64_t start; /* tick */
    uint64_t end; /* tick; 0: there is none */
    cw_levels levels;
    uint64_t sampled; /* by the controllers, after their modes have hidden levels */
    uint64_t wanted;  /* levels that would be driven without faults */
    uint64_t alike;   /* nodes that follow one controller, and have one level */
    unsigned wire_count;
    cw_bit_node nodes[CW_NODES_MAX]; /* without wire, state and counters; nodes that are alike share
                                        the first entry */
    uint8_t wires[CW_NODES_MAX];     /* valid when there are several wires */
} bit_note;

/* A clean frame on its way, see step/frame.c. */
typedef struct cw_frame_step {
    bool active;
    bool at_work;         /* rules act on the levels of its bits */
    bool hit;             /* its rule does not let all of it pass, so that its bits are needed */
    bool bound;           /* rules have been bound to its frames, at their SOF */
    uint8_t node;         /* the transmitter */
    uint8_t tail;         /* last bits, up to the intermission, that pass one by one */
    uint16_t at;          /* bits that have passed, SOF to the third of the intermission */
    cw_look look;         /* the next look of a rule; on a hit single bits go on there */
    uint16_t length;      /* SOF to EOF */
    const cw_bits *bits;  /* NULL: not encoded, see cw_frame_step_bits() */
    cw_frame frame;       /* the frame of the bits; at the end the queue may have another one in
                             that slot */
    uint64_t listeners;
    uint64_t contenders;  /* nodes that began to transmit */
    uint64_t watched;     /* of these, those whose bits rules look at before the step ends */
    uint64_t undecided;   /* of these, those that have not lost yet and will */
    uint64_t hidden;      /* of these, those whose losses have been counted at SOF */
    uint64_t pinned;      /* of these, those whose offered slot has the frame that they began with;
                             that of the others is still the first of their queue */
    uint8_t next_loss;    /* the first lost_at of the undecided nodes */
    uint8_t lost_bit[CW_NODES_MAX]; /* as the SJA1000 counts */
    uint8_t lost_at[CW_NODES_MAX];  /* the wire bit */
} cw_frame_step;

struct cw_bus {
    cw_wire_time time;
    unsigned node_count;
    uint64_t next_restart; /* the earliest restart_at */
    uint64_t recessive_bits;
    uint64_t clean_bits;   /* of clean frames, not in the statistics yet; 0 between public calls */
    uint64_t work;         /* see cw_bus_work() */
    uint64_t queued;       /* frames in all queues */
    uint64_t groups[CW_NODES_MAX]; /* wires of a partitioned bus, as sets of nodes */
    unsigned group_count;          /* 1: all nodes on one wire */
    flag_watch error_flag;
    flag_watch overload_flag;
    cw_load load;
    cw_bus_stats stats;
    inbox inbox;
    event_ring ring;
    uint64_t all;       /* nodes */
    uint64_t followers; /* nodes that are where `common` is, see step/shared.c */
    uint64_t waiting;   /* nodes with frames in their queues */
    uint64_t detached;  /* nodes that their hosts have taken off the bus */
    uint64_t removed;   /* of these, those that have been flushed: for good */
    cw_mac common;
    cw_outlook outlook;
    cw_frame_step frame_step;
    cw_arbiter arbiter;
    uint32_t wanted;    /* kinds of events, as bits */
    bool wire; /* level of the last bit, all wires together */
    bool stepping; /* nothing is skipped, nothing shared */
    bool watching; /* nothing is skipped */
    bool news; /* pending: a rule or a setting has changed something at a controller */
    cw_event unwanted_event; /* written to when the kind is not wanted */
    cw_event lost_event; /* written to when the ring is full */
    bus_node *nodes;
    cw_rule_set rules;
    bit_note note;
};

/* Returns the present tick. */
static inline uint64_t cw_now(const cw_bus *bus)
{
    return cw_wire_now(&bus->time);
}

/* Returns the tick at which the bit that begins now ends. */
static inline uint64_t cw_bit_end(const cw_bus *bus)
{
    return cw_wire_bit_end(&bus->time);
}

/* Returns the tick at which bit n of the frame of a frame step begins, n not before its `at`. Bits
 * of the intermission count on after those of the frame. */
static inline uint64_t cw_frame_step_tick(const cw_bus *bus, unsigned n)
{
    return cw_wire_tick(&bus->time, (uint64_t)n - bus->frame_step.at);
}

/* ---- step/arbiter.c -------------------------------------------------------------------------- */

void cw_share_lost_now(cw_bus *bus, unsigned node);

/* Gives a node its share of lost attempts. Call it before its first frame changes or is tried
 * otherwise. */
static inline void cw_share_lost(cw_bus *bus, unsigned node)
{
    if (bus->nodes[node].lost_before != bus->arbiter.lost)
        cw_share_lost_now(bus, node);
}

/* ---- ring.c ---------------------------------------------------------------------------------- */

/* Finds the most room that a bit can need. Call it when rules come or go. */
void cw_ring_find_enough(cw_bus *bus);

bool cw_ring_has_room_now(const cw_bus *bus);

/* Returns true when the ring has room for the worst case up to the end of the next bit. */
static inline bool cw_ring_has_room(const cw_bus *bus)
{
    return bus->ring.capacity - bus->ring.count >= bus->ring.enough || cw_ring_has_room_now(bus);
}

/* Returns the least size of the ring with which the bus never stands still. */
unsigned cw_ring_least(const cw_bus_config *config);

/* Adds an event. The caller may fill it in until the next one is added. */
cw_event *cw_push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes);

/* Returns true when events of a kind are wanted. */
static inline bool cw_wants_event(const cw_bus *bus, cw_event_kind kind)
{
    return bus->wanted >> kind & 1u;
}

/* Adds an event at the present tick, with the node's counters. */
cw_event *cw_push_node_event(cw_bus *bus, cw_event_kind kind, unsigned node);

/* Adds the hit of a rule that is not quiet. */
void cw_push_fault(cw_bus *bus, unsigned rule, uint64_t tick);

/* Adds the drop of a frame and counts it. side: the way of the frame, onto the bus or to the
 * host. */
void cw_push_drop(cw_bus *bus, unsigned node, cw_side side, const cw_frame *frame, cw_drop why,
                  uint64_t tick);

/* Adds a frame for a host; joins the newest event when that is the same frame for earlier nodes. */
void cw_push_rx(cw_bus *bus, unsigned node, const cw_frame *frame, const frame_origin *origin);

/* ---- rules.c, control.c, topology.c ---------------------------------------------------------- */

/* Links the rules to the bus, whose nodes must exist. */
void cw_link_rules(cw_bus *bus, uint64_t seed);

/* Does the action of a rule to the controllers that it names, at once. */
void cw_control_nodes(cw_bus *bus, const cw_rule *rule);

/* Takes nodes off the bus, puts them onto wires of their own and forbids acknowledging, by the
 * active rules and the hosts; or undoes that. */
void cw_apply_topology(cw_bus *bus);

/* ---- host.c ---------------------------------------------------------------------------------- */

/* Puts a frame into a node's queue, or drops it with an event. source: 0 for the host's frames, the
 * index of the rule plus 1 for those of a rule. */
void cw_queue_frame(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick,
                    unsigned source);

/* Returns the tick of the first frame in the inbox, or CW_NEVER. */
static inline uint64_t cw_inbox_first(const cw_bus *bus)
{
    return bus->inbox.next;
}

/* Takes the frames that were handed in before tick, at least one, from the inbox. */
void cw_take_inbox(cw_bus *bus, uint64_t tick);

static inline void cw_take_inbox_before(cw_bus *bus, uint64_t tick)
{
    if (cw_inbox_first(bus) < tick)
        cw_take_inbox(bus, tick);
}

/* Runs everything that is due for a node now: frames from the inbox, a restart. */
void cw_run_due_node(cw_bus *bus, unsigned node);

/* Makes the first frame of a node's queue the one of its offered slot, not encoded. */
void cw_pin_first(bus_node *node);

void cw_remove_slot(cw_bus *bus, unsigned node, uint16_t slot);

/* Call it when the first frame of a node's queue may have changed. */
void cw_queue_changed(cw_bus *bus, unsigned node);

void cw_schedule_restart(cw_bus *bus, unsigned node, uint64_t tick);

/* Returns the tick at which a node in bus-off restarts by itself: restart_ticks after bus-off, not
 * before now; or CW_NEVER (R12). */
uint64_t cw_automatic_restart(const cw_bus *bus, unsigned node);

void cw_find_next_restart(cw_bus *bus);

bool cw_settings_valid(const bus_node *node, const cw_settings *settings);

/* ---- bus.c ----------------------------------------------------------------------------------- */

void cw_count_clean_bits_now(cw_bus *bus);

/* Adds the bits of clean frames to the statistics. Call it before other bits are counted or the
 * statistics are read. */
static inline void cw_count_clean_bits(cw_bus *bus)
{
    if (bus->clean_bits)
        cw_count_clean_bits_now(bus);
}

/* Return all bits so far, and the busy bits, with those that are not in the statistics yet. */
static inline uint64_t cw_bits_so_far(const cw_bus *bus)
{
    return bus->stats.bits + bus->clean_bits;
}

static inline uint64_t cw_busy_bits_so_far(const cw_bus *bus)
{
    return bus->stats.busy_bits + bus->clean_bits;
}

/* ---- memory.c -------------------------------------------------------------------------------- */

/* Returns the room in a node's queue: enough for the settings of its configuration and of the rules
 * from the start. */
uint16_t cw_queue_room(const cw_bus_config *config, unsigned node);

/* ---- step/bit.c ------------------------------------------------------------------------------ */

/* Simulates the next bit. */
void cw_step_bit(cw_bus *bus);

/* Encode the first frame of a node's queue, or the frame in a slot, and make it ready to be
 * sent. */
void cw_offer_first(bus_node *node);
void cw_offer_slot(bus_node *node, uint16_t slot);

/* Binds rules when a node begins to transmit the frame of its offered slot; they may make its CRC
 * wrong. */
void cw_bind_rules(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Finds the levels of the bit in progress from those that are driven. */
void cw_find_levels(cw_bus *bus, cw_levels *levels);

/* Simulates the bit in progress, whose levels have been found. */
void cw_step_with(cw_bus *bus, const cw_levels *levels);

/* Counts load and flags for the next bit, and for as many equal ones as are taken with it. */
void cw_watch_wire(cw_bus *bus, uint64_t bits);

/* ---- step/run.c ------------------------------------------------------------------------------ */

/* Returns the level of the wire as long as no node changes its own level. */
bool cw_held_level(const cw_bus *bus);

/* Returns the bits up to tick in which the wire keeps that level, no controller does anything new,
 * and nothing comes in. Returns 0 when the next bit must be simulated. */
uint64_t cw_run_reach(cw_bus *bus, bool level, uint64_t tick);

/* Takes that many bits at once. */
void cw_run_go(cw_bus *bus, uint64_t bits, bool level);

/* ---- step/frame*.c --------------------------------------------------------------------------- */

/* Continues the frame step that is under way, or begins one. A step begins with the next frame, or
 * within a frame that has begun bit by bit. It goes as far as the end of the frame, the next moment
 * at which something happens, or tick. At least one bit must lie before tick. Returns false, with
 * nothing done, when bits must be simulated singly. */
bool cw_frame_step_go(cw_bus *bus, uint64_t tick);

/* Ends the frame step that is under way, if there is one: moves all controllers to their present
 * points. Public calls do so before they change a controller, and time does so before due rules and
 * restarts; nothing else does. */
void cw_wake_controllers(cw_bus *bus);

/* Returns the nodes whose losses have been counted beforehand and still lie ahead. */
uint64_t cw_losses_ahead(const cw_bus *bus);

/* Return, in a frame step, the recessive bits up to now and the bits until the next event. */
uint64_t cw_frame_step_recessive_bits(const cw_bus *bus);
uint64_t cw_frame_step_horizon(const cw_bus *bus);

/* ---- step/shared.c --------------------------------------------------------------------------- */

/* Returns the controller of a node, shared or its own. */
const cw_mac *cw_mac_of(const cw_bus *bus, unsigned node);

/* Returns the node's own controller, to change it; controllers must be awake. */
cw_mac *cw_own_mac(cw_bus *bus, unsigned node);

/* Gives these nodes their own controllers from now on. */
void cw_leave(cw_bus *bus, uint64_t nodes);

/* Makes the node a follower if it is at the point of the others. */
void cw_join(cw_bus *bus, unsigned node);

/* Makes followers leave that sample another level than most followers. */
void cw_split_followers(cw_bus *bus, uint64_t levels);

/* Ends the bit for all followers, which see the same level. Returns true when there is a report to
 * commit. */
bool cw_sample_common(cw_bus *bus, uint64_t levels, cw_mac_report *report);

/* ---- view.c ---------------------------------------------------------------------------------- */

/* Notes the bit in progress, after all nodes drove and before they sample. */
void cw_view_note(cw_bus *bus, const cw_levels *levels);

/* Returns true when the last bit has been noted as one of an idle bus that nothing acts on. All
 * nodes must still be as they were in it. */
bool cw_view_is_quiet(const cw_bus *bus);

/* ---- commit.c -------------------------------------------------------------------------------- */

/* Makes the events and statistics of one node at the end of a bit, in the order of
 * cw_event_kind. */
void cw_commit_node(cw_bus *bus, unsigned node, const cw_mac_report *report);

/* Reports that the node has lost arbitration at a bit with the frame of its offered slot. */
void cw_tell_arbitration_lost(cw_bus *bus, unsigned node, uint8_t bit);

/* Commits that the node has sent the frame of its offered slot, in so many bits from SOF to EOF. */
void cw_commit_sent(cw_bus *bus, unsigned node, unsigned wire_bits);

/* Commits that the node has received a frame. */
void cw_receive(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Commits that some nodes, at least one, have received the frame of a sender as it was sent, with
 * so many bytes of data. Nothing acts on it on the host side. The caller fills the frame into the
 * event. */
cw_event *cw_receive_together(cw_bus *bus, unsigned sender, uint64_t receivers, unsigned bytes);

/* Returns true when a received frame may be more than an event to its receivers. */
static inline bool cw_host_side_acts(const cw_bus *bus)
{
    return bus->rules.host_rules || bus->rules.reply_rules || bus->rules.held_count;
}

/* Commits that followers have received a frame in this bit, when no other node has a report.
 * Returns true when that was possible for all of them at once. */
bool cw_commit_reception(cw_bus *bus);

/* Reports a state that has changed since the last report. */
void cw_tell_new_state(cw_bus *bus, unsigned node);

static inline void cw_tell_state(cw_bus *bus, unsigned node)
{
    const bus_node *n = &bus->nodes[node];
    if (n->told_state != n->mac.confinement.state)
        cw_tell_new_state(bus, node);
}

#endif
