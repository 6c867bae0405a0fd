/* SPDX-License-Identifier: MIT
 *
 * rowcheck.c - whether the keys of a row with a result have values that canwire writes.
 */
#include "campaign/report/row.h"

#include <string.h>

/* A key that is missing, or has another value than its kind allows, and the message about it. */
typedef struct wanted_key {
    const char *key;
    size_t length;
    const char *message;
} wanted_key;

#define COUNTER(key) {key, sizeof key - 1, "`" key "`: expected an integer, 0 or more"}
#define COUNTER_OF_BUS(name) COUNTER(#name),
#define COUNTER_OF_NODE(key, member, count) COUNTER(#key),
#define WORD(key) {key, sizeof key - 1, "`first_error`: `" key "`: expected a text"}

static bool is_counter(const jsonread_value *value)
{
    uint64_t unused;
    return jsonread_uint(&unused, value);
}

static bool is_seconds(const jsonread_value *value)
{
    const bool number = jsonread_is(value, JSONREAD_INTEGER) || jsonread_is(value, JSONREAD_REAL);
    return number && (value->text[0] != '-' || jsonread_number(value) >= 0);
}

/* Returns the message about the first key that is not a counter, or NULL. canwire writes them in
 * the order of the keys, the first behind `last`. */
static const char *check_counters(const jsonread_value *object, const jsonread_value *last,
                                  const wanted_key *keys, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        last = jsonread_find(object, last, keys[i].key, keys[i].length);
        if (!is_counter(last))
            return keys[i].message;
    }
    return NULL;
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

static bool is_state(const char *name)
{
    for (unsigned i = 0; i < CW_STATE_COUNT && name; i++)
        if (strcmp(cw_state_name((cw_state)i), name) == 0)
            return true;
    return false;
}

/* Checks the state, and behind it the counters in the order in which canwire writes them. */
static const char *rowcheck_check_node(const jsonread_value *node)
{
    static const wanted_key counters[] = {
        COUNTER("tec"), COUNTER("rec"), COUNTER("tec_max"), COUNTER("rec_max"),
        OUTCOME_NODE_COUNTERS(COUNTER_OF_NODE)
    };
    const jsonread_value *state = jsonread_get(node, "state");
    if (!is_state(jsonread_string(state)))
        return "`nodes`: `state`: expected error-active, error-warning, error-passive, bus-off or "
               "sleeping";
    return check_counters(node, state, counters, sizeof counters / sizeof *counters);
}

/* Returns the message about the first node with a wrong value, or NULL. */
static const char *check_nodes(const jsonread_value *nodes)
{
    const char *wrong = NULL;
    for (const jsonread_value *n = jsonread_first(nodes); n && !wrong; n = jsonread_next(nodes, n))
        wrong = rowcheck_check_node(n);
    return wrong;
}

/* ---- Expectations ---------------------------------------------------------------------------- */

/* The outcome must agree with the list of failed expectations. */
static const char *check_expectations(const jsonread_value *expectations, outcome o)
{
    const jsonread_value *failed = jsonread_get(expectations, "failed");
    const jsonread_value *first = jsonread_first(failed);
    if (!is_counter(jsonread_get(expectations, "met")))
        return "`expectations`: `met`: expected an integer, 0 or more";
    for (const jsonread_value *f = first; f; f = jsonread_next(failed, f))
        if (!jsonread_string(jsonread_get(f, "name")))
            return "`expectations`: `failed`: expected a list of objects, each with its `name`";
    if (o == OUTCOME_PASSED && first)
        return "`outcome`: the row has passed, but `expectations` lists some that have failed";
    if (o == OUTCOME_FAILED && !first)
        return "`outcome`: the row has failed, but `expectations` lists none that has failed";
    return NULL;
}

/* ---- Times ----------------------------------------------------------------------------------- */

/* Checks the first error of a row: null, or its time and texts in the order in which canwire writes
 * them. */
static const char *check_error(const jsonread_value *error)
{
    static const wanted_key words[] = {WORD("node"), WORD("role"), WORD("type"), WORD("field")};
    const jsonread_value *last = jsonread_get(error, "t");
    if (jsonread_is(error, JSONREAD_NULL))
        return NULL;
    if (!is_seconds(last))
        return "`first_error`: `t`: expected seconds, 0 or more";
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        last = jsonread_find(error, last, words[i].key, words[i].length);
        if (!jsonread_string(last))
            return words[i].message;
    }
    return NULL;
}

/* A latency is within the run, and there is none without an error. */
static const char *check_times(const jsonread_value *row)
{
    const jsonread_value *end = jsonread_get(row, "t");
    const jsonread_value *latency = jsonread_get(row, "latency");
    if (!is_seconds(end))
        return "`t`: expected seconds, 0 or more";
    if (jsonread_is(latency, JSONREAD_NULL))
        return NULL;
    if (!is_seconds(latency))
        return "`latency`: expected seconds, 0 or more, or null";
    if (jsonread_number(latency) > jsonread_number(end))
        return "`latency`: it is longer than the run, whose end is `t`";
    if (jsonread_is(jsonread_get(row, "first_error"), JSONREAD_NULL))
        return "`latency`: there is no error, `first_error` is null";
    return NULL;
}

/* ---- Losses ---------------------------------------------------------------------------------- */

/* Each loss is one of a node or of a rule, not of both. */
static const char *check_losses(const jsonread_value *lost)
{
    if (lost && lost->kind != JSONREAD_LIST)
        return "`lost`: expected a list";
    for (const jsonread_value *l = jsonread_first(lost); l; l = jsonread_next(lost, l)) {
        const bool node = jsonread_string(jsonread_get(l, "node"));
        const bool rule = jsonread_string(jsonread_get(l, "rule"));
        if (!jsonread_string(jsonread_get(l, "why")) || node == rule)
            return "`lost`: expected objects, each with a `node` or a `rule`, and `why`";
    }
    return NULL;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

const char *rowcheck_result(const jsonread_value *row, outcome o)
{
    static const wanted_key counters[] = {OUTCOME_BUS_COUNTERS(COUNTER_OF_BUS)};
    const jsonread_value *end = jsonread_get(row, "t");
    const char *wrong = check_counters(row, end, counters, sizeof counters / sizeof *counters);
    if (!wrong)
        wrong = check_times(row);
    if (!wrong)
        wrong = check_error(jsonread_get(row, "first_error"));
    if (!wrong)
        wrong = check_nodes(jsonread_get(row, "nodes"));
    if (!wrong)
        wrong = check_losses(jsonread_get(row, "lost"));
    return wrong ? wrong : check_expectations(jsonread_get(row, "expectations"), o);
}
