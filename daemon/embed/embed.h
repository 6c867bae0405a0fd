/* SPDX-License-Identifier: MIT
 *
 * embed.h - the inside of an instance of libcanwire-sim.
 */
#ifndef CANWIRE_EMBED_EMBED_H
#define CANWIRE_EMBED_EMBED_H

#include "base/text/memo.h"
#include "embed/canwire-sim.h"
#include "run/inputs.h"
#include "sim/expect.h"
#include "sim/losses.h"
#include "sim/sim_group.h"
#include "sim/sim_until.h"
#include "trace/errframe.h"

#include <stdarg.h>
#include <stdio.h>

/* An event that is kept. The name of its rule is behind it, as a text. */
typedef struct embed_kept {
    size_t size;    /* of both, up to the next one */
    cw_event event; /* of its frame the data that it has, as in cw_event_at() */
} embed_kept;

/* Events in their order. */
typedef struct embed_events {
    unsigned char *bytes;
    size_t first; /* byte of the first one that has not been taken */
    size_t end;
    size_t room;
} embed_events;

/* A frame for a node's host. */
typedef struct embed_frame {
    uint64_t tick;
    canwire_sim_frame frame;
} embed_frame;

typedef struct embed_node {
    unsigned listens; /* CANWIRE_SIM_LISTEN_* */
    embed_frame *frames; /* a ring */
    size_t first;
    size_t count;
    size_t room;
    errframe_limit limit;
} embed_node;

/* Judges some expectations of a bus. */
typedef struct embed_judge {
    struct embed_judge *next;
    cfg view; /* the bus as it is, with these expectations */
    cfg_expects *own; /* NULL: they are those of the file */
    expect *judge;
} embed_judge;

typedef struct embed_bus {
    canwire_sim *sim;
    size_t index;
    int first_node;
    live *live;
    const cfg *config;    /* of `live` */
    cfg_node_time *times; /* of the nodes, as the file has them */
    uint64_t seed;        /* in the same way */
    sim_run run;
    inputs in;
    sim_until awaited;
    embed_events events;
    embed_node *nodes;
    embed_judge *judges; /* a list */
    losses lost;
    void *ahead; /* room to look ahead, see canwire_sim_next_event() */
    size_t ahead_size;
} embed_bus;

struct canwire_sim {
    rig *rig; /* NULL: there is one bus */
    sim_group group;
    size_t count; /* of buses */
    embed_bus *buses;
    uint64_t reached; /* tick up to which all is known */
    uint32_t kinds;   /* of events that are kept */
    bool awaits_any;  /* ... one of them ends the run */
    bool happened;    /* the awaited event */
    int frame_at;     /* the run ends with a frame at this node, see canwire_sim_run() */
    bool no_memory;
    memo told; /* messages of runs */
    char *message;
};

/* Notes an error for canwire_sim_message(), and returns its status. */
int embed_fail(canwire_sim *sim, int status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Returns the bus of that number, or NULL after noting an error. */
embed_bus *embed_find_bus(canwire_sim *sim, int bus);

/* Returns the bus of a node and the number of the node there, or NULL after noting an error. */
embed_bus *embed_find_node(canwire_sim *sim, unsigned *number, int node);

/* Returns true for the node of a bus that a number names, see canwire_sim_run(). */
bool embed_is_meant(const embed_bus *bus, unsigned node, int number);

/* The sink of all events of a bus. */
void embed_event(void *user, const cw_event *event);

/* Turns a frame of the bus into one of a program, at time 0. */
void embed_frame_from(canwire_sim_frame *out, const cw_frame *in);

/* Keeps an event until it is taken. */
void embed_keep(embed_bus *bus, const cw_event *event);

/* Returns the next event of all buses up to now, with its bus, or NULL. It stays as it is until the
 * next one is kept. */
const embed_kept *embed_next_kept(const canwire_sim *sim, embed_bus **bus);

/* Returns the event of a bus behind another one, NULL for its first one, or NULL. */
const embed_kept *embed_kept_after(const embed_bus *bus, const embed_kept *kept);

/* Takes the event that embed_next_kept() has returned. */
void embed_take_kept(embed_bus *bus);

/* Returns the name of the rule of a CW_EVENT_FAULT. */
const char *embed_rule_of(const embed_kept *kept);

/* Reads "all", "none" or kinds of events with commas. Returns false after noting an error. */
bool embed_read_kinds(canwire_sim *sim, uint32_t *kinds, const char *text);

/* Sets the kinds of events that a bus has to tell about. */
void embed_choose_events(embed_bus *bus);

/* Begins to judge by the expectations of the file. Returns false without memory. */
bool embed_judge_start(embed_bus *bus);

/* Judges by other expectations, too, from now on, and takes them over. Returns false without
 * memory; they then stay the caller's. */
bool embed_judge_add(embed_bus *bus, cfg_expects *own);

/* Ends all of this. */
void embed_judge_end(embed_bus *bus);

/* Hands the messages of a call over: NULL when there are none. `messages` may be NULL. */
void embed_tell_end(memo *t, char **messages);

/* ---- Texts ----------------------------------------------------------------------------------- */

/* Begins a text of this thread. */
void embed_text_begin(void);

/* Returns true when memory was lacking since then. */
bool embed_text_failed(void);

/* ---- Times ----------------------------------------------------------------------------------- */

/* Returns the first tick that is not before a time. */
uint64_t embed_tick_at(int64_t ns);

/* Returns the last tick whose time in events is not after a time. */
uint64_t embed_tick_until(int64_t ns);

#endif
