/* SPDX-License-Identifier: MIT
 *
 * inputs.h - all that is done to a running bus from outside, in one place, where it can be noted.
 *
 * The same inputs in the same order at the same times give the same events. So every call that
 * changes a bus goes through here: it is carried out and an observer is told, who can write it down
 * for another run (journal.h).
 */
#ifndef CANWIRE_RUN_INPUTS_H
#define CANWIRE_RUN_INPUTS_H

#include "run/live.h"
#include "run/release.h"

typedef enum input_kind {
    INPUT_SEND = 0, /* a frame is handed in: node, frame, at_tick */
    INPUT_INJECT,   /* rules are added, all or none: text, size, name, refused */
    INPUT_CLEAR,    /* a rule is taken away: rule */
    INPUT_FIRE,     /* a rule is armed by hand: rule */
    INPUT_RESTART,  /* a node leaves bus-off: node */
    INPUT_SET,      /* settings of a node change: node, settings */
    INPUT_ATTACH,   /* a node is taken off the bus or put on again: node, on */
    INPUT_SKIP,     /* time passes without the bus: skipped */
    INPUT_RELOAD,   /* the bus goes over to another configuration: config */
    INPUT_COUNT
} input_kind;

/* What was done. Pointers are good only while the observer is being told. */
typedef struct input {
    input_kind kind;
    uint64_t now;  /* tick up to which the bus had been simulated */
    /* cw_bus_advance() was called since the input before, if only up to `now` again */
    bool advanced;
    unsigned node;
    const cw_frame *frame; /* need not be valid */
    uint64_t at_tick;
    const char *text;
    size_t size;
    const char *name; /* of the text */
    bool refused;     /* INPUT_INJECT: the bus did not take the rules */
    const char *rule;
    const cw_settings *settings;
    bool on;
    uint64_t skipped;  /* ticks */
    uint64_t earlier;  /* the same: frames that wait come so much earlier */
    const cfg *config; /* the new one */
} input;

/* Is told after each input that may have changed the bus; must not change it. */
typedef void input_observer(void *user, const input *what);

/* Takes all events of the bus. */
typedef void inputs_drain(void *user);

typedef struct inputs {
    live *config;
    cw_bus *bus;
    inputs_drain *drain;
    void *drain_user;
    input_observer *observer; /* or NULL */
    void *observer_user;
    bool advanced;
} inputs;

/* Configuration and bus must live longer. */
void inputs_init(inputs *in, live *config, cw_bus *bus, inputs_drain *drain, void *user);

/* One observer at most. */
void inputs_observe(inputs *in, input_observer *observer, void *user);

/* cw_bus_advance() to a tick, with all events taken. */
void inputs_advance(inputs *in, uint64_t tick);

/* cw_bus_advance_some(), with all events taken. Returns whether the tick has been reached. */
bool inputs_advance_some(inputs *in, uint64_t tick, uint64_t work);

/* cw_node_send() */
cw_status inputs_send(inputs *in, unsigned node, const cw_frame *frame, uint64_t at_tick);

/* release_hand_in() */
cw_status inputs_release(inputs *in, release_plan *plan);

/* Adds the rules of a text, see cfg_load_rules(), all or none. Returns them, to be freed with
 * cfg_free_rules(), or NULL after writing a line per error to errors. */
cfg_rules *inputs_inject(inputs *in, const char *text, size_t size, const char *name,
                         FILE *errors);

/* cw_bus_clear_rule(), and its name is forgotten. There must be such a rule. */
void inputs_clear(inputs *in, unsigned rule);

/* cw_bus_fire_rule(). There must be such a rule. */
cw_status inputs_fire(inputs *in, unsigned rule);

/* cw_node_restart() */
cw_status inputs_restart(inputs *in, unsigned node);

/* cw_node_set() */
cw_status inputs_set(inputs *in, unsigned node, const cw_settings *settings);

/* cw_node_attach(), with all events taken */
void inputs_attach(inputs *in, unsigned node, bool on);

/* Time passes without the bus, of which frames in the inbox have waited so many ticks already:
 * cw_bus_bring_forward(). The event is to be passed on by the caller. */
cw_event inputs_skip(inputs *in, uint64_t ticks, uint64_t earlier);

/* Drops the frames of nodes that are no more, with events, and lets another bus take over
 * (cw_bus_take_over()); config is what it is made of. The names of the nodes become those of that
 * with live_replace(), which is left to the caller. */
cw_status inputs_take_over(inputs *in, cw_bus *next, const cfg *config,
                           const uint8_t from[CW_NODES_MAX]);

#endif
