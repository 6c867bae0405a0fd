/* SPDX-License-Identifier: MIT
 *
 * action.h - the properties of each action that rules need, one row for each.
 *
 * A rule in use points to its row, so the files in which actions act do not need the table itself.
 */
#ifndef CANWIRE_RULE_ACTION_H
#define CANWIRE_RULE_ACTION_H

#include "canwire.h"

#include <stddef.h>

struct cw_rule_set;
struct cw_rule_state;
struct cw_passing;

/* Traits say what an action needs and what it does, apart from how it does it. */
#define CW_NEEDS_FRAME 0x001u    /* only a rule with a frame trigger has it */
#define CW_HAS_POSITION 0x002u   /* is bound to a transmission, acts when the position is reached */
#define CW_AT_HOST 0x004u        /* its frame is one that a host hands in or gets */
#define CW_IN_ENCODING 0x008u    /* changes the frame that begins, before its first bit */
#define CW_LASTS 0x010u          /* for a time, or until it is ended */
#define CW_FOR_ATTEMPT 0x020u    /* ... with a frame trigger and no time: for that transmission */
#define CW_EACH_BIT 0x040u       /* while it lasts, it is looked at in every bit */
#define CW_ON_LINE 0x080u        /* holds a level on the rule's line */
#define CW_RANDOM_BITS 0x100u    /* its hits are bits that it flips, not its beginning */
#define CW_REWIRES 0x200u        /* changes the nodes' wires, or the nodes that acknowledge */
#define CW_SENDS_FRAME 0x400u    /* sends the rule's frame, which must be valid */
#define CW_IN_TIME 0x1000u       /* acts for parts of bits, see in_time.c */
#define CW_DEVIATES 0x2000u      /* its frames are not as their nodes would send them */
#define CW_IN_MAKING 0x4000u     /* acts on a frame that has a protection, as it is made */
#define CW_STEADY_TRAFFIC 0x800u /* sends whenever there is a reason, not at ticks known before */

/* The values that a number of a rule may have. */
typedef struct cw_action_range {
    uint16_t offset; /* of a number in cw_rule that has so many bytes: 2 or 4 */
    uint16_t bytes;  /* 0: no such number */
    uint16_t least;
    uint16_t most;
    bool may_keep;   /* or CW_KEEP */
} cw_action_range;

#define CW_ACTION_RANGES 2u

/* Changes the levels of the nodes that the rule names, in the bit in progress. */
typedef void cw_level_action(struct cw_rule_set *set, struct cw_rule_state *state, uint64_t *levels,
                             uint64_t nodes);
/* Acts on a frame that comes by. Returns true when the frame goes on. */
typedef bool cw_host_action(struct cw_rule_set *set, const cw_rule *rule,
                            const struct cw_passing *passing);
/* Sends the frames that the rule owes at the present tick. */
typedef void cw_traffic_action(struct cw_rule_set *set, unsigned rule);

typedef struct cw_action_row {
    const char *name;
    cw_action_kind kind;
    unsigned traits;
    cw_action_range ranges[CW_ACTION_RANGES];
    union { /* by kind; NULL: another file looks for the action itself */
        cw_level_action *levels;     /* CW_KIND_POSITION, CW_KIND_LEVEL */
        cw_host_action *host;        /* CW_KIND_HOST */
        cw_traffic_action *traffic;  /* CW_KIND_TRAFFIC */
    };
} cw_action_row;

extern const cw_action_row cw_actions[CW_ACTION_COUNT];

/* level.c, noise.c */
cw_level_action cw_flip, cw_force, cw_glitch, cw_hold_level, cw_flip_at_random;
/* host.c */
cw_host_action cw_drop_frame, cw_delay_frame, cw_copy_frame, cw_let_overtake, cw_change_frame;
/* protect.c */
cw_host_action cw_fault_counter, cw_fault_checksum;
/* traffic.c */
cw_traffic_action cw_send_periodically, cw_babble, cw_fill_up;
/* raw.c has what else RAW and RAW_FRAME do. */

#endif
