/* SPDX-License-Identifier: MIT
 *
 * row.c - reads a row of `canwire campaign run` or of `canwire sim --seeds`.
 */
#include "campaign/report/row.h"

#include "campaign/report/memory.h"

#include <string.h>

#define NO_ROW "it is no row of canwire campaign run or canwire sim --seeds"

/* ---- Values ---------------------------------------------------------------------------------- */

/* Returns seconds as nanoseconds, rounded; 0 for other values. */
static uint64_t ns_of(const jsonread_value *value)
{
    const double ns = jsonread_number(value) * 1e9 + 0.5;
    return ns > 0 && ns < 0x1p63 ? (uint64_t)ns : 0;
}

/* Returns a count; 0 when there is none. */
static uint64_t row_count(const jsonread_value *value)
{
    uint64_t count = 0;
    return jsonread_uint(&count, value) ? count : 0;
}

/* Returns false for a name that is unknown, or NULL. */
static bool find_outcome(outcome *out, const char *name)
{
    for (unsigned i = 0; i < OUTCOME_COUNT && name; i++) {
        *out = (outcome)i;
        if (strcmp(outcome_name(*out), name) == 0)
            return true;
    }
    return false;
}

/* ---- Facts ----------------------------------------------------------------------------------- */

bool row_signs_has(const row_signs *signs, const char *name)
{
    for (size_t i = 0; i < signs->count; i++)
        if (strcmp(signs->names[i], name) == 0)
            return true;
    return false;
}

/* Returns true when the expectation with this name is among the failed ones. */
static bool has_failed(const report_row *row, const char *name)
{
    const jsonread_value *failed = jsonread_first(row->failed);
    for (; failed; failed = jsonread_next(row->failed, failed))
        if (strcmp(row_failed_name(failed), name) == 0)
            return true;
    return false;
}

/* A failed expectation is a failure unless it is a sign of detection. A sign that is met announces
 * the fault. */
static void judge_expectations(report_row *row, const row_signs *signs)
{
    const jsonread_value *failed = jsonread_first(row->failed);
    for (; failed; failed = jsonread_next(row->failed, failed))
        row->facts.failed = row->facts.failed || !row_signs_has(signs, row_failed_name(failed));
    for (size_t i = 0; i < signs->count; i++)
        row->facts.announced = row->facts.announced || !has_failed(row, signs->names[i]);
}

/* Returns true when a counter is not 0. */
static bool is_counted(const jsonread_value *all, const char *key)
{
    return row_count(jsonread_get(all, key)) > 0;
}

/* Finds counters of a node in the order in which they are written. */
static void judge_node(class_facts *f, const jsonread_value *node)
{
    static const struct {
        const char *key;
        unsigned degraded;
    } counters[] = {{"dropped", DEGRADED_DROPPED}, {"rx_dropped", DEGRADED_DROPPED},
                    {"error_passive", DEGRADED_PASSIVE}, {"bus_off", DEGRADED_BUS_OFF}};
    const char *state = jsonread_string(jsonread_get(node, "state"));
    const jsonread_value *last = NULL;
    if (!state || strcmp(state, "error-active") != 0)
        f->degraded |= DEGRADED_STATE;
    for (size_t i = 0; i < sizeof counters / sizeof *counters; i++) {
        last = jsonread_find(node, last, counters[i].key, strlen(counters[i].key));
        f->degraded |= row_count(last) > 0 ? counters[i].degraded : 0u;
    }
}

/* Reads what only a scenario with a result has. Returns what is wrong, or NULL. */
static const char *read_result(report_row *row, const row_signs *signs)
{
    const jsonread_value *all = row->object;
    const jsonread_value *nodes = jsonread_get(all, "nodes");
    const jsonread_value *latency = jsonread_get(all, "latency");
    const jsonread_value *error = jsonread_get(all, "first_error");
    class_facts *f = &row->facts;
    row->failed = jsonread_get(jsonread_get(all, "expectations"), "failed");
    if (!jsonread_is(row->failed, JSONREAD_LIST) || !jsonread_is(nodes, JSONREAD_OBJECT) ||
        !latency || !error || !jsonread_get(all, "faults"))
        return NO_ROW ": keys are missing";
    const char *wrong = rowcheck_result(all, row->facts.outcome);
    if (wrong)
        return wrong;
    row->first_error = jsonread_is(error, JSONREAD_OBJECT) ? error : NULL;
    row->lost = jsonread_get(all, "lost");
    row->has_latency = latency->kind != JSONREAD_NULL;
    row->latency_ns = ns_of(latency);
    row->end_ns = ns_of(jsonread_get(all, "t"));
    f->hit = is_counted(all, "faults");
    f->error = row->first_error != NULL || is_counted(all, "error_frames");
    f->error_after_hit = row->has_latency;
    f->degraded = is_counted(all, "undetected_errors") ? DEGRADED_UNDETECTED : 0u;
    for (const jsonread_value *n = jsonread_first(nodes); n; n = jsonread_next(nodes, n))
        judge_node(f, n);
    judge_expectations(row, signs);
    return NULL;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Reads what each row has. A row of a campaign has number and factors; one of `canwire sim --seeds`
 * has neither. Returns what is wrong, or NULL. */
static const char *read_keys(report_row *row, const row_signs *signs)
{
    const jsonread_value *all = row->object;
    const jsonread_value *number = jsonread_get(all, "number");
    row->factors = jsonread_get(all, "factors");
    row->repeat = jsonread_string(jsonread_get(all, "repeat"));
    row->has_number = jsonread_uint(&row->number, number);
    if (!jsonread_is(all, JSONREAD_OBJECT) || !row->repeat ||
        !jsonread_uint(&row->seed, jsonread_get(all, "seed")) || !number != !row->factors ||
        (number && (!row->has_number || !jsonread_is(row->factors, JSONREAD_OBJECT))))
        return NO_ROW;
    if (!find_outcome(&row->facts.outcome, jsonread_string(jsonread_get(all, "outcome"))))
        return NO_ROW ": it has no outcome that is known";
    if (row->facts.outcome != OUTCOME_PASSED && row->facts.outcome != OUTCOME_FAILED)
        return NULL;
    return read_result(row, signs);
}

const char *report_row_read(report_row *out, jsonread *reader, const char *line, size_t length,
                            const row_signs *signs)
{
    jsonread_problem problem;
    *out = (report_row){.object = memory_json(reader, &problem, line, length)};
    if (problem == JSONREAD_TWICE)
        return NO_ROW ": a key is there twice";
    if (!out->object || out->object->kind < JSONREAD_LIST)
        return NO_ROW ": it is no JSON";
    const char *wrong = read_keys(out, signs);
    out->class = wrong ? CLASS_BROKEN : class_of(&out->facts);
    return wrong;
}
