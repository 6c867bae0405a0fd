/* SPDX-License-Identifier: MIT
 *
 * trial.c - runs a scenario once, in a process of its own: one that crashes or hangs ends alone.
 */
#include "campaign/report/trial.h"

#include "base/text/jsontext.h"
#include "campaign/pool.h"
#include "campaign/report/memory.h"
#include "campaign/tally.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define SPELLS "spells"

typedef struct trying {
    jsonread reader;
    const trial *trial;
    const char *expectation;
    const row_signs *signs;
    trial_result result;
} trying;

static void begin_row(buffer *row)
{
    buffer_put(row, "{");
    jsontext_number(row, "seed", 0);
}

static void end_row(buffer *row)
{
    jsontext_string(row, "repeat", "");
    buffer_put(row, "}\n");
}

/* Opens the scenario in silence. NULL: what is left of it is not valid, or has no end. */
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

/* Adds the spells of nodes that have had one, as trial.h defines them. */
static void put_spells(buffer *out, const scenario_bus *b)
{
    const observation *seen = &b->seen;
    for (size_t i = 0; i < b->config->node_count; i++) {
        const bool unwell = seen->unwell >> i & 1u;
        if (!unwell && seen->back_tick[i] == 0)
            continue;
        char *key = memory_print("%s:%s", b->config->bus_name, b->config->nodes[i].name);
        jsontext_key(out, key);
        buffer_print(out, "[%" PRId64 ",%" PRId64 "]",
                     unwell ? (int64_t)seen->left_tick[i] : -1, (int64_t)seen->back_tick[i]);
        free(key);
    }
}

/* Rows have no such key. */
static void write_spells(buffer *row, const scenario *s)
{
    jsontext_value(row, SPELLS, "{");
    for (size_t i = 0; i < s->count; i++)
        put_spells(row, &s->buses[i]);
    buffer_put(row, "}");
}

static void write_result(buffer *row, const scenario *s)
{
    write_spells(row, s);
    (void)outcome_write(row, s);
}

/* Writes a row like that of a campaign, so that the same reader judges it. */
static unsigned char trial_make(void *user, uint64_t number, buffer *row)
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

/* A trial that crashes or takes too long has such a row: that may be the class to be kept. */
static unsigned char trial_lose(void *user, uint64_t number, const pool_loss *loss, buffer *row)
{
    (void)user;
    (void)number;
    begin_row(row);
    (void)tally_lost(row, loss);
    end_row(row);
    return 0;
}

/* Takes class and spells from the row, and notes when it misses the expectation. A row that cannot
 * be read says nothing. */
static bool trial_take(void *user, unsigned char code, const char *line, size_t length)
{
    trying *y = user;
    report_row row;
    (void)code;
    if (report_row_read(&row, &y->reader, line, length, y->signs))
        return true;
    y->result.class = row.class;
    y->result.degraded = row.class == CLASS_DEGRADED ? row.facts.degraded : 0;
    const jsonread_value *spells = jsonread_get(row.object, SPELLS);
    if (spells)
        y->result.spells = json_loadb(spells->text, spells->length, 0, NULL);
    const jsonread_value *failed = y->expectation ? jsonread_first(row.failed) : NULL;
    for (; failed; failed = jsonread_next(row.failed, failed))
        y->result.failed = y->result.failed ||
                           strcmp(row_failed_name(failed), y->expectation) == 0;
    return true;
}

trial_result trial_run(const trial *t, const char *expectation, const row_signs *signs)
{
    static const pool_calls calls = {.make = trial_make, .lose = trial_lose, .take = trial_take};
    trying y = {.trial = t, .expectation = expectation, .signs = signs,
                .result.class = CLASS_BROKEN};
    const pool_work work = {.calls = &calls, .user = &y, .count = 1, .jobs = 1,
                            .limit_ms = t->limit_ms, .once = true};
    (void)pool_run(&work);
    jsonread_free(&y.reader);
    return y.result;
}

void trial_result_free(trial_result *r)
{
    json_decref(r->spells);
    r->spells = NULL;
}

bool trial_ends_like(const trial_result *r, const json_t *before)
{
    const char *node;
    json_t *spell;
    bool good = true;
    json_object_foreach(r->spells, node, spell) {
        const json_int_t begin = json_integer_value(json_array_get(spell, 0));
        const json_t *old = json_object_get(before, node);
        good = good && (begin < 0 || begin >= json_integer_value(json_array_get(old, 1)));
    }
    return good;
}
