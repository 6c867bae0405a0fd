/* SPDX-License-Identifier: MIT
 *
 * minimise.c - makes a scenario shorter as long as it does the same (delta debugging).
 */
#include "campaign/report/minimise.h"

#include "base/wall.h"
#include "campaign/report/memory.h"
#include "campaign/report/trial.h"
#include "campaign/space/variant.h"

#include <stdlib.h>
#include <string.h>

#define TRIALS_MAX 500u
#define HALVINGS 16u
#define NS_PER_US UINT64_C(1000)
#define NS_PER_MS 1000000

typedef struct work {
    const minimise_task *task;
    uint64_t without; /* factors whose values are those of the scenario, as a set */
    bundle bundle;
    bool has_until;
    cfg_time until;
    bool has_seed;
    bool guarded; /* without faults the expectation is met */
    json_t *spells; /* of the row, see trial.h; owned */
    bool late;    /* the deadline has cut a trial */
    unsigned trials;
} work;

static bool minimise_is_over(const work *w)
{
    return w->late || w->trials >= TRIALS_MAX || wall_ns() >= w->task->deadline_ns;
}

/* ---- Trials ---------------------------------------------------------------------------------- */

/* Returns the real time for a trial, in ms; 0: there is not enough. A time-out needs its limit. */
static int64_t allowed_ms(const work *w)
{
    const minimise_task *task = w->task;
    const int64_t left_ms = (task->deadline_ns - wall_ns()) / NS_PER_MS;
    if (left_ms >= task->limit_ms)
        return task->limit_ms;
    return left_ms < 0 || task->class == CLASS_TIMEOUT ? 0 : left_ms;
}

/* A trial that the deadline has cut says nothing. */
static trial_result run_text(work *w, const bundle_text *text)
{
    const minimise_task *task = w->task;
    const trial t = {.name = w->bundle.file, .text = text, .has_until = w->has_until,
                     .until = w->until, .has_seed = w->has_seed, .seed = task->seed,
                     .limit_ms = allowed_ms(w)};
    trial_result found = {.class = CLASS_BROKEN};
    w->late = w->late || t.limit_ms == 0;
    if (w->late)
        return found;
    w->trials++;
    found = trial_run(&t, task->expectation, task->signs);
    if (found.class == CLASS_TIMEOUT && t.limit_ms < task->limit_ms) {
        w->late = true;
        found.class = CLASS_BROKEN;
    }
    return found;
}

/* The caller frees the result. */
static trial_result minimise_run(work *w, bool without_faults)
{
    bundle_text text;
    const trial_result result = bundle_write(&text, &w->bundle, without_faults, false)
                                    ? run_text(w, &text)
                                    : (trial_result){.class = CLASS_BROKEN};
    bundle_text_free(&text);
    return result;
}

/* Returns true when all is well without the faults. */
static bool is_well_without_faults(work *w)
{
    trial_result found = minimise_run(w, true);
    trial_result_free(&found);
    if (w->task->expectation)
        return found.class < CLASS_TIMEOUT && !found.failed;
    return found.class == CLASS_NO_EFFECT;
}

/* Returns true when the scenario does the same. */
static bool does_the_same(work *w)
{
    trial_result found = minimise_run(w, false);
    const bool same = found.class == w->task->class && found.degraded == w->task->degraded &&
                      (!w->task->expectation || found.failed) &&
                      trial_ends_like(&found, w->spells) &&
                      (!w->guarded || is_well_without_faults(w));
    if (same && !w->spells)
        w->spells = json_incref(found.spells); /* the row itself */
    trial_result_free(&found);
    return same;
}

/* ---- Factors --------------------------------------------------------------------------------- */

/* Loads the scenario with the values of some factors. */
static bool minimise_load(work *w, uint64_t without)
{
    const minimise_task *task = w->task;
    buffer text = {.data = NULL};
    if (task->campaign)
        variant_text_without(&text, task->campaign, task->choices, without);
    else
        (void)buffer_append(&text, task->text, task->size);
    const bool good = !text.no_memory && bundle_load(&w->bundle, task->name, buffer_first(&text),
                                                     buffer_length(&text));
    buffer_free(&text);
    return good;
}

/* Tries to give a factor the scenario's own value. */
static void drop_factor(work *w, size_t i)
{
    const bool is_seed = w->task->campaign->factors[i].is_seed;
    const uint64_t without = w->without | UINT64_C(1) << i;
    const bool had_seed = w->has_seed;
    bundle before = w->bundle;
    w->has_seed = w->has_seed && !is_seed;
    if (minimise_load(w, without) && does_the_same(w)) {
        bundle_free(&before);
        w->without = without;
        return;
    }
    bundle_free(&w->bundle);
    w->bundle = before;
    w->has_seed = had_seed;
}

static void drop_factors(work *w)
{
    const campaign *c = w->task->campaign;
    for (size_t i = 0; c && i < c->factor_count && !minimise_is_over(w); i++)
        drop_factor(w, i);
}

/* ---- Items of lists -------------------------------------------------------------------------- */

/* Leaves up to `count` items out, from item *at on, which moves behind them. Returns how many. */
static size_t leave_out(outline *o, const outline_list *list, size_t *at, size_t count,
                        size_t items[])
{
    size_t found = 0;
    for (size_t item; found < count && (item = outline_item(list, *at)) != 0; (*at)++) {
        if (o->left_out[item])
            continue;
        o->left_out[item] = true;
        items[found++] = item;
    }
    return found;
}

/* Tries all runs of `count` items. */
static void drop_runs(work *w, outline *o, const outline_list *list, size_t count, size_t items[])
{
    for (size_t at = 0; !minimise_is_over(w);) {
        const size_t found = leave_out(o, list, &at, count, items);
        if (found == 0)
            break;
        if (does_the_same(w))
            continue;
        for (size_t i = 0; i < found; i++)
            o->left_out[items[i]] = false;
    }
}

/* Drops runs of items from a list, long ones first: few attempts make most of it go. */
static void drop_from_list(work *w, outline *o, const outline_list *list, size_t items[])
{
    size_t count = 0;
    while (!outline_is_gone(o, list) && outline_item(list, count) != 0)
        count++;
    for (; count > 0; count /= 2)
        drop_runs(w, o, list, count, items);
}

/* All lists of the kind in a document share the memory for the numbers of items. */
static void drop_from(work *w, outline *o, outline_kind kind)
{
    size_t *items = memory_list(NULL, o->nodes, sizeof *items);
    for (size_t i = 0; i < o->list_count; i++)
        if (o->lists[i].kind == kind)
            drop_from_list(w, o, &o->lists[i], items);
    free(items);
}

/* Drops items of a kind from all documents of the scenario. */
static void drop_items(work *w, outline_kind kind)
{
    bool gone = false;
    outline *o;
    for (size_t i = 0; (o = bundle_document(&w->bundle, i, &gone)) || gone; i++)
        if (o)
            drop_from(w, o, kind);
}

/* Leaves out what brings frames. */
static void drop_traffic(work *w)
{
    drop_items(w, OUTLINE_GATEWAYS);
    drop_items(w, OUTLINE_BUSES);
    drop_items(w, OUTLINE_TRAFFIC);
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* Tries a shorter run. One that does not do the same is taken back. */
static bool try_until(work *w, uint64_t us)
{
    const bool had = w->has_until;
    const cfg_time before = w->until;
    w->has_until = true;
    w->until = (cfg_time){.ns = us * NS_PER_US};
    if (does_the_same(w))
        return true;
    w->has_until = had;
    w->until = before;
    return false;
}

/* Finds a short time by halving, in microseconds. */
static void shorten(work *w)
{
    uint64_t low = 0;
    uint64_t high = w->task->end_ns / NS_PER_US + 1;
    for (unsigned i = 0; i < HALVINGS && high - low > 1 && !minimise_is_over(w); i++) {
        const uint64_t middle = low + (high - low) / 2;
        if (try_until(w, middle))
            high = middle;
        else
            low = middle;
    }
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* A rig of which one bus is left becomes this bus. */
static void leave_rig(work *w)
{
    bundle single;
    bundle several = w->bundle;
    if (minimise_is_over(w) || !bundle_is_single(&several))
        return;
    bundle_promote(&single, &several);
    w->bundle = single;
    if (does_the_same(w)) {
        bundle_free(&several);
        return;
    }
    bundle_demote(&w->bundle, &several);
    w->bundle = several;
}

/* Returns the scenario as it is now, whole: nothing more could be dropped. */
static minimised result_of(const work *w, bool tried)
{
    minimised result = {.tried = tried,
                        .rules = bundle_count(&w->bundle, OUTLINE_FAULTS),
                        .traffic = bundle_count(&w->bundle, OUTLINE_TRAFFIC),
                        .has_until = w->has_until,
                        .until_ns = w->until.ns,
                        .has_seed = w->has_seed,
                        .whole = tried && !minimise_is_over(w)};
    if (!bundle_write(&result.text, &w->bundle, false, true))
        bundle_text_free(&result.text);
    return result;
}

/* A failure that does not depend on faults must not come from a lack of traffic or of time. A bad
 * state in the end must be there without the cut, too: traffic goes before it. */
static void make_short(work *w)
{
    const bool free_to = w->guarded || w->task->class >= CLASS_TIMEOUT;
    const bool has_end = (w->task->degraded & DEGRADED_STATE) != 0;
    drop_factors(w);
    drop_items(w, OUTLINE_FAULTS);
    if (free_to)
        drop_traffic(w);
    drop_items(w, OUTLINE_EXPECT);
    if (free_to && has_end)
        drop_traffic(w);
    if (w->guarded)
        shorten(w);
    if (free_to && !has_end)
        drop_traffic(w);
    leave_rig(w);
}

/* Returns true when the faults alone make it fail. */
static bool depends_on_faults(work *w)
{
    return bundle_count(&w->bundle, OUTLINE_FAULTS) > 0 && w->task->class < CLASS_TIMEOUT &&
           is_well_without_faults(w);
}

minimised minimise(const minimise_task *task)
{
    work *w = memory_list(NULL, 1, sizeof *w);
    *w = (work){.task = task, .has_until = task->has_until, .until = task->until,
                .has_seed = task->has_seed};
    minimised result = {.tried = false};
    const bool loaded = minimise_load(w, 0);
    if (loaded && does_the_same(w)) {
        w->guarded = depends_on_faults(w);
        make_short(w);
        result = result_of(w, true);
    } else if (loaded && w->late)
        result = result_of(w, false);
    bundle_free(&w->bundle);
    json_decref(w->spells);
    free(w);
    return result;
}
