/* SPDX-License-Identifier: MIT
 *
 * state.h - the state of a bus, and the changes of it that take no time.
 *
 *   queue.c      the waiting frames of one node; enqueue.c puts frames into queues
 *   inbox.c      frames whose tick is still to come
 *   ring.c       the ring of events; commit.c turns reports into events and statistics
 *   report.c     tells hosts of new states of their nodes
 *   stats.c      load and delays; shares.c statistics that many nodes have in common
 *   followers.c  nodes that share one controller
 *   topology.c   the wire of each node; restart.c the ticks of restarts after bus-off
 *   buffers.c    filters, and frames that wait for their hosts; mailboxes.c mailboxes,
 *                replies.c their replies to remote frames
 *   order.c      tells when an arbitration was not won by the lowest identifier
 *   sleep.c      nodes that sleep, and what wakes them
 *   tt.c         local time, basic cycles and slots of time-triggered nodes
 *   note.c       the bit in progress, for traces; rates.c the two rates of a node
 *   agenda.c     what nodes with clocks of their own do next, see timed.h
 */
#ifndef CANWIRE_STATE_H
#define CANWIRE_STATE_H

#include "canwire.h"
#include "format/bits.h"
#include "format/bitset.h"
#include "format/parts.h"
#include "rule/rule.h"
#include "mac/mac.h"
#include "state/buffers.h"
#include "state/queue.h"
#include "state/stats.h"
#include "state/timed.h"
#include "state/tt.h"
#include "time/wire.h"

#define CW_WRONG_CRC 0x8u /* besides CW_DEVIATES_*: the last bit of the CRC is inverted */

typedef struct cw_bus_node {
    cw_mac mac;
    cw_queue queue;
    uint16_t offered_slot; /* valid while mac.offered */
    uint16_t queue_limit;  /* at most the queue's capacity */
    uint16_t inbox;        /* its frames in the inbox */
    uint8_t deviates;      /* CW_DEVIATES_* and CW_WRONG_CRC: mac.tx is not the frame */
    uint8_t reported_state; /* cw_state of the last event */
    uint64_t lost_before;  /* the `lost` of cw_arbiter at the node's last share */
    cw_node_stats stats;   /* without the shares that shares.c still owes */
} cw_bus_node;

/* Apart from cw_bus_node, whose size is a power of two: an index costs one shift then. */
typedef struct cw_restart_times {
    uint64_t ticks;  /* from bus-off to the automatic request; 0: none */
    uint64_t at;     /* tick of the next restart request, or CW_NEVER */
    uint64_t off_at; /* tick of the last bus-off */
} cw_restart_times;

/* The sleep of one node, which its bus counts and ends; see sleep.c. */
typedef struct cw_sleep {
    cw_sleep_settings settings;
    cw_wake_filter filter; /* in CW_TICK */
    uint64_t since;        /* tick at which it fell asleep */
    uint64_t awake_at;     /* tick at which it integrates, after it has been woken; or CW_NEVER */
    uint8_t modes;         /* of a node that listens: its own ones */
    bool called;           /* its host wants it awake */
    cw_sleep_stats stats;  /* without the present sleep */
} cw_sleep;

/* The end of a transmission, by what has ended it. */
typedef enum cw_end {
    CW_END_SENT = 0,
    CW_END_LATE, /* an error, a rule or the host, from the CRC on */
    CW_END_EARLY, /* ... before it */
} cw_end;

/* The start of a transmission, for the order of arbitration; see order.c. */
typedef struct cw_start {
    uint64_t tick;  /* of its SOF */
    uint64_t ready; /* nodes with frames that could have taken part in the arbitration */
    uint64_t stopped; /* tick of its end or of what has ended it; 0: none */
    uint64_t handed_in; /* when `stopped` is set: tick of its frame ... */
    uint32_t can_id;    /* ... and its identifier, unless it has been sent */
    uint8_t end;        /* ... and what has ended it, a cw_end */
} cw_start;

/* The frame that the last error of a node belongs to, as in its event. */
typedef struct cw_error_frame {
    uint64_t from;
    uint32_t can_id;
} cw_error_frame;

typedef struct cw_inbox_entry {
    uint64_t at_tick;
    uint8_t node;
    uint8_t trigger; /* as in cw_queue_slot */
    bool restarted;  /* handed in behind a restart request that is due now (R12) */
    cw_frame frame[]; /* one, in its short form where the bus has no FD */
} cw_inbox_entry;

/* A ring, sorted by tick, then node (not after cw_bus_bring_forward()), then arrival. */
typedef struct cw_inbox {
    unsigned char *entries; /* see cw_inbox_at() */
    unsigned entry_size;
    unsigned capacity;
    unsigned first;
    unsigned count;
    unsigned kept_free; /* entries for triggers, one for each node that has some */
    uint64_t triggered; /* nodes with a frame of a trigger in it */
    uint64_t next; /* tick of the first one, or CW_NEVER */
} cw_inbox;

typedef struct cw_event_ring {
    unsigned char *events; /* see cw_ring_at(); frames in short form where the bus has no FD */
    unsigned event_size;
    unsigned capacity;
    unsigned first;
    unsigned count;
    uint64_t newest_tick; /* of the last event in it */
    uint64_t enough; /* room for the worst possible bit, whatever waits at present */
} cw_event_ring;

/* The part of cw_bit_view that is known only while the bit is simulated. */
typedef struct cw_bit_note {
    uint64_t start; /* tick */
    uint64_t end; /* tick; 0: there is none */
    cw_levels levels;
    uint64_t came;    /* the level of the wire as it comes to each node, with its delay */
    uint64_t sampled; /* by the controllers, after their modes have hidden levels */
    uint64_t wanted;  /* levels that would be driven without faults */
    uint64_t alike;   /* nodes that follow one controller, and have one level */
    uint64_t fast;    /* nodes that began it at the data rate */
    unsigned wire_count;
    bool steady;      /* as in cw_bit_view */
    cw_bit_node nodes[CW_NODES_MAX]; /* without wire, state and counters; nodes that are alike share
                                        the first entry */
    uint8_t wires[CW_NODES_MAX];     /* valid when there are several wires */
} cw_bit_note;

/* The bit of a frame that traces look at; see step/frame_seen.c. */
typedef struct cw_frame_seen {
    cw_stuffing stuffing; /* of the frame */
    uint64_t others[CW_BIT_WORDS]; /* bits with a level other than the one before, stuff bits, and
                                      those behind these */
    cw_form form;
    uint16_t at;          /* its bits up to the last one that was looked at */
    uint16_t index;       /* part and index of the last of them that was not a stuff bit */
    uint8_t part;
} cw_frame_seen;

/* The part of each node in the next frame, while all nodes are idle; see step/outlook.c.
 * cw_outlook_find() computes the outlook from all controllers. Whoever changes a controller, or
 * anything that `plain` depends on, calls cw_outlook_forget(), and the next decision computes the
 * outlook anew. */
typedef struct cw_outlook {
    bool valid;
    bool calm;              /* each node is idle, or away until a call or rule changes it */
    uint64_t listeners;     /* idle nodes, which will receive the next frame or send it */
    uint64_t away;          /* off or bus-off */
    uint64_t senders;       /* listeners that may transmit */
    uint64_t orderly;       /* senders whose queues go by priority */
    uint64_t acknowledgers; /* listeners that acknowledge */
    uint64_t counting;      /* acknowledgers whose REC a good frame lowers (R8) */
    uint64_t one_shot;      /* senders that try once (M13) */
    uint64_t fd;            /* listeners that know FD frames */
    uint64_t plain;         /* senders whose frames need none of what is rare: no other way of time
                               than frame steps, no order of their own, nothing between controllers
                               and hosts, no reasons for single bits. 0 unless valid and calm */
} cw_outlook;

/* The tournament of the frames that wait, see step/arbiter.c. */
#define CW_ARBITER_HASHES 1024u
typedef struct cw_arbiter {
    uint64_t entries[1 + 4 + 16 + 64]; /* a heap of four: 0 is the root, the last ones are nodes */
    unsigned leaves; /* place of the first node */
    uint64_t stale; /* nodes whose first frame may differ from the one in their leaf */
    uint8_t hashes[CW_ARBITER_HASHES]; /* of the nodes' entries: how many have each */
} cw_arbiter;

/* Statistics that many nodes count alike, see shares.c. */
typedef struct cw_shares {
    uint64_t contenders; /* nodes that have lost `lost` arbitrations since their lost_before */
    unsigned contender_count;
    uint64_t lost;
    uint64_t listeners;  /* nodes that receive all frames counted below, from when they began to
                            listen */
    uint64_t rx_frames;
    uint64_t rx_bytes;
} cw_shares;

/* A clean frame on its way, see step/frame.c. */
typedef struct cw_frame_step {
    bool active;
    bool at_work;         /* rules act on the levels of its bits */
    bool hit;             /* a rule may hit a bit of the frame, so the step needs all its bits */
    bool sure;            /* ... and the only look at one is a hit */
    bool seen;            /* traces look at its bits, see step/frame_seen.c */
    uint8_t node;         /* the transmitter */
    uint8_t tail;         /* last bits, up to the intermission, that pass one by one */
    uint16_t at;          /* bits that have passed, SOF to the third of the intermission */
    cw_look look;         /* the next bit that a rule looks at; at a hit, single bits go on */
    uint16_t length;      /* SOF to EOF */
    uint8_t after_ack;    /* of these, behind the bit in which it is acknowledged */
    cw_fast_part fast;    /* the bits at the data rate, if any */
    const cw_bits *bits;  /* NULL: not encoded, see cw_frame_step_bits() */
    cw_stuffing stuffing; /* of the bits */
    cw_frame frame;       /* the frame of the bits; at the end the queue may have another one in
                             that slot */
    uint64_t listeners;
    uint64_t contenders;  /* nodes that began to transmit */
    uint64_t watched;     /* of these, those whose bits rules look at before the step ends */
    uint16_t counted;     /* the rule whose match has been counted at SOF, or CW_NO_RULE */
    uint64_t undecided;   /* of these, those that have not lost yet and will */
    uint64_t hidden;      /* of these, those whose losses have been counted at SOF */
    uint64_t pinned;      /* of these, those whose offered slot has the frame that they began with;
                             that of the others is still the first of their queue */
    uint8_t next_loss;    /* the first lost_at of the undecided nodes */
    uint8_t won_at;       /* the bits after which an improper arbitration is over; 0: it is not one,
                             or it has been reported */
    uint8_t lost_bit[CW_NODES_MAX]; /* as the SJA1000 counts */
    uint8_t lost_at[CW_NODES_MAX];  /* the wire bit */
} cw_frame_step;

struct cw_bus {
    cw_wire_time time;
    size_t state_size; /* bytes, from the bus on: its state, ... */
    size_t size;       /* ... and the room behind it, too; see cw_bus_copy() */
    unsigned node_count;
    uint64_t node_due; /* the earliest of `restarts`, of frames that hosts fetch, and of nodes that
                          are awake again, and of `tt` */
    uint64_t recessive_bits;
    uint64_t clean_bits;   /* of clean frames, not in the statistics yet; 0 between public calls */
    uint64_t work;         /* see cw_bus_work() */
    uint64_t queued;       /* frames in all queues */
    uint64_t groups[CW_NODES_MAX]; /* wires of a partitioned bus, as sets of nodes */
    unsigned group_count;          /* 1: all nodes on one wire */
    cw_flag_watch error_flag;
    cw_flag_watch overload_flag;
    cw_load load;
    cw_bus_stats stats;
    cw_inbox inbox;
    cw_event_ring ring;
    uint64_t all;       /* nodes */
    uint64_t followers; /* nodes that share the controller `common`, see followers.c */
    uint64_t waiting;   /* nodes with frames in their queues; not those asleep */
    uint64_t asleep;    /* nodes that sleep, until they integrate */
    uint64_t dozing;    /* of these, the ones that wait for a dominant phase ... */
    uint64_t listening; /* ... or for a frame */
    uint64_t detached;  /* nodes that their hosts have taken off the bus */
    uint64_t removed;   /* of these, the ones that never come back; they are flushed */
    uint64_t unplugged; /* of detached, those whose controllers nobody has changed since: off */
    cw_mac common;
    cw_fd_part *fd_parts; /* of `common`, and of each node; NULL: no node knows FD frames */
    cw_outlook outlook;
    cw_frame_step frame_step;
    cw_frame_seen frame_seen;
    cw_arbiter arbiter;
    cw_shares shares;
    uint32_t wanted;    /* kinds of events, as bits */
    uint64_t old; /* nodes that read extended frames as base frames (2.0A) */
    uint64_t strict; /* nodes that destroy frames with a DLC above 8 */
    uint64_t silent; /* nodes whose hosts are not told of error-passive */
    bool overload_when_full; /* some node wants overload frames when its buffers are full */
    bool formats_differ; /* some node knows FD frames, is of CAN 2.0A, or strict */
    bool fd;   /* some node knows FD frames, so there is room for them */
    bool wire; /* level of the last bit, all wires together */
    bool stepping; /* nothing is skipped, nothing shared */
    bool watching; /* nothing is skipped */
    bool start_at_tick; /* see cw_bus_config */
    uint64_t early_ticks; /* by which bits before such frames so far were shorter */
    bool lean; /* no memory for clocks, delays and sleep: see `keeps_setup` of cw_bus_config */
    bool pending; /* pending: a rule or a setting has changed something at a controller */
    cw_event unwanted_event; /* written to when the kind is not wanted */
    cw_event lost_event; /* written to when the ring is full */
    cw_lengths *lengths;
    cw_bus_node *nodes;
    cw_restart_times *restarts; /* one for each node */
    cw_start *starts;        /* likewise: of the last transmission */
    cw_error_frame *error_frames; /* likewise, and one more: of receivers at error_at */
    uint64_t error_at;
    cw_sleep *sleeps;        /* likewise; NULL on a lean bus */
    cw_buffers *buffers;     /* ... or NULL: no node has filters, buffers or mailboxes */
    uint64_t replying;       /* nodes with replies of mailboxes in their queues */
    uint32_t stored;         /* frames in all receive buffers now ... */
    uint32_t stored_most;    /* ... and at most */
    cw_tt *tt;               /* ... or NULL: no node has local time */
    uint32_t triggers;       /* of all nodes */
    cw_rule_set rules;
    cw_timed timed;
    cw_bit_note note;
};

/* Call it after a change of a controller, or of anything else that the outlook depends on. */
static inline void cw_outlook_forget(cw_bus *bus)
{
    bus->outlook.valid = false;
    bus->outlook.plain = 0;
}

/* Returns the nodes that go by controllers of their own. Those that are unplugged do nothing. */
static inline uint64_t cw_single_nodes(const cw_bus *bus)
{
    return bus->all & ~(bus->followers | bus->unplugged);
}

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

/* ---- enqueue.c ------------------------------------------------------------------------------- */

/* Puts a frame into a node's queue, or drops it with an event. source: 0 for the host's frames, the
 * index of the rule plus 1 for those of a rule. */
void cw_queue_frame(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick,
                    unsigned source);

/* Puts a valid frame into a node's queue. cw_refusal() must have returned CW_DROP_COUNT. */
void cw_enqueue(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick, unsigned source);

/* Queues the reply of a mailbox. Its node takes frames now, but for want of room in its queue. */
void cw_enqueue_reply(cw_bus *bus, unsigned node, const cw_frame *frame, unsigned box);

/* Makes the FD frame that has just been put into the queue one that the controller would send now
 * (D8). */
void cw_complete_fd(const cw_bus_node *node);

/* Returns true when the frame is valid, and one that the controller of the node knows (D17). */
static inline bool cw_knows_frame(const cw_bus *bus, unsigned node, const cw_frame *frame)
{
    return cw_mac_knows(&bus->nodes[node].mac, frame);
}

/* Returns the reason why a node takes no frame now; CW_DROP_COUNT when it takes one. */
cw_drop cw_refusal(const cw_bus *bus, unsigned node);

/* Makes the first frame of a node's queue the offered one, without encoding it. */
void cw_pin_first(cw_bus_node *node);

/* Takes a slot out of a node's queue. The frame that goes first may then be another one. */
void cw_remove_slot(cw_bus *bus, unsigned node, uint16_t slot);

/* Takes out the frame of the offered slot of a node that is plain (cw_outlook), all of whose lost
 * arbitrations have been shared out. */
static inline void cw_remove_sent(cw_bus *bus, unsigned node)
{
    cw_queue *q = &bus->nodes[node].queue;
    const uint16_t slot = bus->nodes[node].offered_slot;
    cw_rules_count_gone(&bus->rules, cw_queue_at(q, slot)->source);
    if (slot == cw_queue_first(q))
        cw_queue_remove_first(q);
    else
        cw_queue_remove(q, slot);
    bus->queued--;
    bus->waiting &= ~((uint64_t)(q->count == 0) << node);
    cw_rules_forget_frame(&bus->rules, node);
    bus->arbiter.stale |= cw_node_bit(node);
}

/* Drops all frames of a node's queue. */
void cw_flush_queue(cw_bus *bus, unsigned node, cw_drop why);

/* Call it when the first frame of a node's queue may have changed. */
void cw_queue_changed(cw_bus *bus, unsigned node);

/* Returns the bytes of an entry. fd: it has room for FD frames. */
static inline size_t cw_inbox_entry_size(bool fd)
{
    return cw_frame_entry_size(offsetof(cw_inbox_entry, frame), fd);
}

/* Returns the i-th entry. */
static inline cw_inbox_entry *cw_inbox_at(const cw_inbox *box, unsigned i)
{
    const unsigned place = box->first + i < box->capacity ? box->first + i
                                                          : box->first + i - box->capacity;
    return (cw_inbox_entry *)(void *)(box->entries + (size_t)place * box->entry_size);
}

/* ---- inbox.c --------------------------------------------------------------------------------- */

/* Returns the tick of the first frame in the inbox, or CW_NEVER. */
static inline uint64_t cw_inbox_first(const cw_bus *bus)
{
    return bus->inbox.next;
}

/* Returns the tick before which nothing comes in and nothing is due for nodes and rules. */
static inline uint64_t cw_first_due(const cw_bus *bus)
{
    return cw_least(cw_least(bus->node_due, bus->rules.next_due), cw_inbox_first(bus));
}

/* Takes the frames that come before tick out of the inbox. At least one must be there. */
void cw_take_inbox(cw_bus *bus, uint64_t tick);

static inline void cw_take_inbox_before(cw_bus *bus, uint64_t tick)
{
    if (cw_inbox_first(bus) < tick)
        cw_take_inbox(bus, tick);
}

/* Takes the first frame out of the inbox, which has one. */
void cw_take_inbox_first(cw_bus *bus);

/* Takes the frames of a node that are due now out of the inbox, up to the first one of another
 * node. Those that came after a restart request stay while it is due. */
void cw_take_inbox_of(cw_bus *bus, unsigned node);

/* Does the same with the frames of a node that come before a tick, wherever they are. */
void cw_take_inbox_of_before(cw_bus *bus, unsigned node, uint64_t tick);

/* Puts the frame of a trigger, 1 + number, into the inbox. The node has no other one in it. */
void cw_inbox_put_triggered(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick,
                            unsigned trigger);

/* Drops all frames of a node from the inbox. */
void cw_flush_inbox(cw_bus *bus, unsigned node);

/* ---- restart.c ------------------------------------------------------------------------------- */

void cw_schedule_restart(cw_bus *bus, unsigned node, uint64_t tick);

/* Returns true while a node is to be restarted at this tick. */
static inline bool cw_restart_is_due(const cw_bus *bus, unsigned node)
{
    return bus->restarts[node].at <= cw_now(bus);
}

/* Returns the tick at which a node in bus-off restarts by itself: restart_ticks after bus-off, not
 * before now; or CW_NEVER (R12). */
uint64_t cw_automatic_restart(const cw_bus *bus, unsigned node);

/* Finds the next restart, or frame that a host has fetched. */
void cw_find_node_due(cw_bus *bus);

/* ---- buffers.c ------------------------------------------------------------------------------- */

/* Returns true when a received frame is for the host of a node: no mailbox answers it, and the
 * filters let it pass. Counts it otherwise. */
bool cw_buffers_accept(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Takes a frame for the host of a node. The caller no longer needs it. */
void cw_buffers_receive(cw_bus *bus, unsigned node, cw_frame *frame, const cw_frame_origin *origin);

/* Hands out the frames that the host of a node has fetched by now. */
void cw_buffers_run(cw_bus *bus, unsigned node);

/* Returns the tick at which the host of a node has fetched its next frame, or CW_NEVER. */
uint64_t cw_buffers_due(const cw_bus *bus, unsigned node);

/* Returns the frames that wait for the host of a node. */
uint32_t cw_buffers_count(const cw_bus *bus, unsigned node);

/* Drops the frames that wait for the host of a node. */
void cw_buffers_flush(cw_bus *bus, unsigned node, cw_drop why);

/* Returns the n-th frame that waits for the host of a node. */
const cw_stored_frame *cw_buffers_at(const cw_bus *bus, unsigned node, unsigned n);

/* Puts a frame that waited in another bus behind those that wait for the host of a node. The host
 * has it at once without `waits`, and when there is no place for it. */
void cw_buffers_put(cw_bus *bus, unsigned node, const cw_stored_frame *stored, bool waits);

/* ---- mailboxes.c ----------------------------------------------------------------------------- */

/* Returns the set with that mailbox alone. */
static inline uint64_t cw_box_bit(unsigned box)
{
    return box < CW_MAILBOXES_MAX ? UINT64_C(1) << box : 0;
}

/* Returns the first of a set of mailboxes that takes a frame, or CW_NO_BOX. */
unsigned cw_mailbox_for(const cw_buffers *b, uint64_t boxes, const cw_frame *frame);

/* Returns the mailboxes that have frames of a queue. */
uint64_t cw_mailboxes_full(const cw_queue *q);

/* Returns true when the node may send the frame: a mailbox takes it, or it has none. */
bool cw_mailboxes_take(const cw_bus *bus, unsigned node, const cw_frame *frame);

/* Finds a mailbox for the frame that has just been queued. One that none takes goes without. */
void cw_mailboxes_find_one(cw_bus *bus, unsigned node);

/* Moves a frame of the queue into a mailbox. */
void cw_mailboxes_put_into(cw_bus *bus, unsigned node, uint16_t slot, unsigned box);

/* Takes a slot out of the queue; a frame that waits may take its mailbox. */
void cw_mailboxes_remove(cw_bus *bus, unsigned node, uint16_t slot);

/* Keeps a data frame in the mailbox that will reply with it. Returns false when there is none. */
bool cw_mailboxes_store(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Returns the replies in the queue of a node. */
unsigned cw_mailbox_replies(const cw_bus *bus, unsigned node);

/* Returns the first receive mailbox that takes a frame and is not full, or CW_NO_BOX. */
unsigned cw_mailboxes_for(const cw_buffers *b, const cw_frame *frame, uint64_t full);

/* Returns true when the filter of a mailbox matches a frame. */
bool cw_mailbox_takes(const cw_buffers *b, unsigned box, const cw_frame *frame);

/* Takes over what has been written, from the node of another bus. */
void cw_mailboxes_take_over(cw_bus *bus, unsigned node, const cw_buffers *old);

/* Finds a mailbox for the newest frame of the queue as it was in another bus. reply: of a mailbox
 * that replied there. */
void cw_mailboxes_find_again(cw_bus *bus, unsigned node, bool reply);

/* Returns true when the n-th frame of a queue is the reply of a mailbox. */
bool cw_mailboxes_is_reply(const cw_bus *bus, unsigned node, unsigned n);

/* ---- replies.c ------------------------------------------------------------------------------- */

/* Answers a remote frame. Returns false when no mailbox does. */
bool cw_mailboxes_answer(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Gives the replies in the queue of a node the data last written. */
void cw_mailboxes_load_now(cw_bus *bus, unsigned node);

/* Does this before its next transmission begins. */
static inline void cw_mailboxes_load(cw_bus *bus, unsigned node)
{
    if (bus->replying >> node & 1u)
        cw_mailboxes_load_now(bus, node);
}

/* Returns the controller of a node, shared or its own (followers.c). */
const cw_mac *cw_mac_of(const cw_bus *bus, unsigned node);

/* ---- sleep.c --------------------------------------------------------------------------------- */

/* Lets a node sleep, as soon as its controller can. */
void cw_sleep_request(cw_bus *bus, unsigned node);

/* Has the host of a node wake it when the bus goes on. One that is still to fall asleep stays
 * awake. */
void cw_sleep_call(cw_bus *bus, unsigned node);

/* Notes that the controller of a node has fallen asleep, if that is new. */
void cw_sleep_settle(cw_bus *bus, unsigned node);

/* Returns true when a node is asleep and shall stay so, or is to fall asleep. */
bool cw_sleep_wanted(const cw_bus *bus, unsigned node);

bool cw_sleep_valid(const cw_sleep_settings *settings);

/* Lets a node that is asleep wait for what wakes it. Call it after that has changed. */
void cw_sleep_wait(cw_bus *bus, unsigned node);

/* Wakes a node, or lets one that has been woken integrate. */
void cw_sleep_wake(cw_bus *bus, unsigned node, cw_wake why);

/* Ends the sleep of a node that is bus-off or reset, without an event. */
void cw_sleep_forget(cw_bus *bus, unsigned node);

/* Wakes nodes whose hosts want it, and lets those that are due integrate. */
void cw_sleep_run(cw_bus *bus, unsigned node);

/* Takes a frame that a sleeping node has received: it may wake it. */
void cw_sleep_hear(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Returns the modes of a node as its host knows them. */
static inline unsigned cw_modes_of(const cw_bus *bus, unsigned node)
{
    return bus->listening >> node & 1u ? bus->sleeps[node].modes : bus->nodes[node].mac.modes;
}

/* Changes them. */
void cw_set_modes_of(cw_bus *bus, unsigned node, unsigned modes);

/* Returns the state of a node as its host knows it. */
static inline cw_state cw_node_state(const cw_bus *bus, unsigned node)
{
    return bus->asleep >> node & 1u ? CW_STATE_SLEEPING
                                    : (cw_state)bus->nodes[node].mac.confinement.state;
}

/* Returns the phase of a node as its host knows it. */
static inline cw_mac_phase cw_phase_of(const cw_bus *bus, unsigned node)
{
    return bus->listening >> node & 1u ? CW_MAC_ASLEEP : (cw_mac_phase)cw_mac_of(bus, node)->phase;
}

/* ---- tt.c, for a bus with local times but where it says so ----------------------------------- */

/* Starts the schedule of a node, or ends it for good, if it has one. The bus need have none. */
void cw_tt_start(cw_bus *bus, unsigned node);
void cw_tt_stop(cw_bus *bus, unsigned node);

/* Returns the next tick at which a node has something to do; CW_NEVER also where no node has local
 * time. */
uint64_t cw_tt_due(const cw_bus *bus, unsigned node);

/* Does what is due for a node; nothing where no node has local time. */
void cw_tt_run(cw_bus *bus, unsigned node);

/* Note the SOF that began at a tick, for nodes that have seen it. Bits are common to all nodes. */
void cw_tt_see_sof(cw_bus *bus, unsigned node, uint64_t begin);
void cw_tt_see_sofs(cw_bus *bus, uint64_t nodes, uint64_t begin);

/* Looks for nodes that have seen a SOF in the bit that has passed. */
void cw_tt_look(cw_bus *bus);

/* Note the sample point of a SOF, or of the last bit of EOF, of a node that goes by its own
 * clock. */
void cw_tt_see_sof_at(cw_bus *bus, unsigned node, cw_span moment);
void cw_tt_see_eof_at(cw_bus *bus, unsigned node, cw_span moment);

/* Returns true when such a node has a slot that is over at a moment at which a bit of it begins. */
bool cw_tt_closes_by(const cw_bus *bus, unsigned node, cw_span moment);

/* Ends that slot then. */
void cw_tt_close_at(cw_bus *bus, unsigned node, cw_span moment);

/* Lets the clock of a node go on at the rate of its new bit timing, from an instant on. */
void cw_tt_retime(cw_bus *bus, unsigned node, cw_instant from);

/* Gives a node another unit of local time, with its next bit timing. */
void cw_tt_give_unit(cw_bus *bus, unsigned node, cw_span unit, cw_span quantum);

/* Note how the frame in a slot of a queue has fared. The node has begun to send it at a tick,
 * has lost arbitration with it, or has given it up after its only attempt. */
void cw_tt_started(cw_bus *bus, unsigned node, unsigned slot, uint64_t tick);
void cw_tt_lost(cw_bus *bus, unsigned node, unsigned slot);
void cw_tt_failed(cw_bus *bus, unsigned node, unsigned slot);

/* Note that a node has received a frame, from some nodes, or has sent one. */
void cw_tt_received(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t from);
void cw_tt_sent(cw_bus *bus, unsigned node, const cw_queue_slot *slot);

/* Returns the ticks from its trigger to the start of the frame that a node has just sent. */
uint64_t cw_tt_late(const cw_bus *bus, unsigned node, const cw_queue_slot *slot);

/* Returns the bits of a local time that the host of the node sees. */
uint64_t cw_tt_visible(const cw_tt *tt, uint64_t local);

/* Returns true when counter and schedule of a node are those of another bus. */
bool cw_tt_goes_on(const cw_tt *tt, const cw_tt *old);

/* Goes on as a node of another bus, whose nodes have other numbers now. */
void cw_tt_take_over(cw_bus *bus, unsigned node, const cw_tt *old,
                     const uint8_t to[CW_NODES_MAX]);

/* ---- ring.c ---------------------------------------------------------------------------------- */

/* Events that one node can have in one bit besides drops of frames. */
#define CW_EVENTS_PER_NODE 12u

/* Finds the most room that a bit can need. Call it when rules come or go. */
void cw_ring_find_enough(cw_bus *bus);

/* Does the work of cw_ring_has_room() when the ring is too full for every possible bit. */
bool cw_ring_has_room_now(const cw_bus *bus);

/* Returns true when the ring has room for the worst case up to the end of the next bit. */
static inline bool cw_ring_has_room(const cw_bus *bus)
{
    return bus->ring.capacity - bus->ring.count >= bus->ring.enough || cw_ring_has_room_now(bus);
}

/* Returns the bytes of an event in the ring. fd: it has room for FD frames. */
static inline size_t cw_ring_event_size(bool fd)
{
    return cw_frame_entry_size(offsetof(cw_event, frame), fd);
}

/* Returns the event at a place of the ring's memory. */
static inline cw_event *cw_ring_at(const cw_event_ring *ring, unsigned place)
{
    return (cw_event *)(void *)(ring->events + (size_t)place * ring->event_size);
}

/* Adds an event. The caller may fill it in until the next one is added. */
cw_event *cw_push_event(cw_bus *bus, cw_event_kind kind, uint64_t tick, uint64_t nodes);

/* Returns true when events of a kind are wanted. */
static inline bool cw_wants_event(const cw_bus *bus, cw_event_kind kind)
{
    return bus->wanted >> kind & 1u;
}

/* A frame that some nodes, at least one, receive at a tick, before its sender has sent it. */
typedef struct cw_rx_tx {
    unsigned sender;
    uint64_t receivers;
    uint64_t accepted; /* tick */
    uint64_t ended;    /* tick */
    cw_event *rx;
    cw_event *tx;
} cw_rx_tx;

/* Adds both events, without the frame and its origin, behind all others. Events that are not wanted
 * go to a place of their own. Returns false, with nothing done, when their place is another one or
 * only one of them is wanted. The ring must have room for them in a row, too. */
bool cw_push_rx_tx(cw_bus *bus, cw_rx_tx *pair);

/* Adds an event at the present tick, with the node's counters. */
cw_event *cw_push_node_event(cw_bus *bus, cw_event_kind kind, unsigned node);

/* Adds the hit of a rule that is not quiet. */
void cw_push_fault(cw_bus *bus, unsigned rule, uint64_t tick);

/* Adds the drop of a frame and counts it. side: the way of the frame, onto the bus or to the
 * host. */
cw_event *cw_push_drop(cw_bus *bus, unsigned node, cw_side side, const cw_frame *frame,
                       cw_drop why, uint64_t tick);

/* Adds a frame for a host; joins the newest event when that is the same frame for earlier nodes. */
void cw_push_rx(cw_bus *bus, unsigned node, const cw_frame *frame, const cw_frame_origin *origin);

/* ---- origin.c -------------------------------------------------------------------------------- */

/* Returns the senders of the frame that a node has just received. They are on its wire. */
uint64_t cw_find_senders(const cw_bus *bus, unsigned receiver);

/* Returns the tick at which the host handed in the frame that a node sends, or has just sent. */
uint64_t cw_handed_in_of(const cw_bus *bus, unsigned node);

/* Finds who has sent that frame, and when the first sender's host handed it in. */
cw_frame_origin cw_find_origin(const cw_bus *bus, unsigned receiver);

/* Sets the frame that an error belongs to, `from` and `can_id` of its event. An error in an error
 * flag or behind it belongs to the frame of the node's error before. */
void cw_find_error_frame(cw_bus *bus, unsigned node, cw_event *event);

/* Notes the frame in which a node begins an error flag. own: it has been the transmitter of it. */
void cw_note_flag(cw_bus *bus, unsigned node, bool own);

/* ---- order.c --------------------------------------------------------------------------------- */

/* Returns the nodes on the same wire as this one, itself included. */
uint64_t cw_nodes_on_wire_of(const cw_bus *bus, unsigned node);

/* Notes that a node begins to transmit, with a SOF that began at a tick. */
void cw_order_begin(cw_bus *bus, unsigned node, uint64_t tick);

/* Returns true when a node would win the arbitration with the frame of a slot though a lower
 * identifier is pending. cw_order_begin() must have been called. */
bool cw_order_is_improper(const cw_bus *bus, unsigned node, uint16_t slot);

/* Reports and counts it, for a node that has just won with the frame of its offered slot. */
void cw_order_check(cw_bus *bus, unsigned node);

/* ---- shares.c -------------------------------------------------------------------------------- */

/* Does the work of cw_share_lost() for a node that has a share. */
void cw_share_lost_now(cw_bus *bus, unsigned node);

/* Adds a node's share of lost arbitrations to its statistics. Call this function before the first
 * frame of the node changes, or is tried in another way. */
static inline void cw_share_lost(cw_bus *bus, unsigned node)
{
    if (bus->nodes[node].lost_before != bus->shares.lost)
        cw_share_lost_now(bus, node);
}

/* Adds a node's share that is not in its statistics yet to a copy of these statistics. */
void cw_share_stats(const cw_bus *bus, unsigned node, cw_node_stats *stats);

/* Set the nodes that take part from now on. */
void cw_set_contenders(cw_bus *bus, uint64_t nodes);
void cw_set_listeners(cw_bus *bus, uint64_t nodes);

/* Counts a frame that all listeners but its sender, itself a listener, have received. */
void cw_count_received(cw_bus *bus, unsigned sender, unsigned bytes);

/* Asserts that the shares are possible ones. */
void cw_assert_shares(const cw_bus *bus);

/* ---- followers.c ----------------------------------------------------------------------------- */

/* Returns the node's own controller, to change it; controllers must be awake. */
cw_mac *cw_own_mac(cw_bus *bus, unsigned node);

/* Gives these nodes their own controllers from now on. */
void cw_leave(cw_bus *bus, uint64_t nodes);

/* ---- topology.c ------------------------------------------------------------------------------ */

/* Takes nodes off the bus, moves them to other wires and forbids them to acknowledge, as the active
 * rules and the hosts demand. Undoes all that is no longer demanded. */
void cw_apply_topology(cw_bus *bus);

/* Returns the wired-AND of each wire, as its nodes see it. */
uint64_t cw_wired_and(const cw_bus *bus, uint64_t driven);

/* ---- rates.c --------------------------------------------------------------------------------- */

/* Return the time quantum and the bit timing of the data phase of a node, and a clock, by what is
 * nominal. The clock only matters where there is a data rate. */
cw_span cw_data_quantum(cw_span nominal, const cw_data_timing *data);
cw_bit_timing cw_data_bit_timing(const cw_data_timing *data, const cw_bit_timing *nominal);
cw_span cw_data_clock(const cw_data_timing *data, const cw_bit_timing *nominal);

/* Gives a node its data phase, besides its nominal bit timing. Some node must have a data rate. */
void cw_timed_set_data(cw_bus *bus, unsigned node, const cw_data_timing *data);

/* Returns the nodes whose present bit goes by the data rate. */
uint64_t cw_fast_nodes(const cw_bus *bus);

/* Gives a node its next bit timing, at both rates. */
void cw_timed_retime_rates(cw_bus *bus, unsigned node);

/* ---- note.c ---------------------------------------------------------------------------------- */

/* Notes the bit in progress, after all nodes drove and before they sample. */
void cw_view_note(cw_bus *bus, const cw_levels *levels);

/* Notes a bit of a clean frame that one node sends and all others follow. They have its place and
 * phase in common. */
void cw_view_note_sent(cw_bus *bus, const cw_levels *levels, unsigned sender,
                       const cw_bit_node *all);

/* Returns the place of a controller in its bit, by the names that traces have for it. */
cw_place cw_view_place(const cw_bus *bus, const cw_mac *mac);

/* Returns true when the note of the last bit shows an idle bus on which no rule acts. All nodes
 * must still be as they were in that bit. */
bool cw_view_is_quiet(const cw_bus *bus);

/* Returns what has been noted of a node. */
static inline const cw_bit_node *cw_noted(const cw_bit_note *note, unsigned i)
{
    return &note->nodes[note->alike >> i & 1u ? cw_lowest_node(note->alike) : i];
}

/* ---- report.c -------------------------------------------------------------------------------- */

/* Reports the state of a node, which has changed since the last report. */
void cw_report_new_state(cw_bus *bus, unsigned node);

static inline void cw_report_state(cw_bus *bus, unsigned node)
{
    if (bus->nodes[node].reported_state != cw_node_state(bus, node))
        cw_report_new_state(bus, node);
}

/* ---- commit.c -------------------------------------------------------------------------------- */

/* Does the work of cw_count_clean_bits() when there are some. */
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

/* Makes the events and statistics of one node at the end of a bit, in the order of
 * cw_event_kind. */
void cw_commit_node(cw_bus *bus, unsigned node, const cw_mac_report *report);

/* Does this before the controller or the frames of a node are thrown away. By a clock of its own it
 * may have sampled its bit and not ended it. */
void cw_commit_early(cw_bus *bus, unsigned node);

/* Reports that the node has lost arbitration at a bit with the frame of its offered slot. */
void cw_report_arbitration_lost(cw_bus *bus, unsigned node, uint8_t bit);

/* Notes when a transmission ends, and the time of its frame. The slot may have another frame when
 * the last receiver has this one. */
void cw_note_end(cw_bus *bus, unsigned node, uint64_t tick);

/* Notes that something at this place ends a transmission, unless it has ended before. */
void cw_note_stopped(cw_bus *bus, unsigned node, cw_place place);

/* Does this for a node that is taken from its transmission, if it has one. */
void cw_note_left(cw_bus *bus, unsigned node);

/* Does this for an error that a node reports. All nodes do it before the first receiver has its
 * frame in the same bit. */
void cw_note_report(cw_bus *bus, unsigned node, const cw_mac_report *report);

/* Commits that the node has sent the frame of its offered slot, in that many bits from SOF to
 * EOF. */
void cw_commit_sent(cw_bus *bus, unsigned node, unsigned wire_bits);

/* Commits that the node has received a frame. */
void cw_receive(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Commits that receivers have received the frame of their sender's offered slot, which has then
 * been sent. cw_push_rx_tx() has added the events, and the present tick is the end of the frame. */
void cw_commit_rx_tx(cw_bus *bus, const cw_rx_tx *pair);

/* Commits that some nodes, at least one, have received the frame of a sender as it was sent, with
 * that many bytes of data. No rule acts on it on the host side. The caller fills the frame into the
 * event. */
cw_event *cw_receive_together(cw_bus *bus, unsigned sender, uint64_t receivers, unsigned bytes);

/* Returns true when rules on the host side, filters, buffers or local times may act on a received
 * frame, or it may wake a node. */
static inline bool cw_host_side_acts(const cw_bus *bus)
{
    return bus->rules.host_rules || bus->rules.reply_rules || bus->rules.held_count ||
           bus->buffers || bus->listening || bus->tt;
}

/* Commits that followers have received a frame in this bit, when no other node has a report.
 * Returns true when that was possible for all of them at once. */
bool cw_commit_reception(cw_bus *bus);

#endif
