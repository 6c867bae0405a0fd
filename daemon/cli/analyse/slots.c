/* SPDX-License-Identifier: MIT
 *
 * slots.c - how often the triggers of time-triggered schedules hand in their frames.
 *
 * A basic cycle begins with the capture of a reference message (L4), and a trigger acts once in it,
 * at most. The time master hands in the next reference message by its own trigger, so a cycle is
 * never shorter than that says. It may be longer, since the message may come late. Counters count
 * whole units, and nodes sample a SOF at different moments: that is jitter.
 *
 * With several time masters, one may have its message waiting while that of another is on the bus.
 * Then both begin a cycle. So the messages of all of them count.
 */
#include "cli/analyse/slots.h"

#include "base/text/wide.h"
#include "cli/analyse/lengths.h"

#include <stdlib.h>

#define CAPTURE_BITS 2u /* by which the captures of two SOF are fuzzy */

/* Returns the ticks of so many units of local time, rounded down. */
static uint64_t ticks_of(const cfg_node *node, uint64_t units)
{
    uint64_t rest;
    const wide span = wide_product(units, (uint64_t)cfg_local_unit(node, node->time.ppm));
    return wide_divide(&rest, span, (uint64_t)CW_TICK).low;
}

static bool begins_cycle(const cfg_node *node, const cw_frame *frame)
{
    return cw_frame_matches(frame, &node->schedule.reference, 1);
}

/* ---- Reference messages ---------------------------------------------------------------------- */

/* The triggers of all schedules that begin the basic cycles of a node. */
typedef struct references {
    unsigned count;
    uint64_t longest; /* of their frames */
    bool only;        /* no other frames of FILE do so */
} references;

/* Counts the triggers of a schedule that send the reference of a node, with the longest of them. */
static void count_triggers(references *r, const cfg *config, const cfg_node *of,
                           const cfg_schedule *s)
{
    for (unsigned k = 0; k < s->trigger_count; k++) {
        const cw_frame *frame = &s->triggers[k].frame;
        unsigned fast;
        const unsigned bits = lengths_longest_bits(frame, &fast);
        const uint64_t time = lengths_time(config, bits, fast);
        if (!begins_cycle(of, frame))
            continue;
        r->count++;
        r->longest = time > r->longest ? time : r->longest;
    }
}

/* Finds what sends the frames by which a node knows its cycle. Traffic that does so, too, makes the
 * cycle's length unknown. */
static references find_references(const cfg *config, const cfg_node *of)
{
    references r = {.only = true};
    for (size_t i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        count_triggers(&r, config, of, &node->schedule);
        for (size_t k = 0; k < node->traffic_count; k++)
            r.only = r.only && !(node->traffic[k].kind == CFG_TRAFFIC_SEND &&
                                 begins_cycle(of, &node->traffic[k].frame));
    }
    return r;
}

/* Finds how often a time master hands its message in. That of another one may have begun before,
 * and is known later: the master counts from its start. */
static void find_own_reference(slots_cadence *out, const cfg_node *node, uint32_t units,
                               const references *r)
{
    const uint64_t at = ticks_of(node, units), early = r->count > 1 ? r->longest : 0;
    out->period = at > early ? at - early : 0;
    out->usual = at;
}

/* ---- Basic cycles ---------------------------------------------------------------------------- */

static slots_cadence *slots_place_of(const slots *s, unsigned node, unsigned trigger)
{
    return &s->all[(size_t)node * CW_TRIGGERS_MAX + trigger];
}

const slots_cadence *slots_of(const slots *s, unsigned node, unsigned trigger)
{
    const slots_cadence *c = slots_place_of(s, node, trigger);
    return c->period ? c : NULL;
}

/* Takes a trigger of a node as one that begins basic cycles. Returns false while it is not known
 * how often it acts. */
static bool take_reference(slots_cadence *all, const cfg_node *node, const cw_time_trigger *t,
                           const slots_cadence *one)
{
    /* Only a time master counts from the start of its own frame, so that lateness adds nothing. */
    const uint64_t jitter = one->jitter + (begins_cycle(node, &t->frame) ? 0 : one->slot);
    all->period = one->period < all->period ? one->period : all->period;
    all->usual = one->usual < all->usual ? one->usual : all->usual;
    all->jitter = jitter > all->jitter ? jitter : all->jitter;
    return one->period > 0;
}

/* Finds how often basic cycles begin at a node. Returns false while that is not known. */
static bool find_cycles(slots_cadence *out, const slots *s, const cfg *config, const cfg_node *of,
                        const references *r)
{
    bool found = r->only && r->count > 0;
    *out = (slots_cadence){.period = CW_NEVER, .usual = CW_NEVER};
    for (unsigned i = 0; found && i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        for (unsigned k = 0; found && k < node->schedule.trigger_count; k++)
            if (begins_cycle(of, &node->schedule.triggers[k].frame))
                found =
                    take_reference(out, node, &node->schedule.triggers[k], slots_place_of(s, i, k));
    }
    if (found && r->count > 1) { /* the sum of all comes no more often than this */
        out->jitter += out->period;
        out->period /= r->count;
    }
    return found && out->period > 0;
}

/* Finds how often a trigger acts that begins no cycle. With several time masters two cycles may
 * have the same number. */
static void find_repeated(slots_cadence *out, const slots_cadence *cycles, const cfg_schedule *s,
                          const cw_time_trigger *t, const references *r)
{
    const uint64_t repeat = t->repeat ? t->repeat : 1;
    const bool in_turn = r->count == 1 || s->cycle_byte == CFG_NO_CYCLE_BYTE;
    out->period = cycles->period * (in_turn ? repeat : 1);
    out->usual = cycles->usual * repeat;
    out->jitter += cycles->jitter;
}

/* Finds the cadences of a node. Returns true when one is new. */
static bool slots_find_node(const slots *s, const cfg *config, unsigned i)
{
    const cfg_node *node = &config->nodes[i];
    const references r = find_references(config, node);
    slots_cadence cycles;
    const bool known = find_cycles(&cycles, s, config, node, &r);
    bool changed = false;
    for (unsigned k = 0; r.only && k < node->schedule.trigger_count; k++) {
        const cw_time_trigger *t = &node->schedule.triggers[k];
        slots_cadence *c = slots_place_of(s, i, k);
        if (c->period)
            continue;
        c->jitter = ticks_of(node, 1) + 1 + cw_rate_ticks(config->rate, CAPTURE_BITS);
        c->slot = ticks_of(node, t->slot) + 1;
        if (begins_cycle(node, &t->frame))
            find_own_reference(c, node, t->at, &r);
        else if (known)
            find_repeated(c, &cycles, &node->schedule, t, &r);
        changed = changed || c->period;
    }
    return changed;
}

/* The frame that begins cycles of one node may have a slot of another, so nodes come in rounds. */
bool slots_find(slots *s, const cfg *config)
{
    bool changed = true;
    s->all = calloc((size_t)config->node_count * CW_TRIGGERS_MAX + 1, sizeof *s->all);
    while (s->all && changed) {
        changed = false;
        for (unsigned i = 0; i < config->node_count; i++)
            if (config->nodes[i].schedule.trigger_count)
                changed = slots_find_node(s, config, i) || changed;
    }
    return s->all != NULL;
}

void slots_free(slots *s)
{
    free(s->all);
    s->all = NULL;
}
