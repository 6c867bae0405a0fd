/* SPDX-License-Identifier: MIT
 *
 * rules.c - fault rules and settings of buses in virtual time.
 */
#include "embed/embed.h"

#include "run/settings.h"

#include <string.h>

/* Does something with a text at a bus, and tells of it. Returns false when the text is wrong. */
typedef bool use_text(embed_bus *b, const char *text, size_t size, const char *name, FILE *told);

/* Uses a text. An error is told, and noted. */
static int take_text(canwire_sim *sim, int bus, use_text *use, const char *text, size_t size,
                     const char *name, char **messages)
{
    memo t;
    embed_bus *b = embed_find_bus(sim, bus);
    int status = CANWIRE_SIM_OK;
    if (messages)
        *messages = NULL;
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (!memo_begin(&t))
        return embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
    const bool good = use(b, text, size, name, t.out);
    (void)memo_text(&t);
    if (!good)
        status = t.size > 0 ? embed_fail(sim, CANWIRE_SIM_INVALID, "%.*s", (int)(t.size - 1),
                                         t.text)
                            : CANWIRE_SIM_INVALID;
    embed_tell_end(&t, messages);
    return status;
}

/* Adds rules to a running bus. Warnings are told, also when all is well. */
static bool inject(embed_bus *b, const char *text, size_t size, const char *name, FILE *told)
{
    cfg_rules *rules = inputs_inject(&b->in, text, size, name, told);
    const bool good = rules;
    if (rules)
        fputs(rules->warnings, told);
    cfg_free_rules(rules);
    return good;
}

int canwire_sim_inject(canwire_sim *sim, int bus, const char *text, size_t size, const char *name,
                       char **messages)
{
    return take_text(sim, bus, inject, text, size, name, messages);
}

/* Adds expectations, which then belong to the judge of the bus. */
static bool rules_judge(embed_bus *b, const char *text, size_t size, const char *name, FILE *told)
{
    cfg_expects *own = cfg_load_expects(text, size, name, b->config, told);
    if (!own)
        return false;
    fputs(own->warnings, told);
    if (embed_judge_add(b, own))
        return true;
    fputs("out of memory\n", told);
    cfg_free_expects(own);
    return false;
}

int canwire_sim_expect(canwire_sim *sim, int bus, const char *text, size_t size, const char *name,
                       char **messages)
{
    return take_text(sim, bus, rules_judge, text, size, name, messages);
}

static int rules_find_rule(canwire_sim *sim, const embed_bus *b, unsigned *index, const char *rule)
{
    if (live_find(b->live, index, rule))
        return CANWIRE_SIM_OK;
    return embed_fail(sim, CANWIRE_SIM_REFUSED, "there is no rule '%s'", rule);
}

static void clear_injected(embed_bus *b)
{
    for (unsigned i = (unsigned)b->config->rule_count; i-- > 0;)
        if (live_is_injected(b->live, i))
            inputs_clear(&b->in, i);
}

int canwire_sim_clear(canwire_sim *sim, int bus, const char *rule)
{
    unsigned index;
    embed_bus *b = embed_find_bus(sim, bus);
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (!rule) {
        clear_injected(b);
        return CANWIRE_SIM_OK;
    }
    if (rules_find_rule(sim, b, &index, rule) != CANWIRE_SIM_OK)
        return CANWIRE_SIM_REFUSED;
    inputs_clear(&b->in, index);
    return CANWIRE_SIM_OK;
}

int canwire_sim_fire(canwire_sim *sim, int bus, const char *rule)
{
    unsigned index;
    embed_bus *b = embed_find_bus(sim, bus);
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (rules_find_rule(sim, b, &index, rule) != CANWIRE_SIM_OK)
        return CANWIRE_SIM_REFUSED;
    if (inputs_fire(&b->in, index) == CW_OK)
        return CANWIRE_SIM_OK;
    return embed_fail(sim, CANWIRE_SIM_REFUSED, "rule %s is finished, or has no `manual: yes`",
                      rule);
}

const char *canwire_sim_rule_name(const canwire_sim *sim, int bus, int rule)
{
    if (bus < 0 || (size_t)bus >= sim->count || rule < 0)
        return NULL;
    const cfg *config = sim->buses[bus].config;
    return (size_t)rule < config->rule_count ? config->rules[rule].name : NULL;
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

int canwire_sim_restart(canwire_sim *sim, int node)
{
    unsigned number;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (inputs_restart(&b->in, number) == CW_OK)
        return CANWIRE_SIM_OK;
    return embed_fail(sim, CANWIRE_SIM_REFUSED, "%s: not bus-off, or it restarts by itself",
                      b->config->nodes[number].name);
}

/* Changes settings of a node, all of them or, with a message, none. */
static int rules_set(canwire_sim *sim, embed_bus *b, unsigned node, const json_t *object)
{
    cw_settings settings = {.which = 0};
    cfg_retime time = {.given = 0};
    char error[SETTINGS_ERROR_MAX];
    char problem[RETIME_PROBLEM_MAX];
    if (!settings_from_json(&settings, &time, error, object))
        return embed_fail(sim, CANWIRE_SIM_INVALID, "%s", error);
    if (inputs_set_all(&b->in, problem, node, &settings, &time) == CW_OK)
        return CANWIRE_SIM_OK;
    return embed_fail(sim, CANWIRE_SIM_INVALID, "%s",
                      *problem ? problem : "these settings do not go together");
}

int canwire_sim_set(canwire_sim *sim, int node, const char *json)
{
    unsigned number;
    json_error_t wrong;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    json_t *object = json_loads(json, JSON_REJECT_DUPLICATES, &wrong);
    if (!object)
        return embed_fail(sim, CANWIRE_SIM_INVALID, "this is not JSON: %s", wrong.text);
    const int status = rules_set(sim, b, number, object);
    json_decref(object);
    return status;
}

int canwire_sim_attach(canwire_sim *sim, int node, int on)
{
    unsigned number;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    inputs_attach(&b->in, number, on != 0);
    return CANWIRE_SIM_OK;
}
