/* SPDX-License-Identifier: MIT
 *
 * minimise.c - makes a scenario shorter as long as it does the same (delta debugging).
 */
#include "campaign/report/minimise.h"

#include "base/wall.h"
#include "campaign/report/memory.h"
#include "campaign/report/outline.h"
#include "campaign/report/trial.h"
#include "campaign/variant.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#define TRIALS_MAX 500u
#define HALVINGS 16u
#define NS_PER_US UINT64_C(1000)

typedef struct work {
    const minimise_task *task;
    uint64_t without; /* factors whose values are those of the scenario, as a set */
    outline outline;
    bool has_until;
    cfg_time until;
    bool has_seed;
    bool guarded; /* without faults the expectation is met */
    unsigned trials;
} work;

static bool is_over(const work *w)
{
    return w->trials >= TRIALS_MAX || wall_ns() >= w->task->deadline_ns;
}

/* ---- Trials ---------------------------------------------------------------------------------- */

static trial_result run_text(work *w, const char *text)
{
    const minimise_task *task = w->task;
    const trial t = {.name = task->name, .text = text, .has_until = w->has_until,
                     .until = w->until, .has_seed = w->has_seed, .seed = task->seed,
                     .limit_ms = task->limit_ms};
    w->trials++;
    return trial_run(&t, task->expectation, task->signs);
}

static trial_result run_outline(work *w, const outline *o, bool without_faults)
{
    char *text = outline_text(o, without_faults, NULL);
    const trial_result result = text ? run_text(w, text) : (trial_result){.class = CLASS_BROKEN};
    free(text);
    return result;
}

/* Returns true when all is well without the faults. */
static bool is_well_without_faults(work *w, const outline *o)
{
    const trial_result found = run_outline(w, o, true);
    if (w->task->expectation)
        return found.class < CLASS_TIMEOUT && !found.failed;
    return found.class == CLASS_NO_EFFECT;
}

/* Returns true when a scenario does the same. */
static bool does_the_same(work *w, const outline *o)
{
    const trial_result found = run_outline(w, o, false);
    return found.class == w->task->class && found.degraded == w->task->degraded &&
           (!w->task->expectation || found.failed) &&
           (!w->guarded || is_well_without_faults(w, o));
}

/* ---- Factors --------------------------------------------------------------------------------- */

/* Loads the scenario with the values of some factors. */
static bool load(work *w, outline *o, uint64_t without)
{
    const minimise_task *task = w->task;
    rowtext text = {.no_memory = false};
    if (task->campaign)
        variant_text_without(&text, task->campaign, task->choices, without);
    else
        rowtext_put(&text, task->text);
    const bool good = !text.no_memory && outline_load(o, buffer_first(&text.bytes),
                                                      buffer_length(&text.bytes));
    rowtext_free(&text);
    return good;
}

/* Tries to give a factor the scenario's own value. */
static void drop_factor(work *w, size_t i)
{
    const bool is_seed = w->task->campaign->factors[i].is_seed;
    const uint64_t without = w->without | UINT64_C(1) << i;
    outline shorter = {.loaded = false};
    const bool had_seed = w->has_seed;
    w->has_seed = w->has_seed && !is_seed;
    if (load(w, &shorter, without) && does_the_same(w, &shorter)) {
        outline_free(&w->outline);
        w->outline = shorter;
        w->without = without;
        return;
    }
    outline_free(&shorter);
    w->has_seed = had_seed;
}

static void drop_factors(work *w)
{
    const campaign *c = w->task->campaign;
    for (size_t i = 0; c && i < c->factor_count && !is_over(w); i++)
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
static void drop_runs(work *w, const outline_list *list, size_t count, size_t items[])
{
    for (size_t at = 0; !is_over(w);) {
        const size_t found = leave_out(&w->outline, list, &at, count, items);
        if (found == 0)
            break;
        if (does_the_same(w, &w->outline))
            continue;
        for (size_t i = 0; i < found; i++)
            w->outline.left_out[items[i]] = false;
    }
}

static void drop_items(work *w, outline_kind kind)
{
    size_t *items = memory_list(NULL, w->outline.nodes, sizeof *items);
    for (size_t i = 0; i < w->outline.list_count; i++) {
        const outline_list *list = &w->outline.lists[i];
        size_t count = 0;
        while (list->kind == kind && outline_item(list, count) != 0)
            count++;
        for (; count > 0; count /= 2)
            drop_runs(w, list, count, items);
    }
    free(items);
}

/* ---- Time ------------------------------------------------------------------------------------ */

static bool try_until(work *w, uint64_t us)
{
    const bool had = w->has_until;
    const cfg_time before = w->until;
    w->has_until = true;
    w->until = (cfg_time){.ns = us * NS_PER_US};
    if (does_the_same(w, &w->outline))
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
    for (unsigned i = 0; i < HALVINGS && high - low > 1 && !is_over(w); i++) {
        const uint64_t middle = low + (high - low) / 2;
        if (try_until(w, middle))
            high = middle;
        else
            low = middle;
    }
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* Names of files in the text stay what they mean where the text is written to. */
static char *folder_of(const char *name)
{
    char real[PATH_MAX];
    if (!realpath(name, real))
        return memory_text(".");
    *strrchr(real, '/') = '\0';
    return memory_text(real);
}

static minimised result_of(const work *w)
{
    char *folder = folder_of(w->task->name);
    const minimised result = {.text = outline_text(&w->outline, false, folder),
                              .rules = outline_count(&w->outline, OUTLINE_FAULTS),
                              .traffic = outline_count(&w->outline, OUTLINE_TRAFFIC),
                              .has_until = w->has_until,
                              .until_ns = w->until.ns,
                              .has_seed = w->has_seed,
                              .whole = !is_over(w)};
    free(folder);
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
        drop_items(w, OUTLINE_TRAFFIC);
    drop_items(w, OUTLINE_EXPECT);
    if (free_to && has_end)
        drop_items(w, OUTLINE_TRAFFIC);
    if (w->guarded)
        shorten(w);
    if (free_to && !has_end)
        drop_items(w, OUTLINE_TRAFFIC);
}

minimised minimise(const minimise_task *task)
{
    work w = {.task = task, .has_until = task->has_until, .until = task->until,
              .has_seed = task->has_seed};
    minimised result = {.text = NULL};
    if (load(&w, &w.outline, 0) && does_the_same(&w, &w.outline)) {
        w.guarded = outline_count(&w.outline, OUTLINE_FAULTS) > 0 &&
                    task->class < CLASS_TIMEOUT && is_well_without_faults(&w, &w.outline);
        make_short(&w);
        result = result_of(&w);
    }
    outline_free(&w.outline);
    return result;
}
