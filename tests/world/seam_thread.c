/* SPDX-License-Identifier: MIT
 *
 * seam_thread.c - threads are tasks of the world; locks and conditions hand the baton on.
 */
#include "seam.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#define THREADS_MAX 64

typedef struct start {
    void *(*run)(void *);
    void *argument;
    int task;
} start;

static struct {
    pthread_t thread;
    int task;
} threads[THREADS_MAX];

static void *run_task(void *argument)
{
    start s = *(start *)argument;
    free(argument);
    world_begin_task(s.task);
    void *result = s.run(s.argument);
    world_enter("the end of a thread");
    world_end_task();
    return result;
}

static void remember(pthread_t thread, int task)
{
    for (unsigned i = 0; i < THREADS_MAX; i++)
        if (threads[i].task == 0) {
            threads[i].thread = thread;
            threads[i].task = task + 1;
            return;
        }
    abort();
}

static int find_thread(pthread_t thread, bool forget)
{
    for (unsigned i = 0; i < THREADS_MAX; i++)
        if (threads[i].task != 0 && pthread_equal(threads[i].thread, thread)) {
            int task = threads[i].task - 1;
            if (forget)
                threads[i].task = 0;
            return task;
        }
    return -1;
}

SEAM(int, pthread_create, pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *),
     void *argument)
{
    if (!world_inside)
        return pthread_create(thread, attributes, run, argument);
    world_enter("pthread_create");
    if (seam_refuses(world->refuse_permille / 4, EAGAIN, "pthread_create"))
        return EAGAIN;
    start *s = malloc(sizeof *s);
    if (!s)
        return EAGAIN;
    *s = (start){.run = run, .argument = argument, .task = -1};
    s->task = world_add_task(world_me()->life, false);
    int task = s->task;
    int error = pthread_create(thread, attributes, run_task, s);
    if (error)
        abort();
    remember(*thread, task);
    world_trace("pthread_create");
    return 0;
}

static int join(pthread_t thread, void **result, int64_t until_ns)
{
    world_enter("pthread_join");
    world_task *t = &world->tasks[find_thread(thread, false)];
    while (t->state != TASK_DONE)
        if (!world_block(WAIT_TASK, t, until_ns, "pthread_join", NULL) && t->state != TASK_DONE)
            return ETIMEDOUT;
    (void)find_thread(thread, true);
    t->state = TASK_NONE;
    return pthread_join(thread, result);
}

SEAM(int, pthread_join, pthread_t thread, void **result)
{
    return world_inside ? join(thread, result, NEVER) : pthread_join(thread, result);
}

static int64_t to_monotonic(clockid_t clock, const struct timespec *t)
{
    int64_t ns = t->tv_sec * S + t->tv_nsec;
    return clock == CLOCK_REALTIME ? ns - world->realtime_ns : ns;
}

SEAM(int, pthread_clockjoin_np, pthread_t thread, void **result, clockid_t clock,
     const struct timespec *until)
{
    return world_inside ? join(thread, result, to_monotonic(clock, until))
                        : pthread_clockjoin_np(thread, result, clock, until);
}

/* A thread that is left to itself is forgotten; its task frees itself with the life. */
SEAM(int, pthread_detach, pthread_t thread)
{
    if (world_inside)
        (void)find_thread(thread, true);
    return pthread_detach(thread);
}

/* ---- Locks ----------------------------------------------------------------------------------- */

static void lock(pthread_mutex_t *mutex)
{
    while (pthread_mutex_trylock(mutex) != 0)
        (void)world_block(WAIT_LOCK, mutex, NEVER, "pthread_mutex_lock", NULL);
}

SEAM(int, pthread_mutex_lock, pthread_mutex_t *mutex)
{
    if (!world_inside)
        return pthread_mutex_lock(mutex);
    world_enter("pthread_mutex_lock");
    lock(mutex);
    return 0;
}

SEAM(int, pthread_mutex_unlock, pthread_mutex_t *mutex)
{
    int result = pthread_mutex_unlock(mutex);
    if (world_inside) {
        world_wake(world_me()->life, WAIT_LOCK, mutex, false);
        world_enter("pthread_mutex_unlock");
    }
    return result;
}

static bool wait_for(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t until_ns)
{
    world_charge(0);
    (void)pthread_mutex_unlock(mutex);
    world_wake(world_me()->life, WAIT_LOCK, mutex, false);
    bool woken = world_block(WAIT_LOCK, condition, until_ns, "pthread_cond_wait", NULL);
    lock(mutex);
    return woken;
}

SEAM(int, pthread_cond_wait, pthread_cond_t *condition, pthread_mutex_t *mutex)
{
    if (!world_inside)
        return pthread_cond_wait(condition, mutex);
    (void)wait_for(condition, mutex, NEVER);
    return 0;
}

/* All conditions of canwired go by CLOCK_MONOTONIC. */
SEAM(int, pthread_cond_timedwait, pthread_cond_t *condition, pthread_mutex_t *mutex,
     const struct timespec *until)
{
    if (!world_inside)
        return pthread_cond_timedwait(condition, mutex, until);
    int64_t until_ns = to_monotonic(CLOCK_MONOTONIC, until);
    if (world->now_ns >= until_ns)
        return ETIMEDOUT;
    return wait_for(condition, mutex, until_ns) ? 0 : ETIMEDOUT;
}

SEAM(int, pthread_cond_signal, pthread_cond_t *condition)
{
    if (!world_inside)
        return pthread_cond_signal(condition);
    world_wake(world_me()->life, WAIT_LOCK, condition, true);
    return 0;
}

SEAM(int, pthread_cond_broadcast, pthread_cond_t *condition)
{
    if (!world_inside)
        return pthread_cond_broadcast(condition);
    world_wake(world_me()->life, WAIT_LOCK, condition, false);
    return 0;
}

/* ---- Processes ------------------------------------------------------------------------------- */

#define FIRST_PID 4000

SEAM(pid_t, getpid, void)
{
    return world_inside ? FIRST_PID + world_me()->life : getpid();
}

SEAM(void, exit, int status)
{
    world_exit(status);
}
