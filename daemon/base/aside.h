/* SPDX-License-Identifier: MIT
 *
 * aside.h - has something done beside the bus that may hang, as reading a file of a network may.
 *
 * It is done in a thread of its own, for a limited time. A thread that hangs in the kernel cannot
 * be ended: it is left alone, and when it comes back after all, what it brings is thrown away.
 * Nobody waits for it, not even the end of the process.
 */
#ifndef CANWIRE_BASE_ASIDE_H
#define CANWIRE_BASE_ASIDE_H

#include <ev.h>

typedef struct aside aside;

typedef struct aside_calls {
    void (*work)(void *task); /* in the thread; touches nothing but the task */
    void (*drop)(void *task); /* frees a task that nobody waits for any more; in the thread */
    void (*done)(void *user, void *task); /* in the loop; the task is the caller's again */
    /* In the loop: the time is over, the task is left to the thread, which has kept a processor
     * busy for so long. */
    void (*late)(void *user, double busy_s);
} aside_calls;

/* Begins it. The calls must live longer. NULL when there is no memory or thread (errno); the task
 * is then still the caller's. After done() and late() it is no more. */
aside *aside_start(struct ev_loop *loop, const aside_calls *calls, void *task, void *user,
                   double limit_s);

/* Leaves the task to the thread; neither done() nor late() is called. NULL is fine. */
void aside_leave(aside *a);

/* Threads that were left alone and have not come back. */
unsigned aside_left(void);

#endif
