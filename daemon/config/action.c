/* SPDX-License-Identifier: MIT
 *
 * action.c - the actions of fault rules: the key `do`, with a table of keys for each action.
 */
#include "config/change/live.h"
#include "config/parts.h"
#include "config/protect.h"
#include "config/values.h"
#include "config/node/wake.h"

#include <string.h>

#define DLC_MAX 15u

/* Checks the keys of an action against each other and completes the rule; `map` is the value of
 * `do`. */
typedef void action_completer(schema *self, yaml_node_t *map, cw_rule *rule);

typedef struct action {
    cw_action action;
    const schema_key *keys; /* the first key is the action's own, which has its name; NULL: those
                               of `set` */
    action_completer *complete; /* or NULL */
} action;

static schema_reader read_levels, read_at, read_groups,
    read_load, read_change, action_read_id, read_dlc, read_bytes;
static action_completer complete_force, complete_stuck, complete_wrong_crc, complete_counters,
    complete_set, complete_side, complete_change, complete_send, complete_babble,
    complete_reply, complete_making;

static const schema_range bits_range = {1, UINT16_MAX, sizeof(uint16_t)};
static const schema_range tec_range = {0, CW_TEC_MAX, sizeof(uint16_t)};
static const schema_range rec_range = {0, CW_REC_MAX, sizeof(uint16_t)};
static const schema_range overload_range = {1, CW_OVERLOADS_MAX, sizeof(uint32_t)};
static const schema_range copies_range = {1, CW_COPIES_MAX, sizeof(uint32_t)};
static const schema_range overtaking_range = {1, CW_QUEUE_MAX, sizeof(uint32_t)};
static const schema_range dlc_range = {0, DLC_MAX, sizeof(uint8_t)};

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
#define LASTS_BY(...)                                                                              \
    {                                                                                              \
        .name = "for", MEMBER(for_ticks), __VA_ARGS__,                                             \
        .help = "How long it lasts; 0, or without: until the rule's window of time ends or the "   \
                "rule is cleared."                                                                 \
    }
#define LASTS LASTS_BY(.read = cfg_read_bits)
#define LASTS_OR_ATTEMPT                                                                           \
    {                                                                                              \
        .name = "for", .read = cfg_read_bits, MEMBER(for_ticks),                                   \
        .help = "How long it lasts; 0, or without: with a condition on frames that transmission, " \
                "else until the rule's window of time ends or the rule is cleared."                \
    }
#define FROM                                                                                       \
    {                                                                                              \
        .name = "from", .read = cfg_read_position, .required = true, .help = "First bit."          \
    }
#define AS                                                                                         \
    {                                                                                              \
        .name = "as", .read = cfg_read_node_index, MEMBER(node), .required = true,                 \
        .help = "The node whose traffic it is."                                                    \
    }
#define AT(told)                                                                                   \
    {                                                                                              \
        .name = "at", .read = read_at, MEMBER(at), .type = "nodeSet", .help = (told)               \
    }
#define AT_WIRE AT("Only what these nodes sample changes. Default: the wire, so everybody's.")
#define AT_HOST AT("Receivers whose frames are meant. Default: all.")
#define SIDE(key, told)                                                                            \
    {                                                                                              \
        .name = (key), .read = schema_read_choice, MEMBER(side), .arg = sides, .help = (told)      \
    }
#define OF_SIDE                                                                                    \
    SIDE("side", "tx: where the sender hands the frame in; rx: where receivers get it. Default: "  \
                 "rx with 'at', else tx.")
/* The last row of an action on hosts: `at` names receivers. */
#define NOT_AT_SENDER(key)                                                                         \
    {                                                                                              \
        .name = NULL, .type = TYPE_IF("{'properties': {'" key "': {'const': 'tx'}}, "              \
                                      "'required': ['" key "']}",                                  \
                                      "{'not': " TYPE_NEEDS("at") "}")                             \
    }
#define NODES(key, told)                                                                           \
    {                                                                                              \
        .name = (key), .read = cfg_read_node_set, MEMBER(nodes), .help = (told)                    \
    }
#define FRAME(key, told)                                                                           \
    {                                                                                              \
        .name = (key), .read = cfg_read_frame, MEMBER(frame), .help = (told)                       \
    }
#define NUMBER(key, range, told)                                                                   \
    {                                                                                              \
        .name = (key), .read = schema_read_uint, MEMBER(number), .arg = (range), .help = (told)    \
    }
#define LEVEL(key, told)                                                                           \
    {                                                                                              \
        .name = (key), .read = cfg_read_level, .type = TYPE_CHOICE, .arg = cfg_levels,             \
        .help = (told)                                                                             \
    }
#define BITS                                                                                       \
    {                                                                                              \
        .name = "bits", .read = schema_read_uint, MEMBER(bits), .arg = &bits_range, .preset = "1", \
        .help = "How many wire bits."                                                              \
    }
#define DATA(key, part, what, told)                                                                \
    {                                                                                              \
        .name = (key), .read = read_bytes, .offset = offsetof(cw_change, part), .type = (what),    \
        .help = (told)                                                                             \
    }
#define END                                                                                        \
    {                                                                                              \
        .name = NULL                                                                               \
    }

/* The keys of `change: { ... }`, a cw_change. */
static const schema_key change_part_keys[] = {
    {.name = "id", .read = action_read_id, .type = "id", .help = "New identifier, 3 or 8 digits."},
    {.name = "dlc", .read = read_dlc, .offset = offsetof(cw_change, dlc), .arg = &dlc_range,
     .type = TYPE_UINT, .help = "New data length code."},
    DATA("set", set, "data", "New data; '.' or 'x' leaves a digit as it is."),
    DATA("and", and_mask, "bytes", "Data bytes AND these."),
    DATA("or", or_mask, "bytes", "Data bytes OR these."),
    DATA("xor", xor_mask, "bytes", "Data bytes XOR these."),
    {.name = NULL, .type = "{'minProperties': 1}"},
};

static const schema_key set_key =
    NODES("set", "Changes settings of the node; those that are not given stay.");
static const schema_key ramp_key = {.name = "ramp", .read = cfg_read_ramp, .map = cfg_ramp_keys,
                                    .help = "The clock drifts, as that of a crystal that warms up. "
                                            "Its error goes evenly from one value to the other, "
                                            "and stays there. Without other keys of the node."};
static const schema_key set_end = {.name = NULL, .type = "{'minProperties': 2}"};

/* A row: the action, what completes it or NULL, and its keys. */
#define ACTION(what, completer, ...)                                                               \
    {                                                                                              \
        CW_ACTION_##what, (const schema_key[]){__VA_ARGS__, END}, completer                        \
    }

/* The actions in the order of messages. */
static const action actions[] = {
    ACTION(FLIP, NULL,
        {.name = "flip", .read = cfg_read_position, .help = "Inverts bits from this position on."},
        BITS, AT_WIRE),
    ACTION(FORCE, complete_force,
        LEVEL("force", "Sets bits to this level."), FROM, BITS,
        {.name = "for", .read = cfg_read_bits_min, MEMBER(for_ticks),
         .help = "How long, instead of bits."}, AT_WIRE,
        {.name = NULL, .type = "{'not': {'required': ['bits', 'for']}}"}),
    ACTION(GLITCH, NULL,
        {.name = "glitch", .read = read_levels,
         .type = "{'type': ['string', 'number'], 'pattern': '^(?:(?=.*[01])[01xX]{1,64})$', "
                 "'examples': ['10x1']}",
         .help = "Levels in a row, up to 64, such as `10x1`: 1 recessive, 0 dominant, x as it is; "
                 "one of x alone is refused."}, FROM, AT_WIRE),
    ACTION(STUCK, complete_stuck,
        LEVEL("stuck", "The line is stuck at this level, exactly as long as `for` says."),
        {.name = "on", .read = cfg_read_line,
         .help = "`wire`, or the line of one controller: `NODE.tx` or `NODE.rx`."},
        LASTS_BY(.read = cfg_read_ticks),
        {.name = "dominant-timeout", .read = cfg_read_bits_min, MEMBER(dominant_timeout),
         .help = "TXD dominant time-out of the transceiver, which lets go of the bus after it; "
                 "only with `dominant` on a `NODE.tx`."},
        {.name = NULL,
         .type = TYPE_IF(TYPE_NEEDS("dominant-timeout"),
                         "{'required': ['on'], 'properties': {'on': {'pattern': '\\.tx$|\\$'}, "
                         "'stuck': {'pattern': '^dominant$|\\$'}}}")}),
    ACTION(NOISE, NULL,
        {.name = "noise", .read = cfg_read_fraction, MEMBER(error_rate),
         .help = "Each bit is flipped with this probability, with `at` for each of these nodes by "
                 "itself; with `burst`, a burst begins with it."},
        {.name = "burst", .read = cfg_read_burst,
         .type = "{'type': ['string', 'integer'], 'pattern': "
                 "'^(?:[1-9]|1[0-6])(?:\\.\\.(?:[1-9]|1[0-6]))?$', 'minimum': 1, 'maximum': 16}",
         .help = "Each hit of the noise is a burst of so many bits, or of a number drawn from "
                 "LEAST..MOST. Its first and last bits are flipped, those between with a "
                 "probability of 1/2. Default: one bit."}, AT_WIRE, LASTS_OR_ATTEMPT),
    {CW_ACTION_PULSE, cfg_pulse_keys, NULL},
    {CW_ACTION_JITTER, cfg_jitter_keys, NULL},
    ACTION(NO_ACK, NULL,
        NODES("no-ack", "Nodes that do not acknowledge."), LASTS_OR_ATTEMPT),
    ACTION(WRONG_CRC, complete_wrong_crc,
        NODES("wrong-crc", "Frames of these nodes that match carry an inverted last CRC bit. "
                           "Frames of others do not match.")),
    ACTION(BUS_OFF, NULL,
        NODES("bus-off", "Goes bus-off at once.")),
    ACTION(ERROR_FLAG, NULL,
        NODES("error-flag", "Sends an error flag at once, as if it had found an error.")),
    ACTION(RESTART, NULL,
        NODES("restart", "Leaves bus-off, as a restart by hand; frames of the same moment wait "
                         "until the node is back.")),
    ACTION(COUNTERS, complete_counters,
        NODES("counters", "Sets its error counters, one or both."),
        {.name = "tec", .read = schema_read_uint, MEMBER(tec), .arg = &tec_range,
         .help = "Transmit error counter. One above 255 is bus-off; one below ends that at once, "
                 "without the wait of R12: the node integrates. Default: as it is."},
        {.name = "rec", .read = schema_read_uint, MEMBER(rec), .arg = &rec_range,
         .help = "Receive error counter. Default: as it is."},
        {.name = NULL, .type = TYPE_ANY(TYPE_NEEDS("tec") ", " TYPE_NEEDS("rec"))}),
    ACTION(OVERLOAD, NULL,
        NODES("overload", "Asks for overload frames, from the next intermission on."),
        {.name = "frames", .read = schema_read_uint, MEMBER(number), .arg = &overload_range,
         .preset = "1", .help = "How many in a row."}),
    {CW_ACTION_SET, NULL, complete_set},
    ACTION(SOFTWARE_RESET, NULL,
        NODES("software-reset",
              "The host initialises its controller anew; it is back after 128 x 11 recessive "
              "bits.")),
    ACTION(HARDWARE_RESET, NULL,
        NODES("hardware-reset",
              "The controller begins anew, and is back after 11 recessive bits.")),
    {CW_ACTION_RAW, cfg_raw_keys, cfg_complete_raw},
    ACTION(DISCONNECT, NULL,
        NODES("disconnect", "Neither drives nor samples the bus; integrates when it is back. A "
                            "bus-off node that was asked to restart goes on with its recovery, for "
                            "to it a line without bus is recessive."), LASTS),
    ACTION(PARTITION, NULL,
        {.name = "partition", .read = read_groups,
         .type = TYPE_LIST(1, 64, TYPE_SET(64, TYPE_OPEN(TYPE_REF("node")))),
         .help = "Groups of nodes, such as `[[a, b], [c]]`, each with a wire of its own. Nodes "
                 "that are not named make one more group. All nodes in one group are refused, as "
                 "nothing is separated."}, LASTS),
    ACTION(DROP, complete_side,
        SIDE("drop",
             "The frame is gone; counted and told as a drop with `\"why\":\"fault\"`. tx: at the "
             "sender, before it is sent; rx: at the receivers, after it was received."), AT_HOST,
        NOT_AT_SENDER("drop")),
    ACTION(DELAY, complete_side,
        {.name = "delay", .read = cfg_read_bits_min, MEMBER(for_ticks),
         .help = "Hands frames in or out later."}, AT_HOST, OF_SIDE, NOT_AT_SENDER("side")),
    ACTION(DUPLICATE, complete_side,
        NUMBER("duplicate", &copies_range, "Further copies of each frame."), AT_HOST, OF_SIDE,
        NOT_AT_SENDER("side")),
    ACTION(REORDER, complete_side,
        NUMBER("reorder", &overtaking_range, "Puts the frame behind so many that follow."), AT_HOST,
        OF_SIDE, NOT_AT_SENDER("side")),
    ACTION(CHANGE, complete_change,
        {.name = "change", .read = read_change, MEMBER(change), .map = change_part_keys,
         .help = "New content of the frame, with a CRC that is right for it. Data bytes are from "
                 "the first on, up to 8, on a bus with CAN FD nodes up to 64: set, then and, or, "
                 "xor."},
        AT_HOST, OF_SIDE, NOT_AT_SENDER("side")),
    ACTION(COUNTER, complete_making,
        {.name = "counter", .read = schema_read_choice, MEMBER(number), .arg = counter_faults,
         .help = "A fault of the counter that the traffic of a node writes. stuck: the frame has "
                 "the value of the one before, and the counter stands still; skip: a value is left "
                 "out; repeat: the value of the one before, and the counter goes on."}),
    ACTION(CHECKSUM, complete_making,
        {.name = "checksum", .read = schema_read_choice, MEMBER(number), .arg = checksum_faults,
         .help = "All bits of the checksum that the traffic of a node writes are inverted."}),
    ACTION(SEND, complete_send,
        FRAME("send", "Sends this frame."), AS,
        {.name = "every", .read = cfg_read_period, MEMBER(period_ticks),
         .help = "Again after this time; without: once."},
        LASTS_BY(.read = cfg_read_bits, .needs = "every")),
    ACTION(BABBLE, complete_babble,
        FRAME("babble", "Sends this frame again and again, as fast as it can."), AS,
        {.name = "every", .read = cfg_read_period, MEMBER(period_ticks),
         .help = "From one to the next, as with send; without: as soon as the last one is done."},
        LASTS),
    ACTION(LOAD, NULL,
        {.name = "load", .read = read_load, MEMBER(load_permille), .type = "percent",
         .help = "Random frames, from the seed, until the bus is loaded to this part, 0.1% to "
                 "100%."},
        AS, LASTS),
    ACTION(REPLY, complete_reply,
        FRAME("reply",
              "Answers each matching frame that the node receives, such as a remote frame."),
        AS,
        {.name = "delay", .read = cfg_read_bits, MEMBER(for_ticks), .preset = "0",
         .help = "Between the frame and the answer."}),
};

#define ACTION_COUNT (sizeof actions / sizeof actions[0])

/* Puts the keys of `set`: those of nodes that change while they are in use. */
static const schema_key *set_keys(schema_key room[SCHEMA_KEYS_MAX])
{
    schema_key *out = room;

    *out++ = set_key;
    for (const schema_key *key = cfg_node_keys; key->name; key++) {
        if (!cfg_is_live(key))
            continue;
        *out = *key;
        out->read = cfg_read_setting;
        out->live = key;
        out->preset = out->needs = NULL;
        out++;
    }
    *out++ = ramp_key;
    *out = set_end;
    return room;
}

const schema_key *cfg_action_form(size_t i, schema_key room[SCHEMA_KEYS_MAX])
{
    if (i >= ACTION_COUNT)
        return NULL;
    return actions[i].keys ? actions[i].keys : set_keys(room);
}

static const action *find_action(schema *self, const yaml_node_t *map);
static void complain_no_action(schema *self, yaml_node_t *map, cw_rule *rule);
static void set_defaults(cw_rule *rule);

/* Reads `do`: its action is found by the keys, the table of that action does the rest. */
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
    schema_key room[SCHEMA_KEYS_MAX];
    const schema_key *keys = found->keys ? found->keys : set_keys(room);
    set_defaults(rule);
    schema_read_presets(self, keys, rule);
    schema_map(self, key->name, value, keys, rule);
    if (found->complete && self->errors->errors == errors)
        found->complete(self, value, rule);
}

/* Sets what keys leave as it is that are not given. */
static void set_defaults(cw_rule *rule)
{
    rule->line = CW_LINE_WIRE;
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

/* Keeps the levels as two sets of bits: those that change, and their levels. */
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

/* Puts a node into a group of a partition. A node is in one group only. */
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

/* The number of digits says the format: a rule may turn a base frame into an extended one. */
static void action_read_id(schema *self, const schema_key *key, yaml_node_t *value, void *object)
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

/* Takes one mode of a node. The others stay as they are, so the mask says that this one is
 * given. */
static void read_mode(schema *self, const schema_key *key, const yaml_node_t *value,
                      cw_settings *settings)
{
    const uint8_t mode = (uint8_t)cfg_live_of(key)->which;
    bool on = false;

    schema_choose_bool(self, &on, key, value);
    settings->modes_mask |= mode;
    if (on)
        settings->modes |= mode;
}

/* Reads a number of a node in its own unit and range; the setting has those of the library. */
static void action_read_number(schema *self, const schema_key *key, yaml_node_t *value,
                               cw_settings *settings)
{
    schema_range range = *(const schema_range *)key->arg;
    uint64_t number = 0;

    range.bytes = sizeof number;
    schema_read_uint(self, &(schema_key){.name = key->name, .arg = &range}, value, &number);
    cfg_put_number(settings, key, number);
}

/* Reads a key of a node into the settings of a rule; its row is in the column `live`. */
void cfg_read_setting(schema *self, const schema_key *set, yaml_node_t *value, void *object)
{
    const schema_key *key = set->live;
    const cfg_live *live = cfg_live_of(key);
    cw_settings *settings = &((cw_rule *)object)->settings;

    if (cfg_is_retime(key)) {
        cfg_read_retime(self, key, value, object);
        return;
    }
    settings->which |= live->kind == CFG_LIVE_MODE ? CW_SET_MODES : live->which;
    if (live->kind == CFG_LIVE_MODE)
        read_mode(self, key, value, settings);
    else if (live->kind == CFG_LIVE_NUMBER)
        action_read_number(self, key, value, settings);
    else if (live->kind == CFG_LIVE_ORDER)
        schema_read_choice(self, &(schema_key){.name = key->name, .arg = key->arg}, value,
                           &settings->order);
    else if (live->kind == CFG_LIVE_SLEEP)
        schema_choose_bool(self, &settings->sleeps, key, value);
    else
        cfg_wake_read_into(self, key, value, &settings->sleep);
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

/* A value that a profile leaves open may still become `dominant`, so it is accepted. */
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

/* Checks settings against each other. A ramp stands alone, since it goes on for a time. */
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

/* A change without content would be a rule that does nothing. */
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
