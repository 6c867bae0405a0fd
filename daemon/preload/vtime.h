/* SPDX-License-Identifier: MIT
 *
 * vtime.h - the virtual time of a program: that of a bus, which goes on only while programs wait.
 *
 * The library is the program's connection to the bus's socket of time (port/timing.h). A call that
 * would block ends the program's turn, and returns with its next one. Times are bus time in ns.
 */
#ifndef CANWIRE_PRELOAD_VTIME_H
#define CANWIRE_PRELOAD_VTIME_H

#include "port/timing.h"

#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <time.h>

#define VTIME_VARIABLE "CANWIRE_VIRTUAL" /* PID, a tab, NODE, a tab, PATH of the socket of time */
#define VTIME_NEVER TIMING_NEVER

/* Other descriptors for which a call waits, and signals. */
typedef struct vtime_wait {
    int64_t until_ns;
    unsigned wants;       /* TIMING_MESSAGES, TIMING_ROOM */
    struct pollfd *fds;   /* that no bus feeds; they end the wait, too */
    nfds_t count;
    const sigset_t *mask; /* meanwhile; NULL: that of the thread */
    bool restarts;        /* signals whose handlers have SA_RESTART do not end it */
} vtime_wait;

/* Reads the variable; a program that canwire run has started waits for its first turn. */
void vtime_begin(void);

/* Returns true for a program in virtual time. It joins with the first call. */
bool vtime_is_on(void);

int64_t vtime_now_ns(void);

/* Returns true while the program has its turn. */
bool vtime_has_turn(void);

/* Ends the turn for a call and for what the library itself waits for: a time, and wants. Returns
 * with the next turn: 0, or EINTR when a signal was handled. *turned: there was another turn. */
int vtime_turn(const vtime_wait *wait, const vtime_wait *own, bool *turned);

/* The turn ends while a child runs, and begins again. */
void vtime_leave_to_children(void);
void vtime_come_back(void);

/* fork(): the child has a connection of its own, made before. */
void vtime_fork_prepare(void);
void vtime_fork_parent(void);
void vtime_fork_child(void);

/* Returns a time of one of the clocks as bus time, and the other way round. */
int64_t vtime_of(clockid_t clock, int64_t ns);
int64_t vtime_on(clockid_t clock, int64_t bus_ns);

/* ---- vtime_wait.c ---------------------------------------------------------------------------- */

/* Counts a look at the clock, or a call that finds nothing. A program that only looks would stop
 * time for ever: after VTIME_LOOKS in a row each one takes VTIME_LOOK_NS. */
#define VTIME_LOOKS 100u
#define VTIME_LOOK_NS INT64_C(10000)
void vtime_look(void);

/* Ends the turn, and returns with the next one: 0, or EINTR when a signal was handled. Without the
 * time or message that the call waits for, it is for the caller to wait again. */
int vtime_wait_for(const vtime_wait *wait);

/* Waits until a time. Returns 0 or EINTR. */
int vtime_sleep(int64_t until_ns);

#endif
