/* SPDX-License-Identifier: MIT
 *
 * trial.c - runs a scenario once, in a process of its own: one that crashes or hangs ends alone.
 */
#include "campaign/report/trial.h"

#include "campaign/pool.h"
#include "campaign/report/memory.h"
#include "campaign/tally.h"

#include <stdlib.h>
#include <string.h>

#define UNWELL "unwell"

typedef struct trying {
    const trial *trial;
    const char *expectation;
    const row_signs *signs;
    trial_result result;
} trying;

static void begin_row(rowtext *row)
{
    rowtext_put(row, "{");
    rowtext_number(row, "seed", 0);
}

static void end_row(rowtext *row)
{
    rowtext_string(row, "repeat", "");
    rowtext_put(row, "}\n");
}

static scenario *open_scenario(const trial *t)
{
    const bundle_text *text = t->text;
    const cfg_file file = {.name = t->name, .text = text->main, .size = strlen(text->main)};
    scenario *s = scenario_open_rig(&file, text->buses, text->count, NULL);
    const bool good = s && (!t->has_until || !scenario_set_until(s, t->until)) &&
                      scenario_ends(s, "", NULL);
    if (good)
        return s;
    scenario_close(s);
    return NULL;
}

static void put_unwell(rowtext *out, const scenario_bus *b)
{
    for (uint64_t rest = b->seen.unwell; rest; rest &= rest - 1) {
        const unsigned node = (unsigned)__builtin_ctzll(rest);
        char *line = memory_print("%s:%s %u\n", b->config->bus_name, b->config->nodes[node].name,
                                  (unsigned)b->seen.spells[node]);
        rowtext_put(out, line);
        free(line);
    }
}

/* Rows have no such key. */
static void write_unwell(rowtext *row, const scenario *s)
{
    rowtext text = {.no_memory = false};
    for (size_t i = 0; i < s->count; i++)
        put_unwell(&text, &s->buses[i]);
    row->no_memory = row->no_memory || text.no_memory || !buffer_append(&text.bytes, "", 1);
    if (!row->no_memory)
        rowtext_string(row, UNWELL, buffer_first(&text.bytes));
    rowtext_free(&text);
}

static void write_result(rowtext *row, const scenario *s)
{
    write_unwell(row, s);
    (void)outcome_write(row, s);
}

static unsigned char make(void *user, uint64_t number, rowtext *row)
{
    const trying *y = user;
    scenario *s = open_scenario(y->trial);
    (void)number;
    begin_row(row);
    if (!s)
        outcome_write_none(row, OUTCOME_INVALID, "");
    else if (scenario_run(s, y->trial->has_seed ? &y->trial->seed : NULL))
        write_result(row, s);
    else
        (void)outcome_write_broken(row, s);
    scenario_close(s);
    end_row(row);
    return 0;
}

static unsigned char lose(void *user, uint64_t number, const pool_loss *loss, rowtext *row)
{
    (void)user;
    (void)number;
    begin_row(row);
    (void)tally_lost(row, loss);
    end_row(row);
    return 0;
}

static bool take(void *user, unsigned char code, const char *line, size_t length)
{
    trying *y = user;
    report_row row;
    (void)code;
    if (report_row_read(&row, line, length, y->signs))
        return true;
    y->result.class = row.class;
    y->result.degraded = row.class == CLASS_DEGRADED ? row.facts.degraded : 0;
    const char *unwell = json_string_value(json_object_get(row.object, UNWELL));
    y->result.unwell = unwell ? memory_text(unwell) : NULL;
    for (size_t i = 0; i < json_array_size(row.failed) && y->expectation; i++)
        y->result.failed = y->result.failed ||
                           strcmp(report_row_failed(&row, i), y->expectation) == 0;
    report_row_free(&row);
    return true;
}

trial_result trial_run(const trial *t, const char *expectation, const row_signs *signs)
{
    static const pool_calls calls = {.make = make, .lose = lose, .take = take};
    trying y = {.trial = t, .expectation = expectation, .signs = signs,
                .result.class = CLASS_BROKEN};
    const pool_work work = {.calls = &calls, .user = &y, .count = 1, .jobs = 1,
                            .limit_ms = t->limit_ms, .once = true};
    (void)pool_run(&work);
    return y.result;
}

void trial_result_free(trial_result *r)
{
    free(r->unwell);
    r->unwell = NULL;
}
