/* SPDX-License-Identifier: MIT
 *
 * check_doubts.c - warns about a configuration that is valid and still will not do what it says.
 */
#include "cli/check_doubts.h"

#include "base/text/plain.h"
#include "config/doubts.h"
#include "run/release.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#define RELEASES_MAX 20000000u /* that are looked at for gaps */
#define GAP_SPARE_MS 10u       /* a frame may end so much after its release */

static void warn(FILE *out, const char *file, cfg_place place, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

static void warn(FILE *out, const char *file, cfg_place place, const char *format, ...)
{
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    plain_print(out, "%s:%d:%d: warning: %s\n", file, place.line, place.column, text);
}

static void doubt_rule(const cfg *config, size_t i, uint64_t fed, FILE *out)
{
    const cw_rule *rule = &config->rules[i];
    const cfg_rule_place *place = &config->rule_places[i];
    if (doubts_never_armed(config, rule))
        warn(out, place->file, place->place,
             "rule %s is never armed: the rules that come after each other go in a circle",
             rule->name);
    else if (doubts_no_frame(config, rule, fed))
        warn(out, place->file, place->place, "rule %s: no node sends a frame that it waits for",
             rule->name);
}

static void doubt_queue(const cfg *config, size_t i, FILE *out)
{
    const cfg_node *node = &config->nodes[i];
    char at[TIME_TEXT_MAX];
    uint64_t tick;
    if (node->traffic_count <= node->queue)
        return;
    const unsigned count = doubts_at_once(config, i, &tick);
    if (count <= node->queue)
        return;
    text_print_span(at, tick);
    warn(out, config->file, node->traffic[0].place,
         "%s: %u frames come at %s and its queue holds %u, so others are dropped: queue: %u or "
         "offsets",
         node->name, count, at, node->queue, count);
}

static void doubt_acknowledgement(const cfg *config, size_t i, FILE *out)
{
    const cfg_node *node = &config->nodes[i];
    const cfg_place line = {.line = node->line, .column = 1};
    if (doubts_no_acknowledgement(config, i))
        warn(out, config->file, node->traffic_count > 0 ? node->traffic[0].place : line,
             "%s: no other node acknowledges its frames, so it never gets one through: add a node, "
             "or presume-ack: on",
             node->name);
}

/* ---- Gaps ------------------------------------------------------------------------------------ */

static void ignore(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    (void)text;
}

/* Returns true when the releases alone say when something happens. */
static bool releases_say_all(const cfg *config)
{
    bool all = !cfg_find_unending(config, NULL);
    for (size_t i = 0; i < config->rule_count; i++)
        all = all && config->rules[i].trigger == CW_TRIGGER_FRAME &&
              cw_action_kind_of(config->rules[i].action) != CW_KIND_TRAFFIC;
    for (size_t i = 0; i < config->node_count; i++)
        all = all && config->nodes[i].schedule.cycles == 0;
    return all;
}

/* Finds a time without a release after which a run without --until has ended. */
static bool find_gap(release_plan *plan, uint64_t *begin, uint64_t *end)
{
    const uint64_t most = (uint64_t)RELEASE_QUIET_S * CW_CLOCK_HZ +
                          GAP_SPARE_MS * (CW_CLOCK_HZ / 1000u);
    *begin = 0;
    for (unsigned i = 0; i < RELEASES_MAX && !release_is_fast(plan); i++) {
        *end = release_next_tick(plan);
        if (*end == CW_NEVER)
            return false;
        if (*end - *begin > most)
            return true;
        *begin = *end;
        release_pass(plan);
    }
    return false;
}

static void doubt_gaps(const cfg *config, FILE *out)
{
    char from[TIME_TEXT_MAX];
    char to[TIME_TEXT_MAX];
    uint64_t begin;
    uint64_t end;
    unsigned node;
    release_plan *plan = releases_say_all(config) ? release_plan_new(config, ignore, NULL) : NULL;
    if (plan && find_gap(plan, &begin, &end)) {
        (void)release_first(plan, &node);
        text_print_span(from, begin);
        text_print_span(to, end);
        warn(out, config->file, release_place(plan),
             "%s: no frame comes from %s to %s: canwire sim ends after %u s without one, with "
             "--until TIME it goes on",
             config->nodes[node].name, from, to, RELEASE_QUIET_S);
    }
    release_plan_free(plan);
}

void check_doubts(const cfg *config, const rig *all, size_t bus, FILE *out)
{
    const uint64_t fed = doubts_fed(all, bus);
    for (size_t i = 0; i < config->node_count; i++) {
        doubt_queue(config, i, out);
        doubt_acknowledgement(config, i, out);
    }
    for (size_t i = 0; i < config->rule_count; i++)
        doubt_rule(config, i, fed, out);
    if (!all)
        doubt_gaps(config, out);
}
