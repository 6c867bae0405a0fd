/* SPDX-License-Identifier: MIT
 *
 * aside.h - runs a task that may hang, such as reading a file of a network, beside the bus.
 *
 * The task runs in a thread of its own, for a limited time. A thread that hangs in the kernel
 * cannot be ended: it is left alone, and a late result is discarded. Nothing waits for such a
 * thread, not even the end of the process.
 */
#ifndef CANWIRE_BASE_ASIDE_H
#define CANWIRE_BASE_ASIDE_H

#include <ev.h>

typedef struct aside aside;

typedef struct aside_calls {
    void (*work)(void *task); /* in the thread; touches nothing but the task */
    void (*drop)(void *task); /* frees a task that the caller has left; in the thread */
    void (*done)(void *user, void *task); /* in the loop; the task is the caller's again */
    /* Runs in the loop when the limit has passed; the thread keeps the task. The thread has used
     * busy_s seconds of a processor. */
    void (*late)(void *user, double busy_s);
} aside_calls;

/* Starts a task. The calls must live longer. Returns NULL, with errno, without memory or a thread;
 * the caller then keeps the task. The aside is freed after done() and late(). */
aside *aside_start(struct ev_loop *loop, const aside_calls *calls, void *task, void *user,
                   double limit_s);

/* Leaves the task to the thread; neither done() nor late() is called. NULL is allowed. */
void aside_leave(aside *a);

/* Returns the number of threads that were left alone and have not come back. */
unsigned aside_left(void);

#endif
