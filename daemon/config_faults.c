/* SPDX-License-Identifier: MIT
 *
 * config_faults.c - the keys of fault rules: name, when, do.
 */
#include "config_read.h"

#include <string.h>

static schema_reader read_name, read_when, read_do, read_filters, read_node_set, read_window,
    read_probability, read_position;

static const schema_range number_range = {0, UINT32_MAX, sizeof(uint32_t)};
static const schema_range positive_range = {1, UINT32_MAX, sizeof(uint32_t)};
static const schema_range bits_range = {1, UINT16_MAX, sizeof(uint16_t)};

static const schema_key rule_keys[] = {
    {.name = "name", .read = read_name, .required = true},
    {.name = "when", .read = read_when},
    {.name = "do", .read = read_do, .required = true},
    {.name = NULL},
};

static const schema_key when_keys[] = {
    {.name = "frame", .read = read_filters},
    {.name = "from", .read = read_node_set, .offset = offsetof(cw_rule, from)},
    {.name = "time", .read = read_window},
    {.name = "skip",
     .read = schema_read_uint,
     .offset = offsetof(cw_rule, skip),
     .arg = &number_range},
    {.name = "every",
     .read = schema_read_uint,
     .offset = offsetof(cw_rule, every),
     .arg = &positive_range},
    {.name = "count",
     .read = schema_read_uint,
     .offset = offsetof(cw_rule, count),
     .arg = &positive_range},
    {.name = "probability", .read = read_probability},
    {.name = "after", .read = NULL},
    {.name = "manual", .read = NULL},
    {.name = NULL},
};

static const schema_key do_keys[] = {
    {.name = "flip", .read = read_position, .required = true},
    {.name = "bits",
     .read = schema_read_uint,
     .offset = offsetof(cw_rule, bits),
     .arg = &bits_range},
    {.name = "at", .read = read_node_set, .offset = offsetof(cw_rule, at)},
    /* Actions that come later ... */
    {.name = "force"},
    {.name = "glitch"},
    {.name = "stuck"},
    {.name = "noise"},
    {.name = "no-ack"},
    {.name = "wrong-crc"},
    {.name = "bus-off"},
    {.name = "error-flag"},
    {.name = "restart"},
    {.name = "counters"},
    {.name = "overload"},
    {.name = "set"},
    {.name = "disconnect"},
    {.name = "partition"},
    {.name = "drop"},
    {.name = "delay"},
    {.name = "duplicate"},
    {.name = "reorder"},
    {.name = "change"},
    {.name = "send"},
    {.name = "babble"},
    {.name = "load"},
    {.name = "reply"},
    /* ... and their further keys. */
    {.name = "from"},
    {.name = "for"},
    {.name = "on"},
    {.name = "dominant-timeout"},
    {.name = "tec"},
    {.name = "rec"},
    {.name = "frames"},
    {.name = "as"},
    {.name = "every"},
    {.name = NULL},
};

static void read_rule(schema *self, yaml_node_t *value, cw_rule *rule)
{
    *rule = (cw_rule){
        .time_end = CW_NEVER,
        .every = 1,
        .probability = UINT64_MAX,
        .action = CW_ACTION_FLIP,
        .bits = 1,
    };
    schema_map(self, "rule", value, rule_keys, rule);
}

void cfg_read_faults(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    size_t count = schema_count(self, key, value, 0, CW_RULES_MAX);

    config->rules = schema_alloc(self, count + 1, sizeof *config->rules);
    if (!config->rules)
        return;
    for (; config->rule_count < count; config->rule_count++)
        read_rule(self, schema_item(self, value, config->rule_count),
                  &config->rules[config->rule_count]);
}

static void read_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg *config = self->user;
    cw_rule *rule = object;

    rule->name = cfg_read_name(self, key, value, RULE_NAME_MAX);
    for (size_t i = 0; rule->name && i < config->rule_count; i++) {
        const char *other = config->rules[i].name;
        if (other && strcmp(other, rule->name) == 0) {
            schema_complain(self, value, "duplicate name '%s' (also of rule %zu in the list)",
                            other, i + 1);
            return;
        }
    }
}

static void read_when(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, when_keys, object);
}

static void read_do(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, do_keys, object);
}

static void read_filters(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    unsigned count = 0;
    const char *text = schema_text(self, key, value, "a frame filter such as 123 or 100:700");

    if (text)
        schema_problem(self, key, value,
                       text_parse_filters(rule->filters, &count, CW_RULE_FILTERS_MAX, text));
    rule->filter_count = (uint8_t)count;
}

static void complain_no_node(schema *self, const schema_key *key, const yaml_node_t *value,
                             const char *name)
{
    const cfg *config = self->user;
    nearest guess = {.word = name};
    const char *list = "";

    for (size_t i = 0; i < config->node_count; i++) {
        if (!config->nodes[i].name)
            continue;
        nearest_consider(&guess, config->nodes[i].name);
        list = schema_join(self, list, config->nodes[i].name);
    }
    /* Without any node the missing list is the only complaint worth making. */
    if (*list)
        schema_complain(self, value, "%s: there is no node '%.40s'%s; allowed: %s", key->name, name,
                        schema_suggestion(self, &guess), list);
}

/* The node that a value names as a mask, 0 after a complaint. */
static uint64_t read_node(schema *self, const schema_key *key, const yaml_node_t *value)
{
    const cfg *config = self->user;
    const char *name = schema_text(self, key, value, "the name of a node");

    if (!name)
        return 0;
    for (size_t i = 0; i < config->node_count; i++)
        if (config->nodes[i].name && strcmp(config->nodes[i].name, name) == 0)
            return UINT64_C(1) << i;
    complain_no_node(self, key, value, name);
    return 0;
}

static void read_node_set(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *set = schema_member(key, object);
    size_t count = schema_count_one(self, key, value, 1, CW_NODES_MAX);

    for (size_t i = 0; i < count; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        uint64_t node = read_node(self, key, item);
        if (*set & node)
            schema_complain(self, item, "%s: this node is in the list twice", key->name);
        *set |= node;
    }
}

/* One end of a window in ticks; false after a complaint. */
static bool read_end(schema *self, uint64_t *tick, const schema_key *key, const yaml_node_t *value,
                     const char *text)
{
    const cfg *config = self->user;
    cfg_time time = {0};
    const char *problem = text ? text_parse_time(&time, text) : "out of memory";

    schema_problem(self, key, value, problem);
    *tick = text_time_ticks(time, config->bit_ticks);
    return !problem;
}

/* BEGIN..END or BEGIN.., half open. */
static void read_window(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "a window of time such as 2s..5s or 2s..";
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, expected);
    const char *dots = text ? strstr(text, "..") : NULL;

    if (text && (!dots || dots == text))
        schema_expected(self, key, value, expected);
    if (!dots || dots == text)
        return;
    const char *begin = arena_print(self->arena, "%.*s", (int)(dots - text), text);
    if (!read_end(self, &rule->time_begin, key, value, begin) || dots[2] == '\0' ||
        !read_end(self, &rule->time_end, key, value, dots + 2))
        return;
    if (rule->time_end <= rule->time_begin)
        schema_problem(self, key, value, "the window must end after it begins");
}

static void read_probability(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a decimal fraction from 0 to 1");

    if (text)
        schema_problem(self, key, value, text_parse_probability(&rule->probability, text));
}

static void read_position(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a position such as crc[3]");

    if (text)
        schema_problem(self, key, value, text_parse_position(&rule->field, &rule->index, text));
}
