/* SPDX-License-Identifier: MIT
 *
 * live.c - the configuration that is in effect: the file's, with the present rules.
 */
#include "run/live.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct live {
    cfg now;  /* the configuration of the file with the rules below */
    cfg *file;
    cw_rule rules[CW_RULES_MAX];
    const char *names[CW_RULES_MAX]; /* of the rules */
    char *injected[CW_RULES_MAX]; /* names of our own; NULL for rules of the file */
    char guests[CW_NODES_MAX + 1][CFG_NODE_NAME_MAX + 1]; /* names of guests by number; "": own */
    char *own[CW_NODES_MAX]; /* names by node, as the file has them */
};

/* Takes the rules and nodes of a configuration. Guests that are here keep the names that they
 * brought. */
static void live_take(live *l, cfg *config)
{
    assert(config->rule_count <= CW_RULES_MAX);
    for (size_t i = 0; i < config->rule_count; i++) {
        l->rules[i] = config->rules[i];
        l->names[i] = config->rules[i].name;
    }
    l->file = config;
    l->now = *config;
    for (size_t i = config->guest_count + 1; i <= CW_NODES_MAX; i++)
        *l->guests[i] = '\0';
    for (size_t i = 0; i < config->node_count; i++) {
        l->own[i] = config->nodes[i].name;
        if (config->nodes[i].guest > 0 && *l->guests[config->nodes[i].guest])
            config->nodes[i].name = l->guests[config->nodes[i].guest];
    }
    l->now.rules = l->rules;
}

live *live_new(cfg *config)
{
    live *l = calloc(1, sizeof *l);
    if (l)
        live_take(l, config);
    return l;
}

void live_replace(live *l, cfg *config)
{
    while (l->now.rule_count > 0)
        live_remove(l, (unsigned)l->now.rule_count - 1);
    cfg_free(l->file);
    live_take(l, config);
}

void live_restart(live *l, uint64_t seed)
{
    for (unsigned i = 0; i < CW_RULES_MAX; i++) {
        free(l->injected[i]);
        l->injected[i] = NULL;
        l->names[i] = NULL;
    }
    for (size_t i = 0; i < l->file->node_count; i++)
        l->file->nodes[i].name = l->own[i];
    memset(l->guests, 0, sizeof l->guests);
    l->file->seed = seed;
    live_take(l, l->file);
}

void live_free(live *l)
{
    if (!l)
        return;
    for (unsigned i = 0; i < CW_RULES_MAX; i++)
        free(l->injected[i]);
    cfg_free(l->file);
    free(l);
}

const cfg *live_config(const live *l)
{
    return &l->now;
}

void live_name_guest(live *l, unsigned node, const char *name)
{
    assert(node < l->file->node_count);
    cfg_node *const guest = &l->file->nodes[node];
    char *const kept = l->guests[guest->guest];
    if (guest->guest == 0)
        return;
    (void)snprintf(kept, sizeof l->guests[0], "%s", name ? name : "");
    guest->name = *kept ? kept : l->own[node];
}

void live_set_time(live *l, unsigned node, const cfg_node_time *time)
{
    assert(node < l->file->node_count);
    l->file->nodes[node].time = *time;
}

cfg_running live_running(const live *l)
{
    return (cfg_running){.count = l->now.rule_count, .names = l->names};
}

bool live_find(const live *l, unsigned *index, const char *name)
{
    for (unsigned i = 0; i < l->now.rule_count; i++) {
        if (l->names[i] && strcmp(l->names[i], name) == 0) {
            *index = i;
            return true;
        }
    }
    return false;
}

bool live_is_injected(const live *l, unsigned index)
{
    return index < CW_RULES_MAX && l->injected[index];
}

void live_put(live *l, unsigned index, const cw_rule *rule, char *name)
{
    assert(index < CW_RULES_MAX && !l->names[index]);
    l->injected[index] = name;
    l->rules[index] = *rule;
    l->rules[index].name = name;
    l->names[index] = name;
    if (index >= l->now.rule_count)
        l->now.rule_count = index + 1u;
}

void live_remove(live *l, unsigned index)
{
    assert(index < l->now.rule_count);
    free(l->injected[index]);
    l->injected[index] = NULL;
    l->names[index] = NULL;
    l->rules[index] = (cw_rule){.name = NULL};
    for (size_t i = 0; i < l->now.rule_count; i++) /* another rule may have the index later */
        l->rules[i].has_after = l->rules[i].has_after && l->rules[i].after != index;
    while (l->now.rule_count > 0 && !l->names[l->now.rule_count - 1])
        l->now.rule_count--;
}
