/* SPDX-License-Identifier: MIT
 *
 * inputs.c - all inputs of a running bus in one place, where they can be recorded.
 */
#include "run/inputs.h"

#include <stdlib.h>
#include <string.h>

void inputs_init(inputs *in, live *config, cw_bus *bus, inputs_drain *drain, void *user)
{
    *in = (inputs){.config = config, .bus = bus, .drain = drain, .drain_user = user};
}

void inputs_observe(inputs *in, input_observer *observer, void *user)
{
    in->observer = observer;
    in->observer_user = user;
}

void inputs_advance(inputs *in, uint64_t tick)
{
    in->advanced = true;
    while (cw_bus_advance(in->bus, tick) == CW_FULL)
        in->drain(in->drain_user);
    in->drain(in->drain_user);
}

bool inputs_advance_some(inputs *in, uint64_t tick, uint64_t work)
{
    const uint64_t begin = cw_bus_work(in->bus);
    uint64_t done;
    cw_status status;
    in->advanced = true;
    do {
        done = cw_bus_work(in->bus) - begin;
        status = cw_bus_advance_some(in->bus, tick, done < work ? work - done : 0);
        in->drain(in->drain_user);
    } while (status == CW_FULL && done < work);
    return status == CW_OK;
}

/* Tells the observer, which writes the journal, of an input that has just been made. */
static void note(inputs *in, input what)
{
    what.now = cw_bus_now(in->bus);
    what.advanced = in->advanced;
    in->advanced = false;
    if (in->observer)
        in->observer(in->observer_user, &what);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

cw_status inputs_send(inputs *in, unsigned node, const cw_frame *frame, uint64_t at_tick)
{
    cw_status status = cw_node_send(in->bus, node, frame, at_tick);
    if (status == CW_OK)
        note(in, (input){.kind = INPUT_SEND, .node = node, .frame = frame, .at_tick = at_tick});
    return status;
}

cw_status inputs_release(inputs *in, release_plan *plan)
{
    unsigned node;
    const uint64_t at_tick = release_next_tick(plan);
    const cw_frame *first = release_first(plan, &node);
    const cw_frame frame = first ? *first : (cw_frame){.id = 0};
    const bool determined = release_is_determined(plan);
    cw_status status = release_hand_in(plan, in->bus);
    if (first && status == CW_OK)
        note(in, (input){.kind = INPUT_SEND, .node = node, .frame = &frame,
                         .determined = determined, .at_tick = at_tick});
    return status;
}

/* ---- Rules ----------------------------------------------------------------------------------- */

/* Rules that are being injected. `after` names another one of them by base + its place; that rule
 * is on the bus already. */
typedef struct injection {
    inputs *in;
    const cfg_rules *rules;
    FILE *errors;
    size_t base;
    size_t added;
    unsigned index[CW_RULES_MAX]; /* indices of the added rules on the bus */
    char *names[CW_RULES_MAX];    /* copies of our own */
} injection;

static void free_names(injection *j)
{
    for (size_t i = 0; i < CW_RULES_MAX; i++)
        free(j->names[i]);
}

/* Copies the names before the bus is changed. Running out of memory later would undo a change, but
 * a run of the journal, which has the memory, would not. */
static bool copy_names(injection *j)
{
    for (size_t i = 0; i < j->rules->count && i < CW_RULES_MAX; i++) {
        j->names[i] = strdup(j->rules->rules[i].name);
        if (j->names[i])
            continue;
        free_names(j);
        fprintf(j->errors, "out of memory\n");
        return false;
    }
    return true;
}

/* Returns a rule whose `after` is an index of the bus. */
static cw_rule rule_of_bus(const injection *j, size_t i)
{
    cw_rule rule = j->rules->rules[i];
    if (rule.has_after && rule.after >= j->base)
        rule.after = (uint16_t)j->index[rule.after - j->base];
    return rule;
}

/* Adds rule i of an injection to the bus. Says in `errors` why the bus refuses it. */
static bool add_rule(injection *j, size_t i)
{
    const cw_rule rule = rule_of_bus(j, i);
    cw_status status = cw_bus_add_rule(j->in->bus, &j->index[i], &rule);
    if (status == CW_FULL)
        fprintf(j->errors, "rule %s: no more room, a bus has at most %d rules\n", rule.name,
                CW_RULES_MAX);
    else if (status != CW_OK)
        fprintf(j->errors, "rule %s: the bus does not take it\n", rule.name);
    return status == CW_OK;
}

/* Adds all rules of an injection. After a refusal `added` says how many are to be taken back. */
static bool add_rules(injection *j)
{
    if (j->rules->count > CW_RULES_MAX) {
        fprintf(j->errors, "at most %d rules\n", CW_RULES_MAX);
        return false;
    }
    while (j->added < j->rules->count && add_rule(j, j->added))
        j->added++;
    return j->added == j->rules->count;
}

static void take_back(injection *j)
{
    for (size_t i = 0; i < j->added; i++)
        (void)cw_bus_clear_rule(j->in->bus, j->index[i]);
}

/* Gives the rules on the bus their names, when none of them can be refused any more. */
static void name_rules(injection *j)
{
    for (size_t i = 0; i < j->added; i++) {
        const cw_rule rule = rule_of_bus(j, i);
        live_put(j->in->config, j->index[i], &rule, j->names[i]);
    }
}

cfg_rules *inputs_inject(inputs *in, const char *text, size_t size, const char *name, FILE *errors)
{
    cfg_running running = live_running(in->config);
    cfg_rules *rules =
        cfg_load_rules(text, size, name, live_config(in->config), &running, errors);
    if (!rules)
        return NULL;
    injection j = {.in = in,
                   .rules = rules,
                   .errors = errors,
                   .base = live_config(in->config)->rule_count};
    if (!copy_names(&j)) {
        cfg_free_rules(rules);
        return NULL;
    }
    bool good = add_rules(&j);
    if (good) {
        name_rules(&j);
    } else {
        take_back(&j);
        free_names(&j);
    }
    note(in, (input){.kind = INPUT_INJECT,
                     .text = text,
                     .size = size,
                     .name = name,
                     .refused = !good});
    if (good)
        return rules;
    cfg_free_rules(rules);
    return NULL;
}

void inputs_clear(inputs *in, unsigned rule)
{
    (void)cw_bus_clear_rule(in->bus, rule);
    note(in, (input){.kind = INPUT_CLEAR, .rule = live_config(in->config)->rules[rule].name});
    live_remove(in->config, rule);
}

cw_status inputs_fire(inputs *in, unsigned rule)
{
    cw_status status = cw_bus_fire_rule(in->bus, rule);
    if (status == CW_OK)
        note(in, (input){.kind = INPUT_FIRE, .rule = live_config(in->config)->rules[rule].name});
    return status;
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

cw_status inputs_restart(inputs *in, unsigned node)
{
    cw_status status = cw_node_restart(in->bus, node);
    if (status == CW_OK)
        note(in, (input){.kind = INPUT_RESTART, .node = node});
    return status;
}

cw_status inputs_set(inputs *in, unsigned node, const cw_settings *settings)
{
    char unused[RETIME_PROBLEM_MAX];
    return inputs_set_all(in, unused, node, settings, &(cfg_retime){.given = 0});
}

cw_status inputs_set_all(inputs *in, char problem[RETIME_PROBLEM_MAX], unsigned node,
                         const cw_settings *settings, const cfg_retime *time)
{
    cw_settings all = *settings;
    cfg_node_time changed;
    problem[0] = '\0';
    if (time->given &&
        !cfg_retime_node(&changed, &all, problem, live_config(in->config), node, time))
        return CW_INVALID;
    cw_status status = cw_node_set(in->bus, node, &all);
    if (status != CW_OK)
        return status;
    if (time->given)
        live_set_time(in->config, node, &changed);
    note(in, (input){.kind = INPUT_SET, .node = node, .settings = settings, .time = time});
    return status;
}

void inputs_attach(inputs *in, unsigned node, bool on)
{
    if (cw_node_attached(in->bus, node) == on)
        return;
    while (cw_node_attach(in->bus, node, on) == CW_FULL)
        in->drain(in->drain_user);
    note(in, (input){.kind = INPUT_ATTACH, .node = node, .on = on});
    in->drain(in->drain_user);
    if (!on && in->renaming)
        in->renaming(in->drain_user);
    if (!on)
        live_name_guest(in->config, node, NULL);
}

void inputs_attach_as(inputs *in, unsigned node, const char *name)
{
    if (cw_node_attached(in->bus, node))
        return;
    while (cw_node_attach(in->bus, node, true) == CW_FULL)
        in->drain(in->drain_user);
    note(in, (input){.kind = INPUT_ATTACH, .node = node, .on = true, .as = name});
    live_name_guest(in->config, node, name);
    in->drain(in->drain_user);
}

/* Returns the nodes whose frames come in real time. Traffic of the configuration comes in bus
 * time. */
static uint64_t nodes_with_ports(const cfg *config)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < config->node_count; i++)
        nodes |= (uint64_t)(config->nodes[i].port != NULL) << i;
    return nodes;
}

cw_event inputs_skip(inputs *in, uint64_t ticks, uint64_t earlier)
{
    cw_nodes_bring_forward(in->bus, nodes_with_ports(live_config(in->config)), earlier);
    note(in, (input){.kind = INPUT_SKIP, .skipped = ticks, .earlier = earlier});
    return (cw_event){.kind = CW_EVENT_SKIP, .tick = cw_bus_now(in->bus), .ticks = ticks};
}

/* ---- Reload ---------------------------------------------------------------------------------- */

/* Drops the frames of removed nodes, with events. */
static void flush_removed(inputs *in, const cfg *config, const uint8_t *from)
{
    uint64_t stay = 0;
    for (unsigned i = 0; i < config->node_count; i++)
        stay |= from[i] == CW_NO_NODE ? 0 : UINT64_C(1) << from[i];
    for (unsigned i = 0; i < live_config(in->config)->node_count; i++)
        while (!(stay >> i & 1u) && cw_node_flush(in->bus, i) == CW_FULL)
            in->drain(in->drain_user);
    in->drain(in->drain_user);
}

cw_status inputs_take_over(inputs *in, cw_bus *next, const cfg *config,
                           const uint8_t from[CW_NODES_MAX], uint64_t tick)
{
    flush_removed(in, config, from);
    cw_status status = cw_bus_take_over(next, in->bus, from);
    if (status != CW_OK)
        return status;
    note(in, (input){.kind = INPUT_RELOAD, .config = config, .at_tick = tick});
    in->bus = next;
    return CW_OK;
}
