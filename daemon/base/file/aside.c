/* SPDX-License-Identifier: MIT
 *
 * aside.c - runs a task that may hang, such as reading a file of a network, beside the bus.
 */
#include "base/file/aside.h"

#include "base/thread.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

struct aside {
    struct ev_loop *loop;
    const aside_calls *calls;
    void *task;
    void *user;
    ev_async wakeup;
    ev_timer limit;
    pthread_mutex_t lock; /* of all below */
    clockid_t clock; /* processor time that the thread has used; valid while it works */
    bool working;
    bool ready;
    bool left; /* the caller has left: the thread frees all */
};

static atomic_uint left_alone;

static void free_aside(aside *a)
{
    (void)pthread_mutex_destroy(&a->lock);
    free(a);
}

/* The thread. When the caller has left meanwhile, the task is the thread's to drop. */
static void *aside_run(void *argument)
{
    aside *a = argument;
    (void)pthread_mutex_lock(&a->lock);
    a->working = pthread_getcpuclockid(pthread_self(), &a->clock) == 0;
    (void)pthread_mutex_unlock(&a->lock);
    a->calls->work(a->task);
    (void)pthread_mutex_lock(&a->lock);
    a->working = false;
    const bool left = a->left;
    a->ready = true;
    if (!left)
        ev_async_send(a->loop, &a->wakeup); /* under the lock: the loop still exists */
    (void)pthread_mutex_unlock(&a->lock);
    if (!left)
        return NULL;
    a->calls->drop(a->task);
    free_aside(a);
    left_alone--;
    return NULL;
}

static void stop_watchers(aside *a)
{
    ev_async_stop(a->loop, &a->wakeup);
    ev_timer_stop(a->loop, &a->limit);
}

/* Takes the lock once more, so that the thread no longer holds it. */
static void on_wakeup(struct ev_loop *loop, ev_async *wakeup, int events)
{
    (void)loop;
    (void)events;
    aside *a = wakeup->data;
    const aside_calls *calls = a->calls;
    void *user = a->user;
    void *task = a->task;
    (void)pthread_mutex_lock(&a->lock);
    (void)pthread_mutex_unlock(&a->lock);
    stop_watchers(a);
    free_aside(a);
    calls->done(user, task);
}

/* Returns the processor time of the task, which tells one that works from one that hangs. */
static double busy_seconds(aside *a)
{
    struct timespec busy = {.tv_sec = 0};
    (void)pthread_mutex_lock(&a->lock);
    if (a->working && clock_gettime(a->clock, &busy) != 0)
        busy = (struct timespec){.tv_sec = 0};
    (void)pthread_mutex_unlock(&a->lock);
    return (double)busy.tv_sec + (double)busy.tv_nsec * 1e-9;
}

/* The time is over. The caller goes on without the task, whose thread may hang for ever. */
static void on_limit(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    aside *a = timer->data;
    const aside_calls *calls = a->calls;
    void *user = a->user;
    const double busy_s = busy_seconds(a);
    aside_leave(a);
    calls->late(user, busy_s);
}

aside *aside_start(struct ev_loop *loop, const aside_calls *calls, void *task, void *user,
                   double limit_s)
{
    aside *a = calloc(1, sizeof *a);
    if (!a)
        return NULL;
    *a = (aside){.loop = loop, .calls = calls, .task = task, .user = user};
    (void)pthread_mutex_init(&a->lock, NULL);
    ev_async_init(&a->wakeup, on_wakeup);
    ev_now_update(loop); /* else the limit would begin at the start of a long callback */
    ev_timer_init(&a->limit, on_limit, limit_s, 0.0);
    a->wakeup.data = a;
    a->limit.data = a;
    ev_async_start(loop, &a->wakeup);
    ev_timer_start(loop, &a->limit);
    int error = thread_start_alone(aside_run, a);
    if (error == 0)
        return a;
    stop_watchers(a);
    free_aside(a);
    errno = error;
    return NULL;
}

void aside_leave(aside *a)
{
    if (!a)
        return;
    stop_watchers(a);
    (void)pthread_mutex_lock(&a->lock);
    const bool ready = a->ready; /* the thread has left the task to the loop */
    a->left = true;
    if (!ready)
        left_alone++;
    (void)pthread_mutex_unlock(&a->lock);
    if (!ready)
        return;
    a->calls->drop(a->task);
    free_aside(a);
}

unsigned aside_left(void)
{
    return left_alone;
}
