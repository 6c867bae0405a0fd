/* SPDX-License-Identifier: MIT
 *
 * rule.c - the keys of fault rules other than `do`: name and when. The trigger follows from the
 * conditions and the action.
 */
#include "config/parts.h"
#include "config/values.h"
#include <string.h>

static schema_reader read_nothing, read_when, read_states, read_window, read_after, read_after_rule;
static void check_period(schema *self, const yaml_node_t *map, const cw_rule *rule);
static void rule_read_name(schema *self, yaml_node_t *value, cw_rule *rule);
static void complete_trigger(schema *self, const yaml_node_t *map, cw_rule *rule);
static const schema_range number_range = {0, UINT32_MAX, sizeof(uint32_t)};
static const schema_range positive_range = {1, UINT32_MAX, sizeof(uint32_t)};

static const schema_choice rates[] = {
    {.name = "nominal", .value = CW_RATE_NOMINAL},
    {.name = "data", .value = CW_RATE_DATA},
    {.name = NULL},
};

static const schema_key after_keys[] = {
    {.name = "rule", .read = read_after_rule, .required = true,
     .type = TYPE_TEXT("^(?:[A-Za-z0-9_.-]+)$"),
     .help = "A rule of this file; for `inject` one of the same text, or one that runs."},
    {.name = "delay", .read = cfg_read_bits, .offset = offsetof(cw_rule, after_delay),
     .preset = "0",
     .help = "Between its hit and this rule."},
    {.name = NULL},
};

static const schema_key when_keys[] = {
    {.name = "frame", .read = cfg_read_filters,
     .type = TYPE_ANY(TYPE_REF("filter") ", " TYPE_LIST(1, 8, TYPE_OPEN(TYPE_REF("filter")))),
     .help = "Filters as can-utils write them, several in one text separated by commas, at most 8 "
             "in all: one must match. `123` exact (base), `12345678` exact (extended), `100:700` "
             "value and mask, `100~700` inverted. With a mask an 8-digit value means extended; "
             "mask bit `40000000` looks at RTR, `80000000` at the format. `#MASK` means error "
             "frames of these classes of `linux/can/error.h` instead (`#4` state changes, `#40` "
             "bus-off, `#2` lost arbitration, `#88` bus errors, `#20` missing ACK, `#100` "
             "restarts, `#FFFFFFFF` all), as the node in `from` sees them. It goes neither with "
             "other filters, nor with `data`, nor with an action that needs a frame. Default: all "
             "frames."},
    {.name = "data", .read = cfg_read_data,
     .help = "Data bytes from the first on: `DEAD..EF` or `DE AD x1`; `.` or `x` stands for any "
             "digit, blanks only between bytes; 1 to 8 bytes, on a bus with CAN FD nodes up to 64. "
             "Shorter frames do not match, longer ones do."},
    {.name = "rate", .read = cfg_read_rate, .offset = offsetof(cw_rule, rate), .arg = rates,
     .type = TYPE_CHOICE,
     .help = "data: frames with BRS, so with a fast part (CAN FD); of error frames: errors that "
             "the node finds in the fast part. nominal: all others. Default: both."},
    {.name = "from", .read = cfg_read_node_set, .offset = offsetof(cw_rule, from),
     .help = "The transmitter; of error frames: who sees the error. Default: any node."},
    {.name = "state", .read = read_states,
     .type = "{'type': 'object', 'minProperties': 1, 'propertyNames': "
             "{'pattern': '^[A-Za-z0-9_.-]+$|\\$'}, 'additionalProperties': "
             TYPE_SOME(4, TYPE_OPEN(TYPE_REF("state"))) "}",
     .help = "A map NODE: STATE, or NODE: a list of states. It is asked when the rule would act "
             "(alone it is asked once, at the start: add `frame: '#4'` to act on the change); "
             "then each of these nodes is in its state. All nodes of a rule have the same states; "
             "for different ones make two rules in sequence."},
    {.name = "time", .read = read_window, .type = "window",
     .help = "`2s..5s`, `2s..`, `..5s` or `2s`: bus time since the start of the bus (also for "
             "rules that are injected later: a window that is over never acts), half open, tested "
             "at the start of a bit. `2s` alone is `2s..`, and the moment for a rule that waits "
             "for nothing else. Default: always."},
    {.name = "period", .read = cfg_read_period, .offset = offsetof(cw_rule, again_ticks),
     .help = "A rule that acts at its time acts again after each period, before the end of its "
             "window: at 1 s, 2 s, 3 s with `time: 1s.., period: 1s`. The times keep to that grid "
             "of bus time, also for a rule that is injected later or stays through a reload. "
             "`skip`, `every`, `count`, `probability`, `state` and `hold-off` choose among them. "
             "What the rule does needs an end (`for`), else it could not begin again; with a `for` "
             "longer than the period it just goes on. Not for rules that wait for frames, errors, "
             "other rules or a hand. Default: once."},
    {.name = "after", .read = read_after, .map = after_keys,
     .help = "Each hit of another rule arms this one for one hit. That rule may stand later in "
             "the file."},
    {.name = "skip", .read = schema_read_uint, .offset = offsetof(cw_rule, skip),
     .arg = &number_range,
     .preset = "0",
     .help = "Matches that are passed over first."},
    {.name = "every", .read = schema_read_uint, .offset = offsetof(cw_rule, every),
     .arg = &positive_range,
     .preset = "1",
     .help = "Then the next match and every N-th after it is taken."},
    {.name = "count", .read = schema_read_uint, .offset = offsetof(cw_rule, count),
     .arg = &positive_range,
     .help = "The rule ends after so many hits. Default: no end."},
    {.name = "hold-off", .read = cfg_read_bits, .offset = offsetof(cw_rule, hold_off),
     .preset = "0",
     .help = "After a hit no match counts for this time."},
    {.name = "probability", .read = cfg_read_fraction, .offset = offsetof(cw_rule, probability),
     .preset = "1",
     .help = "Drawn for each match that is taken: `0.05`, `1e-3`; exact to 2^-64."},
    {.name = "manual", .read = schema_read_bool, .offset = offsetof(cw_rule, manual),
     .preset = "false",
     .help = "Armed by hand, `canwire fire BUS RULE`, for one hit each time."},
    {.name = NULL},
};

/* The names have been read before: rules may refer to later ones. */
const schema_key cfg_rule_keys[] = {
    {.name = "name", .read = read_nothing, .required = true,
     .type = TYPE_TEXT("^(?:[A-Za-z0-9_.-]{1,63})$"),
     .help = "Distinct, 1 to 63 letters, digits, `_`, `.`, `-`. With the seed it gives the rule's "
             "random stream: other rules do not change its draws, another name does."},
    {.name = "when", .read = read_when, .map = when_keys, .as = "when",
     .help = "All these conditions together. Default: any frame, or the start."},
    {.name = "do", .read = cfg_read_action, .required = true, .type = "do",
     .help = "One action with its keys."},
    {.name = NULL, .open = true},
};

static const schema_key name_key = {.name = "name"};

/* The trigger follows from all keys together, so it comes after them. */
static void read_rule(schema *self, yaml_node_t *value, cw_rule *rule)
{
    schema_map(self, "rule", value, cfg_rule_keys, rule);
    if (value->type != YAML_MAPPING_NODE)
        return;
    complete_trigger(self, value, rule);
    check_period(self, value, rule);
}

/* Copies the rules and their places to longer arrays. */
static bool grow_rules(schema *self, size_t more)
{
    cfg *config = cfg_of(self);
    cw_rule *rules = schema_alloc(self, config->rule_count + more + 1, sizeof *rules);
    cfg_rule_place *places = schema_alloc(self, config->rule_count + more + 1, sizeof *places);

    if (!rules || !places)
        return false;
    if (config->rule_count > 0) {
        memcpy(rules, config->rules, config->rule_count * sizeof *rules);
        memcpy(places, config->rule_places, config->rule_count * sizeof *places);
    }
    config->rules = rules;
    config->rule_places = places;
    return true;
}

void cfg_read_rules(schema *self, const schema_key *key, yaml_node_t *value)
{
    cfg_walk *walk = self->user;
    cfg *config = walk->config;
    size_t first = config->rule_count;
    size_t room = CW_RULES_MAX - first - config->reply_count;
    size_t count = schema_count_one(self, key, value, 0, room);

    walk->list = first;
    const char *file = schema_copy(self, self->errors->file.name);
    if (!file || !grow_rules(self, count))
        return;
    for (size_t i = 0; i < count && !self->errors->overflow; i++) {
        config->rules[first + i] = (cw_rule){.time_end = CW_NEVER, .bits = 1};
        schema_read_presets(self, when_keys, &config->rules[first + i]);
        yaml_node_t *item = schema_item(self, value, i);
        config->rule_places[first + i] = (cfg_rule_place){.file = file,
                                                          .place = cfg_place_of(item)};
        rule_read_name(self, item, &config->rules[first + i]);
        config->rule_count++;
    }
    for (size_t i = 0; i < count && !self->errors->overflow; i++)
        read_rule(self, schema_item(self, value, i), &config->rules[first + i]);
}

/* Takes a list alone. A text to inject may also be a single rule. */
void cfg_read_faults(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    (void)object;
    if (value->type == YAML_SEQUENCE_NODE)
        cfg_read_rules(self, key, value);
    else
        schema_expected(self, key, value, "a list");
}

/* Takes a key that has been read before the others. */
static void read_nothing(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    (void)self;
    (void)key;
    (void)value;
    (void)object;
}

/* Returns the index of the rule of that name among those read so far, or rule_count. */
static size_t rule_find_rule(const cfg *config, size_t first, const char *name)
{
    size_t i = first;

    while (i < config->rule_count &&
           (!config->rules[i].name || strcmp(config->rules[i].name, name) != 0))
        i++;
    return i < config->rule_count ? i : config->rule_count;
}

/* Returns the index of the running rule of that name, or running->count. */
static size_t find_running(const cfg_running *running, const char *name)
{
    size_t i = 0;

    while (i < running->count && (!running->names[i] || strcmp(running->names[i], name) != 0))
        i++;
    return i;
}

/* Complains about a name that another rule has, here or on the bus that runs. */
static void check_distinct(schema *self, const yaml_node_t *value, const char *name)
{
    const cfg_walk *walk = self->user;
    size_t other = rule_find_rule(walk->config, 0, name);

    if (walk->running && find_running(walk->running, name) < walk->running->count)
        schema_complain(self, value, "a rule '%s' is running already; clear it first", name);
    else if (other < walk->list)
        schema_complain(self, value,
                        "duplicate name '%s' (also of a rule of a profile); give the profile a "
                        "prefix with 'as'",
                        name);
    else if (other < walk->config->rule_count)
        schema_complain(self, value, "duplicate name '%s' (also of rule %zu in the list)", name,
                        other - walk->list + 1);
}

/* Returns the name of a rule with the prefix of its profile, or NULL after a complaint. */
static const char *full_name(schema *self, const char *name)
{
    const cfg_walk *walk = self->user;

    return walk->prefix ? schema_print(self, "%s.%s", walk->prefix, name) : name;
}

/* Reads the name; a rule with a missing or unknown name stays without one. */
static void rule_read_name(schema *self, yaml_node_t *value, cw_rule *rule)
{
    if (value->type != YAML_MAPPING_NODE)
        return;
    yaml_node_t *name = schema_find(self, value, name_key.name);
    if (!name || schema_is_open(self, name))
        return;
    const char *text = cfg_read_name(self, &name_key, name, RULE_NAME_MAX);
    if (!text)
        return;
    const char *full = full_name(self, text);
    if (!full)
        return;
    if (full != text && strlen(full) > RULE_NAME_MAX)
        schema_complain(self, name, "name: '%s' has more than %d characters with its prefix", full,
                        RULE_NAME_MAX);
    check_distinct(self, name, full);
    rule->name = full;
}

static void read_when(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, when_keys, object);
}

/* Reads one entry, NODE: STATE or NODE: [STATES]. */
static void read_state(schema *self, const schema_key *key, const yaml_node_t *node,
                       yaml_node_t *value, cw_rule *rule)
{
    uint64_t bit = cfg_read_node_mask(self, key, node);
    uint8_t mask = cfg_read_states(self, key, value);

    if (rule->state_nodes & bit)
        schema_complain(self, node, "%s: this node is in the map twice", key->name);
    else if (rule->state_mask && mask && mask != rule->state_mask)
        schema_complain(self, value,
                        "%s: all nodes of one rule wait for the same states; make a rule for each "
                        "and put them in sequence with 'after'",
                        key->name);
    rule->state_nodes |= bit;
    rule->state_mask |= mask;
}

/* All nodes of the map are in one set of states; read_state() compares them. */
static void read_states(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "a map such as { engine: error-passive }";
    yaml_node_t *states;
    yaml_node_t *node = NULL;

    if (value->type == YAML_MAPPING_NODE)
        node = schema_pair(self, &states, value, 0);
    if (!node)
        schema_expected(self, key, value, expected);
    for (size_t i = 1; node; i++) {
        read_state(self, key, node, states, object);
        node = schema_pair(self, &states, value, i);
    }
}

/* A rule acts at bits, so both ends are rounded up to bits, with a warning. */
static void read_window(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cw_rule *rule = object;

    cfg_read_window(self, key, value, object);
    cfg_warn_rounded(self, key, value, rule->time_begin);
    cfg_warn_rounded(self, key, value, rule->time_end);
}

static void read_after(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, after_keys, object);
}

/* Complains about a rule that does not exist, with a guess. */
static void complain_no_rule(schema *self, const schema_key *key, const yaml_node_t *value,
                             const char *name)
{
    const cfg_walk *walk = self->user;
    nearest guess = {.word = name};

    for (size_t i = walk->first_rule; i < walk->config->rule_count; i++)
        if (walk->config->rules[i].name)
            nearest_consider(&guess, walk->config->rules[i].name);
    for (size_t i = 0; walk->running && i < walk->running->count; i++)
        if (walk->running->names[i])
            nearest_consider(&guess, walk->running->names[i]);
    schema_complain(self, value, "%s: there is no rule '%.64s'%s", key->name, name,
                    schema_suggestion(self, &guess));
}

/* Reads the name of a rule; rules of the same text take precedence over running ones. */
static void read_after_rule(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;
    cw_rule *rule = object;
    size_t running = walk->running ? walk->running->count : 0;
    const char *text = schema_text(self, key, value, "the name of a rule");

    rule->has_after = true;
    const char *full = text ? full_name(self, text) : NULL;
    if (!full)
        return;
    size_t own = rule_find_rule(config, walk->first_rule, full);
    size_t other = walk->running ? find_running(walk->running, text) : running;
    if (own < config->rule_count && &config->rules[own] == rule)
        schema_complain(self, value, "%s: a rule cannot come after itself", key->name);
    else if (own < config->rule_count)
        rule->after = (uint16_t)(running + own);
    else if (other < running)
        rule->after = (uint16_t)other;
    else
        complain_no_rule(self, key, value, text);
}

/* Returns the value of a key of `when`, or NULL. */
static yaml_node_t *find_when(schema *self, const yaml_node_t *map, const char *name)
{
    const yaml_node_t *when = schema_find(self, map, "when");

    return when && when->type == YAML_MAPPING_NODE ? schema_find(self, when, name) : NULL;
}

/* Complains about a rule that waits for error frames and needs what only frames have. */
static void check_error_trigger(schema *self, const yaml_node_t *map, const cw_rule *rule)
{
    const yaml_node_t *frame = find_when(self, map, "frame");
    const yaml_node_t *data = find_when(self, map, "data");

    if (rule->filter_count > 0)
        schema_complain(self, frame,
                        "frame: a rule waits for frames or for error frames (#MASK), "
                        "not for both");
    else if (data)
        schema_complain(self, data, "data: error frames (#MASK) have no data to compare");
    else if (cw_action_needs_frame(rule->action))
        schema_complain(self, frame,
                        "frame: what this rule does needs a frame on the bus, an "
                        "error frame (#MASK) is none");
}

/* Returns true when the rule acts in frames, at a position if its action has one. */
static bool acts_in_frames(schema *self, const yaml_node_t *map, const cw_rule *rule)
{
    const bool pulse = rule->action == CW_ACTION_PULSE;
    const bool waits = find_when(self, map, "frame") || find_when(self, map, "data") ||
                       find_when(self, map, "from") || find_when(self, map, "rate");

    if (pulse && waits && rule->field == CW_FIELD_NONE && !rule->error_mask)
        schema_complain(self, schema_find(self, map, "do"),
                        "from: a pulse in a frame needs a position, such as crc[3]");
    return waits || cw_action_needs_frame(rule->action) || (pulse && rule->field);
}

/* Derives the trigger of the rule from its conditions and its action. */
static void complete_trigger(schema *self, const yaml_node_t *map, cw_rule *rule)
{
    const bool on_frames = acts_in_frames(self, map, rule);

    if (rule->error_mask) {
        rule->trigger = CW_TRIGGER_ERROR;
        check_error_trigger(self, map, rule);
    } else if (on_frames) {
        rule->trigger = CW_TRIGGER_FRAME;
    } else if (rule->has_after || rule->manual) {
        rule->trigger = CW_TRIGGER_ARMED;
    } else {
        rule->trigger = CW_TRIGGER_TIME;
    }
}

/* Returns true when a rule has times without an end. Its count may never be used up where it waits
 * for states, or where chance lets it act never. */
static bool never_ends(const cw_rule *rule)
{
    return rule->again_ticks > 0 && rule->time_end == CW_NEVER &&
           (rule->count == 0 || rule->state_nodes != 0 || rule->probability == 0);
}

bool cfg_find_unending(const cfg *config, cfg_unending *found)
{
    cfg_unending none = {.what = NULL};
    const cfg_traffic *traffic = cfg_find_endless(config);
    const cfg_place *place = traffic ? &traffic->place : cfg_find_master(config);
    size_t i = 0;

    found = found ? found : &none;
    if (place) {
        *found = (cfg_unending){.what = traffic ? "traffic without `count`"
                                                : "the schedule of a time master",
                                .remedy = traffic ? "`count`, " : "",
                                .file = config->file,
                                .place = *place};
        return true;
    }
    while (i < config->rule_count && !never_ends(&config->rules[i]))
        i++;
    if (i == config->rule_count)
        return false;
    *found = (cfg_unending){.what = "a rule with `period`",
                            .remedy = config->rules[i].count == 0
                                          ? "`count`, an end of its `time`, "
                                          : "an end of its `time`, ",
                            .file = config->rule_places[i].file,
                            .place = config->rule_places[i].place,
                            .is_rule = true};
    return true;
}

/* Returns true when what the rule does goes on from the first time to the end. */
static bool lasts_on(schema *self, const yaml_node_t *map, const cw_rule *rule)
{
    const cw_action_kind kind = cw_action_kind_of(rule->action);
    const bool once = rule->action == CW_ACTION_RAW || rule->dominant_timeout > 0 ||
                      (rule->action == CW_ACTION_SEND && rule->period_ticks == 0) ||
                      rule->action == CW_ACTION_RAW_FRAME;
    const yaml_node_t *does = schema_find(self, map, "do");
    const bool map_given = does && does->type == YAML_MAPPING_NODE;
    const yaml_node_t *length = map_given ? schema_find(self, does, "for") : NULL;

    return (kind == CW_KIND_LEVEL || kind == CW_KIND_TRAFFIC) && !once && rule->for_ticks == 0 &&
           !(length && schema_is_open(self, length));
}

/* A rule that waits for something else has no times of its own. */
static void check_period(schema *self, const yaml_node_t *map, const cw_rule *rule)
{
    yaml_node_t *period = find_when(self, map, "period");

    if (!period || schema_is_open(self, period))
        return;
    if (rule->trigger != CW_TRIGGER_TIME)
        schema_complain(self, period,
                        "period: it is for rules that act at their time; this one waits for %s",
                        rule->trigger == CW_TRIGGER_ARMED ? "another rule, or a hand"
                                                          : "frames or errors");
    else if (lasts_on(self, map, rule))
        schema_complain(self, period,
                        "period: '%s' without 'for' goes on to the end, and does not begin again",
                        cw_action_name(rule->action));
}
