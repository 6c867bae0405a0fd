/* SPDX-License-Identifier: MIT
 *
 * rule.h - fault rules at work, as the rest of the library sees them.
 *
 * When a rule acts:
 *   add.c valid.c  rules come and go
 *   index.c        rules whose filters a frame matches; list.c sorted lists
 *   rule.c         whether a match becomes a hit; prng.c by chance
 *   arming.c       rules that come after others, or by hand
 *   bind.c error.c due.c  transmissions, errors and times that rules wait for
 *   look.c         what rules want of a frame that is leapt over
 * What it does then:
 *   begin.c        actions begin and end
 *   level.c noise.c topology.c  levels of bits, and who is on which wire
 *   control.c      controllers
 *   host.c         frames on the host side
 *   traffic.c      frames that rules send
 * What follows on the bus is the controllers' affair.
 */
#ifndef CANWIRE_RULE_H
#define CANWIRE_RULE_H

#include "canwire.h"
#include "rule/action.h"
#include "rule/prng.h"

#define CW_ARMINGS_MAX 16u /* armings of a rule under way, further ones are lost */

typedef struct cw_rule_state {
    cw_rule rule;
    const cw_action_row *does; /* the row of its action ... */
    unsigned traits;           /* ... and what that says, CW_NEEDS_FRAME etc. */
    cw_prng prng;
    bool used;            /* the place holds a rule */
    bool awake;           /* in the awake list: looked at in every bit */
    bool active;          /* acting, see active_until */
    bool hit_now;         /* hit in the bit in progress; it becomes an event at its end */
    bool to_act;          /* hit, and it acts at the end of the bit */
    bool for_attempt;     /* acts only while the transmissions of `scope` last */
    uint16_t outstanding; /* frames of its traffic in queues */
    uint32_t armed;       /* hits allowed, where the rule must be armed */
    uint32_t to_pass;     /* matches to pass over before the next that is taken */
    bool rx_hit;          /* what was decided at rx_tick */
    uint64_t bits_done;   /* of a position action under way */
    uint64_t bits_left;
    uint64_t on_wire;     /* nodes whose wire it acts on, as far as it acts on levels ... */
    uint64_t at_nodes;    /* ... and nodes for which it changes what they sample */
    uint64_t rx_tick;     /* host rules on the RX side: one decision for all receivers of a frame */
    uint64_t bound;       /* nodes whose present transmission the rule looks at */
    uint64_t scope;
    uint64_t matches;
    uint64_t taken;       /* of these, those that were not passed over */
    uint64_t hits;
    uint64_t last_hit;    /* tick */
    uint64_t fire_at;     /* TIME: tick when it acts, or CW_NEVER */
    uint64_t arm_at[CW_ARMINGS_MAX]; /* ticks of the armings under way, sorted */
    unsigned armings;
    uint64_t armed_at;    /* tick of the last arming; one at a tick */
    uint64_t error_at;    /* ERROR: tick of the last match; one at a tick */
    uint64_t active_until; /* tick; CW_NEVER: till cleared */
    uint64_t next_at;     /* SEND: tick of the next frame */
    uint64_t dominant_bits; /* STUCK on a TX: how long it has been dominant */
    uint64_t busy_base;   /* LOAD: busy bits and bits when it began */
    uint64_t bits_base;
} cw_rule_state;

/* Where a received frame is from, see cw_event. All 0 for frames on their way to the wire. */
typedef struct frame_origin {
    uint64_t from;
    uint64_t handed_in;
} frame_origin;

/* What rules want of a frame that waits to be sent. */
typedef struct cw_watch {
    uint16_t rule; /* that acts on the wire; CW_NO_RULE, CW_SEVERAL_RULES */
    bool early;    /* one may do so before arbitration is lost */
    bool rough;    /* it is one rule only, and its answer is the same at any bit of the frame */
} cw_watch;

#define CW_NO_RULE UINT16_MAX
#define CW_SEVERAL_RULES (UINT16_MAX - 1)

/* What a filter looks for in the bits of its class, and the rule that has it. */
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
    cw_rule_state *rules;
    uint8_t id_classes[1u << CW_ID_HASH_BITS]; /* by hash: the classes with such keys, as bits */
    cw_id_class classes[CW_ID_CLASSES];
    cw_rule_key *keys;     /* of frame rules, sorted by class, identifier and rule */
    uint16_t *wildcards;    /* frame rules that have none */
    uint16_t *awake;        /* sorted */
    unsigned capacity;
    unsigned count;         /* places in use or used before */
    unsigned class_count;   /* in use or used before */
    unsigned key_count;
    unsigned wildcard_count;
    unsigned awake_count;
    unsigned host_rules;    /* rules on frames at the host side */
    unsigned reply_rules;
    unsigned noise_rules;
    unsigned line_rules;    /* that hold a line at a level */
    unsigned traffic_rules; /* that may send at any bit */
    unsigned error_rules;
    unsigned after_rules;   /* that come after another one */
    unsigned copies;        /* that DUPLICATE rules can make of one frame, in all */
    uint64_t off;           /* nodes that DISCONNECT rules or their hosts keep off the bus */
    uint64_t known;         /* nodes whose next frame has been compared with the rules ... */
    uint64_t watched;       /* ... of these, those where a rule acts on the wire, ... */
    uint64_t early;         /* ... those where it may do so before arbitration is lost, ... */
    uint64_t rough;         /* ... and those whose stop may be found roughly */
    uint64_t unusual;       /* nodes for which all that may be other than usual */
    uint16_t watcher[CW_NODES_MAX]; /* the rule that acts on the frame */
    cw_watch usual;         /* what rules in `wildcards` want, if it is the same of each frame */
    bool has_usual;
    bool stale;             /* rules have changed: that is to be found anew */
    uint64_t always_known;  /* all nodes, when no frame is worth a comparison */
    bool rewired;           /* a rule on topology or acknowledging has begun to act */
    uint64_t next_due;      /* the earliest fire_at, arm_at, next_at or active_until */
} cw_rule_set;

/* Levels of one bit: bit i of a set is node i's, recessive where 1. */
typedef struct cw_levels {
    uint64_t driven;
    uint64_t clean; /* of the wire that the node is on, by what is driven */
    uint64_t wire;  /* ... with what faults make of it */
    uint64_t sampled;
} cw_levels;

/* ---- bind.c, error.c, due.c ------------------------------------------------------------------ */

/* A node begins to transmit what is in its offered slot. */
void cw_rules_bind(cw_bus *bus, unsigned node, const cw_frame *frame);

/* Errors, state changes, restarts and lost arbitrations of a node, for rules that wait for them. */
void cw_rules_error_now(cw_bus *bus, unsigned node, const cw_event *event);

/* Something of some rule is due at that tick. */
static inline void cw_rules_set_due(cw_rule_set *set, uint64_t tick)
{
    if (tick < set->next_due)
        set->next_due = tick;
}

/* Rules, armings, traffic and ends of actions that are due now. */
void cw_rules_run_due(cw_bus *bus);

/* ---- look.c ---------------------------------------------------------------------------------- */

/* Those of some nodes whose next frame a rule waits for, to act on the wire; of the losers among
 * them only those where it may do so before they lose. */
uint64_t cw_rules_watched(cw_bus *bus, uint64_t nodes, unsigned winner);

/* Whether some rule may act at or before the SOF of the next frames of these nodes. */
bool cw_rules_act_at_start(const cw_bus *bus, uint64_t nodes);

#define CW_NO_LOOK UINT16_MAX

/* The next bit of a frame that a rule looks at. */
typedef struct cw_look {
    uint16_t bit;  /* on the wire, SOF is 0; CW_NO_LOOK */
    uint16_t rule; /* or CW_SEVERAL_RULES */
    bool exact;    /* false: the bit is there or behind, where is known when the frame is encoded */
} cw_look;

/* Three questions, which change nothing. First: of the frame that is on its way in a frame step,
 * from bit `from` on. */
cw_look cw_rules_next_look(const cw_bus *bus, unsigned from);

/* Second: what rules that are looked at in every bit touch. */
#define CW_TOUCH_LEVELS 0x01u      /* levels, other than by noise that goes on and on */
#define CW_TOUCH_CONTROLLERS 0x02u /* they have to see who sends */
#define CW_TOUCH_FRAME 0x04u       /* they are bound to a transmission */
#define CW_TOUCH_QUEUES 0x08u      /* they send when there is reason to */
#define CW_TOUCH_AT_RANDOM 0x10u   /* bits that cw_rules_keep_quiet() knows */
#define CW_TOUCH_DOMINANT 0x20u    /* dominant bits of a node: nothing as long as there are none */
#define CW_TOUCH_MORE 0x40u        /* or they have anything else to do in the next bit */

unsigned cw_rules_touch_now(const cw_bus *bus);

/* Third: bits to come, no more than that many, that noise leaves alone and before whose end no
 * traffic rule sends, as long as no frame leaves a queue. busy: all these bits are. */
uint64_t cw_rules_keep_quiet(const cw_bus *bus, uint64_t bits, bool busy);

/* And the call that takes note. So many bits pass that rules keep quiet: their draws are consumed.
 * A look (or NULL) that lies in or behind them is decided: true when it is no hit, and the match is
 * counted. False: it is a hit, or not to be told before its bit comes; nothing of the look is
 * consumed. frame: for looks that are not exact, when nothing can keep the node from sending all of
 * it. */
bool cw_rules_consume(cw_bus *bus, uint64_t bits, const cw_look *look, const cw_frame *frame);

/* Whether the stop for the frame of a node may be found roughly: not behind the bit that a rule
 * looks at, but without the bits of the frame. Mostly nobody needs more. */
static inline bool cw_rules_stop_roughly(const cw_rule_set *set, unsigned node)
{
    return set->rough >> node & 1u;
}

/* No transmission is under way any more. */
void cw_rules_unbind(cw_bus *bus);

/* Whether a rule that is bound looks at the bit that comes next in the transmission of a node. */
bool cw_rules_look_at_next(const cw_bus *bus, unsigned node);

/* The nodes whose lines to the bus are stuck. */
uint64_t cw_rules_stuck_lines(const cw_bus *bus);

/* ---- level.c, noise.c, topology.c ------------------------------------------------------------ */

/* Levels that nodes put onto the wire: stuck TX lines, nodes that are cut off in this very bit. */
void cw_rules_change_driven(cw_bus *bus, cw_levels *levels);

/* Levels that nodes see, from those of their wires. */
void cw_rules_change_sampled(cw_bus *bus, cw_levels *levels);

/* Hits of the bit that has ended. */
void cw_rules_emit(cw_bus *bus);

/* Puts nodes off the bus or onto wires of their own, and forbids acknowledging, as the active
 * rules and the hosts say; and undoes it. */
void cw_rules_apply_topology(cw_bus *bus);

/* ---- host.c, traffic.c ----------------------------------------------------------------------- */

/* A frame on its way from a host to its queue. Returns true when it goes on, perhaps changed. */
bool cw_rules_hand_in(cw_bus *bus, unsigned node, cw_frame *frame, uint64_t tick);

/* The same for a frame on its way to a host. */
bool cw_rules_hand_out(cw_bus *bus, unsigned node, cw_frame *frame,
                       const frame_origin *origin);

/* A frame of that node and side has come by at a tick: frames that wait behind it go now. */
void cw_rules_passed(cw_bus *bus, unsigned node, cw_side side, uint64_t tick);

/* How many frames of a node rules hold back on each side. */
void cw_rules_count_held(const cw_bus *bus, unsigned node, uint32_t *tx, uint32_t *rx);

#endif
