/* SPDX-License-Identifier: MIT
 *
 * lookout.c - looks now and then if a file could be written that is to be made later.
 */
#include "base/file/lookout.h"

#include "base/file/spool.h"
#include "base/thread.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define CALLS 5      /* of lookout_look() for a look */
#define PATIENCE_S 5 /* then the disk does not answer */

struct lookout {
    char *file;
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t changed;
    unsigned calls;
    bool looks; /* or is about to */
    bool ending;
    struct timespec late; /* when a look should be over */
    int error;
};

static void free_lookout(lookout *l)
{
    (void)pthread_cond_destroy(&l->changed);
    (void)pthread_mutex_destroy(&l->lock);
    free(l->file);
    free(l);
}

/* Looks as often as it is wanted, and frees all at the end. */
static void *lookout_run(void *user)
{
    lookout *l = user;
    (void)pthread_mutex_lock(&l->lock);
    while (!l->ending) {
        if (!l->looks) {
            (void)pthread_cond_wait(&l->changed, &l->lock);
            continue;
        }
        (void)pthread_mutex_unlock(&l->lock);
        const int error = spool_probe_room(l->file);
        (void)pthread_mutex_lock(&l->lock);
        l->error = error;
        l->looks = false;
    }
    (void)pthread_mutex_unlock(&l->lock);
    free_lookout(l);
    return NULL;
}

lookout *lookout_start(const char *file, int error)
{
    lookout *l = calloc(1, sizeof *l);
    if (!l)
        return NULL;
    l->file = strdup(file);
    l->error = error;
    (void)pthread_mutex_init(&l->lock, NULL);
    thread_init_condition(&l->changed);
    const int why = l->file ? thread_start_alone(lookout_run, l) : ENOMEM;
    if (why == 0)
        return l;
    free_lookout(l);
    errno = why;
    return NULL;
}

int lookout_look(lookout *l)
{
    if (!l)
        return 0;
    (void)pthread_mutex_lock(&l->lock);
    if (!l->looks && l->calls++ % CALLS == 0) {
        l->looks = true;
        l->late = thread_in_seconds(PATIENCE_S);
        (void)pthread_cond_signal(&l->changed);
    }
    const int error = l->looks && thread_is_past(&l->late) ? ETIMEDOUT : l->error;
    (void)pthread_mutex_unlock(&l->lock);
    return error;
}

void lookout_end(lookout *l)
{
    if (!l)
        return;
    (void)pthread_mutex_lock(&l->lock);
    l->ending = true;
    (void)pthread_cond_signal(&l->changed);
    (void)pthread_mutex_unlock(&l->lock);
}
