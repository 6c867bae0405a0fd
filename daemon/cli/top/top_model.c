/* SPDX-License-Identifier: MIT
 *
 * top_model.c - what canwire top knows of a bus: numbers of its last status, and rates.
 */
#include "cli/top/top_model.h"

#include "base/text/jsonput.h"
#include "base/text/plain.h"

#include <stdio.h>
#include <string.h>

#define MILLI_PER_SECOND_NS INT64_C(1000000000000) /* for rates in thousandths a second */

static void take_text(char text[TOP_NAME_MAX], const char *from)
{
    (void)snprintf(text, TOP_NAME_MAX, "%s", from ? from : "?");
    plain_make(text, '?');
}

static void take_key(char text[TOP_NAME_MAX], const json_t *object, const char *key)
{
    take_text(text, get_text(object, key));
}

/* Takes the value of a counter after that time. NULL: there was no value before. */
static top_counter top_model_count(int64_t value, const top_counter *before, int64_t passed_ns)
{
    top_counter c = {.value = value};
    if (before && passed_ns > 0 && value > before->value)
        c.rate = (int64_t)((double)(value - before->value) * (double)MILLI_PER_SECOND_NS /
                           (double)passed_ns + 0.5);
    return c;
}

/* ---- Nodes and rules ------------------------------------------------------------------------- */

/* Returns the node by its name, since a reload may change its number; NULL: it is new. */
static const top_node *top_model_find_node(const top_model *m, const char *name)
{
    for (unsigned i = 0; i < m->node_count; i++)
        if (strcmp(m->nodes[i].name, name) == 0)
            return &m->nodes[i];
    return NULL;
}

/* Returns the rule by its name, in the same way. */
static const top_rule *top_model_find_rule(const top_model *m, const char *name)
{
    for (unsigned i = 0; i < m->rule_count; i++)
        if (strcmp(m->rules[i].name, name) == 0)
            return &m->rules[i];
    return NULL;
}

/* Takes a node out of the status. A rate needs the counters of the same node before, found by its
 * name. */
static void take_node(top_node *n, const json_t *node, const top_model *before, int64_t passed_ns)
{
    const json_t *link = json_object_get(node, "link");
    const char *gone = json_string_value(link);
    take_key(n->name, node, "name");
    take_key(n->state, node, "state");
    if (gone && strcmp(gone, "up") != 0) {
        (void)snprintf(n->state, sizeof n->state, "link ");
        (void)snprintf(n->state + 5, sizeof n->state - 5, "%.40s", gone);
        plain_make(n->state, '?');
    }
    const top_node *old = top_model_find_node(before, n->name);
    n->tec = get_number(node, "tec");
    n->rec = get_number(node, "rec");
    n->tx = top_model_count(get_number(node, "tx_frames"), old ? &old->tx : NULL, passed_ns);
    n->rx = top_model_count(get_number(node, "rx_frames"), old ? &old->rx : NULL, passed_ns);
    n->errors =
        top_model_count(get_number(node, "bus_errors"), old ? &old->errors : NULL, passed_ns);
    n->delay_max_ns = get_number(json_object_get(node, "delay"), "max_ns");
}

/* Returns a word for the state of a rule. */
static const char *rule_state(const json_t *rule)
{
    if (json_is_true(json_object_get(rule, "active")))
        return "active";
    if (json_is_true(json_object_get(rule, "over")))
        return "over";
    return json_is_true(json_object_get(rule, "manual")) ? "manual" : "waiting";
}

/* Takes a rule out of the list. A new one has no rate yet. */
static void take_rule(top_rule *t, const json_t *rule, const top_model *before, int64_t passed_ns)
{
    take_key(t->name, rule, "name");
    take_key(t->action, rule, "action");
    take_text(t->state, rule_state(rule));
    t->injected = json_is_true(json_object_get(rule, "injected"));
    const top_rule *old = top_model_find_rule(before, t->name);
    t->hits = top_model_count(get_number(rule, "hits"), old ? &old->hits : NULL, passed_ns);
}

/* Takes the rules for which there is room; others are not shown. */
static void take_rules(top_model *m, const json_t *faults, const top_model *before,
                       int64_t passed_ns)
{
    const size_t rules = json_array_size(faults);
    m->rule_count = (unsigned)(rules < TOP_RULES_MAX ? rules : TOP_RULES_MAX);
    for (unsigned i = 0; i < m->rule_count; i++)
        take_rule(&m->rules[i], json_array_get(faults, i), before, passed_ns);
}

/* ---- The bus --------------------------------------------------------------------------------- */

static top_model last; /* the one before: too large for a stack */

void top_model_take(top_model *m, const json_t *status, const json_t *faults)
{
    const json_t *bus = json_object_get(status, "bus");
    const json_t *nodes = json_object_get(status, "nodes");
    const size_t count_of_nodes = json_array_size(nodes);
    last = *m;
    *m = (top_model){
        .known = true, .pid = get_number(status, "pid"), .time_ns = get_number(bus, "time_ns")};
    int64_t passed_ns = m->time_ns - last.time_ns;
    const bool same = last.known && last.pid == m->pid && passed_ns >= 0;
    if (!same)
        last = (top_model){.known = false};
    passed_ns = same ? passed_ns : 0;
    take_key(m->name, bus, "name");
    m->bitrate = get_number(bus, "bitrate");
    m->load_permille = get_number(bus, "load_second_permille");
    m->lag_ns = get_number(bus, "lag_ns");
    m->frames = top_model_count(get_number(bus, "frames"), &last.frames, passed_ns);
    m->errors = top_model_count(get_number(bus, "error_frames"), &last.errors, passed_ns);
    m->faults = top_model_count(get_number(bus, "faults"), &last.faults, passed_ns);
    m->node_count = (unsigned)(count_of_nodes < TOP_NODES_MAX ? count_of_nodes : TOP_NODES_MAX);
    for (unsigned i = 0; i < m->node_count; i++)
        take_node(&m->nodes[i], json_array_get(nodes, i), &last, passed_ns);
    take_rules(m, faults, &last, passed_ns);
}
