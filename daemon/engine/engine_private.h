/* SPDX-License-Identifier: MIT
 *
 * engine_private.h - what the parts of the engine share.
 *
 *   engine.c         start and stop; time: when it wakes up and what it does then
 *   engine/links.c   nodes leave the bus and come back with their interfaces
 *   engine/go_over.c  over to another configuration
 */
#ifndef CANWIRE_ENGINE_ENGINE_PRIVATE_H
#define CANWIRE_ENGINE_ENGINE_PRIVATE_H

#include "base/alarm.h"
#include "engine/catchup.h"
#include "engine/conserve.h"
#include "engine/engine.h"
#include "engine/pacing.h"
#include "engine/reload.h"
#include "port/linkwatch.h"

typedef struct port_watch {
    ev_io io; /* first: the callback gets a pointer to it */
    engine *engine;
} port_watch;

/* The interfaces of the nodes, as far as is known. */
typedef struct engine_links {
    linkwatch *watch;
    report_link state[CW_NODES_MAX];
    bool awaited;       /* there is a list of interfaces to come */
    uint64_t mentioned; /* nodes whose interface has come up in the list that is being read */
    uint64_t vcans;     /* nodes whose interface is a vcan, as far as is known */
    bool told_uncounted; /* that frames without loopback cannot be counted has been logged */
    uint64_t refused;   /* nodes whose interface is there but could not be opened */
    ev_timer retry;     /* of these, and of a list that could not be had */
    bool told_small;    /* that the kernel keeps a port short of room has been logged */
} engine_links;

struct engine {
    struct ev_loop *loop;
    live *live;
    const cfg *config; /* what is in effect */
    publisher *publisher;
    engine_observer *observer;
    void *observer_user;
    engine_bit_observer *bit_observer;
    void *bit_user;
    unsigned calm_bits; /* that were shown to it since the last event */
    engine_changed *changed;
    void *changed_user;
    setup now;
    conserve books;
    catchup catchup;
    uint64_t catch_up_ticks; /* how far the bus may fall behind */
    engine_links links;
    inputs inputs; /* of now.bus */
    uint64_t released; /* tick: what was to be released up to then has been */
    reload *next; /* what it is to go over to, or NULL */
    port_watch watches[CW_NODES_MAX];
    uint64_t pushed_back; /* nodes whose port is not read, since their queue is full */
    cw_frame overflowed[CW_NODES_MAX]; /* as report_node has it */
    uint64_t arrived[CW_NODES_MAX]; /* tick of the last frame from each node's port */
    ev_io timer;
    wake_alarm alarm; /* behind it */
    int64_t deadline_ns; /* CLOCK_MONOTONIC: when this wake-up is to give others their turn */
    uint64_t looked_at;  /* work of the bus when the clock was looked at for that */
    int64_t due_ns; /* CLOCK_MONOTONIC: what the timer is armed for; INT64_MAX: nothing */
    pacing_duty duty;
    bool ticking;   /* in `tick`: ports are read at each tick and not watched meanwhile */
    int64_t epoch_ns; /* CLOCK_MONOTONIC at bus time 0 */
    int64_t realtime_offset_ns; /* CLOCK_REALTIME is so much ahead of CLOCK_MONOTONIC */
    bool failed; /* it can no longer wake up in time */
    bool stopping;
    uint64_t stop_tick; /* no later than this ... */
    int64_t stop_ns;    /* ... and CLOCK_MONOTONIC than this */
    port_frame batch[PORT_BATCH];
    uint64_t frames_read; /* from all ports */
};

#define BOUNDARY_BITS 1000u /* to wait for the end of a frame */

/* ---- engine.c -------------------------------------------------------------------------------- */

/* Releases and bus up to a tick. Returns the tick that was reached; it is an earlier one when there
 * is so much to be done that the time of this wake-up is over. */
uint64_t engine_run_to(engine *e, uint64_t tick);

/* Hands in what still waits at a port, whether there is room for it or not. */
void engine_read_rest(engine *e, unsigned node);

/* Takes what it needs at each wake-up from the configuration. */
void engine_read_limits(engine *e);

/* Do nothing where there is no port, or it is so already. */
void engine_watch_port(engine *e, unsigned node);
void engine_unwatch_port(engine *e, unsigned node);

/* ---- engine/links.c -------------------------------------------------------------------------- */

/* Opens the ports of all nodes. False after logging what is wrong. */
bool engine_open_ports(engine *e);

/* Watches the interfaces from now on. False after logging why not. */
bool engine_watch_links(engine *e);

void engine_unwatch_links(engine *e);

/* After a change of the configuration: links by old node become links by new node. */
void engine_carry_links_over(engine *e, const reload *r);

/* ---- engine/go_over.c ------------------------------------------------------------------------- */

/* Bit by bit up to now, until a frame ends or the time of this wake-up is over; then over to the
 * next configuration, if there is one. */
void engine_run_to_boundary(engine *e, uint64_t now);

#endif
