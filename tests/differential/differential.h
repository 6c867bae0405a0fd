/* SPDX-License-Identifier: MIT
 *
 * differential.h - two buses with the same inputs. One steps every node through every bit, the
 * other takes all its fast paths. No readable state may differ.
 *
 * A scenario is data: configurations, rules, and operations at ticks. It is made from a seed
 * (generate.c, rules.c) and run on both buses (run.c, compare.c). A failing one is made smaller
 * (shrink.c), until a person can read it (show.c). Only the public header is used.
 */
#ifndef CANWIRE_DIFFERENTIAL_H
#define CANWIRE_DIFFERENTIAL_H

#include "canwire.h"

#include <stdio.h>

#define DIFF_RULES_MAX 40u  /* of one configuration, and added while the bus runs */
#define DIFF_PLANS_MAX 5u   /* configurations of a scenario */
#define DIFF_PROTECTIONS_MAX 24u /* of one configuration */
#define DIFF_NAMES 256u     /* distinct names of rules */
#define DIFF_STYLES 21u
#define DIFF_TIMED_BIT_MAX 8000u /* ticks; longer bits have no clocks of their own here */

/* ---- Random numbers -------------------------------------------------------------------------- */

typedef struct diff_random {
    uint64_t state;
} diff_random;

void diff_random_init(diff_random *r, uint64_t seed);
uint64_t diff_draw(diff_random *r);
uint64_t diff_below(diff_random *r, uint64_t limit);               /* 0 when limit is 0 */
uint64_t diff_between(diff_random *r, uint64_t least, uint64_t most); /* both included */
bool diff_chance(diff_random *r, unsigned permille);

/* Draws a number from least (at least 1) to most; each order of magnitude has about the same
 * chance. */
uint64_t diff_magnitude(diff_random *r, uint64_t least, uint64_t most);

/* Works as realloc(), but ends the program without memory. */
void *diff_allocate(void *old, size_t size);

/* ---- Scenarios ------------------------------------------------------------------------------- */

typedef struct diff_rule {
    cw_rule rule;  /* its name is filled in when it is used */
    unsigned name; /* number of its name */
} diff_rule;

typedef struct diff_plan {
    cw_bus_config config; /* nodes and rules are those below, filled in when it is used */
    cw_node_config nodes[CW_NODES_MAX];
    diff_rule rules[DIFF_RULES_MAX];
    cw_protection protections[DIFF_PROTECTIONS_MAX];
} diff_plan;

typedef enum diff_op_kind {
    DIFF_SEND = 0,
    DIFF_RESTART,
    DIFF_ADD_RULE,
    DIFF_CLEAR_RULE,
    DIFF_STOP_RULE,
    DIFF_FIRE_RULE,
    DIFF_SET,
    DIFF_FLUSH,
    DIFF_ATTACH,
    DIFF_SET_EVENTS,
    DIFF_TAKE_OVER,
    DIFF_BRING_FORWARD,
    DIFF_STEPPING, /* of the fast bus */
    DIFF_WATCHING, /* of it, too */
    DIFF_CHECK,    /* all that can be read is compared */
    DIFF_OP_COUNT
} diff_op_kind;

typedef struct diff_op {
    diff_op_kind kind;
    bool at_once;    /* without an advance since the operation before */
    uint64_t tick;   /* both buses are advanced to it first */
    unsigned target; /* node; index of a rule on the bus; of an added rule; of a plan */
    union {
        struct {
            cw_frame frame;
            uint64_t at_tick;
        } send;
        cw_settings settings;
        bool on;        /* STEPPING, WATCHING, ATTACH */
        uint32_t kinds; /* SET_EVENTS */
        uint64_t ticks; /* BRING_FORWARD */
        uint8_t from[CW_NODES_MAX]; /* TAKE_OVER */
    };
} diff_op;

/* Ways to bring a bus to the tick of the next operation. */
typedef enum diff_slicing {
    DIFF_WHOLE = 0, /* in one call */
    DIFF_BITS,      /* bit by bit */
    DIFF_SHORT,     /* a few bits and parts of bits */
    DIFF_MIXED,     /* all orders of magnitude */
    DIFF_NEXT,      /* to cw_bus_next() each time */
    DIFF_WORK,      /* as far as a little work goes */
    DIFF_SLICING_COUNT
} diff_slicing;

typedef struct diff_scenario {
    uint64_t seed;
    unsigned style;
    uint64_t end; /* tick */
    diff_slicing fast;
    diff_slicing reference;
    unsigned drains; /* permille of the slices after which the events are taken */
    bool repeats; /* the reference goes to the ends of bits at which the fast bus stops */
    bool peeks; /* the fast bus is read at the end of each slice */
    bool own_clocks; /* the reference goes by the clocks of its nodes, not by common bits */
    unsigned plan_count;
    diff_plan plans[DIFF_PLANS_MAX]; /* the first one is the bus at tick 0 */
    unsigned added_count;
    diff_rule added[DIFF_RULES_MAX];
    unsigned op_count;
    unsigned op_room;
    diff_op *ops; /* sorted by tick */
} diff_scenario;

/* Returns the text of a rule name. */
const char *diff_name(unsigned number);

/* Returns a configuration for the library, valid until the plan ends or is filled in again. */
const cw_bus_config *diff_fill_in(diff_plan *plan, cw_rule rules[DIFF_RULES_MAX]);

void diff_scenario_copy(diff_scenario *to, const diff_scenario *from);
void diff_scenario_free(diff_scenario *s);
void diff_add_op(diff_scenario *s, const diff_op *op);

/* ---- generate.c, rules.c --------------------------------------------------------------------- */

const char *diff_style_name(unsigned style);

/* Makes the scenario of a seed. Free it with diff_scenario_free(). */
void diff_generate(diff_scenario *s, uint64_t seed);

/* The source of scenarios. */
typedef struct diff_maker {
    diff_random random;
    uint64_t bit;   /* ticks */
    uint64_t bits;  /* length of the scenario */
    unsigned nodes;
    unsigned rules; /* of the present configuration */
    uint64_t actions; /* allowed, 1 << cw_action */
    unsigned rarity;  /* rules hit about every so-many-th match, 1: no limit */
    bool clocks;      /* nodes have clocks of their own */
    bool near;        /* ... which differ by so little that most frames are read right */
    bool fd;          /* nodes know FD frames, or not */
    bool mailboxes;   /* some nodes have mailboxes, and frames their identifiers */
    bool rates;       /* ... and have a data rate, mostly that of these timings */
    cw_node_timing common;
    bool sleeps;      /* nodes sleep */
    bool owned;       /* an identifier is sent by one node only, as it should be */
    unsigned frame_count;
    cw_frame frames[12]; /* of which the traffic consists */
} diff_maker;

cw_rule diff_random_rule(diff_maker *m);

/* Draws the bit timing, the clock and the delays of a node; half of them have those of the bus. */
void diff_random_timing(diff_maker *m, cw_node_timing *timing);

/* Filters that some nodes have the first ones of. */
#define DIFF_FILTERS 3u
extern const cw_filter diff_filters[DIFF_FILTERS];

/* Mailboxes that some nodes have some of. */
#define DIFF_MAILBOXES 16u
extern const cw_mailbox diff_mailboxes[DIFF_MAILBOXES];

/* Draws what wakes a node. */
cw_sleep_settings diff_random_sleep(diff_maker *m);

/* Triggers of which nodes have the first ones, of a time master and of others. The master's last
 * one is its reference message. */
#define DIFF_TRIGGERS 6u
extern const cw_time_trigger diff_master[DIFF_TRIGGERS], diff_slave[DIFF_TRIGGERS];

/* Draws two rates, which all nodes can have in common. */
void diff_random_rates(diff_maker *m, cw_node_timing *timing);

/* Returns the frame with an identifier of that node, if identifiers belong to nodes. */
cw_frame diff_owned_frame(const diff_maker *m, const cw_frame *frame, unsigned node);

/* Gives frames of some nodes a counter, a checksum or both. */
void diff_random_protections(diff_maker *m, diff_plan *plan);
cw_settings diff_random_settings(diff_maker *m);
cw_frame diff_random_frame(diff_maker *m);
void diff_change_format(diff_maker *m, cw_frame *frame);
uint64_t diff_random_nodes(diff_maker *m); /* at least one */
unsigned diff_random_modes(diff_maker *m);
uint64_t diff_random_ticks(diff_maker *m, uint64_t bits_least, uint64_t bits_most);

/* ---- coverage.c ------------------------------------------------------------------------------ */

/* Single things that must have been there. */
typedef enum diff_mark {
    DIFF_COMPARISONS = 0, /* of all that can be read */
    DIFF_SHORT_CUTS,      /* of these, where the fast bus had not simulated the last bit */
    DIFF_FULL_RINGS,
    DIFF_FULL_BUSES, /* with CW_NODES_MAX nodes */
    DIFF_FORETOLD,   /* events that cw_bus_next_rx() has been asked about, without rules */
    DIFF_FORESEEN,   /* looks ahead that found an event */
    DIFF_MARK_COUNT
} diff_mark;

typedef struct diff_coverage {
    uint64_t scenarios;
    uint64_t bits;
    uint64_t frames;
    uint64_t error_frames;
    uint64_t events[CW_EVENT_COUNT];
    uint64_t actions[CW_ACTION_COUNT]; /* hits */
    uint64_t triggers[CW_TRIGGER_ERROR + 1];
    uint64_t fields[CW_FIELD_COUNT]; /* hits of position actions */
    uint64_t errors[CW_ERROR_COUNT];
    uint64_t drops[CW_DROP_COUNT];
    uint64_t states[CW_STATE_COUNT];
    uint64_t ops[DIFF_OP_COUNT]; /* that were carried out */
    uint64_t refusals[CW_AGAIN + 1]; /* by status, of operations */
    uint64_t marks[DIFF_MARK_COUNT];
    uint64_t style_bits[DIFF_STYLES];
    uint64_t style_frames[DIFF_STYLES];
} diff_coverage;

void diff_cover_event(diff_coverage *c, const cw_event *e, const cw_rule *rule);
void diff_cover_write(const diff_coverage *c, FILE *out);

/* Writes what was never exercised; returns how many kinds. */
unsigned diff_cover_missing(const diff_coverage *c, FILE *out);

const char *diff_action_name(cw_action action);
const char *diff_op_name(diff_op_kind kind);

/* ---- run.c, compare.c ------------------------------------------------------------------------ */

/* The first difference and its place. */
typedef struct diff_verdict {
    bool differs;
    uint64_t tick;
} diff_verdict;

/* Runs a scenario on both buses. Differences are written to out, unless it is NULL. */
void diff_run(diff_verdict *v, const diff_scenario *s, diff_coverage *c, FILE *out);

/* Returns true when two events are the same in all defined members. */
bool diff_same_event(const cw_event *a, const cw_event *b);

/* Compares all that can be read of two buses at the same tick, writing what differs. */
bool diff_same_buses(const cw_bus *fast, const cw_bus *reference, unsigned rules, FILE *out);

/* Does the same with the last bit, which nodes with clocks of their own do not have in common. */
bool diff_same_bits(const cw_bus *fast, const cw_bus *reference, FILE *out);

/* ---- ledger.c -------------------------------------------------------------------------------- */

typedef struct diff_ledger diff_ledger;

diff_ledger *diff_ledger_new(const diff_scenario *s);
void diff_ledger_free(diff_ledger *l);

/* Note a frame that was taken; an event; another bus that goes on with these nodes; and that later
 * events are left out. */
void diff_ledger_send(diff_ledger *l, unsigned node, const cw_frame *frame);
void diff_ledger_event(diff_ledger *l, const cw_event *e);
void diff_ledger_take_over(diff_ledger *l, const uint8_t *from, unsigned node_count);
void diff_ledger_close(diff_ledger *l);

/* Return true when the bus counts all reported frames; the second one, with all nodes flushed, when
 * each frame was reported once. They write differences. All events have been taken. */
bool diff_ledger_check(const diff_ledger *l, const cw_bus *bus, FILE *out);
bool diff_ledger_check_end(const diff_ledger *l, const cw_bus *bus, FILE *out);

/* ---- show.c ---------------------------------------------------------------------------------- */

void diff_write_event(FILE *out, const cw_event *e);

/* Writes the scenario as calls of the library. */
void diff_write_scenario(FILE *out, const diff_scenario *s);

/* ---- shrink.c -------------------------------------------------------------------------------- */

typedef enum diff_outcome {
    DIFF_SAME = 0,
    DIFF_DIFFERS,
    DIFF_CRASHES,
    DIFF_HANGS,
} diff_outcome;

/* Runs the scenario in a process of its own; *tick is where it differs. */
diff_outcome diff_try(const diff_scenario *s, uint64_t *tick, bool tell);

/* Makes a scenario smaller while diff_try() gives the same outcome. */
void diff_shrink(diff_scenario *s, diff_outcome outcome, uint64_t tick);

#endif
