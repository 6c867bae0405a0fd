/* SPDX-License-Identifier: MIT
 *
 * inputs.h - all inputs of a running bus in one place, where they can be recorded.
 *
 * The same inputs in the same order at the same times give the same events. So every call that
 * changes a bus passes through this file. The call is carried out and reported to an observer,
 * which can record it for another run (journal.h).
 */
#ifndef CANWIRE_RUN_INPUTS_H
#define CANWIRE_RUN_INPUTS_H

#include "config/change/retime.h"
#include "run/live.h"
#include "run/release.h"

typedef enum input_kind {
    INPUT_SEND = 0, /* a frame is handed in: node, frame, at_tick */
    INPUT_INJECT,   /* rules are added, all or none: text, size, name, refused */
    INPUT_CLEAR,    /* a rule is removed: rule */
    INPUT_FIRE,     /* a rule is armed by hand: rule */
    INPUT_RESTART,  /* a node leaves bus-off: node */
    INPUT_SET,      /* settings of a node change: node, settings, time */
    INPUT_ATTACH,   /* a node is taken off the bus or put on again: node, on */
    INPUT_SKIP,     /* time passes without simulation: skipped */
    INPUT_RELOAD,   /* the bus takes over another configuration: config, at_tick */
    INPUT_COUNT
} input_kind;

/* A completed input. Its pointers are valid only during the report. */
typedef struct input {
    input_kind kind;
    uint64_t now;  /* tick up to which the bus had been simulated */
    /* cw_bus_advance() was called since the input before, perhaps only up to `now` again */
    bool advanced;
    unsigned node;
    const cw_frame *frame; /* may be invalid */
    bool determined;       /* INPUT_SEND: the configuration tells frame and tick */
    uint64_t at_tick;      /* INPUT_RELOAD: the traffic of the new one begins there */
    const char *text;
    size_t size;
    const char *name; /* of the text */
    bool refused;     /* INPUT_INJECT: the bus did not take the rules */
    const char *rule;
    const char *as;     /* INPUT_ATTACH of a guest: the name that it gets, or NULL */
    const cw_settings *settings;
    const cfg_retime *time; /* keys of its bit timing, or NULL */
    bool on;
    uint64_t skipped;  /* ticks */
    uint64_t earlier;  /* in the same way: waiting frames come earlier by so much */
    const cfg *config; /* the new one */
} input;

/* Reports each input that may have changed the bus. The observer must not change it. */
typedef void input_observer(void *user, const input *what);

/* Takes all events of the bus. */
typedef void inputs_drain(void *user);

typedef struct inputs {
    live *config;
    cw_bus *bus;
    inputs_drain *drain;
    inputs_drain *renaming; /* the name of a guest goes, and all events have been taken; or NULL */
    void *drain_user;
    input_observer *observer; /* or NULL */
    void *observer_user;
    bool advanced;
} inputs;

/* Initialises the inputs. Configuration and bus must live longer. */
void inputs_init(inputs *in, live *config, cw_bus *bus, inputs_drain *drain, void *user);

/* Sets the only observer. */
void inputs_observe(inputs *in, input_observer *observer, void *user);

/* Calls cw_bus_advance() and takes all events. */
void inputs_advance(inputs *in, uint64_t tick);

/* Calls cw_bus_advance_some() and takes all events. Returns true when the tick has been reached. */
bool inputs_advance_some(inputs *in, uint64_t tick, uint64_t work);

/* Calls cw_node_send(). */
cw_status inputs_send(inputs *in, unsigned node, const cw_frame *frame, uint64_t at_tick);

/* Calls release_hand_in(). */
cw_status inputs_release(inputs *in, release_plan *plan);

/* Adds the rules of a text, see cfg_load_rules(), all or none. Returns them, to be freed with
 * cfg_free_rules(), or NULL after writing a line per error to `errors`. */
cfg_rules *inputs_inject(inputs *in, const char *text, size_t size, const char *name,
                         FILE *errors);

/* Calls cw_bus_clear_rule() and forgets the name. The rule must exist. */
void inputs_clear(inputs *in, unsigned rule);

/* Calls cw_bus_fire_rule(). The rule must exist. */
cw_status inputs_fire(inputs *in, unsigned rule);

/* Calls cw_node_restart(). */
cw_status inputs_restart(inputs *in, unsigned node);

/* Calls cw_node_set(). */
cw_status inputs_set(inputs *in, unsigned node, const cw_settings *settings);

/* Does the same with keys of the node's bit timing, too: all, or nothing and CW_INVALID. The
 * message then says why; it is "" when other settings are wrong. */
cw_status inputs_set_all(inputs *in, char problem[RETIME_PROBLEM_MAX], unsigned node,
                         const cw_settings *settings, const cfg_retime *time);

/* Calls cw_node_attach() and takes all events. A guest that leaves has its own name afterwards. */
void inputs_attach(inputs *in, unsigned node, bool on);

/* Puts a guest on the bus under another name, NULL: its own. */
void inputs_attach_as(inputs *in, unsigned node, const char *name);

/* Lets time pass without simulation, with cw_nodes_bring_forward(). `earlier` is the time that
 * frames of ports have waited in the inbox already. Traffic of the configuration comes in bus time,
 * so it stays where it is. The caller passes the event on. */
cw_event inputs_skip(inputs *in, uint64_t ticks, uint64_t earlier);

/* Drops the frames of removed nodes, with events, and lets another bus take over
 * (cw_bus_take_over()). The other bus is made of config. The caller then calls live_replace() for
 * the names of the nodes, and release_take_over() with that tick. */
cw_status inputs_take_over(inputs *in, cw_bus *next, const cfg *config,
                           const uint8_t from[CW_NODES_MAX], uint64_t tick);

#endif
