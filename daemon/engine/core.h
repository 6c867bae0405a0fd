/* SPDX-License-Identifier: MIT
 *
 * core.h - the engine's struct, shared by its parts. Each part depends on those
 *          above it:
 *
 *   clock.c    bus time and the clocks of the machine
 *   present.c  the present moment, of the machine or of virtual time
 *   timer.c    the moment of the next wake-up
 *   advance.c  advances the bus to a tick, passes its events on
 *   releases.c hands in the traffic of the configuration
 *   intake.c   moves frames of ECUs from their ports into the inbox of the bus
 *   core.c     advances the bus, with its inputs, to a tick
 *   links.c    detaches and attaches nodes with their interfaces
 *   guests.c   ... and with their clients
 *   orders.c   ... and as their controllers say, which are in programs
 *   go_over.c  changes to another configuration
 *   go.c       ... on the way to a tick
 *   virtual.c  bus time that the waits of programs move
 *   engine.c   start and stop; wake-ups
 *   group.c    wake-ups of several engines with one clock and one timer
 */
#ifndef CANWIRE_ENGINE_CORE_H
#define CANWIRE_ENGINE_CORE_H

#include "base/alarm.h"
#include "engine/catchup.h"
#include "engine/clock.h"
#include "engine/conserve.h"
#include "engine/engine.h"
#include "engine/pacing.h"
#include "engine/programs.h"
#include "engine/reload.h"
#include "port/linkwatch.h"
#include "run/settings.h"

typedef struct port_watch {
    ev_io io; /* first: the callback gets a pointer to it */
    engine *engine;
} port_watch;

/* An MTU that does not fit the node, as the log has told it. */
typedef enum mtu_told {
    MTU_FITS = 0,
    MTU_SMALL, /* of a node that knows CAN FD: its frames do not pass */
    MTU_LARGE  /* of another one: programs can write CAN FD frames, which are dropped */
} mtu_told;

/* The calls of an engine to its group. */
typedef struct group_calls {
    void (*carry)(engine *e, const cw_event *event); /* an event of a node of a gateway */
    /* Returns false, after writing a line per error, when gateways cannot do with that. */
    bool (*may_take)(engine *e, const cfg *config, FILE *errors);
    void (*moved)(engine *e, const uint8_t from[CW_NODES_MAX]); /* nodes have other places */
} group_calls;

/* The known interfaces of the nodes. */
typedef struct engine_links {
    linkwatch *watch;
    report_link state[CW_NODES_MAX];
    bool awaited;       /* a list of interfaces is pending */
    uint64_t mentioned; /* nodes whose interface is in the list that is being read */
    uint64_t vcans;     /* nodes whose interface is known to be a vcan */
    bool reported_uncounted; /* the log says that frames without loopback cannot be counted */
    uint64_t refused;   /* nodes whose interface exists but could not be opened */
    ev_timer retry;     /* of these, and of a list that failed */
    mtu_told mtu[CW_NODES_MAX];
    bool reported_small; /* the log says that the kernel grants a port too little room */
} engine_links;

/* Virtual time; see virtual.c. */
struct engine_virtual {
    programs *programs;
    turns *turns;      /* of them */
    int64_t now_ns;    /* bus time */
    int64_t left_ns;   /* when the last program has gone */
    bool begun;        /* enough programs have been there */
    bool unread;       /* somebody may have sent something since the ports were read */
    bool more;         /* the time of the last wake-up was too short */
    uint64_t given;    /* turns */
    ev_timer look;     /* tells who holds time */
    uint64_t seen;     /* turns at its last look that differed from the one before ... */
    unsigned same;     /* ... and the looks since then */
};

/* Guests, whose nodes are on the bus while their clients are connected. */
typedef struct engine_guests {
    ev_io io;      /* of the door */
    uint64_t gone; /* nodes whose client has gone */
} engine_guests;

struct engine {
    struct ev_loop *loop;
    void (*wake)(engine *e); /* advances the bus to the present and arms the timer:
                                engine_update() */
    /* ... as the callback of a readable port */
    void (*on_port)(struct ev_loop *loop, ev_io *io, int events);
    void (*arm)(engine *e);  /* sets the timer to wake_ns */
    void (*over)(engine *e); /* it has stopped, or failed */
    struct engine_group *group; /* NULL: this bus is alone */
    const group_calls *group_calls;
    size_t place;            /* in the group */
    const char *name;        /* in its messages; NULL: this bus is alone */
    uint64_t carried;        /* nodes of gateways, as a set */
    live *live;
    const cfg *config; /* the configuration in effect */
    engine_observer *observer;
    void *observer_user;
    uint32_t kinds; /* of events, see engine_set_events() */
    engine_bit_observer *bit_observer;
    void *bit_user;
    unsigned calm_bits; /* bits shown to it since the last event */
    engine_changed *changed;
    void *changed_user;
    setup now;
    conserve books;
    catchup catchup;
    uint64_t catch_up_ticks; /* largest lag of the bus */
    engine_links links;
    engine_guests guests;
    inputs inputs; /* of now.bus */
    uint64_t released; /* tick up to which releases have been handed in */
    reload *next; /* the next configuration, or NULL */
    port_watch watches[CW_NODES_MAX];
    uint64_t pushed_back; /* nodes whose port is not read, since their queue is full */
    cw_frame overflowed[CW_NODES_MAX]; /* see report_node */
    uint64_t arrived[CW_NODES_MAX]; /* tick of the last frame from each node's port */
    ev_io timer;
    wake_alarm alarm; /* of the timer */
    int64_t deadline_ns; /* CLOCK_MONOTONIC: time at which this wake-up must end */
    uint64_t looked_at;  /* work of the bus at the last reading of the clock */
    int64_t due_ns; /* CLOCK_MONOTONIC: the time of the timer; INT64_MAX: none */
    int64_t wake_ns; /* in the same way: the wake-up for it */
    pacing_duty duty;
    struct engine_virtual *virtual_time; /* NULL: real time */
    bool ticking;   /* in `tick`: ports are read at each tick and not watched meanwhile */
    engine_clock *clock; /* its own, or that of the group */
    engine_clock own_clock;
    bool failed; /* it can no longer wake up in time */
    bool stopping;
    uint64_t stop_tick; /* no later than this ... */
    int64_t stop_ns;    /* ... and, by CLOCK_MONOTONIC, than this */
    bool stopped;
    port_frame batch[PORT_BATCH];
    uint64_t frames_read; /* from all ports */
};

#define BOUNDARY_BITS 1000u /* limit of the wait for the end of a frame */

/* ---- present.c ------------------------------------------------------------------------------- */

/* Returns the present moment, of the machine or of virtual time. */
clock_pair engine_now(const engine *e);

/* Returns true while a program has its turn, whose messages are read when it waits. */
bool engine_is_held(const engine *e);

/* ---- timer.c --------------------------------------------------------------------------------- */

/* Ends the loop, as a bus that cannot wake up must not seem to run. */
void engine_fail(engine *e, const char *what, const char *why);

/* Returns false, after that, for a descriptor that the kernel cannot watch: libev stops the watcher
 * and calls once more. */
bool engine_is_watched(engine *e, int events, const char *what);

/* Returns the tick of the next event without input from ports. CW_NEVER: the bus rests, nothing is
 * planned. */
uint64_t engine_next_tick(const engine *e);

/* Sets the timer to the next event. */
void engine_arm_timer(engine *e);

/* Waits in a busy loop for the moment of the timer, which `spin` sets a little early. It returns at
 * once when nothing is due so soon. */
void engine_spin(const engine *e);

/* ---- advance.c ------------------------------------------------------------------------------- */

/* Passes an event to all but the ECUs. */
void engine_notify(engine *e, const cw_event *event);

/* Passes all pending events of the bus on; user: the engine. */
void engine_handle_events(void *user);

/* Starts the time limit of a wake-up. */
void engine_start_turn(engine *e);

/* Returns true when this wake-up has lasted for long enough. */
bool engine_turn_is_over(const engine *e);

/* Advances the bus to a tick, with its events; returns false when the time of this wake-up ends
 * before. */
bool engine_advance(engine *e, uint64_t tick);

/* ---- releases.c ------------------------------------------------------------------------------ */

/* Hands in the releases up to a tick. Returns the tick up to which all are handed in, an earlier
 * one when the time of this wake-up is too short. */
uint64_t engine_release_to(engine *e, uint64_t now);

/* ---- intake.c -------------------------------------------------------------------------------- */

/* Reads waiting frames from the ports of all nodes that have room. */
void engine_read_ports(engine *e, const clock_pair *now);

/* Reads frames that have waited for room as soon as there is some. */
void engine_read_pushed_back(engine *e);

/* Hands in all frames that wait at a port, even without room in the queue. */
void engine_read_rest(engine *e, unsigned node);

/* Start and stop watching a port; a missing port, and one in that state already, are allowed. */
void engine_watch_port(engine *e, unsigned node);
void engine_unwatch_port(engine *e, unsigned node);

/* ---- core.c ---------------------------------------------------------------------------------- */

/* Runs releases and bus up to a tick. Returns the tick that was reached, an earlier one when the
 * time of this wake-up is too short. */
uint64_t engine_run_to(engine *e, uint64_t tick);

/* Takes the values for each wake-up from the configuration. */
void engine_read_limits(engine *e);

/* Selects the kinds of events that the bus reports. */
void engine_choose_events(engine *e);

/* ---- links.c --------------------------------------------------------------------------------- */

/* Opens the ports of all nodes. Returns false after logging the reasons. */
bool engine_open_ports(engine *e);

/* Watches the interfaces from now on. Returns false after logging the reason. */
bool engine_watch_links(engine *e);

void engine_unwatch_links(engine *e);

/* Changes the link of a node. The bus has been advanced to the present. */
void engine_set_link(engine *e, unsigned node, report_link state);

/* Adapts to a changed configuration: links by old node become links by new node. */
void engine_carry_links_over(engine *e, const reload *r);

/* ---- guests.c -------------------------------------------------------------------------------- */

/* Opens the door of the guests, if there is one. Returns false after logging the reason. */
bool engine_open_door(engine *e);

/* Start and stop watching the door; a missing one, and one in that state already, are allowed. */
void engine_watch_door(engine *e);
void engine_unwatch_door(engine *e);

/* Reads the door, and gives nodes to those who wait. */
void engine_look_at_door(engine *e);

/* Takes the nodes of guests off the bus whose clients have gone. */
void engine_see_guests_off(engine *e);

/* ---- orders.c -------------------------------------------------------------------------------- */

/* Does what the controllers of nodes have ordered. The bus has been advanced to the present. */
void engine_obey(engine *e);

/* ---- ownership.c ----------------------------------------------------------------------------- */

/* Does the settings that the controller of a node asks for, all or none; an empty text has none.
 * Returns false after logging the reason, which is in *problem, too. */
bool engine_set_or_say(engine *e, unsigned node, const char *text,
                       char problem[SETTINGS_ERROR_MAX]);

/* Sets again what the controller of a node has set, after a reload. */
void engine_keep_settings(engine *e, unsigned node);

/* Tells the controller of a node its state, when an event has come. */
void engine_tell_state(const engine *e, unsigned node, const cw_event *event);

/* After an event: lets the controller know when its node has no more frames. */
void engine_settle(const engine *e, unsigned node, const cw_event *event);

/* ---- go_over.c ------------------------------------------------------------------------------- */

/* Advances bit by bit to the present, until a frame ends or the time of this wake-up does. A
 * pending configuration takes over at that end of a frame. */
void engine_run_to_boundary(engine *e, uint64_t now);

/* ---- go.c ------------------------------------------------------------------------------------ */

/* Advances to a tick, which has passed, in slices. Returns false when the time of this wake-up ends
 * before. */
bool engine_go(engine *e, uint64_t now);

/* Advances bit by bit to the present, so that the bus stops at the end of the frame. On a machine
 * that is too slow the clock ends it. */
void engine_run_out(engine *e, uint64_t now);

/* ---- virtual.c ------------------------------------------------------------------------------- */

/* Gives an engine virtual time. Returns false after logging the reason. */
bool engine_open_virtual(engine *e);

/* Lets programs come. */
void engine_begin_virtual(engine *e);

void engine_close_virtual(engine *e);

void engine_report_virtual(const engine *e, report *out);

/* ---- engine.c -------------------------------------------------------------------------------- */

/* Makes an engine with its ports, which do not wake it yet. Returns NULL after logging the
 * reason. */
engine *engine_open(struct ev_loop *loop, live *config);

/* Lets ports wake it, and arms the timer. Bus time has begun. */
void engine_begin(engine *e);

/* Skips time, of which frames of ports have waited for `excess`. */
void engine_skip(engine *e, uint64_t skipped_ns, uint64_t excess);

/* Returns true when a readable port is to wake its bus. With `tick` ports are read once a tick from
 * now on, until a tick has no frame. */
bool engine_port_wakes(engine *e, int events);
void engine_stop_ticking(engine *e);

#endif
