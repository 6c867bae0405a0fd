/* SPDX-License-Identifier: MIT
 *
 * report_view.c - what the forms of a report share.
 */
#include "cli/campaign/report_view.h"

#include "base/text/decimal.h"
#include "base/text/plain.h"
#include "campaign/report/memory.h"
#include "campaign/shellword.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

const char *const report_remarks[] = {
    "These are counts of what this simulation has shown for these faults and this traffic: "
    "evidence for an argument in the sense of ISO 26262, and no metric of it.",
    "A share is no failure rate and no diagnostic coverage: the factors of a campaign are not "
    "weighted by how often such faults occur. An FMEDA needs a fault model with rates.",
    "The intervals say how well the sample stands for the campaign as it was drawn. They assume "
    "rows drawn independently; a full product is no sample, and its shares are exact.",
    NULL,
};

/* Says what is not known without the file of the campaign; to be freed. */
static char *unknown_text(const report *r)
{
    char *reason = report_unread_text(r);
    char *text = memory_print("The campaign's file %s. So it is not known how many rows and values "
                              "are possible, nor which expectations tell of a detection.", reason);
    free(reason);
    return text;
}

char *report_missing_text(const report *r)
{
    const uint64_t possible = report_possible(r);
    span gap;
    if (r->source.is_campaign && !r->campaign)
        return unknown_text(r);
    if (!report_missing(r, &gap))
        return NULL;
    if (possible == 0)
        return memory_print("Rows are missing, the first ones are %" PRIu64 " to %" PRIu64 ".",
                            gap.first, gap.last);
    return memory_print("%" PRIu64 " of %" PRIu64 " rows are there. The first ones that are "
                        "missing are %" PRIu64 " to %" PRIu64 ".",
                        r->rows, possible, gap.first, gap.last);
}

void report_print_share(char out[REPORT_PERCENT_BYTES], share s)
{
    (void)snprintf(out, REPORT_PERCENT_BYTES, "%.3f %% (%.3f to %.3f %%)", 100 * s.value,
                   100 * s.low, 100 * s.high);
}

share report_class_share(const report_view *v, const class_counts *c, row_class class)
{
    return share_of(c->of[class], class_counts_rated(c), v->confidence);
}

/* Returns a number by which the worst value comes first: its share of undetected failures, then of
 * all that is not well. */
static double badness(const class_counts *c)
{
    const double rated = (double)class_counts_rated(c);
    const double undetected = (double)c->of[CLASS_UNDETECTED];
    const double bad = (double)(class_counts_failed(c) + c->of[CLASS_TIMEOUT]);
    return rated > 0 ? (undetected * 1e6 + bad * 1e3 + (double)c->of[CLASS_DEGRADED]) / rated : 0;
}

/* Orders values: the worst ones first; equal ones keep their order. */
static int report_view_compare(const void *left, const void *right, void *user)
{
    const dimension *d = user;
    const uint32_t a = *(const uint32_t *)left;
    const uint32_t b = *(const uint32_t *)right;
    const double first = badness(&d->values[a].rows);
    const double second = badness(&d->values[b].rows);
    if (first > second || first < second)
        return first > second ? -1 : 1;
    return a < b ? -1 : a > b;
}

uint32_t *report_worst_values(size_t *count, const dimension *d)
{
    uint32_t *list = memory_list(NULL, d->count, sizeof *list);
    *count = 0;
    for (uint32_t i = 0; i < d->count; i++)
        if (class_counts_all(&d->values[i].rows) > 0)
            list[(*count)++] = i;
    qsort_r(list, *count, sizeof *list, report_view_compare, (void *)d);
    return list;
}

uint64_t report_pairs_possible(const report *r, size_t i, size_t k)
{
    const uint64_t first = r->factors[i].possible;
    const uint64_t second = r->factors[k].possible;
    return second > 0 && first <= UINT64_MAX / second ? first * second : 0;
}

char *report_pair_name(const report *r, size_t i, size_t k)
{
    return memory_print("%s with %s", r->factors[i].name, r->factors[k].name);
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

char *report_scenario_name(const shortest *s, size_t i)
{
    static const char *const words[CLASS_COUNT] = {
        [CLASS_DEGRADED] = "degraded", [CLASS_DETECTED] = "failed-detected",
        [CLASS_UNDETECTED] = "failed-undetected", [CLASS_TIMEOUT] = "time-out",
        [CLASS_CRASHED] = "crashed",
    };
    size_t number = 1;
    for (size_t k = 0; k < i; k++)
        number += s->list[k].class == s->list[i].class;
    const char *word = words[s->list[i].class];
    return memory_print("%s-%zu%s.yaml", word ? word : "row", number,
                        s->list[i].found.text.count > 0 ? "/rig" : "");
}

char *report_scenario_command(const shortest *s, size_t i, const char *file)
{
    const shortest_scenario *one = &s->list[i];
    buffer line = {.data = NULL};
    shellword_begin(&line, "canwire sim", file);
    if (one->found.has_seed)
        buffer_print(&line, " --seed %" PRIu64, one->seed);
    if (one->found.has_until)
        buffer_print(&line, " --until %sms", decimal(one->found.until_ns, 6).text);
    return memory_of_buffer(&line);
}

char *report_scenario_why(const shortest_scenario *one)
{
    buffer text = {.data = NULL};
    if (one->expectation)
        buffer_print(&text, ": %s", one->expectation);
    for (unsigned i = 0; i < DEGRADED_REASONS && !one->expectation; i++)
        if (one->degraded >> i & 1u)
            buffer_print(&text, "%s%s", buffer_length(&text) > 0 ? ", " : ": ",
                         class_reason_name(i));
    return memory_of_buffer(&text);
}

char *report_others_text(const shortest *s)
{
    if (s->others == 0)
        return NULL;
    return memory_print("%u more %s run again, and did not do the same. Have files changed since?",
                        s->others, s->others == 1 ? "was" : "were");
}

const char *report_scenario_state(const shortest_scenario *one)
{
    if (!one->found.tried)
        return ", not run again for lack of time";
    return one->found.whole ? ", minimised" : "";
}

char *report_scenario_text(const report *r, const shortest *s, size_t i)
{
    const shortest_scenario *one = &s->list[i];
    char *name = report_scenario_name(s, i);
    char *command = report_scenario_command(s, i, name);
    char *why = report_scenario_why(one);
    char *first = memory_print("%s%s", class_name(one->class), why);
    char *second = memory_print("%s %" PRIu64 " of %s%s", r->source.is_campaign ? "row" : "seed",
                                one->number, r->source.file, report_scenario_state(one));
    plain_make(first, '?'); /* an end of a line would end the comment */
    plain_make(second, '?');
    char *text = memory_print("# %s\n# %s\n# %s\n%s", first, second, command,
                              one->found.text.main);
    free(name);
    free(command);
    free(why);
    free(first);
    free(second);
    return text;
}

void report_each_dimension(FILE *out, const report_view *v, report_write_dimension *write)
{
    const report *r = v->report;
    if (r->expectations.count > 0)
        write(out, v, &r->expectations);
    if (r->lost.count > 0)
        write(out, v, &r->lost);
    for (size_t i = 0; i < r->group_count; i++)
        write(out, v, &r->groups[i]);
    for (size_t i = 0; i < r->factor_count; i++)
        write(out, v, &r->factors[i]);
}
