/* SPDX-License-Identifier: MIT
 *
 * rules.c - fault rules and settings of buses in virtual time.
 */
#include "embed/embed.h"

#include "run/settings.h"

#include <stdlib.h>
#include <string.h>

/* Collects messages for a caller. Returns false without memory. */
static bool tell_begin(canwire_sim *sim, FILE **out, char **text, size_t *size)
{
    *text = NULL;
    *size = 0;
    *out = open_memstream(text, size);
    if (!*out)
        (void)embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
    return *out;
}

/* Hands the messages over. An error is noted, too. */
static int tell_end(canwire_sim *sim, FILE *out, char *const *text, const size_t *size, bool good,
                    char **messages)
{
    (void)fclose(out);
    const bool any = *text && *size > 0;
    if (!good && any)
        (void)embed_fail(sim, CANWIRE_SIM_INVALID, "%.*s", (int)(*size - 1), *text);
    if (messages)
        *messages = any ? *text : NULL;
    if (!messages || !any)
        free(*text);
    return good ? CANWIRE_SIM_OK : CANWIRE_SIM_INVALID;
}

int canwire_sim_inject(canwire_sim *sim, int bus, const char *text, size_t size, const char *name,
                       char **messages)
{
    FILE *out;
    char *told;
    size_t told_size;
    embed_bus *b = embed_find_bus(sim, bus);
    if (messages)
        *messages = NULL;
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (!tell_begin(sim, &out, &told, &told_size))
        return CANWIRE_SIM_NO_MEMORY;
    cfg_rules *rules = inputs_inject(&b->in, text, size, name, out);
    const bool good = rules;
    if (rules)
        fputs(rules->warnings, out);
    cfg_free_rules(rules);
    return tell_end(sim, out, &told, &told_size, good, messages);
}

int canwire_sim_expect(canwire_sim *sim, int bus, const char *text, size_t size, const char *name,
                       char **messages)
{
    FILE *out;
    char *told;
    size_t told_size;
    embed_bus *b = embed_find_bus(sim, bus);
    if (messages)
        *messages = NULL;
    if (!b)
        return CANWIRE_SIM_INVALID;
    if (!tell_begin(sim, &out, &told, &told_size))
        return CANWIRE_SIM_NO_MEMORY;
    cfg_expects *own = cfg_load_expects(text, size, name, b->config, out);
    bool good = own;
    if (own)
        fputs(own->warnings, out);
    if (own && !embed_judge_add(b, own)) {
        fputs("out of memory\n", out);
        cfg_free_expects(own);
        good = false;
    }
    return tell_end(sim, out, &told, &told_size, good, messages);
}

static int find_rule(canwire_sim *sim, const embed_bus *b, unsigned *index, const char *rule)
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
    if (find_rule(sim, b, &index, rule) != CANWIRE_SIM_OK)
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
    if (find_rule(sim, b, &index, rule) != CANWIRE_SIM_OK)
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

static int set(canwire_sim *sim, embed_bus *b, unsigned node, const json_t *object)
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
    const int status = set(sim, b, number, object);
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
