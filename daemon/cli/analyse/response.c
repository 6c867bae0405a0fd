/* SPDX-License-Identifier: MIT
 *
 * response.c - worst-case response times of periodic messages on one CAN bus.
 */
#include "cli/analyse/response.h"

#define ERROR_BITS 31u /* the longest error frame, with the intermission */
#define ROUNDS_MAX 64u /* of delays of fifo nodes, which depend on each other */
#define LIMIT_TICKS ((uint64_t)CW_CLOCK_HZ * 600) /* of a busy period */

uint32_t response_key(const cw_frame *frame)
{
    const bool extended = frame->flags & CW_FRAME_EXTENDED;
    const uint32_t remote = (frame->flags & CW_FRAME_REMOTE) != 0;
    const uint32_t base = extended ? frame->id >> 18 : frame->id;
    const uint32_t low = extended ? frame->id & 0x3FFFF : 0;

    return base << 20 | (uint32_t)extended << 19 | low << 1 | remote;
}

/* Returns the messages of a kind that come in a time, at most. */
static uint64_t arrivals(const response_message *m, uint64_t time)
{
    const uint64_t window = time + m->jitter + m->delay;
    return m->period == CW_NEVER ? 1 : (window + m->period - 1) / m->period;
}

/* The message that a message waits for has a lower key, or is one of the same fifo node. */
typedef struct view {
    const response_bus *bus;
    const response_message *self;
    uint32_t key; /* its own, or the highest of its fifo node */
} view;

static bool same_fifo(const response_message *a, const response_message *b)
{
    return a->fifo && a->node == b->node;
}

/* Returns how others delay a message. In a FIFO it may wait behind a frame of its own node that has
 * a lower priority, so the lowest one counts. */
static view view_of(const response_bus *bus, const response_message *self)
{
    view v = {.bus = bus, .self = self, .key = self->key};
    for (size_t i = 0; i < bus->count; i++) {
        const response_message *m = &bus->messages[i];
        if (same_fifo(self, m) && m->key > v.key)
            v.key = m->key;
    }
    return v;
}

static bool goes_before(const view *v, const response_message *m)
{
    return m != v->self && (m->key <= v->key || same_fifo(v->self, m));
}

/* Returns the time that errors take in a time: each an error frame, and the longest frame that may
 * have to be repeated. */
static uint64_t time_of_errors(const view *v, uint64_t time)
{
    uint64_t longest = v->self->length;
    if (v->bus->error_every == CW_NEVER && v->bus->errors == 0)
        return 0;
    for (size_t i = 0; i < v->bus->count; i++) {
        const response_message *m = &v->bus->messages[i];
        if (goes_before(v, m) && m->length > longest)
            longest = m->length;
    }
    const uint64_t every = v->bus->error_every;
    const uint64_t errors = every == CW_NEVER ? v->bus->errors : (time + every - 1) / every;
    return errors * (ERROR_BITS * v->bus->bit + longest);
}

/* Returns the longest frame that may have begun just before: a frame on the bus is not
 * interrupted. */
static uint64_t find_blocking(const view *v)
{
    uint64_t longest = 0;
    for (size_t i = 0; i < v->bus->count; i++) {
        const response_message *m = &v->bus->messages[i];
        if (m != v->self && !goes_before(v, m) && m->length > longest)
            longest = m->length;
    }
    return longest;
}

/* Returns the time that all messages before this one take, which come up to a moment. */
static uint64_t time_before(const view *v, uint64_t moment)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < v->bus->count; i++) {
        const response_message *m = &v->bus->messages[i];
        if (goes_before(v, m))
            sum += arrivals(m, moment) * m->length;
    }
    return sum;
}

/* Returns the length of the longest time in which frames of this priority or a higher one wait. */
static uint64_t find_busy_period(const view *v)
{
    const response_message *self = v->self;
    response_message own = *self;
    uint64_t busy = self->length, before = 0;
    own.delay = 0;
    while (busy != before && busy < LIMIT_TICKS) {
        before = busy;
        busy = self->blocking + time_of_errors(v, before) + time_before(v, before) +
               arrivals(&own, before) * self->length;
    }
    return busy;
}

/* Returns the time from the start of the busy period to the start of instance q. A frame that comes
 * within the first bit of it still takes part in arbitration, also one at its very end (M6). */
static uint64_t find_start(const view *v, uint64_t q)
{
    const response_message *self = v->self;
    uint64_t start = self->blocking + q * self->length, before = CW_NEVER;
    while (start != before && start < LIMIT_TICKS) {
        before = start;
        start = self->blocking + time_of_errors(v, before + self->length) + q * self->length +
                time_before(v, before + v->bus->bit + 1);
    }
    return start;
}

/* Returns the response time of instance q, from the start of its period. */
static uint64_t find_instance(const view *v, uint64_t q)
{
    const response_message *self = v->self;
    const uint64_t start = find_start(v, q);
    const uint64_t since = self->period == CW_NEVER ? 0 : q * self->period;
    return start >= LIMIT_TICKS ? CW_NEVER : self->jitter + start - since + self->length;
}

bool response_is_late(const response_message *m)
{
    if (m->slot) /* it promises its slot, and no more */
        return false;
    return m->response == CW_NEVER || (m->period != CW_NEVER && m->response > m->period);
}

/* Returns true when a frame of the same node may keep that of a slot from its first arbitration.
 * Slots of a node do not overlap. */
static bool has_rival(const view *v)
{
    for (size_t i = 0; i < v->bus->count; i++) {
        const response_message *m = &v->bus->messages[i];
        if (m->node == v->self->node && !m->slot && goes_before(v, m))
            return true;
    }
    return false;
}

/* The node takes part in arbitration a bit after the frame came, at the latest. */
static void find_slotted(const view *v, response_message *self)
{
    const bool errors = v->bus->error_every != CW_NEVER || v->bus->errors > 0;
    uint64_t longest = 0;
    for (size_t i = 0; i < v->bus->count; i++) {
        const response_message *m = &v->bus->messages[i];
        if (m != self && m->length > longest)
            longest = m->length;
    }
    const bool waits_once = !errors && !has_rival(v) && longest < self->slot;
    self->blocking = (waits_once ? longest : self->slot) + v->bus->bit;
    self->response = self->blocking + self->length;
    self->instances = 1;
}

/* Finds the worst response: each instance within the longest busy period is looked at, since the
 * first one need not be the worst. */
static void find_response(const response_bus *bus, response_message *self)
{
    const view v = view_of(bus, self);
    if (self->slot) {
        find_slotted(&v, self);
        return;
    }
    self->blocking = find_blocking(&v);
    self->response = CW_NEVER;
    const uint64_t busy = find_busy_period(&v);
    if (busy >= LIMIT_TICKS)
        return;
    const response_message own = {.period = self->period, .jitter = self->jitter};
    self->instances = arrivals(&own, busy);
    self->response = 0;
    for (uint64_t q = 0; q < self->instances && self->response != CW_NEVER; q++) {
        const uint64_t response = find_instance(&v, q);
        self->response = response > self->response ? response : self->response;
    }
}

/* Takes the delays in fifo nodes from the responses. Returns true when one has changed. */
static bool take_delays(response_bus *bus)
{
    bool changed = false;
    for (size_t i = 0; i < bus->count; i++) {
        response_message *m = &bus->messages[i];
        const bool bounded = m->fifo && m->response != CW_NEVER;
        const uint64_t delay = !bounded  ? 0
                               : m->slot ? m->blocking
                                         : m->response - m->length - m->jitter;
        changed = changed || delay != m->delay;
        m->delay = delay;
    }
    return changed;
}

/* Rounds end with the first FIFO message that has no bound: its delay would grow without end. */
static bool any_unbounded(const response_bus *bus)
{
    for (size_t i = 0; i < bus->count; i++)
        if (bus->messages[i].fifo && bus->messages[i].response == CW_NEVER)
            return true;
    return false;
}

/* Takes the bounds of messages that wait for one without a bound. It may delay them for ever. */
static void spread_unbounded(response_bus *bus)
{
    for (size_t i = 0; i < bus->count; i++) {
        const view v = view_of(bus, &bus->messages[i]);
        for (size_t k = 0; k < bus->count; k++) {
            const response_message *m = &bus->messages[k];
            if (m->response == CW_NEVER && m->fifo && goes_before(&v, m))
                bus->messages[i].response = CW_NEVER;
        }
    }
}

/* Makes nodes with mailboxes wait where a message is late. Returns true when there is a new one. */
static bool crowd_mailboxes(response_bus *bus)
{
    bool changed = false;
    for (size_t i = 0; i < bus->count; i++) {
        const response_message *late = &bus->messages[i];
        if (!late->boxed || late->fifo || !response_is_late(late))
            continue;
        for (size_t k = 0; k < bus->count; k++)
            bus->messages[k].fifo |= bus->messages[k].boxed && bus->messages[k].node == late->node;
        changed = true;
    }
    return changed;
}

/* The delays grow from round to round. */
static void find_responses(response_bus *bus)
{
    unsigned rounds = 0;
    bool changed = true;
    for (size_t i = 0; i < bus->count; i++)
        bus->messages[i].delay = 0;
    for (; changed && rounds < ROUNDS_MAX; rounds++) {
        for (size_t i = 0; i < bus->count; i++)
            find_response(bus, &bus->messages[i]);
        changed = !any_unbounded(bus) && take_delays(bus);
    }
    for (size_t i = 0; changed && i < bus->count; i++) /* too many rounds */
        if (bus->messages[i].fifo)
            bus->messages[i].response = CW_NEVER;
    spread_unbounded(bus);
}

void response_find(response_bus *bus)
{
    for (size_t i = 0; i < bus->count; i++)
        bus->messages[i].fifo = bus->messages[i].fifo && !bus->messages[i].boxed;
    do
        find_responses(bus);
    while (crowd_mailboxes(bus));
}
