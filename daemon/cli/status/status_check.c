/* SPDX-License-Identifier: MIT
 *
 * status_check.c - judges the status of buses for monitoring: one line, and an exit code.
 */
#include "cli/status/status_check.h"

#include "base/text/counted.h"
#include "base/text/decimal.h"
#include "base/text/jsonput.h"
#include "base/text/number.h"
#include "base/text/plain.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define SLEEPING "sleeping"
#define PART_BYTES 32 /* of an option */
#define LABEL_BYTES 96
#define COUNT_OF(array) (sizeof(array) / sizeof((array)[0]))

static const char *const levels[] = {"ok", "warning", "critical"};
static const char *const titles[] = {"OK", "WARNING", "CRITICAL", "UNKNOWN"};

/* From good to bad; "none" is never reached. */
static const char *const states[] = {"error-active", "error-warning", "error-passive", "bus-off",
                                     "none"};
#define NONE (COUNT_OF(states) - 1)

/* ---- Options --------------------------------------------------------------------------------- */

static bool status_check_refuse(const char *option, const char *text, const char *expected)
{
    plain_print(stderr, "canwire status: %s %s: expected %s\n", option, text, expected);
    return false;
}

/* Splits "W,C"; each may be empty. Returns false without a comma, or with long parts. */
static bool split(char parts[2][PART_BYTES], const char *text)
{
    const char *comma = strchr(text, ',');
    if (!comma || comma - text >= PART_BYTES || strlen(comma + 1) >= PART_BYTES)
        return false;
    (void)snprintf(parts[0], PART_BYTES, "%.*s", (int)(comma - text), text);
    (void)snprintf(parts[1], PART_BYTES, "%s", comma + 1);
    return true;
}

/* Reads 70, 70% or 70.5; nothing and 0 are no limit. */
static bool take_percent(uint64_t *permille, const char *text)
{
    char percent[PART_BYTES + 1];
    uint16_t value = 0;
    (void)snprintf(percent, sizeof percent, "%.*s%s", PART_BYTES - 1, text,
                   strchr(text, '%') ? "" : "%");
    const bool none = *text == '\0' || strcmp(text, "0") == 0;
    if (!none && text_parse_percent(&value, percent))
        return false;
    *permille = value;
    return true;
}

bool check_take_load(void *out, const char *option, const char *text)
{
    check_limits *limits = out;
    char parts[2][PART_BYTES];
    bool good = split(parts, text);
    for (size_t i = 0; good && i < 2; i++)
        good = take_percent(&limits->load_permille[CHECK_WARNING + i], parts[i]);
    if (good && limits->load_permille[CHECK_CRITICAL] > 0 &&
        limits->load_permille[CHECK_WARNING] > limits->load_permille[CHECK_CRITICAL])
        return status_check_refuse(option, text,
                                   "a limit for WARNING that is at most the one for CRITICAL, such "
                                   "as 70,90");
    return good || status_check_refuse(option, text,
                                       "two percentages up to 100 in steps of 0.1, such as 70,90 "
                                       "or 0.5,90");
}

/* Finds the place of a word in a list that goes from good to bad. */
static bool status_check_find(unsigned *place, const char *const *words, size_t count,
                              const char *word)
{
    for (*place = 0; *place < count; (*place)++)
        if (strcmp(words[*place], word) == 0)
            return true;
    return false;
}

bool check_take_state(void *out, const char *option, const char *text)
{
    check_limits *limits = out;
    char parts[2][PART_BYTES];
    bool good = split(parts, text);
    for (size_t i = 0; good && i < 2; i++)
        good = status_check_find(&limits->state[CHECK_WARNING + i], states, COUNT_OF(states),
                                 parts[i]);
    const unsigned warning = limits->state[CHECK_WARNING];
    good = good && (warning <= limits->state[CHECK_CRITICAL] || warning == NONE);
    return good || status_check_refuse(option, text,
                                       "two of error-active, error-warning, error-passive, "
                                       "bus-off and none, the worse one last, such as "
                                       "error-passive,bus-off");
}

bool check_take_level(void *out, const char *option, const char *text)
{
    unsigned place;
    if (!status_check_find(&place, levels, COUNT_OF(levels), text))
        return status_check_refuse(option, text, "ok, warning or critical");
    *(check_level *)out = (check_level)place;
    return true;
}

/* ---- Findings -------------------------------------------------------------------------------- */

/* A bus that is critical matters more than one of which nothing is known. */
static void raise_to(check *c, check_level level)
{
    static const unsigned weight[] = {
        [CHECK_OK] = 0, [CHECK_WARNING] = 1, [CHECK_UNKNOWN] = 2, [CHECK_CRITICAL] = 3};
    if (weight[level] > weight[c->level])
        c->level = level;
}

/* Returns the highest level whose limit a value has reached. */
static check_level reached(uint64_t value, uint64_t warning, uint64_t critical)
{
    return critical > 0 && value >= critical  ? CHECK_CRITICAL
           : warning > 0 && value >= warning ? CHECK_WARNING
                                              : CHECK_OK;
}

/* Checks a link of a node, or a tunnel, which is one. Without a state there is none. */
static void check_link(check *c, const json_t *node, const char *what, const char *state)
{
    if (c->limits.links == CHECK_OK || *state == '\0' || strcmp(state, "up") == 0)
        return;
    buffer_print(&c->text, ", %s %s %s", get_any_text(node, "name"), what, state);
    raise_to(c, c->limits.links);
}

/* Checks the state of a node and its connections. A sleeping node is well, and guests come and
 * go. */
static void status_check_check_node(check *c, const json_t *node)
{
    const char *state = get_any_text(node, "state"), *link = get_any_text(node, "link");
    unsigned place;
    const check_level level =
        status_check_find(&place, states, COUNT_OF(states), state)
            ? reached(place, c->limits.state[CHECK_WARNING], c->limits.state[CHECK_CRITICAL])
        : strcmp(state, SLEEPING) == 0 ? CHECK_OK
                                       : CHECK_UNKNOWN;
    if (level > CHECK_OK)
        buffer_print(&c->text, ", %s %s", get_any_text(node, "name"),
                     *state ? state : "without a state");
    raise_to(c, level);
    if (json_object_get(node, "guest"))
        return;
    check_link(c, node, "link", link);
    check_link(c, node, "tunnel", get_any_text(json_object_get(node, "tunnel"), "state"));
}

/* Checks a recording or a publication, unless they are not of interest. A journal with a gap cannot
 * be played again across it. */
static void check_sink(check *c, const json_t *sink)
{
    const uint64_t gaps = get_count(sink, "gaps");
    const bool good = json_is_true(json_object_get(sink, "good"));
    if (c->limits.sinks == CHECK_OK || (good && gaps == 0))
        return;
    raise_to(c, c->limits.sinks);
    if (good) {
        buffer_print(&c->text, ", %s %s has %s", get_any_text(sink, "kind"),
                     get_any_text(sink, "name"), counted(gaps, "gap").text);
        return;
    }
    const char *why = get_any_text(sink, "why");
    buffer_print(&c->text, ", %s %s %s%s%s", get_any_text(sink, "kind"),
                 get_any_text(sink, "name"), get_any_text(sink, "state"), *why ? ": " : "", why);
}

/* Checks what has happened to the frames of a node, or to the time of the bus. */
static void check_lately(check *c, const json_t *one)
{
    const char *node = get_any_text(one, "node");
    if (c->limits.losses == CHECK_OK)
        return;
    buffer_print(&c->text, ", %s%s %s", *node ? node : "the bus", *node ? " frames" : "",
                 get_any_text(one, "what"));
    raise_to(c, c->limits.losses);
}

/* Warns of something, unless the text is "". */
static void warn_of(check *c, const char *what, const char *text)
{
    if (!*text)
        return;
    buffer_print(&c->text, ", %s%s", what, text);
    raise_to(c, CHECK_WARNING);
}

/* Warns of rules that are not in force though somebody wanted them, of verdicts that a crash has
 * lost, and of a refused reload. */
static void check_rules(check *c, const json_t *status)
{
    const char *lost = get_any_text(json_object_get(status, "lost_rules"), "note");
    const char *verdicts = get_any_text(json_object_get(status, "lost_verdicts"), "note");
    const json_t *kept = json_object_get(status, "kept_rules");
    warn_of(c, "", lost);
    warn_of(c, "", get_any_text(status, "unread_rules"));
    warn_of(c, "", verdicts);
    warn_of(c, "reload refused: ", get_any_text(status, "reload_refused"));
    for (size_t i = 0; i < json_array_size(kept); i++) {
        const json_t *one = json_array_get(kept, i);
        if (!json_is_true(json_object_get(one, "refused")))
            continue;
        buffer_print(&c->text, ", rules of %s are refused: %s", get_any_text(one, "name"),
                     get_any_text(one, "why"));
        raise_to(c, CHECK_WARNING);
    }
}

/* Adds the expectations that have failed, of many only their number. */
static void check_expectations(check *c, const json_t *all)
{
    size_t failed = 0;
    const char *name = "";
    for (size_t i = 0; i < json_array_size(all); i++) {
        const json_t *one = json_array_get(all, i);
        if (strcmp(get_any_text(one, "state"), "failed") != 0)
            continue;
        name = get_any_text(one, "name");
        failed++;
    }
    if (failed == 0)
        return;
    buffer_print(&c->text, ", %s failed%s%s", counted(failed, "expectation").text,
                 failed == 1 ? ": " : "", failed == 1 ? name : "");
    raise_to(c, CHECK_WARNING);
}

/* Adds "powertrain_load=", as no two values may have one label. When that is there, since two units
 * have buses of one name, the name of the socket follows that of the bus. */
static void add_label(check *c, const char *bus, const char *socket)
{
    char label[LABEL_BYTES];
    const char *slash = strrchr(socket, '/');
    const char *file = slash ? slash + 1 : socket;
    (void)snprintf(label, sizeof label, " %s_load=", bus);
    const char *there = buffer_length(&c->figures) > 0 ? buffer_text(&c->figures) : NULL;
    if (there && strstr(there, label))
        buffer_print(&c->figures, " %s.%.*s_load=", bus, (int)strcspn(file, "."), file);
    else
        buffer_put(&c->figures, label);
}

/* Adds "powertrain_load=12.3%;70;90;0;100". */
static void add_figure(check *c, const char *bus, const char *socket, uint64_t permille)
{
    add_label(c, bus, socket);
    buffer_print(&c->figures, "%" PRIu64 ".%" PRIu64 "%%;", permille / 10, permille % 10);
    for (size_t i = CHECK_WARNING; i <= CHECK_CRITICAL; i++)
        if (c->limits.load_permille[i] > 0)
            buffer_print(&c->figures, "%s;", decimal(c->limits.load_permille[i], 1).text);
        else
            buffer_print(&c->figures, ";");
    buffer_print(&c->figures, "0;100");
}

/* Returns what a status lacks, or NULL when it is one. */
static const char *lack_of(const json_t *status)
{
    const json_t *now = json_object_get(status, "bus");
    if (!json_is_object(status))
        return "a status";
    if (*get_any_text(now, "name") == '\0')
        return "the name of a bus";
    if (!json_is_integer(json_object_get(now, "load_second_permille")))
        return "a load";
    if (!json_is_array(json_object_get(status, "nodes")))
        return "nodes";
    return json_is_array(json_object_get(status, "sinks")) ? NULL : "sinks";
}

/* Begins another part of the line. */
static void begin_part(check *c)
{
    if (buffer_length(&c->text) > 0)
        buffer_put(&c->text, "; ");
}

void check_tell(check *c, check_level level, const char *text)
{
    begin_part(c);
    buffer_put(&c->text, text);
    raise_to(c, level);
}

/* Checks all of a bus. A status that lacks something is unknown: it comes from another version. */
void check_bus(check *c, const char *bus, const json_t *status, const char *why)
{
    const json_t *now = json_object_get(status, "bus");
    const json_t *nodes = json_object_get(status, "nodes");
    const json_t *sinks = json_object_get(status, "sinks");
    const json_t *lately = json_object_get(status, "lately");
    const uint64_t load = get_count(now, "load_second_permille");
    if (!status) {
        check_tell(c, CHECK_CRITICAL, why);
        return;
    }
    begin_part(c);
    if (lack_of(status)) {
        buffer_print(&c->text, "bus %s: what it answers has not got %s", bus, lack_of(status));
        raise_to(c, CHECK_UNKNOWN);
        return;
    }
    buffer_print(&c->text, "%s: load %" PRIu64 ".%" PRIu64 " %%, %s, %s",
                 get_any_text(now, "name"), load / 10, load % 10,
                 counted(json_array_size(nodes), "node").text,
                 counted(json_array_size(sinks), "sink").text);
    raise_to(c, reached(load, c->limits.load_permille[CHECK_WARNING],
                        c->limits.load_permille[CHECK_CRITICAL]));
    add_figure(c, get_any_text(now, "name"), bus, load);
    for (size_t i = 0; i < json_array_size(nodes); i++)
        status_check_check_node(c, json_array_get(nodes, i));
    for (size_t i = 0; i < json_array_size(sinks); i++)
        check_sink(c, json_array_get(sinks, i));
    for (size_t i = 0; i < json_array_size(lately); i++)
        check_lately(c, json_array_get(lately, i));
    check_rules(c, status);
    check_expectations(c, json_object_get(status, "expectations"));
}

/* Returns a text without control characters: monitoring systems show it on pages. */
static const char *plain_text(buffer *text)
{
    if (!buffer_text(text))
        return "out of memory";
    plain_make(buffer_first(text), '?');
    return buffer_first(text);
}

int check_end(check *c)
{
    const char *figures = plain_text(&c->figures);
    plain_print(stdout, "CANWIRE %s - %s%s%s\n", titles[c->level],
                buffer_length(&c->text) > 0 ? plain_text(&c->text) : "no bus",
                *figures ? " |" : "", figures);
    buffer_free(&c->text);
    buffer_free(&c->figures);
    return (int)c->level;
}
