/* SPDX-License-Identifier: MIT
 *
 * rowcheck.c - whether the keys of a row with a result have values that canwire writes.
 */
#include "campaign/report/rowcheck.h"

#include "base/text/jsonput.h"

#include <string.h>

/* A key that is missing, or has another value than its kind allows, and the message about it. */
typedef struct wanted_key {
    const char *key;
    const char *message;
} wanted_key;

#define COUNTER(key) {key, "`" key "`: expected an integer, 0 or more"}
#define COUNTER_OF_BUS(name) COUNTER(#name),
#define COUNTER_OF_NODE(key, member, count) COUNTER(#key),
#define WORD(key) {key, "`first_error`: `" key "`: expected a text"}

static bool is_counter(const json_t *value)
{
    return json_is_integer(value) && json_integer_value(value) >= 0;
}

static bool is_seconds(const json_t *value)
{
    return json_is_number(value) && json_number_value(value) >= 0;
}

/* Returns the message about the first key that is not a counter, or NULL. */
static const char *check_counters(const json_t *object, const wanted_key *keys, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!is_counter(json_object_get(object, keys[i].key)))
            return keys[i].message;
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

static const char *rowcheck_check_node(const json_t *node)
{
    static const wanted_key counters[] = {
        COUNTER("tec"), COUNTER("rec"), COUNTER("tec_max"), COUNTER("rec_max"),
        OUTCOME_NODE_COUNTERS(COUNTER_OF_NODE)
    };
    if (!is_state(get_text(node, "state")))
        return "`nodes`: `state`: expected error-active, error-warning, error-passive, bus-off or "
               "sleeping";
    return check_counters(node, counters, sizeof counters / sizeof *counters);
}

static const char *check_nodes(const json_t *nodes)
{
    const char *wrong = NULL;
    for (void *at = json_object_iter((json_t *)nodes); at && !wrong;
         at = json_object_iter_next((json_t *)nodes, at))
        wrong = rowcheck_check_node(json_object_iter_value(at));
    return wrong;
}

/* ---- Expectations ---------------------------------------------------------------------------- */

static const char *check_expectations(const json_t *expectations, outcome o)
{
    const json_t *failed = json_object_get(expectations, "failed");
    if (!is_counter(json_object_get(expectations, "met")))
        return "`expectations`: `met`: expected an integer, 0 or more";
    for (size_t i = 0; i < json_array_size(failed); i++)
        if (!json_is_string(json_object_get(json_array_get(failed, i), "name")))
            return "`expectations`: `failed`: expected a list of objects, each with its `name`";
    if (o == OUTCOME_PASSED && json_array_size(failed) > 0)
        return "`outcome`: the row has passed, but `expectations` lists some that have failed";
    if (o == OUTCOME_FAILED && json_array_size(failed) == 0)
        return "`outcome`: the row has failed, but `expectations` lists none that has failed";
    return NULL;
}

/* ---- Times ----------------------------------------------------------------------------------- */

static const char *check_error(const json_t *error)
{
    static const wanted_key words[] = {WORD("node"), WORD("role"), WORD("type"), WORD("field")};
    if (json_is_null(error))
        return NULL;
    if (!is_seconds(json_object_get(error, "t")))
        return "`first_error`: `t`: expected seconds, 0 or more";
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (!json_is_string(json_object_get(error, words[i].key)))
            return words[i].message;
    return NULL;
}

static const char *check_times(const json_t *row)
{
    const json_t *end = json_object_get(row, "t");
    const json_t *latency = json_object_get(row, "latency");
    if (!is_seconds(end))
        return "`t`: expected seconds, 0 or more";
    if (json_is_null(latency))
        return NULL;
    if (!is_seconds(latency))
        return "`latency`: expected seconds, 0 or more, or null";
    if (json_number_value(latency) > json_number_value(end))
        return "`latency`: it is longer than the run, whose end is `t`";
    if (json_is_null(json_object_get(row, "first_error")))
        return "`latency`: there is no error, `first_error` is null";
    return NULL;
}

/* ---- Losses ---------------------------------------------------------------------------------- */

static const char *check_losses(const json_t *lost)
{
    if (lost && !json_is_array(lost))
        return "`lost`: expected a list";
    for (size_t i = 0; i < json_array_size(lost); i++) {
        const json_t *l = json_array_get(lost, i);
        const bool node = json_is_string(json_object_get(l, "node"));
        const bool rule = json_is_string(json_object_get(l, "rule"));
        if (!json_is_string(json_object_get(l, "why")) || node == rule)
            return "`lost`: expected objects, each with a `node` or a `rule`, and `why`";
    }
    return NULL;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

const char *rowcheck_result(const json_t *row, outcome o)
{
    static const wanted_key counters[] = {OUTCOME_BUS_COUNTERS(COUNTER_OF_BUS)};
    const char *wrong = check_counters(row, counters, sizeof counters / sizeof *counters);
    if (!wrong)
        wrong = check_times(row);
    if (!wrong)
        wrong = check_error(json_object_get(row, "first_error"));
    if (!wrong)
        wrong = check_nodes(json_object_get(row, "nodes"));
    if (!wrong)
        wrong = check_losses(json_object_get(row, "lost"));
    return wrong ? wrong : check_expectations(json_object_get(row, "expectations"), o);
}
