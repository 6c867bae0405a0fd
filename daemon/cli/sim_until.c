/* SPDX-License-Identifier: MIT
 *
 * sim_until.c - ends a run with an event: [NODE:]KIND[:WHICH].
 */
#include "sim_until.h"

#include <string.h>

static const char expected[] =
    "expected [NODE:]EVENT, an event of 'canwire watch' (error, rx, tx, drop, restart, overload, "
    "arbitration-lost, state), a state (error-active, error-warning, error-passive, bus-off), "
    "tx:FILTER or the like for frames, or fault[:RULE]";

/* Events with a frame: a filter may follow. */
#define FRAME_KINDS                                                                                \
    (1u << CW_EVENT_RX | 1u << CW_EVENT_TX | 1u << CW_EVENT_DROP | 1u << CW_EVENT_ARBITRATION_LOST)

static bool fail(const char *text, const char *problem)
{
    fprintf(stderr, "canwire sim: --until-event %s: %s\n", text, problem);
    return false;
}

static bool same(const char *word, size_t length, const char *name)
{
    return strlen(name) == length && strncmp(word, name, length) == 0;
}

/* The kind or the state that a word is; false when it is none. */
static bool find_kind(sim_until *u, const char *word, size_t length)
{
    for (unsigned kind = 0; kind < CW_EVENT_COUNT; kind++) {
        const char *name = cw_event_name((cw_event_kind)kind);
        if (kind == CW_EVENT_TOLERATED || !same(word, length, name))
            continue;
        u->kinds = 1u << kind;
        u->states = UINT32_MAX;
        return true;
    }
    for (unsigned state = 0; state < CW_STATE_COUNT; state++) {
        if (!same(word, length, cw_state_name((cw_state)state)))
            continue;
        u->kinds = 1u << CW_EVENT_STATE;
        u->states = 1u << state;
        return true;
    }
    return false;
}

static int find_node(const cfg *config, const char *word, size_t length)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (same(word, length, config->nodes[i].name))
            return (int)i;
    return -1;
}

static bool find_rule(sim_until *u, const char *name)
{
    const cfg *config = u->run->config;
    for (size_t i = 0; i < config->rule_count; i++)
        if (config->rules[i].name && strcmp(config->rules[i].name, name) == 0)
            u->rule = name;
    return u->rule || fail(u->text, "there is no such rule");
}

/* What stands behind the kind: which rule, or which frames. */
static bool read_which(sim_until *u, const char *which)
{
    if (u->kinds & 1u << CW_EVENT_FAULT)
        return find_rule(u, which);
    if (!(u->kinds & FRAME_KINDS))
        return fail(u->text, expected);
    const char *problem =
        text_parse_filters(u->filters, &u->filter_count, CW_RULE_FILTERS_MAX, which);
    return !problem || fail(u->text, problem);
}

/* "KIND" or "KIND:WHICH" */
static bool read_kind(sim_until *u, const char *text)
{
    size_t length = strcspn(text, ":");
    if (!find_kind(u, text, length))
        return fail(u->text, expected);
    return text[length] == '\0' || read_which(u, text + length + 1);
}

/* A node first, if there is one of that name and something follows. */
static bool read_event(sim_until *u, const char *text)
{
    size_t length = strcspn(text, ":");
    sim_until probe = *u;
    int node = text[length] == ':' ? find_node(u->run->config, text, length) : -1;
    const char *rest = text + length + 1;
    if (node < 0 || !find_kind(&probe, rest, strcspn(rest, ":")))
        return read_kind(u, text);
    if (probe.kinds & 1u << CW_EVENT_FAULT)
        return fail(u->text, "faults are events of the bus, not of a node");
    u->nodes = UINT64_C(1) << node;
    return read_kind(u, rest);
}

static bool is_awaited(const sim_until *u, const cw_event *event)
{
    if (!(u->kinds >> event->kind & 1u))
        return false;
    if (event->kind == CW_EVENT_FAULT)
        return !u->rule || strcmp(u->run->config->rules[event->rule].name, u->rule) == 0;
    if (event->kind == CW_EVENT_STATE && !(u->states >> event->state & 1u))
        return false;
    if ((FRAME_KINDS >> event->kind & 1u) &&
        !cw_frame_matches(&event->frame, u->filters, u->filter_count))
        return false;
    return event->nodes & u->nodes;
}

static void look_at_event(void *user, const cw_event *event)
{
    sim_until *u = user;
    if (u->happened || !is_awaited(u, event))
        return;
    u->happened = true;
    sim_stop(u->run, event->tick);
}

bool sim_until_start(sim_until *u, const char *text, sim_run *run)
{
    const sim_sink sink = {.user = u, .event = look_at_event};
    *u = (sim_until){.text = text, .run = run, .nodes = UINT64_MAX};
    if (!text)
        return true;
    if (!read_event(u, text))
        return false;
    sim_may_stop(run);
    sim_add_sink(run, &sink);
    return true;
}

void sim_until_change(sim_until *u)
{
    sim_until again = {.text = u->text, .run = u->run, .nodes = UINT64_MAX};
    if (!u->text || u->happened)
        return;
    if (!read_event(&again, u->text))
        again.kinds = 0;
    *u = again;
}

void sim_until_finish(const sim_until *u)
{
    if (u->text && !u->happened)
        fprintf(stderr, "canwire sim: --until-event %s: it did not happen\n", u->text);
}
