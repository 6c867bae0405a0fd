/* SPDX-License-Identifier: MIT
 *
 * core.h - the engine's struct, and what the parts of the engine share. Each stands on those above
 *          it:
 *
 *   clock.c    bus time and the clocks of the machine
 *   advance.c  the bus up to a tick, and its events to whom they concern
 *   intake.c   what ECUs write, from their ports into the inbox of the bus
 *   core.c     the bus and what is put into it, up to a tick
 *   links.c    nodes leave the bus and come back with their interfaces
 *   go_over.c  over to another configuration
 *   engine.c   start and stop; when it wakes up, and what it does then
 */
#ifndef CANWIRE_ENGINE_CORE_H
#define CANWIRE_ENGINE_CORE_H

#include "base/alarm.h"
#include "engine/catchup.h"
#include "engine/clock.h"
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
    void (*wake)(engine *e); /* brings the bus up to now and arms the timer: engine_update() */
    /* ... as the callback of a port that can be read */
    void (*on_port)(struct ev_loop *loop, ev_io *io, int events);
    live *live;
    const cfg *config; /* what is in effect */
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
    engine_clock clock;
    bool failed; /* it can no longer wake up in time */
    bool stopping;
    uint64_t stop_tick; /* no later than this ... */
    int64_t stop_ns;    /* ... and CLOCK_MONOTONIC than this */
    port_frame batch[PORT_BATCH];
    uint64_t frames_read; /* from all ports */
};

#define BOUNDARY_BITS 1000u /* to wait for the end of a frame */

/* ---- advance.c ------------------------------------------------------------------------------- */

/* An event to whom it concerns beside the ECUs. */
void engine_tell(engine *e, const cw_event *event);

/* All events of the bus so far to whom they concern; user: the engine. */
void engine_handle_events(void *user);

/* From now on the wake-up may last for as long as one may. */
void engine_start_turn(engine *e);

/* Whether this wake-up has lasted for long enough. */
bool engine_turn_is_over(const engine *e);

/* The bus up to a tick, with its events; false when the time of this wake-up is over before. */
bool engine_advance(engine *e, uint64_t tick);

/* ---- intake.c -------------------------------------------------------------------------------- */

/* Reads what waits at the ports of all nodes that have room. */
void engine_read_ports(engine *e, const clock_pair *now);

/* What has waited for room comes in as soon as there is some. */
void engine_read_pushed_back(engine *e);

/* Hands in what still waits at a port, whether there is room for it or not. */
void engine_read_rest(engine *e, unsigned node);

/* The first frame of the inbox comes up at the latest in the bit that holds its tick. False when
 * the time of this wake-up is over before. */
bool engine_make_room(engine *e);

/* Do nothing where there is no port, or it is so already. */
void engine_watch_port(engine *e, unsigned node);
void engine_unwatch_port(engine *e, unsigned node);

/* ---- core.c ---------------------------------------------------------------------------------- */

/* Releases and bus up to a tick. Returns the tick that was reached; it is an earlier one when there
 * is so much to be done that the time of this wake-up is over. */
uint64_t engine_run_to(engine *e, uint64_t tick);

/* Takes what it needs at each wake-up from the configuration. */
void engine_read_limits(engine *e);

/* ---- links.c --------------------------------------------------------------------------------- */

/* Opens the ports of all nodes. False after logging what is wrong. */
bool engine_open_ports(engine *e);

/* Watches the interfaces from now on. False after logging why not. */
bool engine_watch_links(engine *e);

void engine_unwatch_links(engine *e);

/* After a change of the configuration: links by old node become links by new node. */
void engine_carry_links_over(engine *e, const reload *r);

/* ---- go_over.c ------------------------------------------------------------------------------- */

/* Bit by bit up to now, until a frame ends or the time of this wake-up is over; then over to the
 * next configuration, if there is one. */
void engine_run_to_boundary(engine *e, uint64_t now);

#endif
