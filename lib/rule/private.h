/* SPDX-License-Identifier: MIT
 *
 * private.h - declarations that the parts of the rules share.
 */
#ifndef CANWIRE_RULE_PRIVATE_H
#define CANWIRE_RULE_PRIVATE_H

#include "mac/mac.h"
#include "rule/rule.h"

#define CW_RULES_OF_A_PIECE 16u /* a unit of work: rules that are looked at and have nothing to
                                   do */

static inline cw_rule_state *cw_rule_at(cw_rule_set *set, unsigned rule)
{
    return &set->rules[rule];
}

/* Return the present tick, and the tick at which the bit that begins now ends. */
static inline uint64_t cw_rules_now(const cw_rule_set *set)
{
    return cw_wire_now(set->bus.time);
}

static inline uint64_t cw_rules_bit_end(const cw_rule_set *set)
{
    return cw_wire_bit_end(set->bus.time);
}

static inline unsigned cw_rule_index(const cw_rule_set *set, const cw_rule_state *state)
{
    return (unsigned)(state - set->rules);
}

/* ---- Actions --------------------------------------------------------------------------------- */

/* Returns whether its action has all of these traits. */
static inline bool cw_rule_is(const cw_rule_state *state, unsigned traits)
{
    return (state->traits & traits) == traits;
}

/* Returns true when the rule's frame is one on the wire, not one that a host hands in or gets. */
static inline bool cw_rule_acts_on_wire(const cw_rule_state *state)
{
    return !cw_rule_is(state, CW_AT_HOST);
}

/* Returns true when the rule is active and does nothing else. Rules with a position never are. */
static inline bool cw_rule_is_plain(const cw_rule_state *state)
{
    return state->active && !state->hit_now;
}

/* Returns true when an action at a position changes the present bit. */
static inline bool cw_rule_is_at_work(const cw_rule_state *state)
{
    return cw_rule_is(state, CW_HAS_POSITION) && state->position.bits_left > 0;
}

/* Unbinds a rule with a position from the transmissions of these nodes. */
static inline void cw_rule_unbind(cw_rule_state *state, uint64_t nodes)
{
    if (cw_rule_is(state, CW_HAS_POSITION))
        state->position.bound &= ~nodes;
}

static inline bool cw_rule_is_raw(const cw_rule_state *state)
{
    return state->rule.action == CW_ACTION_RAW;
}

/* A frame on its way between host and queue, as an action on the host side sees it. */
typedef struct cw_passing {
    cw_frame *frame;
    unsigned rule;
    unsigned node;
    uint64_t tick;
    const cw_frame_origin *origin;
    cw_protected *made_by; /* CW_IN_MAKING: the protection that has written counter and checksum */
} cw_passing;

/* ---- protect.c ------------------------------------------------------------------------------- */

/* Writes counter and checksum into a frame that a host hands in. Returns the protection that has
 * done so, or NULL. */
cw_protected *cw_rules_protect(const cw_rule_set *set, unsigned node, cw_frame *frame);

/* Returns whether a rule acts on what a protection has written; with NULL, whether it acts on
 * anything else. */
bool cw_rule_is_for(const cw_rule_state *state, const cw_protected *made_by);

/* ---- Effects on the bus ---------------------------------------------------------------------- */

/* Traffic of a node is not a fault, so its hits are not reported. */
static inline void cw_rule_report_hit(const cw_rule_set *set, unsigned rule, uint64_t tick)
{
    if (!set->rules[rule].rule.quiet)
        set->bus.effects->report_hit(set->bus.self, rule, tick);
}

static inline void cw_rules_rewire(const cw_rule_set *set)
{
    set->bus.effects->rewire(set->bus.self);
}

/* ---- raw.c ----------------------------------------------------------------------------------- */

/* A hit of RAW: the node drives bits when it may. One that waits or drives goes on as before. */
void cw_raw_act(cw_rule_set *set, unsigned rule);

/* Goes on after a bit in which RAW has waited or driven. Returns false after the last one. */
bool cw_raw_go_on(cw_rule_set *set, unsigned rule);

/* Returns the level that RAW drives in the present bit. */
bool cw_raw_level(const cw_rule_state *state);

/* Changes the levels that nodes drive. */
uint64_t cw_raw_change_lines(const cw_rule_set *set, uint64_t driven);

/* Returns false for deviations that the frame or the node of RAW_FRAME cannot have. */
bool cw_raw_valid(const cw_rule_set *set, const cw_rule *rule);

/* ---- valid.c --------------------------------------------------------------------------------- */

bool cw_rule_valid(const cw_rule_set *set, const cw_rule *rule);

/* ---- index.c --------------------------------------------------------------------------------- */

/* Add and remove a rule in use, with a frame trigger or another one. */
void cw_index_add(cw_rule_set *set, unsigned rule);
void cw_index_remove(cw_rule_set *set, unsigned rule);

/* Goes through the rules with a frame trigger whose filters and data match a frame, in order. */
typedef struct cw_key_run {
    uint16_t next;
    uint16_t end;
} cw_key_run;

typedef struct cw_candidates {
    const cw_frame *frame;
    uint32_t id;
    unsigned wildcard;  /* the next one of the list */
    unsigned run_count;
    cw_key_run runs[CW_ID_CLASSES];
} cw_candidates;

/* Returns false when only rules of the list of wildcards may wait for that identifier. That is the
 * usual result, by one look at a table. */
bool cw_rules_may_wait(const cw_rule_set *set, const cw_frame *frame);

/* Begin with a frame, and find the next rule. Returns false when there are no more. */
void cw_candidates_begin(cw_candidates *c, const cw_rule_set *set, const cw_frame *frame);
bool cw_candidates_next(cw_candidates *c, unsigned *rule, const cw_rule_set *set);

/* Returns whether two sets of nodes meet; an empty first set names all. */
static inline bool cw_rule_names(uint64_t set, uint64_t nodes)
{
    return set == 0 || (set & nodes) != 0;
}

/* ---- rule.c ---------------------------------------------------------------------------------- */

/* Counts a match of a rule and returns whether it is a hit. Time, state, arming, hold-off, skip,
 * every, probability and count decide, in this order. A hit arms the rules that come after this
 * one. start: tick at which the bit in progress began; reported: tick of the event. */
bool cw_rule_match(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported);

/* Counts a hit without a match: a bit flipped by noise. */
void cw_rule_count_hit(cw_rule_set *set, unsigned rule, uint64_t reported);

bool cw_rule_is_over(const cw_rule_state *state);

/* Does the same as cw_rule_match(), except that it does not count the hit itself. */
bool cw_rule_takes_match(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported);

/* Counts a match that is not a hit. Returns false for a hit and changes nothing then; the bit
 * itself will count it. start, reported: ticks of the bit and of its end, or of any other bit with
 * the same result. */
bool cw_rule_passes_over(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported);

/* ---- arming.c -------------------------------------------------------------------------------- */

/* Returns whether a rule acts only when it has been armed. */
static inline bool cw_rule_needs_arming(const cw_rule *rule)
{
    return rule->has_after || rule->manual;
}

/* Returns false when too many armings are under way already, so this one is lost. */
bool cw_rule_add_arming(cw_rule_set *set, unsigned rule, uint64_t tick);

/* Returns the tick of a rule's next arming, or CW_NEVER. */
uint64_t cw_rule_next_arming(const cw_rule_state *state);

/* Takes the next arming, at that tick. */
void cw_rule_take_arming(cw_rule_state *state, uint64_t tick);

/* Arms the rules that come after this one, at once or later. */
void cw_rule_arm_followers(cw_rule_set *set, unsigned rule, uint64_t reported);

/* ---- due.c ----------------------------------------------------------------------------------- */

/* Plans the first time of a rule from a tick on. One that has no other time acts at once when its
 * time has passed. */
void cw_rule_plan_from(cw_rule_state *state, uint64_t tick);

/* ---- awake.c --------------------------------------------------------------------------------- */

/* Puts a rule into the list of those that are looked at in every bit. */
void cw_rule_wake(cw_rule_set *set, unsigned rule);

/* Takes rules that have nothing left to do out of the list. */
void cw_rules_fall_asleep(cw_rule_set *set);

/* Unbinds a rule from transmissions that have ended for it: the node has become a receiver or is
 * idle. For a rule on a frame bit they end, too, when the next bit is not a frame bit. */
void cw_rule_unbind_ended(const cw_rule_set *set, cw_rule_state *state);

/* Returns whether the rule has to be looked at in the next bit. */
bool cw_rule_needs_bits(const cw_rule_state *state);

/* ---- begin.c --------------------------------------------------------------------------------- */

/* Returns whether a rule whose action has no position begins to act: its match is a hit. */
bool cw_rule_begins(cw_rule_set *set, unsigned rule, uint64_t start, uint64_t reported);

/* Notes a hit, which becomes an event at the end of its bit, a tick. */
void cw_rule_note_hit(cw_rule_set *set, unsigned rule, uint64_t end);

/* Lets the rule act from now on, for its time or once. */
void cw_rule_act(cw_rule_set *set, unsigned rule);

/* The rule acts at that tick, when the bit in progress has been committed. */
void cw_rule_act_later(cw_rule_set *set, unsigned rule, uint64_t tick);

/* Begins an action that lasts; if it lasts for a transmission, scope has the transmitters. */
void cw_rule_begin_window(cw_rule_set *set, unsigned rule, uint64_t scope);

/* Handles a match at the present tick, between two bits: the rule acts if it is a hit. */
void cw_rule_fire(cw_rule_set *set, unsigned rule);

/* ---- level.c, noise.c ------------------------------------------------------------------------ */

/* Returns the length of a nominal bit of the bus. */
static inline cw_span cw_rule_bit_time(const cw_rule_set *set)
{
    return (cw_span)cw_rate_ticks(cw_wire_rate(set->bus.time), 1) * CW_TICK;
}

/* Counts a bit of a position action under way, of this length. */
void cw_rule_pass_bit(cw_rule_state *state, cw_span length);

/* Finds the nodes whose levels a new rule changes. The hit of a rule with a position finds them
 * again. */
void cw_rule_aim(cw_rule_state *state);

/* Returns the level of a stuck TX line in a bit, and counts its time for the dominant timeout. */
bool cw_stuck_tx_level(const cw_rule_set *set, cw_rule_state *state);

/* Returns the driven levels of all nodes with those of stuck TX lines, and counts nothing. */
uint64_t cw_rules_change_lines(cw_rule_set *set, uint64_t driven);

/* Returns those of some nodes to which a rule is bound and that are in the named bit now. */
uint64_t cw_rule_nodes_at_position(const cw_rule_set *set, cw_rule_state *state, uint64_t nodes);

/* Notes that such nodes are in the named bit. Returns true when that is a hit, and the action
 * begins. begin, end: ticks of that bit. */
bool cw_rule_reaches(cw_rule_set *set, unsigned rule, uint64_t nodes, uint64_t begin,
                     uint64_t end);

/* Ends an action for one transmission with that transmission. */
void cw_rule_check_scope(cw_rule_set *set, unsigned rule);

/* Returns the bits to come, at most `bits`, that noise does not flip: a look at draws, which
 * changes nothing. Noise for a transmission is left out. */
uint64_t cw_noise_free(const cw_rule_set *set, uint64_t bits);

/* Consumes the draws of such bits. */
void cw_noise_pass(cw_rule_set *set, uint64_t bits);

/* ---- host.c, traffic.c ----------------------------------------------------------------------- */

/* Releases frames that were held back and are due now. */
void cw_rules_release_held(cw_rule_set *set);

/* Makes frames that an ending rule holds back due now. */
void cw_rule_let_go(cw_rule_set *set, unsigned rule);

/* Returns the tick at which the first frame that is held back is due, or CW_NEVER. */
uint64_t cw_rules_next_held(const cw_rule_set *set);

/* Returns the bits to come, at most `bits`, before whose end traffic rules send nothing as long as
 * no frame leaves a queue. busy: all these bits are. */
uint64_t cw_traffic_free(const cw_rule_set *set, uint64_t bits, bool busy);

#endif
