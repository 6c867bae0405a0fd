/* SPDX-License-Identifier: MIT
 *
 * sim_until.c - ends a run with an event: [NODE:]KIND[:WHICH].
 */
#include "sim/sim_until.h"

#include "base/text/plain.h"
#include "trace/frametext.h"

#include <string.h>

#define WARN_S 10u /* of bus time */

static const char expected[] =
    "expected [NODE:]EVENT, an event of 'canwire watch' (error, rx, tx, drop, restart, overload, "
    "protocol-exception, arbitration-lost, improper-arbitration, overrun, wake, state, link, "
    "sync), a state (error-active, error-warning, error-passive, bus-off, sleeping), tx:FILTER or "
    "the like for frames, fault[:RULE], or skip";

/* Events of the bus, which have no node. */
#define BUS_KINDS (1u << CW_EVENT_FAULT | 1u << CW_EVENT_SKIP)

/* Events with a frame; a filter may follow them. */
#define FRAME_KINDS                                                                                \
    (1u << CW_EVENT_RX | 1u << CW_EVENT_TX | 1u << CW_EVENT_DROP |                                 \
     1u << CW_EVENT_ARBITRATION_LOST | 1u << CW_EVENT_IMPROPER | 1u << CW_EVENT_OVERRUN)

static bool sim_until_fail(const sim_until *u, const char *problem)
{
    if (u->run->messages)
        plain_print(u->run->messages, "%s%s: %s\n", u->before, u->text, problem);
    return false;
}

static bool same(const char *word, size_t length, const char *name)
{
    return strlen(name) == length && strncmp(word, name, length) == 0;
}

/* Finds the kind or the state for a word; returns false for other words. */
static bool sim_until_find_kind(sim_until *u, const char *word, size_t length)
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

static int sim_until_find_node(const cfg *config, const char *word, size_t length)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (same(word, length, config->nodes[i].name))
            return (int)i;
    return -1;
}

/* Complains about an unknown node or rule, and lists the named ones. */
static bool fail_unknown(sim_until *u, const char *what, const char *word, size_t length)
{
    const cfg *config = u->run->config;
    const bool nodes = strcmp(what, "node") == 0;
    const size_t count = nodes ? config->node_count : config->rule_count;
    const char *before = ": there is ";
    FILE *const out = u->run->messages;
    if (!out)
        return false;
    plain_print(out, "%s%s: there is no %s '%.*s'", u->before, u->text, what, (int)length, word);
    for (size_t i = 0; i < count; i++) {
        const char *name = nodes ? config->nodes[i].name : config->rules[i].name;
        if (name)
            plain_print(out, "%s%s", before, name);
        if (name)
            before = ", ";
    }
    fputc('\n', out);
    return false;
}

/* Explains that a word is not an event. Returns false. */
static bool fail_word(const sim_until *u, const char *word, size_t length)
{
    if (same(word, length, "record"))
        return sim_until_fail(u, "recordings are canwired's, canwire sim has no such events");
    if (u->run->messages)
        plain_print(u->run->messages, "%s%s: there is no event '%.*s': %s\n", u->before, u->text,
                    (int)length, word, expected);
    return false;
}

/* Keeps the name of the rule: its number may change with a reload. */
static bool sim_until_find_rule(sim_until *u, const char *name)
{
    const cfg *config = u->run->config;
    for (size_t i = 0; i < config->rule_count; i++)
        if (config->rules[i].name && strcmp(config->rules[i].name, name) == 0)
            u->rule = name;
    return u->rule || fail_unknown(u, "rule", name, strlen(name));
}

/* Explains a part behind the kind of event that cannot be there. Returns false. */
static bool fail_behind(const sim_until *u, const char *which)
{
    if (u->run->messages)
        plain_print(u->run->messages, "%s%s: ':%s' cannot follow: %s\n", u->before, u->text, which,
                    expected);
    return false;
}

/* Reads the part behind the kind: a rule, or filters of frames. */
static bool read_which(sim_until *u, const char *which)
{
    if (u->kinds & 1u << CW_EVENT_FAULT)
        return sim_until_find_rule(u, which);
    if (!(u->kinds & FRAME_KINDS))
        return fail_behind(u, which);
    const char *problem =
        text_parse_filters(u->filters, &u->filter_count, CW_RULE_FILTERS_MAX, which);
    return !problem || sim_until_fail(u, problem);
}

/* Reads "KIND" or "KIND:WHICH". */
static bool read_kind(sim_until *u, const char *text)
{
    size_t length = strcspn(text, ":");
    if (!sim_until_find_kind(u, text, length))
        return fail_word(u, text, length);
    return text[length] == '\0' || read_which(u, text + length + 1);
}

/* Reads an event. The word before a ':' is a node if an event follows and it is not an event
 * itself, or if such a node exists. */
static bool read_event(sim_until *u, const char *text)
{
    size_t length = strcspn(text, ":");
    sim_until probe = *u;
    bool event_itself = sim_until_find_kind(&probe, text, length);
    const char *rest = text[length] == ':' ? text + length + 1 : NULL;
    int node = rest ? sim_until_find_node(u->run->config, text, length) : -1;
    if (!rest || (node < 0 && event_itself))
        return read_kind(u, text);
    bool event_follows = sim_until_find_kind(&probe, rest, strcspn(rest, ":"));
    if (!event_follows && (event_itself || node < 0))
        return read_kind(u, text);
    if (!event_follows)
        return fail_word(u, rest, strcspn(rest, ":"));
    if (node < 0)
        return fail_unknown(u, "node", text, length);
    if (probe.kinds & BUS_KINDS)
        return sim_until_fail(u, "faults and skips are events of the bus, not of a node");
    u->nodes = UINT64_C(1) << node;
    return read_kind(u, rest);
}

bool sim_until_is(const sim_until *u, const cw_event *event)
{
    if (!(u->kinds >> event->kind & 1u))
        return false;
    if (event->kind == CW_EVENT_FAULT)
        return !u->rule || strcmp(u->run->config->rules[event->rule].name, u->rule) == 0;
    if (event->kind == CW_EVENT_SKIP)
        return true;
    if (event->kind == CW_EVENT_STATE && !(u->states >> event->state & 1u))
        return false;
    if ((FRAME_KINDS >> event->kind & 1u) &&
        !cw_frame_matches(&event->frame, u->filters, u->filter_count))
        return false;
    return event->nodes & u->nodes;
}

/* Warns once that the run may never end. */
static void warn(sim_until *u)
{
    FILE *const out = u->warns;
    u->warns = NULL;
    if (u->run->show.wipe)
        u->run->show.wipe(u->run->show.user);
    plain_print(out,
                "%s%s: not yet after %u s of bus time; there is traffic "
                "without `count`, so that without the event only --until TIME ends the run\n",
                u->before, u->text, WARN_S);
}

/* Ends the run with the first such event, or tells who looks for it. */
static void look_at_event(void *user, const cw_event *event)
{
    sim_until *u = user;
    if (u->warns && event->tick > WARN_S * (uint64_t)CW_CLOCK_HZ)
        warn(u);
    if (u->happened || !sim_until_is(u, event))
        return;
    u->happened = true;
    u->tick = event->tick;
    if (u->found)
        u->found(u->user, event->tick);
    else
        sim_stop(u->run, event->tick);
}

bool sim_until_read(sim_until *u, const char *text, sim_run *run, const char *before)
{
    *u = (sim_until){.text = text, .run = run, .before = before, .nodes = UINT64_MAX};
    return read_event(u, text);
}

bool sim_until_start(sim_until *u, const char *text, sim_run *run)
{
    sim_sink sink = {.user = u, .event = look_at_event};
    *u = (sim_until){.text = text, .run = run};
    if (!text)
        return true;
    if (!sim_until_read(u, text, run, "canwire sim: --until-event "))
        return false;
    sink.kinds = CW_EVENTS_USUAL | u->kinds;
    sim_be_careful(run, 0);
    sim_add_sink(run, &sink);
    return true;
}

void sim_until_change(sim_until *u)
{
    sim_until again = {.text = u->text,
                       .run = u->run,
                       .before = u->before,
                       .nodes = UINT64_MAX,
                       .warns = u->warns,
                       .found = u->found,
                       .user = u->user};
    if (!u->text || u->happened)
        return;
    if (!read_event(&again, u->text))
        again.kinds = 0;
    *u = again;
}

void sim_until_warn(sim_until *u, FILE *out)
{
    u->warns = out;
}

void sim_until_finish(const sim_until *u, FILE *out)
{
    if (u->text && !u->happened)
        plain_print(out, "%s%s: it did not happen\n", u->before, u->text);
}
