/* SPDX-License-Identifier: MIT
 *
 * action.c - the actions of fault rules: the key `do`, with a table of keys for each action.
 */
#include "config/parts.h"
#include "config/protect.h"
#include "config/values.h"
#include "config/wake.h"

#include <string.h>

#define COPIES_MAX 16u /* of a frame by one hit, as in the library */
#define OVERTAKING_MAX CW_QUEUE_MAX
#define OVERLOAD_FRAMES_MAX 2u
#define TEC_MAX 263u /* the limit of cw_mac_set_counters() */
#define REC_MAX 255u
#define DLC_MAX 15u
#define TICKS_PER_MS (CW_CLOCK_HZ / 1000u)

/* Checks the keys of an action against each other and completes the rule; `map` is the value of
 * `do`. */
typedef void action_completer(schema *self, yaml_node_t *map, cw_rule *rule);

typedef struct action {
    cw_action action;
    const schema_key *keys; /* the first key is the action's own, which has its name */
    action_completer *complete; /* or NULL */
} action;

/* A setting of a node in the form of schema_read_uint(), and its CW_SET_*. */
typedef struct setting {
    schema_range range; /* first: schema_read_uint() gets the pointer */
    uint8_t which;
} setting;

static schema_reader read_level, read_levels, read_at, read_groups,
    read_load, read_change, read_id, read_dlc, read_bytes, read_mode, read_setting,
    read_restart, read_order, read_sleep, read_wake;
static action_completer complete_force, complete_stuck, complete_wrong_crc, complete_counters,
    complete_set, complete_side, complete_change, complete_send, complete_babble,
    complete_reply, complete_making;

static const schema_range bits_range = {1, UINT16_MAX, sizeof(uint16_t)};
static const schema_range tec_range = {0, TEC_MAX, sizeof(uint16_t)};
static const schema_range rec_range = {0, REC_MAX, sizeof(uint16_t)};
static const schema_range overload_range = {1, OVERLOAD_FRAMES_MAX, sizeof(uint32_t)};
static const schema_range copies_range = {1, COPIES_MAX, sizeof(uint32_t)};
static const schema_range overtaking_range = {1, OVERTAKING_MAX, sizeof(uint32_t)};
static const schema_range dlc_range = {0, DLC_MAX, sizeof(uint8_t)};

static const setting queue_setting = {{1, CW_QUEUE_MAX, sizeof(uint16_t)}, CW_SET_QUEUE};
static const setting warning_setting = {{1, 255, sizeof(uint16_t)}, CW_SET_WARNING};
static const setting restart_setting = {{0, UINT32_MAX, sizeof(uint64_t)}, CW_SET_RESTART};

static const schema_choice levels[] = {
    {.name = "dominant", .value = CW_DOMINANT},
    {.name = "recessive", .value = CW_RECESSIVE},
    {.name = NULL},
};

static const schema_choice sides[] = {
    {.name = "tx", .value = CW_SIDE_TX},
    {.name = "rx", .value = CW_SIDE_RX},
    {.name = NULL},
};

static const schema_choice counter_faults[] = {
    {.name = "stuck", .value = CW_COUNTER_STUCK},
    {.name = "skip", .value = CW_COUNTER_SKIP},
    {.name = "repeat", .value = CW_COUNTER_REPEAT},
    {.name = NULL},
};

static const schema_choice checksum_faults[] = {
    {.name = "wrong", .value = 1},
    {.name = NULL},
};

/* Keys of several actions. */
#define MEMBER(m) .offset = offsetof(cw_rule, m)
#define AT                                                                                         \
    {                                                                                              \
        .name = "at", .read = read_at, MEMBER(at)                                                  \
    }
#define FOR                                                                                        \
    {                                                                                              \
        .name = "for", .read = cfg_read_bits, MEMBER(for_ticks)                                   \
    }
#define FROM                                                                                       \
    {                                                                                              \
        .name = "from", .read = cfg_read_position, .required = true                                \
    }
#define AS                                                                                         \
    {                                                                                              \
        .name = "as", .read = cfg_read_node_index, MEMBER(node), .required = true                  \
    }
#define SIDE                                                                                       \
    {                                                                                              \
        .name = "side", .read = schema_read_choice, MEMBER(side), .arg = sides                     \
    }
#define NODES(key)                                                                                 \
    {                                                                                              \
        .name = (key), .read = cfg_read_node_set, MEMBER(nodes)                                    \
    }
#define FRAME(key)                                                                                 \
    {                                                                                              \
        .name = (key), .read = cfg_read_frame, MEMBER(frame)                                       \
    }
#define NUMBER(key, range)                                                                         \
    {                                                                                              \
        .name = (key), .read = schema_read_uint, MEMBER(number), .arg = (range)                    \
    }
#define BITS                                                                                       \
    {                                                                                              \
        .name = "bits", .read = schema_read_uint, MEMBER(bits), .arg = &bits_range                 \
    }
#define END                                                                                        \
    {                                                                                              \
        .name = NULL                                                                               \
    }

static const schema_key flip_keys[] = {{.name = "flip", .read = cfg_read_position}, BITS, AT, END};
static const schema_key force_keys[] = {
    {.name = "force", .read = read_level},
    FROM,
    BITS,
    {.name = "for", .read = cfg_read_bits_min, MEMBER(for_ticks)},
    AT,
    END,
};
static const schema_key glitch_keys[] = {{.name = "glitch", .read = read_levels}, FROM, AT, END};
static const schema_key stuck_keys[] = {
    {.name = "stuck", .read = read_level},
    {.name = "on", .read = cfg_read_line},
    {.name = "for", .read = cfg_read_ticks, MEMBER(for_ticks)},
    {.name = "dominant-timeout", .read = cfg_read_bits_min, MEMBER(dominant_timeout)},
    END,
};
static const schema_key noise_keys[] = {
    {.name = "noise", .read = cfg_read_fraction, MEMBER(error_rate)},
    {.name = "burst", .read = cfg_read_burst},
    AT,
    FOR,
    END,
};
static const schema_key no_ack_keys[] = {NODES("no-ack"), FOR, END};
static const schema_key wrong_crc_keys[] = {NODES("wrong-crc"), END};
static const schema_key bus_off_keys[] = {NODES("bus-off"), END};
static const schema_key error_flag_keys[] = {NODES("error-flag"), END};
static const schema_key restart_keys[] = {NODES("restart"), END};
static const schema_key counters_keys[] = {
    NODES("counters"),
    {.name = "tec", .read = schema_read_uint, MEMBER(tec), .arg = &tec_range},
    {.name = "rec", .read = schema_read_uint, MEMBER(rec), .arg = &rec_range},
    END,
};
static const schema_key overload_keys[] = {NODES("overload"), NUMBER("frames", &overload_range),
                                           END};
static const schema_key set_keys[] = {
    NODES("set"),
    {.name = "one-shot", .read = read_mode},
    {.name = "listen-only", .read = read_mode},
    {.name = "loopback", .read = read_mode},
    {.name = "presume-ack", .read = read_mode},
    {.name = "restricted", .read = read_mode},
    {.name = "time-triggered", .read = read_mode},
    {.name = "berr-reporting", .read = read_mode},
    {.name = "lost-arbitration-reporting", .read = read_mode},
    {.name = "restart-ms",
     .read = read_restart,
     MEMBER(settings.restart_ticks),
     .arg = &restart_setting},
    {.name = "queue", .read = read_setting, MEMBER(settings.queue), .arg = &queue_setting},
    {.name = "order", .read = read_order, MEMBER(settings.order), .arg = cfg_orders},
    {.name = "warning-limit",
     .read = read_setting,
     MEMBER(settings.warning_limit),
     .arg = &warning_setting},
    {.name = "sleep", .read = read_sleep},
    {.name = "wake-filter", .read = read_wake},
    {.name = "wake-time", .read = read_wake},
    {.name = "wake-on", .read = read_wake},
    {.name = "clock", .read = cfg_read_retime},
    {.name = "ppm", .read = cfg_read_retime},
    {.name = "sample-point", .read = cfg_read_retime},
    {.name = "brp", .read = cfg_read_retime},
    {.name = "prop-seg", .read = cfg_read_retime},
    {.name = "phase-seg1", .read = cfg_read_retime},
    {.name = "phase-seg2", .read = cfg_read_retime},
    {.name = "sjw", .read = cfg_read_retime},
    {.name = "triple-sampling", .read = cfg_read_retime},
    {.name = "dbrp", .read = cfg_read_retime},
    {.name = "dprop-seg", .read = cfg_read_retime},
    {.name = "dphase-seg1", .read = cfg_read_retime},
    {.name = "dphase-seg2", .read = cfg_read_retime},
    {.name = "dsjw", .read = cfg_read_retime},
    {.name = "dsample-point", .read = cfg_read_retime},
    {.name = "tdc-mode", .read = cfg_read_retime},
    {.name = "tdco", .read = cfg_read_retime},
    {.name = "tdcv", .read = cfg_read_retime},
    {.name = "tx-delay", .read = cfg_read_reway},
    {.name = "rx-delay", .read = cfg_read_reway},
    {.name = "position", .read = cfg_read_retime},
    {.name = "stub", .read = cfg_read_retime},
    {.name = "ringing", .read = cfg_read_retime},
    {.name = "ramp", .read = cfg_read_ramp},
    END,
};
static const schema_key software_reset_keys[] = {NODES("software-reset"), END};
static const schema_key hardware_reset_keys[] = {NODES("hardware-reset"), END};
static const schema_key disconnect_keys[] = {NODES("disconnect"), FOR, END};
static const schema_key partition_keys[] = {{.name = "partition", .read = read_groups}, FOR, END};
static const schema_key drop_keys[] = {
    {.name = "drop", .read = schema_read_choice, MEMBER(side), .arg = sides}, AT, END};
static const schema_key delay_keys[] = {
    {.name = "delay", .read = cfg_read_bits_min, MEMBER(for_ticks)}, AT, SIDE, END};
static const schema_key duplicate_keys[] = {NUMBER("duplicate", &copies_range), AT, SIDE, END};
static const schema_key reorder_keys[] = {NUMBER("reorder", &overtaking_range), AT, SIDE, END};
static const schema_key change_keys[] = {
    {.name = "change", .read = read_change, MEMBER(change)}, AT, SIDE, END};
static const schema_key counter_keys[] = {
    {.name = "counter", .read = schema_read_choice, MEMBER(number), .arg = counter_faults}, END};
static const schema_key checksum_keys[] = {
    {.name = "checksum", .read = schema_read_choice, MEMBER(number), .arg = checksum_faults}, END};
static const schema_key send_keys[] = {
    FRAME("send"), AS,  {.name = "every", .read = cfg_read_period, MEMBER(period_ticks)},
    FOR,           END,
};
static const schema_key babble_keys[] = {
    FRAME("babble"), AS,  {.name = "every", .read = cfg_read_period, MEMBER(period_ticks)},
    FOR,             END,
};
static const schema_key load_keys[] = {
    {.name = "load", .read = read_load, MEMBER(load_permille)}, AS, FOR, END};
static const schema_key reply_keys[] = {
    FRAME("reply"), AS, {.name = "delay", .read = cfg_read_bits, MEMBER(for_ticks)}, END};

/* The keys of `change: { ... }`, a cw_change. */
static const schema_key change_part_keys[] = {
    {.name = "id", .read = read_id},
    {.name = "dlc", .read = read_dlc, .offset = offsetof(cw_change, dlc), .arg = &dlc_range},
    {.name = "set", .read = read_bytes, .offset = offsetof(cw_change, set)},
    {.name = "and", .read = read_bytes, .offset = offsetof(cw_change, and_mask)},
    {.name = "or", .read = read_bytes, .offset = offsetof(cw_change, or_mask)},
    {.name = "xor", .read = read_bytes, .offset = offsetof(cw_change, xor_mask)},
    END,
};

/* The actions in the order of messages. */
static const action actions[] = {
    {CW_ACTION_FLIP, flip_keys, NULL},
    {CW_ACTION_FORCE, force_keys, complete_force},
    {CW_ACTION_GLITCH, glitch_keys, NULL},
    {CW_ACTION_STUCK, stuck_keys, complete_stuck},
    {CW_ACTION_NOISE, noise_keys, NULL},
    {CW_ACTION_PULSE, cfg_pulse_keys, NULL},
    {CW_ACTION_JITTER, cfg_jitter_keys, NULL},
    {CW_ACTION_NO_ACK, no_ack_keys, NULL},
    {CW_ACTION_WRONG_CRC, wrong_crc_keys, complete_wrong_crc},
    {CW_ACTION_BUS_OFF, bus_off_keys, NULL},
    {CW_ACTION_ERROR_FLAG, error_flag_keys, NULL},
    {CW_ACTION_RESTART, restart_keys, NULL},
    {CW_ACTION_COUNTERS, counters_keys, complete_counters},
    {CW_ACTION_OVERLOAD, overload_keys, NULL},
    {CW_ACTION_SET, set_keys, complete_set},
    {CW_ACTION_SOFTWARE_RESET, software_reset_keys, NULL},
    {CW_ACTION_HARDWARE_RESET, hardware_reset_keys, NULL},
    {CW_ACTION_RAW, cfg_raw_keys, cfg_complete_raw},
    {CW_ACTION_DISCONNECT, disconnect_keys, NULL},
    {CW_ACTION_PARTITION, partition_keys, NULL},
    {CW_ACTION_DROP, drop_keys, complete_side},
    {CW_ACTION_DELAY, delay_keys, complete_side},
    {CW_ACTION_DUPLICATE, duplicate_keys, complete_side},
    {CW_ACTION_REORDER, reorder_keys, complete_side},
    {CW_ACTION_CHANGE, change_keys, complete_change},
    {CW_ACTION_COUNTER, counter_keys, complete_making},
    {CW_ACTION_CHECKSUM, checksum_keys, complete_making},
    {CW_ACTION_SEND, send_keys, complete_send},
    {CW_ACTION_BABBLE, babble_keys, complete_babble},
    {CW_ACTION_LOAD, load_keys, NULL},
    {CW_ACTION_REPLY, reply_keys, complete_reply},
};

#define ACTION_COUNT (sizeof actions / sizeof actions[0])

static const action *find_action(schema *self, const yaml_node_t *map);
static void complain_no_action(schema *self, yaml_node_t *map, cw_rule *rule);
static void set_defaults(cw_rule *rule);

void cfg_read_action(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    size_t errors = self->errors->errors;
    const action *found = NULL;

    if (value->type == YAML_MAPPING_NODE)
        found = find_action(self, value);
    if (!found)
        complain_no_action(self, value, rule);
    if (!found || self->errors->errors > errors)
        return;
    rule->action = found->action;
    set_defaults(rule);
    schema_map(self, key->name, value, found->keys, rule);
    if (found->complete && self->errors->errors == errors)
        found->complete(self, value, rule);
}

/* Sets the defaults of the keys of an action. */
static void set_defaults(cw_rule *rule)
{
    rule->line = CW_LINE_WIRE;
    rule->number = 1;
    rule->tec = CW_KEEP;
    rule->rec = CW_KEEP;
    memset(rule->change.and_mask, 0xFF, sizeof rule->change.and_mask);
}

/* Returns the only action of a map, or NULL when there is none. Complains about a second one. */
static const action *find_action(schema *self, const yaml_node_t *map)
{
    const action *found = NULL;
    bool replies = schema_find(self, map, "reply"); /* `delay` is then one of its keys */

    for (size_t i = 0; i < ACTION_COUNT; i++) {
        const yaml_node_t *value = schema_find(self, map, cw_action_name(actions[i].action));

        if (!value || (replies && actions[i].action == CW_ACTION_DELAY))
            continue;
        if (!found) {
            found = &actions[i];
            continue;
        }
        schema_complain(self, map, "do: a rule has one action, not both '%s' and '%s'",
                        cw_action_name(found->action), cw_action_name(actions[i].action));
        break;
    }
    return found;
}

/* Lists all actions as keys, so that an unknown one gets a suggestion. */
static void complain_no_action(schema *self, yaml_node_t *map, cw_rule *rule)
{
    schema_key keys[ACTION_COUNT + 1] = {END};
    size_t errors = self->errors->errors;
    const char *list = "";

    for (size_t i = 0; i < ACTION_COUNT; i++) {
        keys[i] = (schema_key){.name = cw_action_name(actions[i].action), .read = cfg_read_action};
        list = schema_join(self, list, cw_action_name(actions[i].action));
    }
    schema_map(self, "do", map, keys, rule);
    if (self->errors->errors == errors)
        schema_complain(self, map, "do: an action is missing; one of: %s", list);
}

static void read_level(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    unsigned level;

    if (schema_choose(self, &level, key, value, levels))
        rule->level = level;
}

static void read_levels(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    text_levels found = {.bits = 1};
    const char *text = schema_text(self, key, value, "levels such as 10x1");

    if (text)
        schema_problem(self, key, value, text_parse_levels(&found, text));
    rule->bits = found.bits;
    rule->pattern_level = found.level;
    rule->pattern_mask = found.mask;
}

/* Reads nodes, or `wire`, the default, for all nodes. A node may have the name `wire`. */
static void read_at(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    bool wire = value->type == YAML_SCALAR_NODE &&
                strcmp((const char *)value->data.scalar.value, "wire") == 0;

    if (!wire || cfg_find_node(walk->config, "wire") != CW_NO_NODE)
        cfg_read_node_set(self, key, value, object);
}

static void join_group(schema *self, const schema_key *key, const yaml_node_t *value,
                       uint64_t *named, uint8_t *group, uint8_t number)
{
    if (schema_is_open(self, value))
        return;
    const char *name = schema_text(self, key, value, "the name of a node");
    int node = name ? cfg_read_node(self, key, value, name) : -1;
    if (node < 0)
        return;
    if (*named >> node & 1)
        schema_complain(self, value, "%s: '%s' is named twice", key->name, name);
    *named |= UINT64_C(1) << node;
    group[node] = number;
}

/* Reads groups; the nodes without a group form one more. */
static void read_groups(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    cw_rule *rule = object;
    uint64_t named = 0;
    size_t count = schema_count(self, key, value, 1, CW_NODES_MAX);

    for (size_t i = 0; i < CW_NODES_MAX; i++)
        rule->group[i] = (uint8_t)count;
    for (size_t i = 0; i < count; i++) {
        yaml_node_t *list = schema_item(self, value, i);
        size_t members = schema_count(self, key, list, 1, CW_NODES_MAX);

        for (size_t j = 0; j < members; j++)
            join_group(self, key, schema_item(self, list, j), &named, rule->group, (uint8_t)i);
    }
    bool all = (size_t)__builtin_popcountll(named) == walk->config->node_count;
    if (count == 1 && named && all && !walk->any_node)
        schema_complain(self, value, "%s: all nodes are in one group, nothing is separated",
                        key->name);
}

static void read_load(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a part such as 60%");

    if (text)
        schema_problem(self, key, value, text_parse_percent(schema_member(key, object), text));
}

static void read_change(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, change_part_keys, schema_member(key, object));
}

static void read_id(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_change *change = object;
    const char *text = schema_text(self, key, value, "an identifier such as 123");

    change->set_id = true;
    if (text)
        schema_problem(self, key, value, text_parse_id(&change->id, &change->id_flags, text));
}

static void read_dlc(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_change *change = object;

    change->set_dlc = true;
    schema_read_uint(self, key, value, object);
}

/* Reads the bytes of one member of a change; only `set` may leave bits open. */
static void read_bytes(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_change *change = object;
    uint8_t *member = schema_member(key, object);
    text_bytes bytes = {0};
    const char *text = schema_text(self, key, value, "data bytes such as DEADBEEF");

    if (text)
        schema_problem(self, key, value, cfg_parse_bytes(self, &bytes, text));
    bool all_given = true;
    for (size_t i = 0; i < bytes.length; i++)
        all_given = all_given && bytes.mask[i] == 0xFF;
    if (!all_given && member != change->set)
        schema_complain(self, value, "%s: only 'set' may have wildcards", key->name);
    memcpy(member, bytes.value, bytes.length);
    if (member == change->set)
        memcpy(change->set_mask, bytes.mask, bytes.length);
}

static void read_mode(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_settings *settings = &((cw_rule *)object)->settings;
    uint8_t mode = cfg_mode(key->name);
    bool on = false;

    schema_choose_bool(self, &on, key, value);
    settings->which |= CW_SET_MODES;
    settings->modes_mask |= mode;
    if (on)
        settings->modes |= mode;
}

static void read_setting(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const setting *wanted = key->arg;

    ((cw_rule *)object)->settings.which |= wanted->which;
    schema_read_uint(self, key, value, object);
}

static void read_restart(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_settings *settings = &((cw_rule *)object)->settings;

    read_setting(self, key, value, object);
    settings->restart_ticks *= TICKS_PER_MS;
}

static void read_sleep(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_settings *settings = &((cw_rule *)object)->settings;

    settings->which |= CW_SET_SLEEP;
    schema_choose_bool(self, &settings->sleeps, key, value);
}

static void read_wake(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_settings *settings = &((cw_rule *)object)->settings;

    settings->which |= cfg_wake_set(cfg_wake_find(key->name));
    cfg_wake_read(self, key, value, &settings->sleep);
}

static void read_order(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ((cw_rule *)object)->settings.which |= CW_SET_ORDER;
    schema_read_choice(self, key, value, object);
}

/* Complains about the value of a key that two others exclude. */
static void complain_at(schema *self, const yaml_node_t *map, const char *name, const char *problem)
{
    const yaml_node_t *value = schema_find(self, map, name);

    schema_complain(self, value ? value : map, "%s: %s", name, problem);
}

static bool has(schema *self, const yaml_node_t *map, const char *name)
{
    return schema_find(self, map, name) != NULL;
}

static void complete_force(schema *self, yaml_node_t *map, cw_rule *rule)
{
    (void)rule;
    if (has(self, map, "bits") && has(self, map, "for"))
        complain_at(self, map, "for", "give the length in 'bits' or as a time, not both");
}

static void complete_stuck(schema *self, yaml_node_t *map, cw_rule *rule)
{
    bool sensible = rule->line == CW_LINE_TX && rule->level == CW_DOMINANT;

    if (has(self, map, "dominant-timeout") && !sensible && !self->has_open)
        complain_at(self, map, "dominant-timeout",
                    "a transceiver ends a dominant level on its NODE.tx only");
}

/* Limits the rule to frames of the node itself, so that frames of other nodes are not counted. */
static void complete_wrong_crc(schema *self, yaml_node_t *map, cw_rule *rule)
{
    if (rule->from == 0)
        rule->from = rule->nodes;
    else if (rule->nodes & rule->from)
        rule->from &= rule->nodes;
    else if (rule->nodes)
        complain_at(self, map, "wrong-crc", "the rule waits for frames 'from' another node");
}

static void complete_counters(schema *self, yaml_node_t *map, cw_rule *rule)
{
    (void)rule;
    if (!has(self, map, "tec") && !has(self, map, "rec"))
        complain_at(self, map, "counters", "one of the keys 'tec' and 'rec' is needed");
}

/* A node with a schedule stays time-triggered, as in the list of nodes. */
static void check_schedules(schema *self, const yaml_node_t *map, const cw_rule *rule)
{
    const cfg *config = cfg_of(self);

    for (size_t i = 0; i < config->node_count; i++)
        if (rule->nodes >> i & 1 && cfg_stops_schedule(&config->nodes[i], &rule->settings))
            schema_complain(self, schema_find(self, map, "time-triggered"),
                            "time-triggered: node '%s' has a schedule, which needs it",
                            config->nodes[i].name);
}

static void complete_set(schema *self, yaml_node_t *map, cw_rule *rule)
{
    yaml_node_t *value;
    const bool alone = schema_pair(self, &value, map, 1) && !schema_pair(self, &value, map, 2);

    check_schedules(self, map, rule);
    if (!schema_pair(self, &value, map, 1))
        complain_at(self, map, "set", "there is no key that says what to set");
    if (rule->action != CW_ACTION_RAMP)
        cfg_complete_retime(self, map, rule);
    else if (alone)
        cfg_complete_ramp(self, map, rule);
    else
        complain_at(self, map, "ramp", "use a rule of its own for the other keys");
}

/* Completes a rule of the host side. `at` names receivers, or with the side of the sender one more
 * condition for `from`. */
static void complete_side(schema *self, yaml_node_t *map, cw_rule *rule)
{
    bool given = rule->action == CW_ACTION_DROP || has(self, map, "side");

    if (!has(self, map, "at"))
        return;
    if (!given)
        rule->side = CW_SIDE_RX;
    if (rule->side == CW_SIDE_RX)
        return;
    if (rule->from && rule->at && !(rule->from & rule->at))
        complain_at(self, map, "at", "the rule waits for frames 'from' another node");
    if (rule->at)
        rule->from = rule->from ? rule->from & rule->at : rule->at;
    rule->at = 0;
}

static void complete_change(schema *self, yaml_node_t *map, cw_rule *rule)
{
    const yaml_node_t *change = schema_find(self, map, "change");
    yaml_node_t *value;

    complete_side(self, map, rule);
    if (change->type == YAML_MAPPING_NODE && !schema_pair(self, &value, change, 0))
        complain_at(self, map, "change", "one of the keys id, dlc, set, and, or, xor is needed");
}

/* Completes a rule on what senders write into their frames. */
static void complete_making(schema *self, yaml_node_t *map, cw_rule *rule)
{
    rule->side = CW_SIDE_TX;
    cfg_check_protected(self, schema_find(self, map, cw_action_name(rule->action)), rule);
}

/* Complains about a frame that the node of the rule does not know. */
static void check_frame(schema *self, const yaml_node_t *map, const char *name, const cw_rule *rule)
{
    const schema_key key = {.name = name};

    cfg_check_sender(self, &key, schema_find(self, map, name), &rule->frame, rule->node);
}

/* Makes a babble with a time between its frames act as `send`. */
static void complete_babble(schema *self, yaml_node_t *map, cw_rule *rule)
{
    check_frame(self, map, "babble", rule);
    if (has(self, map, "every"))
        rule->action = CW_ACTION_SEND;
}

static void complete_send(schema *self, yaml_node_t *map, cw_rule *rule)
{
    check_frame(self, map, "send", rule);
    if (has(self, map, "for") && !has(self, map, "every"))
        complain_at(self, map, "for", "without 'every' the frame is sent once");
}

static void complete_reply(schema *self, yaml_node_t *map, cw_rule *rule)
{
    check_frame(self, map, "reply", rule);
}
