/* SPDX-License-Identifier: MIT
 *
 * bus_private.h - what the parts of the bus share: its state, and who does what.
 *
 *   bus.c      time: what is due, which step comes next; memory.c the caller's memory
 *   host.c     frames from and to the hosts: inbox, queues, restart, settings
 *   rules.c    what rules see of the bus and have it do; control.c topology.c what they do to nodes
 *   ring.c     the ring of events; commit.c makes events and statistics of reports
 *   status.c   what can be read; view.c the last bit, for traces
 *   takeover.c a bus goes on as another one
 *   step/      how time moves: frame*.c clean frames without controllers, arbiter.c who wins them
 *              and what the others pay, run.c equal bits, shared.c one controller for all nodes
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
    uint64_t lost_before;  /* what had been shared out, see cw_arbiter */
    cw_node_stats stats;   /* as far as arbiter.c has shared them out */
} bus_node;

typedef struct inbox_entry {
    uint64_t at_tick;
    uint8_t node;
    cw_frame frame;
} inbox_entry;

/* A ring, sorted by tick, then node (not behind cw_bus_bring_forward()), then arrival. */
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
    uint64_t enough; /* room for the worst bit there can be, whatever waits at present */
} event_ring;

/* What of cw_bit_view is known only while the bit is simulated. */
typedef struct bit_note {
    uint64_t start; /* tick */
    uint64_t end; /* tick; 0: there is none */
    cw_levels levels;
    uint64_t sampled; /* by the controllers, behind what their modes hide */
    uint64_t wanted;  /* levels that would be driven without faults */
    uint64_t alike;   /* nodes that follow one controller, and have one level */
    unsigned wire_count;
    cw_bit_node nodes[CW_NODES_MAX]; /* but for wire, state and counters; of those that are alike
                                        the first one */
    uint8_t wires[CW_NODES_MAX];     /* where there are several */
} bit_note;

/* A clean frame on its way, see step/frame.c. */
typedef struct cw_frame_step {
    bool active;
    bool broken;          /* it must end with the bit in progress */
    bool at_work;         /* rules act on the levels of its bits */
    bool hit;             /* its rule does not let all of it pass, so that its bits are needed */
    bool bound;           /* rules have been bound to its frames, at their SOF */
    uint8_t node;         /* the transmitter */
    uint8_t tail;         /* last bits, up to the intermission, that go by singly */
    uint16_t at;          /* bits that have passed, SOF to the third of the intermission */
    cw_look look;         /* the next one of a rule, at which single bits go on if it is a hit */
    uint16_t length;      /* SOF to EOF */
    const cw_bits *bits;  /* NULL: not encoded, see cw_frame_step_bits() */
    cw_frame frame;       /* what they are of; the queue may have another one there at the end */
    uint64_t listeners;
    uint64_t contenders;  /* nodes that began to transmit */
    uint64_t watched;     /* of these, those whose bits rules look at before the step ends */
    uint64_t undecided;   /* of these, those that have not lost yet and will */
    uint64_t hidden;      /* of these, those whose losses have been counted at SOF */
    uint8_t next_loss;    /* the first lost_at of those that are undecided */
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
    unsigned group_count;          /* 1: all on one wire */
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
    bool news; /* a rule or a setting has changed something at a controller */
    cw_event unwanted_event; /* written to when nobody wants it */
    cw_event lost_event; /* written to when the ring is full */
    bus_node *nodes;
    cw_rule_set rules;
    bit_note note;
};

/* The present tick. */
static inline uint64_t cw_now(const cw_bus *bus)
{
    return cw_wire_now(&bus->time);
}

/* The tick at which the bit ends that begins now. */
static inline uint64_t cw_bit_end(const cw_bus *bus)
{
    return cw_wire_bit_end(&bus->time);
}

/* In a frame step: the tick at which bit n of the frame begins, n not before its `at`. Bits of
 * the intermission go on behind those of the frame. */
static inline uint64_t cw_frame_step_tick(const cw_bus *bus, unsigned n)
{
    return cw_wire_tick(&bus->time, (uint64_t)n - bus->frame_step.at);
}

/* ---- step/arbiter.c -------------------------------------------------------------------------- */

void cw_share_lost_now(cw_bus *bus, unsigned node);

/* Gives a node its share of lost attempts; before its first frame changes or is tried otherwise. */
static inline void cw_share_lost(cw_bus *bus, unsigned node)
{
    if (bus->nodes[node].lost_before != bus->arbiter.lost)
        cw_share_lost_now(bus, node);
}

/* ---- ring.c ---------------------------------------------------------------------------------- */

/* The most room that a bit can need; to be found anew when rules come or go. */
void cw_ring_find_enough(cw_bus *bus);

bool cw_ring_has_room_now(const cw_bus *bus);

/* Whether the worst that can happen up to the end of the next bit fits into the ring. */
static inline bool cw_ring_has_room(const cw_bus *bus)
{
    return bus->ring.capacity - bus->ring.count >= bus->ring.enough || cw_ring_has_room_now(bus);
}

/* The least size of the ring with which the bus never stands still. */
unsigned cw_ring_least(const cw_bus_config *config);

/* The event may be filled in until the next one is put in. */
cw_event *cw_push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes);

/* Whether anybody sees events of a kind. */
static inline bool cw_wants_event(const cw_bus *bus, cw_event_kind kind)
{
    return bus->wanted >> kind & 1u;
}

/* At the present tick, with the node's counters. */
cw_event *cw_push_node_event(cw_bus *bus, cw_event_kind kind, unsigned node);

/* A hit of a rule that is not quiet. */
void cw_push_fault(cw_bus *bus, unsigned rule, uint64_t tick);

/* side: where the frame was going, onto the bus or to the host. */
void cw_push_drop(cw_bus *bus, unsigned node, cw_side side, const cw_frame *frame, cw_drop why,
                  uint64_t tick);

/* A frame for a host; joins the newest event when that is the same frame for earlier nodes. */
void cw_push_rx(cw_bus *bus, unsigned node, const cw_frame *frame, const frame_origin *origin);

/* ---- rules.c, control.c, topology.c ---------------------------------------------------------- */

/* The rules get to know the bus, whose nodes are there. */
void cw_link_rules(cw_bus *bus, uint64_t seed);

/* What a rule does to the controllers that it names, at once. */
void cw_control_nodes(cw_bus *bus, const cw_rule *rule);

/* Puts nodes off the bus or onto wires of their own, and forbids acknowledging, as the active
 * rules and the hosts say; and undoes it. */
void cw_apply_topology(cw_bus *bus);

/* ---- host.c ---------------------------------------------------------------------------------- */

/* Puts a frame into a node's queue, or drops it with an event. source: 0 for the host's frames, the
 * index of the rule plus 1 for those of a rule. */
void cw_queue_frame(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick,
                    unsigned source);

/* The tick of the first frame in the inbox, or CW_NEVER. */
static inline uint64_t cw_inbox_first(const cw_bus *bus)
{
    return bus->inbox.next;
}

/* The frames that were handed in before tick, of which there are some. */
void cw_take_inbox(cw_bus *bus, uint64_t tick);

static inline void cw_take_inbox_before(cw_bus *bus, uint64_t tick)
{
    if (cw_inbox_first(bus) < tick)
        cw_take_inbox(bus, tick);
}

/* What is due for a node now: its frames that were handed in, its restart. */
void cw_run_due_node(cw_bus *bus, unsigned node);

void cw_remove_slot(cw_bus *bus, unsigned node, uint16_t slot);

/* To be called when the frame that goes first at a node may be another one. */
void cw_queue_changed(cw_bus *bus, unsigned node);

void cw_schedule_restart(cw_bus *bus, unsigned node, uint64_t tick);

/* When a node in bus-off restarts by itself: restart_ticks after bus-off, not before now; or
 * CW_NEVER (R12). */
uint64_t cw_automatic_restart(const cw_bus *bus, unsigned node);

void cw_find_next_restart(cw_bus *bus);

bool cw_settings_valid(const bus_node *node, const cw_settings *settings);

/* ---- bus.c ----------------------------------------------------------------------------------- */

void cw_count_clean_bits_now(cw_bus *bus);

/* Bits of clean frames go to the statistics; before others are counted, or somebody reads them. */
static inline void cw_count_clean_bits(cw_bus *bus)
{
    if (bus->clean_bits)
        cw_count_clean_bits_now(bus);
}

/* All bits so far, and the busy ones of them, with those that are not in the statistics yet. */
static inline uint64_t cw_bits_so_far(const cw_bus *bus)
{
    return bus->stats.bits + bus->clean_bits;
}

static inline uint64_t cw_busy_bits_so_far(const cw_bus *bus)
{
    return bus->stats.busy_bits + bus->clean_bits;
}

/* ---- memory.c -------------------------------------------------------------------------------- */

/* Room in the queue of a node: for what its configuration and rules from the start may set. */
uint16_t cw_queue_room(const cw_bus_config *config, unsigned node);

/* ---- step/bit.c ------------------------------------------------------------------------------ */

/* Simulates the bit that comes next. */
void cw_step_bit(cw_bus *bus);

/* The frame of a node's queue that goes first, or the one in a slot, encoded and ready to be
 * sent. */
void cw_offer_first(bus_node *node);
void cw_offer_slot(bus_node *node, uint16_t slot);

/* A node begins to transmit the frame of its offered slot; rules may make its CRC wrong. */
void cw_bind_rules(cw_bus *bus, unsigned node, const cw_frame *frame);

/* The levels of the bit in progress, from what is driven. */
void cw_find_levels(cw_bus *bus, cw_levels *levels);

/* Simulates the bit in progress, whose levels have been found. */
void cw_step_with(cw_bus *bus, const cw_levels *levels);

/* Load and flags, by what the nodes are doing in the next bit and those that go with it. */
void cw_watch_wire(cw_bus *bus, uint64_t bits);

/* ---- step/run.c ------------------------------------------------------------------------------ */

/* The level of the wire as long as nobody begins or ends to drive it. */
bool cw_held_level(const cw_bus *bus);

/* Bits up to tick in which the wire keeps that level, no controller does anything new, and nothing
 * comes in; 0 when the next one is to be simulated. */
uint64_t cw_run_reach(cw_bus *bus, bool level, uint64_t tick);

/* Takes that many bits at once. */
void cw_run_go(cw_bus *bus, uint64_t bits, bool level);

/* ---- step/frame*.c --------------------------------------------------------------------------- */

/* Goes on with the frame step that is under way, or begins one: with the frame that comes next, or
 * amid one that has begun bit by bit. Goes as far as the end of the frame, the next moment at which
 * something happens, or tick; at least one bit lies before tick. False, with nothing done: bits are
 * to be simulated singly. */
bool cw_frame_step_go(cw_bus *bus, uint64_t tick);

/* Ends the frame step that is under way, if there is one: puts all controllers where they are by
 * now. Public calls do so before they do anything to a controller, and time does before rules and
 * restarts that are due; nobody else. */
void cw_wake_controllers(cw_bus *bus);

/* In a frame step a node is about to get a frame to send. */
void cw_frame_step_frame_comes(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick);

/* Returns the nodes whose losses have been counted beforehand and have not come to pass. */
uint64_t cw_losses_ahead(const cw_bus *bus);

/* In a frame step: recessive bits up to now, and bits until the next event. */
uint64_t cw_frame_step_recessive_bits(const cw_bus *bus);
uint64_t cw_frame_step_horizon(const cw_bus *bus);

/* ---- step/shared.c --------------------------------------------------------------------------- */

/* The controller of a node, shared or its own. */
const cw_mac *cw_mac_of(const cw_bus *bus, unsigned node);

/* The node's own controller, to do something to it; controllers must be awake. */
cw_mac *cw_own_mac(cw_bus *bus, unsigned node);

/* These nodes have controllers of their own from now on. */
void cw_leave(cw_bus *bus, uint64_t nodes);

/* The node becomes a follower if it is where the others are. */
void cw_join(cw_bus *bus, unsigned node);

/* Followers that sample another level than most of them leave. */
void cw_split_followers(cw_bus *bus, uint64_t levels);

/* Ends the bit for all followers, which see the same level. Returns whether there is anything to
 * commit. */
bool cw_sample_common(cw_bus *bus, uint64_t levels, cw_mac_report *report);

/* ---- view.c ---------------------------------------------------------------------------------- */

/* Notes the bit in progress, after all nodes drove and before they sample. */
void cw_view_note(cw_bus *bus, const cw_levels *levels);

/* Whether the last bit has been noted, and was one of an idle bus that nothing acts on, and whether
 * all nodes are where they were in it. */
bool cw_view_is_quiet(const cw_bus *bus);

/* ---- commit.c -------------------------------------------------------------------------------- */

/* Events and statistics of one node at the end of a bit, in the order of cw_event_kind. */
void cw_commit_node(cw_bus *bus, unsigned node, const cw_mac_report *report);

/* The node has lost arbitration at a bit with the frame of its offered slot. */
void cw_tell_arbitration_lost(cw_bus *bus, unsigned node, uint8_t bit);

/* The node has sent the frame of its offered slot, in so many bits from SOF to EOF. */
void cw_commit_sent(cw_bus *bus, unsigned node, unsigned wire_bits);

/* The node has received a frame. */
void cw_receive(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Nodes, at least one, have received the frame of a sender as it was sent, so many bytes of data,
 * and nothing acts on it on the host side. The caller fills the frame into the event. */
cw_event *cw_receive_together(cw_bus *bus, unsigned sender, uint64_t receivers, unsigned bytes);

/* Whether a frame may be more to its receivers than an event. */
static inline bool cw_host_side_acts(const cw_bus *bus)
{
    return bus->rules.host_rules || bus->rules.reply_rules || bus->rules.held_count;
}

/* Followers have received a frame in this bit, and nobody else has anything to tell. Returns
 * whether that could be done for all of them at once. */
bool cw_commit_reception(cw_bus *bus);

/* A state that has changed since it was last told. */
void cw_tell_new_state(cw_bus *bus, unsigned node);

static inline void cw_tell_state(cw_bus *bus, unsigned node)
{
    const bus_node *n = &bus->nodes[node];
    if (n->told_state != n->mac.confinement.state)
        cw_tell_new_state(bus, node);
}

#endif
