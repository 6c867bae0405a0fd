/* SPDX-License-Identifier: MIT
 *
 * turns.h - the order in which programs run in virtual time: one at a time, until it waits.
 *
 * At each moment the programs that have waited for it have a turn. They have it in the order of
 * their nodes, then of their words, then of their coming. One that is ready again at the same
 * moment has its next turn when all have had theirs. Time goes on when nobody is ready, and holds
 * while somebody runs. All times are bus time in ns. No system calls are made here.
 */
#ifndef CANWIRE_ENGINE_TURNS_H
#define CANWIRE_ENGINE_TURNS_H

#include "port/timing.h"

#include <stdbool.h>
#include <stddef.h>

#define TURNS_MAX 64u
#define TURNS_NONE TURNS_MAX

typedef enum turn_state {
    TURN_NONE = 0, /* the place is free */
    TURN_RUNS,
    TURN_WAITS,
    TURN_CHILDREN, /* it waits for a child; time holds while no descendant has joined */
    TURN_ENDS      /* its connection has ended, but it may come again: exec() */
} turn_state;

typedef struct turn {
    turn_state state;
    unsigned node;
    uint32_t came; /* number of its coming */
    int pid;
    int ancestors[TIMING_ANCESTORS];
    char program[TIMING_PROGRAM_BYTES];
    int64_t until_ns;    /* it waits until then ... */
    unsigned wants;      /* ... or until a port has told it one of these: PORT_TOLD_* */
    bool ready;          /* it has its turn as soon as possible */
} turn;

/* Starts all zero. */
typedef struct turns {
    turn all[TURNS_MAX];
    unsigned count;
    uint32_t came;
    bool round;        /* somebody has had a turn at this moment, in this round ... */
    turn last;         /* ... the one that was last */
} turns;

/* Adds a program, which is ready. Returns its place, or TURNS_NONE when there are TURNS_MAX. */
unsigned turns_add(turns *t, unsigned node, const timing_join *join);

void turns_remove(turns *t, unsigned place);

/* The program waits. wants: PORT_TOLD_*. */
void turns_wait(turns *t, unsigned place, int64_t until_ns, unsigned wants);
void turns_wait_for_children(turns *t, unsigned place);

/* It wants its turn, whatever it waits for. */
void turns_cancel(turns *t, unsigned place);

/* A port has told a process something (PORT_TOLD_*); 0: some process. All programs with this
 * process among their ancestors, or among whose ancestors it is, may have its sockets. */
void turns_told(turns *t, int pid, unsigned what);

/* Returns true when nobody runs: time may go on, or a turn begin. */
bool turns_all_wait(const turns *t);

/* Returns the program whose turn is next, TURNS_NONE when nobody is ready. It runs from now on. */
unsigned turns_begin(turns *t, int64_t now_ns);

/* Returns when the first program wakes up by itself, TIMING_NEVER: none does. */
int64_t turns_next_ns(const turns *t);

/* Time has gone on: a new round begins. */
void turns_go_on(turns *t);

#endif
