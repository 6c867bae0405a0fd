/* SPDX-License-Identifier: MIT
 *
 * release.c - the periodic traffic of nodes without port: when which frame is handed in.
 *
 * A binary heap over the `send` entries, ordered by time and then by their place in the file.
 */
#include "release.h"

#include <assert.h>
#include <stdlib.h>

typedef struct source {
    const cfg_traffic *traffic;
    unsigned node;
    unsigned place; /* in the file */
    uint64_t done;  /* releases so far */
    uint64_t tick;  /* of the next one */
} source;

struct release_plan {
    uint32_t bit_ticks;
    size_t count;
    source heap[];
};

static bool comes_before(const source *a, const source *b)
{
    return a->tick < b->tick || (a->tick == b->tick && a->place < b->place);
}

static void swap(source *a, source *b)
{
    source t = *a;
    *a = *b;
    *b = t;
}

static void sift_down(release_plan *plan, size_t i)
{
    for (;;) {
        size_t child = 2 * i + 1;
        if (child >= plan->count)
            return;
        if (child + 1 < plan->count && comes_before(&plan->heap[child + 1], &plan->heap[child]))
            child++;
        if (!comes_before(&plan->heap[child], &plan->heap[i]))
            return;
        swap(&plan->heap[child], &plan->heap[i]);
        i = child;
    }
}

static void add_node(release_plan *plan, const cfg_node *node, unsigned index)
{
    for (size_t t = 0; t < node->traffic_count; t++) {
        const cfg_traffic *traffic = &node->traffic[t];
        if (traffic->count == 0)
            continue;
        unsigned place = (unsigned)plan->count++;
        plan->heap[place] = (source){.traffic = traffic, .node = index, .place = place};
        plan->heap[place].tick = text_time_ticks(traffic->offset, plan->bit_ticks);
    }
}

release_plan *release_plan_new(const cfg *config)
{
    size_t sources = 0;
    for (size_t i = 0; i < config->node_count; i++)
        sources += config->nodes[i].traffic_count;
    release_plan *plan = calloc(1, sizeof *plan + sources * sizeof plan->heap[0]);
    if (!plan)
        return NULL;
    plan->bit_ticks = config->bit_ticks;
    for (size_t i = 0; i < config->node_count; i++)
        add_node(plan, &config->nodes[i], (unsigned)i);
    for (size_t i = plan->count / 2; i-- > 0;)
        sift_down(plan, i);
    return plan;
}

void release_plan_free(release_plan *plan)
{
    free(plan);
}

/* The first release at or after a tick; s->traffic->count when there is none. */
static uint64_t first_from(const source *s, uint64_t tick, uint32_t bit_ticks)
{
    const cfg_traffic *t = s->traffic;
    uint64_t low = 0;
    uint64_t high = t->count;
    while (low < high) {
        uint64_t middle = low + (high - low) / 2;
        if (text_time_ticks_sum(t->offset, middle, t->every, bit_ticks) < tick)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void release_skip_before(release_plan *plan, uint64_t tick)
{
    size_t kept = 0;
    for (size_t i = 0; i < plan->count; i++) {
        source s = plan->heap[i];
        s.done = first_from(&s, tick, plan->bit_ticks);
        if (s.done == s.traffic->count)
            continue;
        s.tick = text_time_ticks_sum(s.traffic->offset, s.done, s.traffic->every, plan->bit_ticks);
        plan->heap[kept++] = s;
    }
    plan->count = kept;
    for (size_t i = plan->count / 2; i-- > 0;)
        sift_down(plan, i);
}

uint64_t release_next_tick(const release_plan *plan)
{
    return plan->count ? plan->heap[0].tick : CW_NEVER;
}

const cw_frame *release_first(const release_plan *plan, unsigned *node)
{
    assert(plan->count > 0);
    *node = plan->heap[0].node;
    return &plan->heap[0].traffic->frame;
}

/* The first source goes on to its next release, or away. */
static void go_on(release_plan *plan)
{
    source *s = &plan->heap[0];
    const cfg_traffic *t = s->traffic;
    if (++s->done < t->count)
        s->tick = text_time_ticks_sum(t->offset, s->done, t->every, plan->bit_ticks);
    else
        *s = plan->heap[--plan->count];
    sift_down(plan, 0);
}

cw_status release_hand_in(release_plan *plan, cw_bus *bus)
{
    assert(plan->count > 0);
    const source *s = &plan->heap[0];
    cw_status status = cw_node_send(bus, s->node, &s->traffic->frame, s->tick);
    if (status == CW_OK)
        go_on(plan);
    return status;
}
