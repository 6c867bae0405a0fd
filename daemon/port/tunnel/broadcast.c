/* SPDX-License-Identifier: MIT
 *
 * broadcast.c - frames that are sent again and again, and frames that are received by their
 * identifier.
 */
#include "port/tunnel/broadcast.h"

#include <stdlib.h>
#include <string.h>

#define ROOM_FIRST 8u

void broadcast_free(broadcast *b)
{
    free(b->jobs);
    free(b->subscriptions);
    *b = (broadcast){.jobs = NULL};
}

/* Makes room for one more element at powers of two. Returns NULL when there are too many. */
static void *broadcast_grow(void *elements, size_t count, size_t size)
{
    if (count >= BROADCAST_MAX)
        return NULL;
    if (count > 0 && (count < ROOM_FIRST || (count & (count - 1)) != 0))
        return elements;
    return realloc(elements, (count < ROOM_FIRST ? ROOM_FIRST : 2 * count) * size);
}

static void remove_at(void *elements, size_t *count, size_t i, size_t size)
{
    unsigned char *bytes = elements;
    (*count)--;
    memmove(bytes + i * size, bytes + (i + 1) * size, (*count - i) * size);
}

/* ---- Jobs ------------------------------------------------------------------------------------ */

/* Returns the job with this identifier, of which there is one; NULL: none. */
static broadcast_job *find_job(const broadcast *b, canid_t id)
{
    for (size_t i = 0; i < b->job_count; i++)
        if (b->jobs[i].frame.can_id == id)
            return &b->jobs[i];
    return NULL;
}

bool broadcast_add(broadcast *b, const struct can_frame *frame, int64_t interval_ns,
                   int64_t now_ns)
{
    broadcast_job *job = find_job(b, frame->can_id);
    if (!job) {
        broadcast_job *jobs = broadcast_grow(b->jobs, b->job_count, sizeof *jobs);
        if (!jobs)
            return false;
        b->jobs = jobs;
        job = &jobs[b->job_count++];
    }
    if (interval_ns > 0 && interval_ns < BROADCAST_LEAST_NS)
        interval_ns = BROADCAST_LEAST_NS;
    *job = (broadcast_job){.frame = *frame, .interval_ns = interval_ns};
    job->next_ns = interval_ns > 0 ? now_ns + interval_ns : 0;
    return true;
}

bool broadcast_update(broadcast *b, const struct can_frame *frame)
{
    broadcast_job *job = find_job(b, frame->can_id);
    if (job)
        job->frame = *frame;
    return job != NULL;
}

/* Ends a job. Returns false when there is none. */
bool broadcast_delete(broadcast *b, canid_t id)
{
    const broadcast_job *job = find_job(b, id);
    if (job)
        remove_at(b->jobs, &b->job_count, (size_t)(job - b->jobs), sizeof *job);
    return job != NULL;
}

/* A job that is late by more than its interval leaves frames out, as timers of the kernel do. */
bool broadcast_due(broadcast *b, struct can_frame *frame, int64_t now_ns, int64_t *late_ns)
{
    broadcast_job *first = NULL;
    for (size_t i = 0; i < b->job_count; i++)
        if (b->jobs[i].next_ns != 0 && (!first || b->jobs[i].next_ns < first->next_ns))
            first = &b->jobs[i];
    if (!first || first->next_ns > now_ns)
        return false;
    *frame = first->frame;
    *late_ns = now_ns - first->next_ns;
    first->next_ns += (*late_ns / first->interval_ns + 1) * first->interval_ns;
    return true;
}

/* ---- Subscriptions --------------------------------------------------------------------------- */

/* Returns the subscription to this identifier, of which there is one; NULL: none. */
static broadcast_subscription *find_subscription(const broadcast *b, canid_t id)
{
    for (size_t i = 0; i < b->subscription_count; i++)
        if (b->subscriptions[i].id == id)
            return &b->subscriptions[i];
    return NULL;
}

bool broadcast_subscribe(broadcast *b, canid_t id, const uint8_t mask[CAN_MAX_DLEN],
                         int64_t interval_ns)
{
    broadcast_subscription *s = find_subscription(b, id);
    if (!s) {
        broadcast_subscription *all =
            broadcast_grow(b->subscriptions, b->subscription_count, sizeof *all);
        if (!all)
            return false;
        b->subscriptions = all;
        s = &all[b->subscription_count++];
    }
    *s = (broadcast_subscription){
        .id = id, .by_content = mask != NULL, .interval_ns = interval_ns};
    if (mask)
        memcpy(s->mask, mask, sizeof s->mask);
    return true;
}

/* Ends a subscription. Returns false when there is none. */
bool broadcast_unsubscribe(broadcast *b, canid_t id)
{
    const broadcast_subscription *s = find_subscription(b, id);
    if (s)
        remove_at(b->subscriptions, &b->subscription_count, (size_t)(s - b->subscriptions),
                  sizeof *s);
    return s != NULL;
}

bool broadcast_wants(const broadcast *b, canid_t id)
{
    return find_subscription(b, id) != NULL;
}

/* Returns true when bits of the mask differ from the frame before, or when there was none. A
 * subscription without a mask takes each frame. */
static bool has_changed(const broadcast_subscription *s, const struct can_frame *frame)
{
    if (!s->by_content || !s->received)
        return true;
    for (unsigned i = 0; i < CAN_MAX_DLEN; i++)
        if ((frame->data[i] ^ s->last[i]) & s->mask[i])
            return true;
    return false;
}

bool broadcast_passes(broadcast *b, const struct can_frame *frame, int64_t realtime_ns,
                      int64_t now_ns)
{
    broadcast_subscription *s = find_subscription(b, frame->can_id);
    if (!s || !has_changed(s, frame))
        return false;
    s->received = true;
    memcpy(s->last, frame->data, sizeof s->last);
    if (now_ns >= s->free_ns && !s->held) {
        s->free_ns = now_ns + s->interval_ns;
        return true;
    }
    s->held = true;
    s->frame = *frame;
    s->realtime_ns = realtime_ns;
    return false;
}

bool broadcast_held(broadcast *b, struct can_frame *frame, int64_t *realtime_ns, int64_t now_ns)
{
    for (size_t i = 0; i < b->subscription_count; i++) {
        broadcast_subscription *s = &b->subscriptions[i];
        if (!s->held || s->free_ns > now_ns)
            continue;
        s->held = false;
        s->free_ns = now_ns + s->interval_ns;
        *frame = s->frame;
        *realtime_ns = s->realtime_ns;
        return true;
    }
    return false;
}

/* ---- Time ------------------------------------------------------------------------------------ */

static void note_earlier(int64_t *next_ns, int64_t ns)
{
    if (ns != 0 && (*next_ns == 0 || ns < *next_ns))
        *next_ns = ns;
}

int64_t broadcast_next_ns(const broadcast *b)
{
    int64_t next_ns = 0;
    for (size_t i = 0; i < b->job_count; i++)
        note_earlier(&next_ns, b->jobs[i].next_ns);
    for (size_t i = 0; i < b->subscription_count; i++)
        note_earlier(&next_ns, b->subscriptions[i].held ? b->subscriptions[i].free_ns : 0);
    return next_ns;
}
