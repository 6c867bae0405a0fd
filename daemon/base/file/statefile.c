/* SPDX-License-Identifier: MIT
 *
 * statefile.c - a small file with the present state of something, replaced as a whole.
 */
#include "base/file/statefile.h"

#include "base/thread.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define MODE 0640
#define PATIENCE_S 5.0    /* of those that wait for a state */
#define END_PATIENCE_S 1u /* of the end */

struct statefile {
    struct ev_loop *loop;
    int folder;
    const char *name;
    const char *next;
    statefile_written *written;
    void *user;
    ev_async wakeup;
    ev_timer patience;
    uint64_t told;        /* up to this state */
    pthread_t thread;
    bool has_thread;
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t change;
    char *text;           /* of the state that is put */
    uint64_t put;
    uint64_t done;        /* is in the file, or has failed: */
    int error;
    bool touch;
    bool ending;
};

/* ---- The thread ------------------------------------------------------------------------------ */

/* Sets the times of the file to CLOCK_REALTIME. Those that the kernel sets are a little behind
 * it. */
static void stamp_now(int fd)
{
    struct timespec times[2] = {{.tv_sec = 0}};
    (void)clock_gettime(CLOCK_REALTIME, &times[0]);
    times[1] = times[0];
    (void)futimens(fd, times);
}

/* Writes all of the text, and goes on after a signal. Returns false with errno. */
static bool write_all(int fd, const char *text)
{
    for (size_t left = strlen(text); left > 0;) {
        const ssize_t count = write(fd, text, left);
        if (count < 0 && errno != EINTR)
            return false;
        text += count > 0 ? count : 0;
        left -= count > 0 ? (size_t)count : 0;
    }
    return true;
}

/* Makes the file anew: what has its name may be of somebody else. Returns 0 or an errno. */
static int replace_file(const statefile *s, const char *text)
{
    if (unlinkat(s->folder, s->next, 0) != 0 && errno != ENOENT)
        return errno;
    const int fd = openat(s->folder, s->next,
                          O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, MODE);
    if (fd < 0)
        return errno;
    int error = write_all(fd, text) ? 0 : errno;
    stamp_now(fd);
    if (close(fd) != 0 && error == 0)
        error = errno;
    if (error == 0 && renameat(s->folder, s->next, s->folder, s->name) != 0)
        error = errno;
    if (error != 0)
        (void)unlinkat(s->folder, s->next, 0);
    return error;
}

static int write_state(const statefile *s, const char *text)
{
    if (text)
        return replace_file(s, text);
    return unlinkat(s->folder, s->name, 0) == 0 || errno == ENOENT ? 0 : errno;
}

/* Shows that the state is still the same. A file that is missing stays so: the next state makes
 * it. */
static void touch_file(const statefile *s)
{
    const int fd = openat(s->folder, s->name, O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return;
    stamp_now(fd);
    (void)close(fd);
}

/* Does what there is to do, without the lock. */
static void statefile_work(statefile *s)
{
    char *text = s->text;
    const uint64_t number = s->put;
    const bool is_state = number > s->done;
    s->text = NULL;
    s->touch = false;
    (void)pthread_mutex_unlock(&s->lock);
    const int error = is_state ? write_state(s, text) : 0;
    if (!is_state)
        touch_file(s);
    free(text);
    (void)pthread_mutex_lock(&s->lock);
    if (!is_state)
        return;
    s->done = number;
    s->error = error;
    (void)pthread_cond_broadcast(&s->change);
    if (!s->ending)
        ev_async_send(s->loop, &s->wakeup); /* under the lock: the loop still exists */
}

/* The thread: writes the last state that was put. Earlier ones that it has missed are never
 * written. */
static void *statefile_run(void *user)
{
    statefile *s = user;
    (void)pthread_mutex_lock(&s->lock);
    while (!s->ending || s->put > s->done) {
        if (s->put > s->done || s->touch)
            statefile_work(s);
        else
            (void)pthread_cond_wait(&s->change, &s->lock);
    }
    (void)pthread_mutex_unlock(&s->lock);
    return NULL;
}

/* ---- The loop -------------------------------------------------------------------------------- */

/* Tells the loop of the last state that is done, once. */
static void tell_written(statefile *s, uint64_t number, int error)
{
    if (number <= s->told)
        return;
    s->told = number;
    s->written(s->user, number, error);
}

/* The thread has done something. While there is more, the limit of time begins anew. */
static void on_wakeup(struct ev_loop *loop, ev_async *wakeup, int events)
{
    (void)events;
    statefile *s = wakeup->data;
    (void)pthread_mutex_lock(&s->lock);
    const uint64_t done = s->done;
    const int error = s->error;
    const bool over = done == s->put;
    (void)pthread_mutex_unlock(&s->lock);
    ev_timer_stop(loop, &s->patience);
    if (!over) {
        ev_timer_set(&s->patience, PATIENCE_S, 0.0); /* the disk answers */
        ev_timer_start(loop, &s->patience);
    }
    tell_written(s, done, error);
}

/* Gives up for those that wait. The thread goes on. */
static void on_patience(struct ev_loop *loop, ev_timer *patience, int events)
{
    (void)loop;
    (void)events;
    statefile *s = patience->data;
    (void)pthread_mutex_lock(&s->lock);
    const uint64_t put = s->put;
    (void)pthread_mutex_unlock(&s->lock);
    tell_written(s, put, ETIMEDOUT);
}

statefile *statefile_new(struct ev_loop *loop, int folder, const char *name, const char *next,
                         statefile_written *written, void *user)
{
    statefile *s = calloc(1, sizeof *s);
    if (!s)
        return NULL;
    *s = (statefile){.loop = loop, .folder = folder, .name = name, .next = next,
                     .written = written, .user = user};
    (void)pthread_mutex_init(&s->lock, NULL);
    thread_init_condition(&s->change);
    ev_async_init(&s->wakeup, on_wakeup);
    ev_timer_init(&s->patience, on_patience, PATIENCE_S, 0.0);
    s->wakeup.data = s->patience.data = s;
    return s;
}

/* The first state starts the thread: most buses have none. */
static bool start_thread(statefile *s)
{
    const int error = s->has_thread ? 0 : thread_start(&s->thread, statefile_run, s);
    errno = error;
    if (error == 0 && !s->has_thread) {
        s->has_thread = true;
        ev_async_start(s->loop, &s->wakeup);
    }
    return error == 0;
}

uint64_t statefile_put(statefile *s, char *text)
{
    if (!start_thread(s)) {
        free(text);
        return 0;
    }
    (void)pthread_mutex_lock(&s->lock);
    free(s->text);
    s->text = text;
    const uint64_t number = ++s->put;
    (void)pthread_cond_broadcast(&s->change);
    (void)pthread_mutex_unlock(&s->lock);
    if (!ev_is_active(&s->patience)) {
        ev_timer_set(&s->patience, PATIENCE_S, 0.0);
        ev_timer_start(s->loop, &s->patience);
    }
    return number;
}

void statefile_touch(statefile *s)
{
    if (!s->has_thread)
        return;
    (void)pthread_mutex_lock(&s->lock);
    s->touch = true;
    (void)pthread_cond_broadcast(&s->change);
    (void)pthread_mutex_unlock(&s->lock);
}

static void stop_watchers(statefile *s)
{
    ev_timer_stop(s->loop, &s->patience);
    ev_async_stop(s->loop, &s->wakeup);
}

/* Frees all of it. The thread must have ended, or never have been started. */
static void free_statefile(statefile *s)
{
    (void)pthread_cond_destroy(&s->change);
    (void)pthread_mutex_destroy(&s->lock);
    free(s->text);
    free(s);
}

int statefile_close(statefile *s)
{
    const struct timespec until = thread_in_seconds(END_PATIENCE_S);
    int error = 0;
    stop_watchers(s);
    (void)pthread_mutex_lock(&s->lock);
    s->ending = true;
    (void)pthread_cond_broadcast(&s->change);
    (void)pthread_mutex_unlock(&s->lock);
    if (s->has_thread)
        error = pthread_clockjoin_np(s->thread, NULL, CLOCK_MONOTONIC, &until);
    if (error != 0) {
        (void)pthread_detach(s->thread);
        return ETIMEDOUT;
    }
    error = s->error;
    free_statefile(s);
    return error;
}
