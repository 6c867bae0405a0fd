/* SPDX-License-Identifier: MIT
 *
 * shortest.c - the shortest scenarios of each class of failures.
 */
#include "campaign/report/shortest.h"

#include "base/wall.h"
#include "base/text/yamlfile.h"
#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

#define NS_PER_MS INT64_C(1000000)

/* ---- Lists ----------------------------------------------------------------------------------- */

static void shortest_forget(shortest_scenario *one)
{
    free(one->expectation);
    free(one->repeat);
    bundle_text_free(&one->found.text);
}

static uint64_t size_of(const shortest_scenario *one)
{
    return (uint64_t)one->found.rules + one->found.traffic;
}

/* Fewer items count more than a shorter time. The number of the row makes the order unique. */
static bool is_shorter(const shortest_scenario *a, const shortest_scenario *b)
{
    const uint64_t time_a = a->found.has_until ? a->found.until_ns : UINT64_MAX;
    const uint64_t time_b = b->found.has_until ? b->found.until_ns : UINT64_MAX;
    if (size_of(a) != size_of(b))
        return size_of(a) < size_of(b);
    return time_a != time_b ? time_a < time_b : a->number < b->number;
}

/* Takes a longer scenario with the same text out. Returns false when there is a shorter one. */
static bool make_way(shortest *s, size_t begin, const shortest_scenario *one)
{
    for (size_t i = begin; i < s->count; i++) {
        if (!bundle_text_equals(&s->list[i].found.text, &one->found.text))
            continue;
        if (!is_shorter(one, &s->list[i]))
            return false;
        shortest_forget(&s->list[i]);
        memmove(s->list + i, s->list + i + 1, (s->count - i - 1) * sizeof *s->list);
        s->count--;
        return true;
    }
    return true;
}

/* Puts a scenario in its place behind item `begin`, unless it is there, or too long. */
static void put_in(shortest *s, size_t begin, shortest_scenario one)
{
    if (!make_way(s, begin, &one)) {
        shortest_forget(&one);
        return;
    }
    size_t at = s->count;
    while (at > begin && is_shorter(&one, &s->list[at - 1]))
        at--;
    if (at - begin >= SHORTEST_OF_CLASS) {
        shortest_forget(&one);
        return;
    }
    if (s->count - begin == SHORTEST_OF_CLASS)
        shortest_forget(&s->list[--s->count]);
    memmove(s->list + at + 1, s->list + at, (s->count - at) * sizeof *s->list);
    s->list[at] = one;
    s->count++;
}

/* ---- Classes --------------------------------------------------------------------------------- */

/* Makes the task for a row. Only rows of `canwire sim --seeds`, and of a campaign that varies the
 * seed, have a seed of their own. */
static minimise_task task_of(const minimise_task *common, const candidate *c, row_class class)
{
    minimise_task task = *common;
    task.class = class;
    task.degraded = c->degraded;
    task.expectation = c->expectation;
    task.end_ns = c->end_ns;
    task.seed = c->seed;
    task.has_seed = !common->campaign;
    if (!common->campaign)
        return task;
    sample_choose(task.choices, common->campaign, c->number);
    for (size_t i = 0; i < common->campaign->factor_count; i++)
        task.has_seed = task.has_seed || common->campaign->factors[i].is_seed;
    return task;
}

/* Returns the deadline of a row of which others follow. Each gets an equal part of the time that is
 * left, but a time-out, which takes its limit, as much as there is. */
static int64_t deadline_of(const minimise_task *common, row_class class, size_t rows_left,
                           int64_t end_ns)
{
    const int64_t now = wall_ns();
    const int64_t left = end_ns > now ? end_ns - now : 0;
    const int64_t part = left / (int64_t)rows_left;
    return now + (class == CLASS_TIMEOUT && part < common->limit_ms * NS_PER_MS ? left : part);
}

/* Makes the candidates of a class shorter. Rows that do not do the same again are only counted. */
static void add_class(shortest *s, const report *r, row_class class, const minimise_task *common,
                      int64_t end_ns)
{
    const candidates *all = &r->candidates[class];
    const size_t begin = s->count;
    for (size_t i = 0; i < all->count; i++) {
        const candidate *c = &all->list[i];
        minimise_task task = task_of(common, c, class);
        task.deadline_ns = deadline_of(common, class, all->count - i, end_ns);
        const minimised found = minimise(&task);
        if (!found.text.main) {
            s->others++;
            continue;
        }
        put_in(s, begin, (shortest_scenario){
            .class = class, .number = c->number, .seed = c->seed, .found = found,
            .degraded = c->degraded, .repeat = memory_text(c->repeat),
            .expectation = c->expectation ? memory_text(c->expectation) : NULL});
    }
}

/* Each class gets an equal part of the time that is left. */
static void add_classes(shortest *s, const report *r, const minimise_task *common, int64_t end_ns)
{
    static const row_class order[] = {CLASS_UNDETECTED, CLASS_DETECTED, CLASS_DEGRADED,
                                      CLASS_CRASHED, CLASS_TIMEOUT};
    size_t left = 0;
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++)
        left += r->candidates[order[i]].count > 0;
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++) {
        if (r->candidates[order[i]].count == 0)
            continue;
        const int64_t now = wall_ns();
        const int64_t part = end_ns > now ? (end_ns - now) / (int64_t)left : 0;
        left--;
        add_class(s, r, order[i], common, now + part);
    }
}

/* ---- The scenario ---------------------------------------------------------------------------- */

/* Takes the scenario of `canwire sim --seeds`. Returns its text, to be freed, or NULL. */
static char *read_scenario(minimise_task *common, const row_source *source)
{
    diag found = {.file.name = source->file};
    size_t size = 0;
    char *text = yaml_file_read(&size, source->file, true, &found);
    diag_flush(&found, stderr);
    common->name = source->file;
    common->text = text;
    common->size = size;
    common->has_until = source->until && !text_parse_time(&common->until, source->until);
    return text;
}

/* Says why there are none; to be freed. */
static char *no_scenarios(const report *r)
{
    char *reason = report_unread_text(r);
    char *text = memory_print("%s, so there are no scenarios.", reason);
    free(reason);
    return text;
}

static bool has_failures(const report *r)
{
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        if (r->candidates[i].count > 0)
            return true;
    return false;
}

void shortest_find(shortest *s, const report *r, int64_t time_ns)
{
    minimise_task common = {.campaign = r->campaign, .signs = &r->signs,
                            .limit_ms = CAMPAIGN_LIMIT_MS};
    const campaign *c = r->campaign;
    char *text = NULL;
    if (!has_failures(r))
        return;
    if (c) {
        common.name = c->scenario_name;
        common.has_until = c->until != NULL;
        common.until = c->until_time;
        common.limit_ms = c->limit_ms;
    } else if (!r->source.is_campaign) {
        text = read_scenario(&common, &r->source);
    }
    if (c && c->ecus.count > 0)
        s->why = memory_text("Scenarios with real ECUs are not run again for a report.");
    else if (!c && !text)
        s->why = no_scenarios(r);
    else
        add_classes(s, r, &common, wall_ns() + time_ns);
    free(text);
}

void shortest_free(shortest *s)
{
    for (size_t i = 0; i < s->count; i++)
        shortest_forget(&s->list[i]);
    free(s->why);
    *s = (shortest){.count = 0};
}
