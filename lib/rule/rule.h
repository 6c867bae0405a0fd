/* SPDX-License-Identifier: MIT
 *
 * rule.h - fault rules, as the rest of the library sees them.
 *
 * Files that decide when a rule acts:
 *   add.c valid.c  add and remove rules, and check them
 *   index.c        finds the rules whose filters match a frame; list.c has sorted lists
 *   rule.c         decides when a match becomes a hit; prng.c draws random numbers
 *   arming.c       arms rules after hits of others, or by hand
 *   bind.c error.c due.c  wait for transmissions, errors and times
 *   look.c         finds the bits of a frame that rules look at in a frame step
 * Files that act:
 *   begin.c        begins and ends actions; awake.c lists the rules that each bit needs
 *   level.c noise.c topology.c  change the levels of bits, and the wires of nodes
 *   raw.c          drives given bits in place of a controller
 *   in_time.c disturb.c  do so where nodes have clocks of their own
 *   host.c         acts on frames on the host side
 *   protect.c      writes counters and checksums into frames, and makes faults in them
 *   traffic.c      sends the frames of rules
 * The bus acts on controllers, queues and events for the rules (cw_rule_effects). The controllers
 * themselves do all that follows on the bus.
 */
#ifndef CANWIRE_RULE_H
#define CANWIRE_RULE_H

#include "canwire.h"
#include "format/bits.h"
#include "format/bitset.h"
#include "format/frame.h"
#include "rule/action.h"
#include "rule/disturb.h"
#include "rule/prng.h"
#include "time/wire.h"

/* The first flag of one kind since the last SOF of a transmitter. */
typedef struct cw_flag_watch {
    bool now;        /* some node is in such a flag in the present bit */
    bool over;       /* the first flag of this attempt has ended */
    uint64_t length; /* bits of it so far, the present one not included */
} cw_flag_watch;

/* ---- What an action keeps -------------------------------------------------------------------- */

/* CW_HAS_POSITION: the bits that it changes, counted from the named one. */
typedef struct cw_position_kept {
    uint64_t bound;      /* nodes whose present transmission the rule looks at */
    uint64_t bits_done;  /* of the action under way */
    uint64_t bits_left;  /* of one that lasts for a time 1, until that has passed */
    uint64_t ticks_left; /* of that time ... */
    cw_span part;        /* ... but for this part of a tick */
    uint64_t reached_at; /* tick of the bit time in which the position was last reached ... */
    uint8_t source;      /* ... by this node, whose bits count */
    bool disturbs;       /* it acts in the present bit of that node, see in_time.c */
    bool pulses;         /* PULSE: one is to come in the next bit time */
} cw_position_kept;

/* CW_ON_LINE: a line that is stuck. */
typedef struct cw_line_kept {
    uint64_t dominant_ticks; /* of a TX line: its dominant time up to now */
} cw_line_kept;

/* CW_RANDOM_BITS: bursts of bits. */
typedef struct cw_noise_kept {
    uint64_t in_burst; /* nodes that are in a burst; bit 0 for the wire ... */
    uint16_t bursts[CW_NODES_MAX]; /* ... and the bits to come of each, the next one lowest */
} cw_noise_kept;

/* RAW: the bits that a node drives without its controller. */
typedef struct cw_raw_kept {
    uint64_t bits_done;
    uint64_t next_at; /* tick of the end of the present bit, while it drives or waits */
    bool waits;       /* the bits come when the node is idle */
} cw_raw_kept;

/* CW_KIND_TRAFFIC but for replies: the frames that the rule sends. */
typedef struct cw_traffic_kept {
    uint64_t next_at;     /* SEND, RAW_FRAME: tick of the next frame. Otherwise CW_NEVER */
    uint64_t busy_base;   /* LOAD: busy time and time when it began */
    uint64_t time_base;
    uint16_t outstanding; /* frames in queues */
} cw_traffic_kept;

/* CW_KIND_HOST: one decision for all receivers of a frame. */
typedef struct cw_host_kept {
    uint64_t rx_tick; /* the last one on the RX side ... */
    bool rx_hit;      /* ... and what it was */
} cw_host_kept;

/* ---- A rule in use --------------------------------------------------------------------------- */

#define CW_ARMINGS_MAX 16u /* armings of a rule under way, further ones are lost */

typedef struct cw_rule_state {
    cw_rule rule;
    const cw_action_row *does; /* the row of its action ... */
    unsigned traits;           /* ... and the traits of that row, CW_NEEDS_FRAME etc. */
    cw_prng prng;
    bool used;            /* the place holds a rule */
    bool awake;           /* in the awake list: looked at in every bit */
    bool active;          /* acting, see active_until */
    bool hit_now;         /* hit in the bit in progress; it becomes an event at its end ... */
    bool to_act;          /* hit, and it acts at the end of the bit */
    bool for_attempt;     /* acts only while the transmissions of `scope` last */
    bool open;            /* no time, arming or place in a frame keeps it from a match */
    uint32_t armed;       /* hits allowed, when the rule must be armed */
    uint32_t to_pass;     /* matches to pass over before the next that is taken */
    uint64_t on_wire;     /* nodes whose wire it acts on, if it acts on levels ... */
    uint64_t at_nodes;    /* ... and nodes whose samples it changes */
    uint64_t scope;       /* for_attempt: nodes whose transmissions still last */
    uint64_t matches;
    uint64_t taken;       /* matches that were not passed over */
    uint64_t hits;
    uint64_t last_hit;    /* tick */
    uint64_t hit_at;      /* ... tick of that end, if hit_now */
    uint64_t fire_at;     /* TIME: tick when it acts next, or CW_NEVER */
    uint64_t arm_at[CW_ARMINGS_MAX]; /* ticks of the armings under way, sorted */
    unsigned armings;
    uint64_t armed_at;    /* tick of the last arming; one at a tick */
    uint64_t error_at;    /* ERROR: tick of the last match; one at a tick */
    uint64_t active_until; /* tick; CW_NEVER: until cleared */
    union {               /* by the action: ask `traits` or `does` first, see above */
        cw_noise_kept noise; /* the largest is first, so that all is 0 at the start */
        cw_position_kept position;
        cw_line_kept line;
        cw_raw_kept raw;
        cw_traffic_kept traffic;
        cw_host_kept host;
    };
} cw_rule_state;

/* The origin of a received frame, see cw_event. All 0 for frames on their way to the wire. */
typedef struct cw_frame_origin {
    uint64_t from;
    uint64_t handed_in;
} cw_frame_origin;

/* A frame that a host rule holds back. */
typedef struct cw_held_frame {
    uint64_t due;    /* tick, or CW_NEVER while it waits for others to pass */
    uint32_t behind; /* frames of that node and side still to pass */
    uint16_t rule;
    uint8_t node;
    cw_side side;
    cw_frame_origin origin;
    cw_frame frame; /* in its short form where the bus has no FD */
} cw_held_frame;

/* A protection in use. */
typedef struct cw_protected {
    cw_protection what;
    uint32_t next;   /* value of the counter in the next frame */
    bool sent;       /* some frame has had a value ... */
    uint32_t value;  /* ... and the last one this */
    bool wrong;      /* of the frame that passes: its checksum is inverted ... */
    uint32_t before; /* ... `next` without it ... */
    uint32_t last;   /* ... and the value of the frame before it */
} cw_protected;

#define CW_HELD_FRAMES 256u /* all nodes together */

/* ---- The bus that rules are on --------------------------------------------------------------- */

/* The functions that rules call to act on the bus. Each has acted when it returns. Rules that come
 * later at the same tick see its effect, such as the state of a node. None of these functions makes
 * a rule act. */
typedef struct cw_rule_effects {
    /* Reports the hit of a rule at a tick as an event. */
    void (*report_hit)(cw_bus *bus, unsigned rule, uint64_t tick);
    /* A rule of CW_KIND_CONTROL acts on the controllers of its nodes. */
    void (*control)(cw_bus *bus, const cw_rule *rule);
    /* Applies the topology when a rule on topology or acknowledging has begun or ended: see
     * cw_rules_find_topology(). */
    void (*rewire)(cw_bus *bus);
    /* Gives clocks of nodes another time quantum, from their next bits on. */
    void (*retime)(cw_bus *bus, uint64_t nodes, cw_span quantum);
    /* Queues a frame at a node. source: 0, or the rule's index plus 1 when it is its traffic; the
     * bus counts such frames in and out of `outstanding`. */
    void (*queue)(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t tick,
                  unsigned source);
    /* Hands a frame to a node's host. */
    void (*hand_out)(cw_bus *bus, unsigned node, const cw_frame *frame,
                     const cw_frame_origin *origin);
    /* Drops a frame on its way onto the bus or to the host. */
    void (*drop)(cw_bus *bus, unsigned node, cw_side side, const cw_frame *frame, uint64_t tick);
    /* Counts a frame that no host has handed in, or that no wire has carried. */
    void (*count_made)(cw_bus *bus, unsigned node, cw_side side);
    /* Answer traffic rules: true when a node's queue takes a frame now, and the time so far with
     * its busy part. The time is in bits; where bits are divided in ticks. */
    bool (*can_take)(const cw_bus *bus, unsigned node);
    uint64_t (*time)(const cw_bus *bus, uint64_t *busy);
    /* Returns true when a node may begin to drive bits: its controller is idle. One that is not on
     * the bus cannot tell; then the wire has been recessive for 11 bits. */
    bool (*is_idle)(const cw_bus *bus, unsigned node);
    /* Returns the length of a transmitter's bit that has begun, by an exact clock. */
    cw_span (*bit_length)(const cw_bus *bus, unsigned node);
    /* Returns the tick at which the bit of a node with its own clock will end, if no edge comes. */
    uint64_t (*end_of_bit)(const cw_bus *bus, unsigned node);
} cw_rule_effects;

/* The part of the bus that rules see. It is set when the bus is made, and rules change nothing in
 * it. */
typedef struct cw_rule_bus {
    const cw_wire_time *time;
    const cw_mac *macs[CW_NODES_MAX]; /* of each node; a follower's looks idle */
    unsigned node_count;
    uint64_t all; /* nodes */
    const uint64_t *asleep; /* nodes that sleep */
    uint64_t seed;
    bool fd;      /* some node knows FD frames */
    uint32_t unit; /* of the time that load rules count: ticks of a bit where bits may be shorter,
                      otherwise 1 */
    bool divided; /* some node has a data rate: bits may be shorter than the rate says (D10) */
    const cw_flag_watch *error_flag;
    const cw_flag_watch *overload_flag;
    const uint64_t *wires; /* sets of nodes that share one ... */
    const unsigned *wire_count;
    const cw_rule_effects *effects;
    cw_bus *self; /* the argument of effects */
} cw_rule_bus;

/* ---- Rules in use ---------------------------------------------------------------------------- */

/* The result of comparing a frame that waits to be sent with the rules. */
typedef struct cw_watch {
    uint16_t rule; /* the rule that acts on the wire; CW_NO_RULE, CW_SEVERAL_RULES */
    bool early;    /* a rule may act before arbitration is lost */
    bool rough;    /* one rule only, with the same result at any bit of the frame */
    bool counting; /* rough, and only its counters and chance tell whether a match is a hit */
} cw_watch;

#define CW_NO_RULE UINT16_MAX
#define CW_SEVERAL_RULES (UINT16_MAX - 1)

/* The value of a filter in the bits of its class, and the rule that has it. */
typedef struct cw_rule_key {
    uint32_t id; /* with CW_FILTER_EXTENDED */
    uint16_t rule;
    uint8_t class;
} cw_rule_key;

/* Filters that look at the same bits of an identifier. */
typedef struct cw_id_class {
    uint32_t mask;
    uint16_t first; /* of its keys */
    uint16_t count;
} cw_id_class;

#define CW_ID_CLASSES 8u /* a bit of a byte for each one */
#define CW_ID_HASH_BITS 12u

typedef struct cw_rule_set {
    cw_rule_bus bus;
    cw_rule_state *rules;
    uint8_t id_classes[1u << CW_ID_HASH_BITS]; /* by hash: the classes with such keys, as bits */
    cw_id_class classes[CW_ID_CLASSES];
    cw_rule_key *keys;     /* of frame rules, sorted by class, identifier and rule */
    uint16_t *wildcards;    /* frame rules without keys */
    uint16_t *awake;        /* sorted */
    unsigned char *held;    /* CW_HELD_FRAMES of them, see cw_held_at() */
    unsigned held_size;
    unsigned held_count;
    uint64_t work;          /* see cw_bus_work() */
    uint64_t driven;        /* of the bit in progress, see cw_levels */
    unsigned capacity;
    unsigned count;         /* places in use or used before */
    unsigned class_count;   /* in use or used before */
    unsigned key_count;
    unsigned wildcard_count;
    unsigned awake_count;
    cw_protected *protections; /* sorted by node and identifier */
    unsigned protection_count;
    unsigned host_rules;    /* rules on frames at the host side */
    unsigned making_rules;  /* ... of these, those on counters and checksums */
    unsigned hand_in_rules; /* the former, and 1 more where frames have protections */
    unsigned reply_rules;
    unsigned noise_rules;
    unsigned line_rules;    /* rules that hold a line at a level */
    unsigned traffic_rules; /* rules that may send at any bit */
    unsigned error_rules;
    unsigned after_rules;   /* rules that come after another one */
    unsigned timed_rules;   /* rules that act for parts of bits */
    unsigned raw_rules;     /* rules that drive bits */
    cw_span jitter;         /* the most that JITTER rules can add to the delay of an edge */
    unsigned copies;        /* copies that DUPLICATE rules can make of one frame, in all */
    uint64_t off;           /* nodes that rules or their hosts keep off the bus: those that are cut
                               off by DISCONNECT or by their hosts, and those that drive raw bits */
    uint64_t cut;           /* nodes that are cut off */
    uint64_t raw;           /* nodes that drive raw bits */
    uint64_t known;         /* nodes whose next frame has been compared with the rules ... */
    uint64_t watched;       /* ... of these, those with a rule that acts on the wire, ... */
    uint64_t early;         /* ... those with a rule that may act before arbitration is lost, ... */
    uint64_t rough;         /* ... those whose stop may be found roughly, ... */
    uint64_t counting;      /* ... and of these, those whose rule only counts */
    uint64_t unusual;       /* nodes whose watch may differ from `usual` */
    uint16_t watcher[CW_NODES_MAX]; /* the rule that acts on the frame */
    cw_watch usual;         /* the result for rules in `wildcards`, if each frame has the same */
    bool has_usual;
    bool stale;             /* rules have changed: all that must be found anew */
    uint64_t always_known;  /* all nodes, when no frame is worth a comparison */
    bool rewired;           /* a rule on topology or acknowledging has begun to act */
    uint64_t next_due;      /* the earliest fire_at, arm_at, next_at or active_until */
} cw_rule_set;

/* Levels of one bit: bit i of a set is node i's, recessive where 1. */
typedef struct cw_levels {
    uint64_t driven;
    uint64_t clean; /* of the wire that the node is on, by the driven levels */
    uint64_t wire;  /* ... with the changes by faults */
    uint64_t sampled;
} cw_levels;

/* Returns the bytes of a frame that is held back. fd: it may be an FD frame. */
static inline size_t cw_held_frame_size(bool fd)
{
    return cw_frame_entry_size(offsetof(cw_held_frame, frame), fd);
}

/* Returns the i-th frame that is held back. Copy it with cw_held_copy() only. */
static inline cw_held_frame *cw_held_at(const cw_rule_set *set, unsigned i)
{
    return (cw_held_frame *)(void *)(set->held + (size_t)i * set->held_size);
}

/* Copies a held frame, in the form that the bus keeps it in. */
static inline void cw_held_copy(const cw_rule_set *set, cw_held_frame *to,
                                const cw_held_frame *from)
{
    memcpy(to, from, set->held_size);
}

/* ---- add.c, begin.c -------------------------------------------------------------------------- */

/* Returns true when a rule is in use at that place. */
static inline bool cw_rules_has(const cw_rule_set *set, unsigned rule)
{
    return rule < set->count && set->rules[rule].used;
}

/* Returns CW_OK and a free place; CW_INVALID or CW_FULL. Settings are not checked: the bus knows
 * whether its nodes can have them. */
cw_status cw_rules_may_add(const cw_rule_set *set, unsigned *place, const cw_rule *rule);

/* Adds the rule at that place, where it may be added; its name is not kept. */
void cw_rules_add(cw_rule_set *set, unsigned place, const cw_rule *rule);

/* Ends the action of the rule and frees its place. */
void cw_rules_remove(cw_rule_set *set, unsigned rule);

/* Arms the rule by hand. Returns false when that is impossible, or too many armings are under
 * way. */
bool cw_rules_arm(cw_rule_set *set, unsigned rule);

/* Returns the counts of a rule, and its state at present. */
cw_rule_stats cw_rules_get_stats(const cw_rule_set *set, unsigned rule);

/* Ends the action of a rule at once, and lets go of the frames that it holds back. */
void cw_rule_end_action(cw_rule_set *set, unsigned rule);

/* ---- bind.c, error.c, due.c ------------------------------------------------------------------ */

/* Binds rules when a node begins to transmit a frame. Returns true when a bit of its CRC must be
 * inverted. */
bool cw_rules_bind(cw_rule_set *set, unsigned node, const cw_frame *frame);

/* Passes errors, state changes, restarts and lost arbitrations of a node to rules that wait for
 * them. */
void cw_rules_error_now(cw_rule_set *set, unsigned node, const cw_event *event);

static inline void cw_rules_error(cw_rule_set *set, unsigned node, const cw_event *event)
{
    if (set->error_rules || set->off)
        cw_rules_error_now(set, node, event);
}

/* Notes that a rule has something due at that tick. */
static inline void cw_rules_set_due(cw_rule_set *set, uint64_t tick)
{
    if (tick < set->next_due)
        set->next_due = tick;
}

/* Starts rules on a bus whose time begins now, not at 0: rules that were to act before act now. */
void cw_rules_start(cw_rule_set *set);

/* See cw_bus_rules_until(). */
uint64_t cw_rules_until(const cw_rule_set *set);

/* Runs rules, armings, traffic and ends of actions that are due now. */
void cw_rules_run_due(cw_rule_set *set);

/* ---- awake.c --------------------------------------------------------------------------------- */

/* Unbinds all rules: no transmission is under way now. */
void cw_rules_unbind(cw_rule_set *set);

/* ---- look.c ---------------------------------------------------------------------------------- */

/* Returns true when some rule waits for frames. If none does, no frame needs to be compared. */
static inline bool cw_rules_wait_for_frames(const cw_rule_set *set)
{
    return set->key_count + set->wildcard_count > 0;
}

/* Notes that rules have changed: no frame has been compared with them. */
static inline void cw_rules_forget_all(cw_rule_set *set)
{
    set->stale = true;
    set->known = set->always_known = 0;
}

/* Notes that the next frame of a node may have changed. */
static inline void cw_rules_forget_frame(cw_rule_set *set, unsigned node)
{
    set->known &= ~cw_node_bit(node) | set->always_known;
}

/* Returns true when the next frames of these nodes have been compared with the rules. */
static inline bool cw_rules_know(const cw_rule_set *set, uint64_t nodes)
{
    return (nodes & ~set->known) == 0;
}

/* Returns those of some nodes whose next frame has not been compared with the rules yet. */
uint64_t cw_rules_unknown(cw_rule_set *set, uint64_t nodes);

/* Compares the next frame of a node with the rules. */
void cw_rules_watch(cw_rule_set *set, unsigned node, const cw_frame *frame);

/* Returns those of some nodes for whose next frame a rule waits, to act on the wire. A node that
 * loses is one of them only if the rule may act before the loss. All must have been compared. */
static inline uint64_t cw_rules_watched(const cw_rule_set *set, uint64_t nodes, unsigned winner)
{
    return nodes & (set->early | (set->watched & cw_node_bit(winner)));
}

/* Returns true when some rule may act at or before the SOF of the next frame of a node. */
bool cw_rules_act_at_start(const cw_rule_set *set, unsigned node, const cw_frame *frame);

/* A transmission, as rules look at it. */
typedef struct cw_frame_view {
    const cw_frame *frame;
    const cw_bits *bits; /* NULL: not encoded */
    const cw_stuffing *stuffing; /* of the bits, or NULL: not known */
    uint8_t node;        /* the transmitter */
    uint16_t at;         /* bits that have passed */
    uint16_t length;     /* of the frame that wins arbitration, SOF to EOF */
    uint16_t last;       /* the bit at which this one loses it; CW_NOT_LOST */
} cw_frame_view;

#define CW_NOT_LOST UINT16_MAX
#define CW_NO_LOOK UINT16_MAX

/* The next bit of a frame that a rule looks at. */
typedef struct cw_look {
    uint16_t bit;  /* on the wire, SOF is 0; CW_NO_LOOK */
    uint16_t rule; /* or CW_SEVERAL_RULES */
    bool exact;    /* false: the bit is there or later; only the encoded frame shows where */
} cw_look;

/* The functions for the three questions of DESIGN.md follow. None of them changes a rule. First:
 * finds the next bit of a watched transmission, from one on, at which a rule looks. The bit goes
 * into *look, unless an earlier bit is there. */
void cw_rules_add_looks(const cw_rule_set *set, cw_look *look, const cw_frame_view *view,
                        unsigned from);

/* Returns true when rules look at only one bit of the watched transmission of a node. */
static inline bool cw_rules_look_once(const cw_rule_set *set, unsigned node)
{
    return set->watcher[node] != CW_SEVERAL_RULES;
}

/* Second: the objects that rules of the awake list touch. */
#define CW_TOUCH_LEVELS 0x01u      /* levels, other than by steady noise */
#define CW_TOUCH_CONTROLLERS 0x02u /* controllers, since the rules must see the senders */
#define CW_TOUCH_QUEUES 0x04u      /* queues: the rules send when there is a reason */
#define CW_TOUCH_AT_RANDOM 0x08u   /* bits that cw_rules_keep_quiet() knows */
#define CW_TOUCH_DOMINANT 0x10u    /* dominant bits of a node; nothing as long as there are none */
#define CW_TOUCH_MORE 0x20u        /* anything else in the next bit */

/* Does the work of cw_rules_touch() when some rule is awake. */
unsigned cw_rules_touch_now(const cw_rule_set *set);

/* Returns the CW_TOUCH_* of all awake rules. In the usual case no rule is awake. */
static inline unsigned cw_rules_touch(const cw_rule_set *set)
{
    return set->awake_count ? cw_rules_touch_now(set) : 0;
}

/* Third: returns the number of bits to come, at most `bits`, that noise leaves alone and before
 * whose end no traffic rule sends. The number holds as long as no frame leaves a queue. busy: true
 * when all these bits are busy. */
uint64_t cw_rules_keep_quiet(const cw_rule_set *set, uint64_t bits, bool busy);

/* Consumes that many bits that rules keep quiet: their draws are used up. Decides a look (or NULL)
 * within or after them. Returns true when it is not a hit, and counts the match. Returns false when
 * it is a hit, or unknown before its bit comes; nothing of the look is consumed then. With a look
 * that is not exact, nothing may keep the node from sending the whole frame. */
bool cw_rules_consume(cw_rule_set *set, uint64_t bits, const cw_look *look,
                      const cw_frame_view *view);

/* Returns true when the stop for the frame of a node may be found roughly. A rough stop needs no
 * bits of the frame. It lies at the bit that a rule looks at, or before that bit. */
static inline bool cw_rules_stop_roughly(const cw_rule_set *set, unsigned node)
{
    return set->rough >> node & 1u;
}

/* Counts the match of a frame that is sent to its end, when `skip` or `every` passes over it. This
 * is the usual case. Returns false, with nothing done, when the match needs a decision. */
static inline bool cw_rules_count_off(cw_rule_set *set, unsigned node)
{
    if (!(set->counting >> node & 1u))
        return false;
    cw_rule_state *s = &set->rules[set->watcher[node]];
    if (s->to_pass == 0)
        return false;
    s->to_pass--;
    s->matches++;
    return true;
}

/* Returns true when one rule waits for the frame of a node and is sure to have a hit in it. The
 * frame must be sent up to that bit. */
static inline bool cw_rules_hit_surely(const cw_rule_set *set, unsigned node)
{
    if (!(set->counting >> node & 1u))
        return false;
    const cw_rule_state *s = &set->rules[set->watcher[node]];
    return s->to_pass == 0 && s->rule.probability == UINT64_MAX;
}

/* Takes back what cw_rules_count_off() has counted. */
static inline void cw_rules_count_back(cw_rule_set *set, unsigned rule)
{
    set->rules[rule].to_pass++;
    set->rules[rule].matches--;
}

/* Returns the CW_DEVIATES_* with which a frame is sent. source: as in cw_rules_count_queued(), not
 * 0. */
unsigned cw_rules_deviations(const cw_rule_set *set, unsigned source);

/* Returns the nodes whose lines to the bus are stuck. */
uint64_t cw_rules_stuck_lines(const cw_rule_set *set);

/* ---- level.c, noise.c, topology.c ------------------------------------------------------------ */

/* Changes the levels that nodes put onto the wire: stuck TX lines, nodes cut off in this very
 * bit. */
void cw_rules_change_driven(cw_rule_set *set, cw_levels *levels);

/* Changes the levels that nodes see, from those of their wires. */
void cw_rules_change_sampled(cw_rule_set *set, cw_levels *levels);

/* ---- in_time.c ------------------------------------------------------------------------------- */

/* Disturbs levels where nodes have clocks of their own. A bit time of the bus begins at the present
 * tick. Rules that are looked at in every bit act for all of it. */
void cw_rules_begin_bit_time(cw_rule_set *set, cw_disturbances *all, cw_span begin, cw_span end);

/* Returns true while edges of nodes come late, by rules on jitter. */
bool cw_rules_delay_edges(const cw_rule_set *set);

/* Returns how late an edge of a node comes, by rules on jitter. */
cw_span cw_rules_edge_delay(cw_rule_set *set, unsigned node);

/* Nodes begin a bit at a moment, which is a tick or comes before it; rules on positions act in it.
 * driven: as in cw_levels. */
void cw_rules_begin_bits(cw_rule_set *set, cw_disturbances *all, uint64_t nodes, cw_span moment,
                         uint64_t tick, uint64_t driven);

/* Reports the hits of the bits that have ended by now. */
void cw_rules_emit(cw_rule_set *set);

/* Reports all hits. No bit of a node goes on beyond now. */
void cw_rules_emit_rest(cw_rule_set *set);

/* The wires of the bus, and the nodes that do not acknowledge, as the active rules say. */
typedef struct cw_topology {
    uint64_t off;    /* nodes that are cut off */
    uint64_t raw;    /* nodes that drive raw bits in place of their controllers */
    uint64_t no_ack; /* nodes that do not acknowledge */
    uint64_t wires[CW_NODES_MAX]; /* sets of nodes */
    unsigned wire_count;
} cw_topology;

/* Finds it; the caller applies it. */
void cw_rules_find_topology(const cw_rule_set *set, cw_topology *topology);

/* ---- host.c, traffic.c ----------------------------------------------------------------------- */

/* Shows rules a frame on its way from a host to its queue. Returns true when it goes on, perhaps
 * changed. */
bool cw_rules_hand_in(cw_rule_set *set, unsigned node, cw_frame *frame, uint64_t tick);

/* Does the same for a frame on its way to a host. */
bool cw_rules_hand_out(cw_rule_set *set, unsigned node, cw_frame *frame,
                       const cw_frame_origin *origin);

/* Returns the protection of a node's frames with an identifier, or NULL. */
cw_protected *cw_rules_protection(const cw_rule_set *set, unsigned node, uint32_t id);

/* Goes on with the counters of another bus; from: the old node of each node, or CW_NO_NODE. */
void cw_rules_take_over_protections(cw_rule_set *set, const cw_rule_set *old, const uint8_t *from);

/* Notes that a frame of that node and side has passed at a tick: frames that wait behind it go
 * now. */
void cw_rules_passed(cw_rule_set *set, unsigned node, cw_side side, uint64_t tick);

/* Holds a frame back until it is due. Returns false when there is no room. */
bool cw_rules_hold(cw_rule_set *set, const cw_held_frame *frame);

/* Takes the first frame of a node that is held back out of the held frames. Returns false when
 * there is none. */
bool cw_rules_take_held(cw_rule_set *set, unsigned node, cw_held_frame *frame);

/* Counts a frame that has come to a queue or has left one. source: 0, or the index plus 1 of the
 * rule that sent it. */
static inline void cw_rules_count_queued(cw_rule_set *set, unsigned source)
{
    if (source)
        set->rules[source - 1].traffic.outstanding++;
}

/* Returns true when a frame of that source is followed by another one as soon as it is gone. */
static inline bool cw_rules_is_steady(const cw_rule_set *set, unsigned source)
{
    return source && (set->rules[source - 1].traits & CW_STEADY_TRAFFIC);
}

static inline void cw_rules_count_gone(cw_rule_set *set, unsigned source)
{
    if (source && set->rules[source - 1].traffic.outstanding)
        set->rules[source - 1].traffic.outstanding--;
}

/* Counts the frames of a node that rules hold back on each side. */
void cw_rules_count_held(const cw_rule_set *set, unsigned node, uint32_t *tx, uint32_t *rx);

#endif
