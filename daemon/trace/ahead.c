/* SPDX-License-Identifier: MIT
 *
 * ahead.c - reads a recording ahead in a thread, for a bus that must not wait for a disk.
 */
#include "trace/ahead.h"

#include "base/thread.h"

#include <stdlib.h>

#define PIECE 64u /* entries that are read before the lock is taken for them */

typedef struct item {
    trace_result result;
    uint64_t position;
    trace_record record;
} item;

struct trace_ahead {
    trace_reader *reader; /* of the thread */
    bool again;
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t changed;
    bool closed; /* the caller takes no more entries */
    bool ended;  /* the thread reads no more */
    unsigned first;
    unsigned count;
    item items[TRACE_AHEAD_ENTRIES];
};

/* The thread must have ended, or never have been started: it uses the reader. */
static void free_ahead(trace_ahead *a)
{
    trace_close(a->reader);
    (void)pthread_cond_destroy(&a->changed);
    (void)pthread_mutex_destroy(&a->lock);
    free(a);
}

/* ---- The thread ------------------------------------------------------------------------------ */

/* Reads an entry. Returns true when more may follow. */
static bool read_item(trace_ahead *a, item *i)
{
    i->result = trace_next(a->reader, &i->record);
    i->position = trace_position(a->reader);
    return i->result == TRACE_RECORD || (i->result == TRACE_END && a->again);
}

/* Reads some entries, but none behind an end of the file, which may be small. */
static unsigned read_piece(trace_ahead *a, item items[PIECE], bool *more)
{
    unsigned count = 0;
    *more = true;
    while (*more && count < PIECE) {
        *more = read_item(a, &items[count++]);
        if (items[count - 1].result == TRACE_END)
            break;
    }
    if (*more && items[count - 1].result == TRACE_END && !trace_rewind(a->reader)) {
        items[count - 1].result = TRACE_BAD;
        *more = false;
    }
    return count;
}

/* Appends entries to the queue. Returns false when it is closed. The lock is held. */
static bool ahead_add(trace_ahead *a, const item *items, unsigned count)
{
    while (a->count + count > TRACE_AHEAD_ENTRIES && !a->closed)
        (void)pthread_cond_wait(&a->changed, &a->lock);
    for (unsigned i = 0; i < count && !a->closed; i++)
        a->items[(a->first + a->count++) % TRACE_AHEAD_ENTRIES] = items[i];
    return !a->closed;
}

/* The thread. If the caller has gone meanwhile, it frees all. */
static void *ahead_run(void *argument)
{
    trace_ahead *a = argument;
    item items[PIECE];
    bool more = true;
    bool wanted = true;
    while (more && wanted) {
        unsigned count = read_piece(a, items, &more);
        (void)pthread_mutex_lock(&a->lock);
        wanted = ahead_add(a, items, count);
        a->ended = !more || !wanted;
        (void)pthread_cond_broadcast(&a->changed);
        (void)pthread_mutex_unlock(&a->lock);
    }
    if (!wanted)
        free_ahead(a);
    return NULL;
}

/* ---- For other threads ----------------------------------------------------------------------- */

trace_ahead *trace_ahead_start(trace_reader *reader, bool again)
{
    trace_ahead *a = calloc(1, sizeof *a);
    if (!a)
        return NULL;
    a->again = again;
    (void)pthread_mutex_init(&a->lock, NULL);
    thread_init_condition(&a->changed);
    a->reader = reader;
    if (thread_start_alone(ahead_run, a) == 0)
        return a;
    a->reader = NULL;
    free_ahead(a);
    return NULL;
}

void trace_ahead_close(trace_ahead *a)
{
    if (!a)
        return;
    (void)pthread_mutex_lock(&a->lock);
    const bool ended = a->ended;
    a->closed = true;
    (void)pthread_cond_broadcast(&a->changed);
    (void)pthread_mutex_unlock(&a->lock);
    if (ended)
        free_ahead(a);
}

/* Reports room to the thread only when half of the queue is empty, since the thread then fills
 * it. */
trace_result trace_ahead_next(trace_ahead *a, trace_record *record, uint64_t *position)
{
    trace_result result = TRACE_LATER;
    (void)pthread_mutex_lock(&a->lock);
    if (a->count > 0) {
        const item *i = &a->items[a->first];
        result = i->result;
        *record = i->record;
        *position = i->position;
        a->first = (a->first + 1) % TRACE_AHEAD_ENTRIES;
        if (--a->count == TRACE_AHEAD_ENTRIES / 2)
            (void)pthread_cond_broadcast(&a->changed);
    } else if (a->ended) {
        result = TRACE_END;
    }
    (void)pthread_mutex_unlock(&a->lock);
    return result;
}

void trace_ahead_fill(trace_ahead *a)
{
    (void)pthread_mutex_lock(&a->lock);
    while (!a->ended && a->count + PIECE <= TRACE_AHEAD_ENTRIES)
        (void)pthread_cond_wait(&a->changed, &a->lock);
    (void)pthread_mutex_unlock(&a->lock);
}
