/* SPDX-License-Identifier: MIT
 *
 * expect.c - the keys of `expect`: the criteria by which a run is judged.
 *
 * Each expectation has one key for its subject, and perhaps conditions.
 */
#include "base/text/number.h"
#include "base/text/yamlfile.h"
#include "config/parts.h"
#include "config/source.h"
#include "config/values.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define EXPECT_MAX 1000u
#define NAME_MAX_BYTES 200u
#define PERCENT_MAX 1000u /* permille */

/* The conditions of subjects. */
#define HAS_FRAME 0x01u /* frame, data */
#define HAS_FROM 0x02u
#define HAS_TO 0x04u
#define HAS_TIME 0x08u /* time, before */
#define HAS_NODE 0x10u
#define HAS_REACHED 0x20u
#define HAS_TYPE 0x40u
#define HAS_WHY 0x80u
#define HAS_RULE 0x100u
#define HAS_RATE 0x200u
#define HAS_WINDOW 0x400u
#define IS_FRAMES (HAS_FRAME | HAS_FROM | HAS_TO | HAS_TIME | HAS_RATE)

typedef struct subject {
    const char *name;
    cfg_expect_kind kind;
    unsigned conditions;
} subject;

static const subject subjects[] = {
    {"delivered", CFG_EXPECT_DELIVERED, IS_FRAMES},
    {"delay", CFG_EXPECT_DELAY, IS_FRAMES},
    {"gap", CFG_EXPECT_GAP, IS_FRAMES},
    {"seen", CFG_EXPECT_SEEN, IS_FRAMES},
    {"state", CFG_EXPECT_STATE, HAS_NODE | HAS_REACHED | HAS_TIME},
    {"errors", CFG_EXPECT_ERRORS, HAS_NODE | HAS_TYPE | HAS_TIME | HAS_RATE},
    {"drops", CFG_EXPECT_DROPS, HAS_NODE | HAS_WHY | HAS_FRAME | HAS_WINDOW | HAS_TIME},
    {"restarts", CFG_EXPECT_RESTARTS, HAS_NODE | HAS_TIME},
    {"overloads", CFG_EXPECT_OVERLOADS, HAS_NODE | HAS_TIME},
    {"protocol-exceptions", CFG_EXPECT_EXCEPTIONS, HAS_NODE | HAS_TIME},
    {"arbitration-lost", CFG_EXPECT_ARBITRATION_LOST,
     HAS_NODE | HAS_FRAME | HAS_WINDOW | HAS_TIME},
    {"faults", CFG_EXPECT_FAULTS, HAS_RULE | HAS_TIME},
    {"load", CFG_EXPECT_LOAD, 0},
    {"jitter", CFG_EXPECT_JITTER, HAS_FRAME | HAS_FROM | HAS_WINDOW | HAS_TIME},
};

#define SUBJECTS (sizeof subjects / sizeof subjects[0])

typedef struct condition {
    const char *name;
    unsigned flag; /* HAS_* */
} condition;

static const condition conditions[] = {
    {"frame", HAS_FRAME}, {"data", HAS_FRAME},  {"from", HAS_FROM}, {"to", HAS_TO},
    {"time", HAS_TIME},   {"before", HAS_TIME}, {"node", HAS_NODE}, {"reached", HAS_REACHED},
    {"type", HAS_TYPE},   {"why", HAS_WHY},     {"rule", HAS_RULE}, {"rate", HAS_RATE},
    {"window", HAS_WINDOW},
};

#define CONDITIONS (sizeof conditions / sizeof conditions[0])

static schema_reader expect_read_name, read_count, read_delay, read_whether, read_states, read_load,
    read_percent, read_types, read_whys, read_rule, read_rate, read_windows;

static const schema_range count_range = {0, UINT64_MAX, sizeof(uint64_t)};

static const schema_choice whether[] = {
    {.name = "yes", .value = false},
    {.name = "never", .value = true},
    {.name = NULL},
};

#define NUMBER "{'type': 'integer', 'minimum': 0, 'maximum': '#18446744073709551615'}"
#define NODES TYPE_ANY(TYPE_REF("node") ", " TYPE_SET(64, TYPE_REF("node")))
#define COUNTED(text, told)                                                                        \
    {                                                                                              \
        .name = text, .read = read_count, .offset = offsetof(cfg_expect, min),                     \
        .arg = &count_range, .map = count_keys, .type = TYPE_ANY(NUMBER ", @"), .help = told       \
    }

static const schema_key count_keys[] = {
    {.name = "min", .read = schema_read_uint, .offset = offsetof(cfg_expect, min),
     .arg = &count_range},
    {.name = "max", .read = schema_read_uint, .offset = offsetof(cfg_expect, max),
     .arg = &count_range},
    {.name = NULL,
     .type = "{'minProperties': 1}"},
};

static const schema_key load_keys[] = {
    {.name = "min", .read = read_percent, .offset = offsetof(cfg_expect, min), .type = "percent"},
    {.name = "max", .read = read_percent, .offset = offsetof(cfg_expect, max), .type = "percent"},
    {.name = NULL,
     .type = "{'minProperties': 1}"},
};

#define PERCENTILE(text, which)                                                                    \
    {                                                                                              \
        .name = text, .read = cfg_read_ticks_min,                                                  \
        .offset = offsetof(cfg_expect, percentile) + (which) * sizeof(uint64_t)                    \
    }

static const schema_key delay_keys[] = {
    {.name = "max", .read = cfg_read_ticks_min, .offset = offsetof(cfg_expect, delay_max)},
    PERCENTILE("p50", CFG_P50),
    PERCENTILE("p90", CFG_P90),
    PERCENTILE("p95", CFG_P95),
    PERCENTILE("p99", CFG_P99),
    {.name = NULL,
     .type = "{'minProperties': 1}"},
};

const schema_key cfg_expect_keys[] = {
    {.name = "name", .read = expect_read_name,
     .type = "{'type': ['string', 'number'], 'minLength': 1, 'maxLength': 200, 'pattern': "
             "'^[^\\u0000-\\u001f\\u007f]+$'}",
     .help = "In reports; default: what is wanted, in words."},
    COUNTED("delivered", "Frames: at each of 'to', or, without it, sent without an error."),
    {.name = "delay", .read = read_delay, .offset = offsetof(cfg_expect, delay_max),
     .map = delay_keys, .type = TYPE_ANY(TYPE_REF("span") ", @"),
     .help = "From hand-in to the delivery; a time is the maximum. pN: of so many percent of the "
             "frames."},
    {.name = "gap", .read = cfg_read_ticks_min, .offset = offsetof(cfg_expect, delay_max),
     .help = "The longest time without such a frame: up to the first one, between two, and "
             "behind the last one."},
    {.name = "seen", .read = read_whether, .type = TYPE_CHOICE, .arg = whether,
     .help = "Whether there is such a frame at all."},
    {.name = "state", .read = read_states, .type = TYPE_SOME(4, TYPE_REF("state")),
     .help = "Whether the nodes change to one of these states."},
    COUNTED("errors", "Errors that nodes detect."),
    COUNTED("drops", "Frames dropped."),
    COUNTED("restarts", "Restarts after bus-off."),
    COUNTED("overloads", "Overload flags."),
    COUNTED("protocol-exceptions",
            "Protocol exceptions: frames that nodes leave without an error."),
    COUNTED("arbitration-lost", "Lost arbitrations."),
    COUNTED("faults", "Hits of fault rules."),
    {.name = "load", .read = read_load, .map = load_keys,
     .help = "Of the bus, in the whole run."},
    {.name = "jitter", .read = cfg_read_ticks, .offset = offsetof(cfg_expect, delay_max),
     .help = "Of frames that triggers send, of each trigger on its own: how much later than the "
             "earliest one a frame begins after its trigger."},
    {.name = "frame", .read = cfg_read_filters, .type = TYPE_SOME(8, TYPE_REF("frameFilter")),
     .help = "Only frames that match one of these filters, as can-utils write them."},
    {.name = "data", .read = cfg_read_data,
     .help = "Only frames with these data bytes from the first on; '.' or 'x' for any digit."},
    {.name = "from", .read = cfg_read_node_set,
     .offset = offsetof(cfg_expect, when) + offsetof(cw_rule, from), .type = NODES,
     .help = "Only frames of these transmitters."},
    {.name = "to", .read = cfg_read_node_set, .offset = offsetof(cfg_expect, to), .type = NODES,
     .help = "At these receivers, each for itself."},
    {.name = "node", .read = cfg_read_node_set, .offset = offsetof(cfg_expect, node), .type = NODES,
     .help = "Only at these nodes, each for itself."},
    {.name = "time", .read = cfg_read_window,
     .help = "Only in this window of bus time, half open: 2s..5s, 2s.., ..5s, 2s."},
    {.name = "before", .read = cfg_read_ticks_min,
     .offset = offsetof(cfg_expect, when) + offsetof(cw_rule, time_end),
     .help = "Only before this bus time."},
    {.name = "reached", .read = read_whether, .type = TYPE_CHOICE, .arg = whether, .preset = "yes",
     .help = "Whether the state must be reached or must not."},
    {.name = "type", .read = read_types, .type = TYPE_SOME(5, TYPE_REF("errorType")),
     .help = "Only errors of these types."},
    {.name = "why", .read = read_whys, .type = TYPE_SOME(9, TYPE_REF("drop")),
     .help = "Only drops for these reasons."},
    {.name = "rule", .read = read_rule, .type = TYPE_TEXT("^(?:[A-Za-z0-9_.-]+)$"),
     .help = "Only hits of this rule."},
    {.name = "rate", .read = read_rate, .type = "{'enum': ['nominal', 'data']}",
     .help = "The bit rate of the data field of frames, or at which errors are found."},
    {.name = "window", .read = read_windows,
     .type = "{'enum': ['exclusive', 'arbitrating', 'any']}",
     .help = "Only frames that triggers send, or would have sent, in these windows."},
    {.name = NULL,
     .type = "{'not': {'required': ['time', 'before']}}"},
};

static_assert(offsetof(cfg_expect, when) == 0, "readers of rules read into it");

const char *cfg_expect_subject(size_t i)
{
    return i < SUBJECTS ? subjects[i].name : NULL;
}

const char *cfg_expect_condition(size_t i)
{
    return i < CONDITIONS ? conditions[i].name : NULL;
}

bool cfg_expect_has(size_t of, size_t i)
{
    return subjects[of].conditions & conditions[i].flag;
}

/* ---- Subjects -------------------------------------------------------------------------------- */

/* Reads a map of at least one limit. */
static void read_limits(schema *self, const schema_key *key, yaml_node_t *value,
                        const schema_key *limits, cfg_expect *e)
{
    yaml_node_t *first;

    schema_map(self, key->name, value, limits, e);
    if (value->type == YAML_MAPPING_NODE && !schema_pair(self, &first, value, 0))
        schema_complain(self, value, "%s: no limit is given", key->name);
    else if (e->min > e->max)
        schema_complain(self, value, "%s: min is more than max", key->name);
}

/* Reads a number, or a map with min, max or both. */
/* Complains of limits that are written as 0..20. Returns false for another text. */
static bool complain_of_range(schema *self, const schema_key *key, yaml_node_t *value)
{
    const char *at =
        value->type == YAML_SCALAR_NODE ? (const char *)value->data.scalar.value : "";
    uint64_t min, max;
    if (!text_take_uint(&min, &at, UINT64_MAX) || strncmp(at, "..", 2) != 0)
        return false;
    at += 2;
    if (!text_take_uint(&max, &at, UINT64_MAX) || *at != '\0')
        return false;
    schema_complain(self, value,
                    "%s: expected a number or limits: { min: %" PRIu64 ", max: %" PRIu64 " }, "
                    "not '%" PRIu64 "..%" PRIu64 "'",
                    key->name, min, max, min, max);
    return true;
}

static void read_count(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_expect *e = object;

    if (complain_of_range(self, key, value))
        return;

    if (value->type == YAML_MAPPING_NODE) {
        read_limits(self, key, value, count_keys, e);
        return;
    }
    schema_read_uint(self, key, value, e);
    e->max = e->min;
}

/* Reads a time, the maximum, or a map. */
static void read_delay(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    if (value->type == YAML_MAPPING_NODE)
        read_limits(self, key, value, delay_keys, object);
    else
        cfg_read_ticks_min(self, key, value, object);
}

/* `never` inverts the expectation: it fails where it would be met. */
static void read_whether(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_expect *e = object;
    unsigned never;

    if (schema_choose(self, &never, key, value, whether))
        e->never = never;
}

static void read_states(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_expect *e = object;

    e->states = cfg_read_states(self, key, value);
}

/* Without `max` any load up to all of the bus is good. */
static void read_load(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_expect *e = object;

    e->max = PERCENT_MAX;
    read_limits(self, key, value, load_keys, e);
}

/* Reads a part of the bus as permille. */
static void read_percent(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *member = schema_member(key, object);
    uint16_t permille = 0;
    const char *text = schema_text(self, key, value, "a part of the bus such as 60%");

    if (text)
        schema_problem(self, key, value, text_parse_percent(&permille, text));
    *member = permille;
}

/* ---- Conditions ------------------------------------------------------------------------------ */

/* The name must be unique, as reports and campaigns tell expectations apart by it. */
static void expect_read_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "a text of 1 to 200 bytes on one line";
    cfg_expect *e = object;
    const char *text = schema_text(self, key, value, expected);
    bool good = text && strlen(text) <= NAME_MAX_BYTES;

    for (const char *c = text; good && *c; c++)
        good = (unsigned char)*c >= ' ' && *c != 0x7F;
    if (text && !good)
        schema_expected(self, key, value, expected);
    if (!text || !good)
        return;
    for (size_t i = 0; i < cfg_of(self)->expect_count; i++) {
        const cfg_expect *other = &cfg_of(self)->expects[i];
        if (other->name && strcmp(other->name, text) == 0) {
            schema_complain(self, value, "duplicate name '%s' (also of the one in line %d)", text,
                            other->line);
            return;
        }
    }
    e->name = schema_copy(self, text);
}

/* Reads one word or a list of words as bits. */
static uint32_t read_words(schema *self, const schema_key *key, yaml_node_t *value,
                           const schema_choice *choices, size_t max)
{
    size_t count = schema_count_one(self, key, value, 1, max);
    uint32_t mask = 0;
    unsigned word;

    for (size_t i = 0; i < count; i++)
        if (schema_choose(self, &word, key, schema_item(self, value, i), choices))
            mask |= 1u << word;
    return mask;
}

/* The words are those of error events. */
static void read_types(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_choice choices[CW_ERROR_COUNT + 1] = {{.name = NULL}};
    cfg_expect *e = object;

    for (unsigned i = 0; i < CW_ERROR_COUNT; i++)
        choices[i] = (schema_choice){.name = cw_error_type_name((cw_error_type)i), .value = i};
    e->types = read_words(self, key, value, choices, CW_ERROR_COUNT);
}

/* The words are those of drop events. */
static void read_whys(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_choice choices[CW_DROP_COUNT + 1] = {{.name = NULL}};
    cfg_expect *e = object;

    for (unsigned i = 0; i < CW_DROP_COUNT; i++)
        choices[i] = (schema_choice){.name = cw_drop_name((cw_drop)i), .value = i};
    e->why = read_words(self, key, value, choices, CW_DROP_COUNT);
}

/* `any` takes all frames of schedules, and no others. */
static void read_windows(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_choice windows[] = {
        {.name = "exclusive", .value = CFG_WINDOW_EXCLUSIVE},
        {.name = "arbitrating", .value = CFG_WINDOW_ARBITRATING},
        {.name = "any", .value = CFG_WINDOW_EXCLUSIVE | CFG_WINDOW_ARBITRATING},
        {.name = NULL},
    };
    cfg_expect *e = object;
    unsigned chosen;

    if (schema_choose(self, &chosen, key, value, windows))
        e->windows = chosen;
}

/* The rate is a part of the condition that frames, or errors, must meet. */
static void read_rate(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_choice rates[] = {
        {.name = "nominal", .value = CW_RATE_NOMINAL},
        {.name = "data", .value = CW_RATE_DATA},
        {.name = NULL},
    };
    cfg_expect *e = object;
    unsigned rate;

    if (schema_choose(self, &rate, key, value, rates))
        e->when.rate = (cw_phase_rate)rate;
}

/* The expectation keeps the name, not the number: rules come and go while the bus runs. */
static void read_rule(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg *config = cfg_of(self);
    cfg_expect *e = object;
    const char *text = schema_text(self, key, value, "the name of a rule");
    nearest guess = {.word = text};

    for (size_t i = 0; text && i < config->rule_count && !e->rule; i++) {
        const char *name = config->rules[i].name;
        if (name && strcmp(name, text) == 0)
            e->rule = schema_copy(self, text); /* the rule may go before */
        else if (name)
            nearest_consider(&guess, name);
    }
    if (text && !e->rule)
        schema_complain(self, value, "%s: there is no rule '%.64s'%s", key->name, text,
                        schema_suggestion(self, &guess));
}

/* ---- Combinations ---------------------------------------------------------------------------- */

/* Returns all subjects for a complaint, in the order of their table. */
static const char *list_subjects(schema *self)
{
    const char *list = "";

    for (size_t i = 0; i < SUBJECTS; i++)
        list = schema_join(self, list, subjects[i].name);
    return list;
}

/* Returns the only subject, or NULL after a complaint. */
static const subject *find_subject(schema *self, yaml_node_t *map)
{
    const subject *found = NULL;

    for (size_t i = 0; i < SUBJECTS; i++) {
        yaml_node_t *value = schema_find(self, map, subjects[i].name);
        if (value && found) {
            schema_complain(self, value, "'%s' and '%s': make an expectation of each", found->name,
                            subjects[i].name);
            return NULL;
        }
        if (value)
            found = &subjects[i];
    }
    if (!found)
        schema_complain(self, map, "expectation: expected one of %s", list_subjects(self));
    return found;
}

/* Complains about conditions that do not go with what is expected. */
static void check_conditions(schema *self, yaml_node_t *map, const subject *about)
{
    const char *allowed = "";

    for (size_t i = 0; i < CONDITIONS; i++)
        if (about->conditions & conditions[i].flag)
            allowed = schema_join(self, allowed, conditions[i].name);
    for (size_t i = 0; i < CONDITIONS; i++) {
        yaml_node_t *value = schema_find(self, map, conditions[i].name);
        if (value && !(about->conditions & conditions[i].flag))
            schema_complain(self, value, "%s: does not go with '%s'; %s%s", conditions[i].name,
                            about->name, *allowed ? "what does: " : "nothing does", allowed);
    }
}

/* Complains about expectations that could never have a meaningful result. */
static void check_sense(schema *self, yaml_node_t *map, const cfg_expect *e)
{
    const cfg *config = cfg_of(self);
    yaml_node_t *before = schema_find(self, map, "before");
    yaml_node_t *to = schema_find(self, map, "to");
    bool own = e->to && e->to == e->when.from && (e->to & (e->to - 1)) == 0;

    if (before && schema_find(self, map, "time"))
        schema_complain(self, before, "before: 'time' has an end of its own; give one of both");
    if (e->when.error_mask)
        schema_complain(
            self, schema_find(self, map, "frame"),
            "frame: error frames (#MASK) are no frames that are delivered; see 'errors'");
    if (e->kind == CFG_EXPECT_STATE && !e->node && !schema_find(self, map, "node"))
        schema_complain(self, map, "expectation: the key 'node' is missing");
    for (unsigned i = 0; own && i < config->node_count; i++)
        if ((e->to >> i & 1u) && !(config->nodes[i].modes & CW_MODE_LOOPBACK))
            schema_complain(self, to, "to: a node does not get its own frames");
}

/* Reads an expectation. It has one subject, which says what conditions go with it. */
static void read_expect(schema *self, yaml_node_t *value, cfg_expect *e)
{
    size_t errors = self->errors->errors;

    *e = (cfg_expect){
        .when.time_end = CW_NEVER,
        .max = UINT64_MAX,
        .delay_max = CW_NEVER,
        .line = (int)value->start_mark.line + 1,
    };
    for (unsigned i = 0; i < CFG_PERCENTILES; i++)
        e->percentile[i] = CW_NEVER;
    schema_map(self, "expectation", value, cfg_expect_keys, e);
    const subject *about = value->type == YAML_MAPPING_NODE ? find_subject(self, value) : NULL;
    if (!about)
        return;
    e->kind = about->kind;
    check_conditions(self, value, about);
    if (self->errors->errors == errors)
        check_sense(self, value, e);
}

/* Reads expectations one by one, so that each can be compared with those before it. */
static void read_list(schema *self, yaml_node_t *value, size_t count)
{
    cfg *config = cfg_of(self);

    config->expects = schema_alloc(self, count + 1, sizeof *config->expects);
    if (!config->expects)
        return;
    for (; config->expect_count < count; config->expect_count++)
        read_expect(self, schema_item(self, value, config->expect_count),
                    &config->expects[config->expect_count]);
}

void cfg_read_expect(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    (void)object;
    read_list(self, value, schema_count(self, key, value, 0, EXPECT_MAX));
}

/* ---- Expectations alone ---------------------------------------------------------------------- */

/* Reads the path of the verdict, which is relative to the configuration. */
void cfg_read_expect_report(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    const char *text = schema_text(self, key, value, "the path of a file");
    config->expect_report_place = cfg_place_of(value);
    if (text)
        config->expect_report = cfg_resolve_path(self, config->file, text);
}

/* The owner of expectations; cfg_load_expects() returns its first member. */
typedef struct expects_owner {
    cfg_expects expects;
    arena arena;
} expects_owner;

static void expect_read_root(schema *self, yaml_node_t *root)
{
    static const schema_key key = {.name = "expect"};

    read_list(self, root, schema_count_one(self, &key, root, 0, EXPECT_MAX));
}

/* Reads expectations without a configuration of their own. They live in the owner's memory. */
static bool expect_read_text(expects_owner *owner, cfg_walk *walk, diag *errors, const char *text,
                             size_t size)
{
    if (!cfg_read_text(&owner->arena, walk, errors, text, size, expect_read_root,
                       "there is no expectation"))
        return false;
    owner->expects.expects = walk->config->expects;
    owner->expects.count = walk->config->expect_count;
    return true;
}

cfg_expects *cfg_load_expects(const char *text, size_t size, const char *name, const cfg *config,
                              FILE *errors)
{
    diag found = {.file.name = name};
    cfg scratch = *config;
    cfg_walk walk = {.config = &scratch};
    expects_owner *owner = calloc(1, sizeof *owner);

    scratch.expects = NULL;
    scratch.expect_count = 0;
    if (!owner)
        diag_add(&found, 0, 0, "out of memory");
    else if (expect_read_text(owner, &walk, &found, text, size) &&
             cfg_keep_warnings(&owner->expects.warnings, &owner->arena, &found))
        return &owner->expects;
    diag_flush(&found, errors);
    cfg_free_expects(owner ? &owner->expects : NULL);
    return NULL;
}

void cfg_free_expects(cfg_expects *expects)
{
    if (!expects)
        return;
    expects_owner *owner = (expects_owner *)expects;
    arena_free(&owner->arena);
    free(owner);
}
