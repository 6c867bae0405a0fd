/* SPDX-License-Identifier: MIT
 *
 * traffic.c - the traffic of nodes without port: the keys of `send`, `replay` and `reply`.
 */
#include "config/parts.h"
#include "config/protect.h"
#include "config/source.h"
#include "config/values.h"

#include <stdlib.h>
#include <string.h>

#define TRAFFIC_MAX 4096u /* entries of one node */
#define GAP_DEFAULT_NS 1000000u
#define LOOK_ENTRIES 1000u /* of a file that are checked beforehand */

static schema_reader read_every, read_delay, traffic_read_file, read_channel, read_filters;

static const schema_range count_range = {1, UINT64_MAX, sizeof(uint64_t)};
static const schema_range replies_range = {1, UINT32_MAX, sizeof(uint64_t)};

static const schema_choice formats[] = {
    {.name = "candump", .value = TRACE_CANDUMP},
    {.name = "candump-delta", .value = TRACE_CANDUMP_DELTA},
    {.name = "asc", .value = TRACE_ASC},
    {.name = "pcapng", .value = TRACE_PCAPNG},
    {.name = NULL},
};

enum { SPEED_ORIGINAL = 0, SPEED_MAX };

static const schema_choice speeds[] = {
    {.name = "original", .value = SPEED_ORIGINAL},
    {.name = "max", .value = SPEED_MAX},
    {.name = NULL},
};

static schema_reader read_speed;

#define MEMBER(m) .offset = offsetof(cfg_traffic, m)

static const schema_key send_keys[] = {
    {.name = "send", .read = cfg_read_frame, MEMBER(frame),
     .help = "The frame."},
    {.name = "every", .read = read_every, MEMBER(every), .type = "span",
     .help = "Again after this time; without: once."},
    {.name = "offset", .read = cfg_read_time, MEMBER(offset), .preset = "0",
     .help = "Of the first one."},
    {.name = "jitter", .read = cfg_read_time, MEMBER(jitter), .preset = "0",
     .help = "Each one comes later by a random time of 0 up to this, at most 'every'; drawn from "
             "the seed."},
    {.name = "count", .read = schema_read_uint, MEMBER(count), .arg = &count_range,
     .help = "How many; default: without end."},
    {.name = "counter", .read = cfg_read_counter, .map = cfg_counter_keys},
    {.name = "checksum", .read = cfg_read_checksum, .map = cfg_checksum_keys},
    {.name = NULL,
     .type = "{'if': {'required': ['count'], 'properties': {'count': {'minimum': 2}}}, 'then': "
             TYPE_NEEDS("every") "}"},
};

static const schema_key replay_keys[] = {
    {.name = "replay", .read = traffic_read_file, .type = "text",
     .help = "A recording: candump (with or without -L), Vector ASC, pcapng or pcap; relative to "
             "this file."},
    {.name = "only", .read = read_filters, .type = TYPE_SOME(8, TYPE_REF("frameFilter")),
     .help = "Only frames that match one of these filters."},
    {.name = "interface", .read = read_channel, .type = TYPE_TEXT("^.{1,31}$"),
     .help = "Only this interface or channel of the recording."},
    {.name = "format", .read = schema_read_choice, MEMBER(format), .arg = formats,
     .help = "What the recording is; default: by what is in it. candump-delta is candump -t d, "
             "which cannot be told from -t z."},
    {.name = "speed", .read = read_speed, .arg = speeds, .type = "{'enum': ['original', 'max']}",
     .help = "original: with the times of the recording (default); max: whenever the node has "
             "nothing else to send."},
    {.name = "offset", .read = cfg_read_time, MEMBER(offset), .preset = "0",
     .help = "Of the first entry of the recording."},
    {.name = "count", .read = schema_read_uint, MEMBER(count), .arg = &count_range,
     .help = "How often; default: once."},
    {.name = "loop", .read = schema_read_bool, MEMBER(loop),
     .help = "Again and again without end."},
    {.name = "gap", .read = cfg_read_span, MEMBER(gap),
     .help = "From the last entry to the first one when it is repeated; default 1ms."},
    {.name = NULL,
     .type = "{'allOf': ["
             TYPE_IF("{'required': ['loop'], "
                     "'properties': {'loop': {'enum': [true, 'on', 'yes']}}}",
                     "{'not': " TYPE_NEEDS("count") "}") ", "
             TYPE_IF("{'required': ['speed'], 'properties': {'speed': {'const': 'max'}}}",
                     "{'not': " TYPE_NEEDS("gap") "}") "]}"},
};

static const schema_key reply_keys[] = {
    {.name = "reply", .read = cfg_read_frame, MEMBER(frame),
     .help = "The answer."},
    {.name = "to", .read = read_filters, .type = TYPE_SOME(8, TYPE_REF("frameFilter")),
     .help = "What is answered; default: the remote frame of the answer's identifier."},
    {.name = "delay", .read = read_delay, MEMBER(delay), .type = "time", .preset = "0",
     .help = "Between the frame and the answer."},
    {.name = "count", .read = schema_read_uint, MEMBER(count), .arg = &replies_range,
     .help = "How many; default: without end."},
    {.name = NULL},
};

/* Checks the keys of an entry against each other and completes it. */
typedef void entry_completer(schema *self, yaml_node_t *map, cfg_traffic *traffic);

static entry_completer complete_send, complete_replay, complete_reply;

/* The kinds of entries by cfg_traffic_kind; the first key names the kind. */
static const struct {
    const schema_key *keys;
    entry_completer *complete;
} kinds[] = {
    [CFG_TRAFFIC_SEND] = {send_keys, complete_send},
    [CFG_TRAFFIC_REPLAY] = {replay_keys, complete_replay},
    [CFG_TRAFFIC_REPLY] = {reply_keys, complete_reply},
};

#define KINDS (sizeof kinds / sizeof kinds[0])

const schema_key *cfg_traffic_form(size_t i, schema_key room[SCHEMA_KEYS_MAX])
{
    (void)room;
    return i < KINDS ? kinds[i].keys : NULL;
}

bool cfg_traffic_is_endless(const cfg_traffic *traffic)
{
    return traffic->kind != CFG_TRAFFIC_REPLY && traffic->count == UINT64_MAX;
}

const cfg_traffic *cfg_find_endless(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++)
            if (cfg_traffic_is_endless(&config->nodes[i].traffic[t]))
                return &config->nodes[i].traffic[t];
    return NULL;
}

/* ---- Entries --------------------------------------------------------------------------------- */

/* Returns true for a key of any kind of entry: then only the key of the kind is missing. */
static bool is_known_key(const char *name)
{
    for (size_t i = 0; i < KINDS; i++)
        for (const schema_key *key = kinds[i].keys; key->name; key++)
            if (strcmp(key->name, name) == 0)
                return true;
    return false;
}

/* Complains about an entry without a key that names its kind; the key may be misspelt. */
static void complain_missing(schema *self, const yaml_node_t *map)
{
    yaml_node_t *value;
    const yaml_node_t *name;
    for (size_t i = 0; (name = schema_pair(self, &value, map, i)); i++) {
        const char *text = name->type == YAML_SCALAR_NODE ? (char *)name->data.scalar.value : "";
        nearest guess = {.word = text};
        for (size_t k = 0; k < KINDS; k++)
            nearest_consider(&guess, kinds[k].keys[0].name);
        if (*text == '\0' || is_known_key(text))
            continue;
        schema_complain(self, name, "traffic: unknown key '%s'%s", text,
                        guess.best ? schema_suggestion(self, &guess)
                                   : "; one of 'send', 'replay' and 'reply' is needed");
        return;
    }
    schema_complain(self, map, "traffic: one of the keys 'send', 'replay' and 'reply' is missing");
}

/* Returns the kind of a map, or KINDS after a complaint. */
static size_t traffic_find_kind(schema *self, yaml_node_t *map)
{
    size_t found = KINDS;
    const yaml_node_t *database = schema_find(self, map, "dbc");
    if (database) {
        schema_complain(self, database, "dbc: canwire reads no databases; this makes frames of all "
                        "such entries: canwire-restbus %s > FILE", cfg_of(self)->file);
        return KINDS;
    }
    for (size_t i = 0; i < KINDS; i++) {
        yaml_node_t *value = schema_find(self, map, kinds[i].keys[0].name);
        if (value && found < KINDS) {
            schema_complain(self, value, "traffic: '%s' and '%s' exclude each other",
                            kinds[found].keys[0].name, kinds[i].keys[0].name);
            return KINDS;
        }
        if (value)
            found = i;
    }
    if (found == KINDS)
        complain_missing(self, map);
    return found;
}

/* Reads an entry of a node's traffic, whose kind follows from its keys. */
static void read_entry(schema *self, yaml_node_t *value, cfg_traffic *traffic)
{
    *traffic = (cfg_traffic){
        .place = cfg_place_of(value), .count = UINT64_MAX, .gap.ns = GAP_DEFAULT_NS};
    size_t kind = CFG_TRAFFIC_SEND; /* of a value that is not a map, for the complaint */
    if (value->type == YAML_MAPPING_NODE)
        kind = traffic_find_kind(self, value);
    if (kind == KINDS)
        return;
    size_t errors = self->errors->errors;
    traffic->kind = (cfg_traffic_kind)kind;
    schema_map(self, "traffic", value, kinds[kind].keys, traffic);
    if (self->errors->errors == errors)
        kinds[kind].complete(self, value, traffic);
}

/* Reads the traffic of a node, which then has no ECU. */
void cfg_read_traffic(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    size_t count = schema_count(self, key, value, 0, TRAFFIC_MAX);

    if (node->port)
        schema_complain(self, value, "%s: only a node without port has traffic of its own",
                        key->name);
    node->traffic = schema_alloc(self, count + 1, sizeof *node->traffic);
    if (!node->traffic)
        return;
    for (; node->traffic_count < count; node->traffic_count++)
        read_entry(self, schema_item(self, value, node->traffic_count),
                   &node->traffic[node->traffic_count]);
}

/* Checks the traffic of a node against what the node knows. */
static void traffic_check_node(schema *self, yaml_node_t *map, size_t index)
{
    cfg_node *node = &cfg_of(self)->nodes[index];
    yaml_node_t *list = node->traffic_count > 0 ? schema_find(self, map, "traffic") : NULL;

    for (size_t i = 0; list && i < node->traffic_count; i++) {
        cfg_traffic *traffic = &node->traffic[i];
        const schema_key *key = &kinds[traffic->kind].keys[0];

        traffic->fd = cfg_knows_fd(cfg_of(self), node);
        if ((traffic->frame.flags & (CW_FRAME_FD | CW_FRAME_EXTENDED)) ||
            cw_frame_is_refused(&traffic->frame, node->controller.variants)) /* so it is a map */
            cfg_check_sender(self, key, schema_find(self, schema_item(self, list, i), key->name),
                             &traffic->frame, index);
    }
}

void cfg_check_traffic(schema *self, yaml_node_t *nodes)
{
    for (size_t i = 0; i < cfg_of(self)->node_count; i++)
        traffic_check_node(self, cfg_node_map(self, nodes, i), i);
    cfg_collect_protections(self, nodes);
}

/* ---- send ------------------------------------------------------------------------------------ */

/* Notes that it is given, since a count needs it. */
static void read_every(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;

    traffic->has_every = true;
    cfg_read_span(self, key, value, object);
}

/* Completes frames that are sent. Without `every` there is one. */
static void complete_send(schema *self, yaml_node_t *map, cfg_traffic *traffic)
{
    cw_rate rate = cfg_of(self)->rate;
    yaml_node_t *count = schema_find(self, map, "count");

    cfg_complete_protection(self, map, traffic);
    if (traffic->has_every) {
        if (text_time_ticks(traffic->jitter, rate) > text_time_ticks(traffic->every, rate))
            schema_complain(self, schema_find(self, map, "jitter"),
                            "jitter: at most as long as 'every', so that the order stays");
        return;
    }
    if (count && traffic->count > 1)
        schema_complain(self, count, "count: without 'every' a frame is sent once");
    traffic->count = 1;
}

/* ---- replay ---------------------------------------------------------------------------------- */

/* The path is relative to the configuration. */
static void traffic_read_file(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;
    const char *text = schema_text(self, key, value, "the path of a file");

    if (text)
        traffic->file = cfg_resolve_path(self, cfg_of(self)->file, text);
}

/* The name is compared with that in the recording when it is read. */
static void read_channel(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "an interface or a channel of the file, at most 31 bytes";
    cfg_traffic *traffic = object;
    const char *text = schema_text(self, key, value, expected);

    if (text && strlen(text) >= TRACE_CHANNEL_MAX)
        schema_expected(self, key, value, expected);
    if (text)
        traffic->channel = schema_copy(self, text);
}

/* `max` ignores the times of the recording. */
static void read_speed(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;
    unsigned speed;

    if (schema_choose(self, &speed, key, value, key->arg))
        traffic->fast = speed == SPEED_MAX;
}

/* Adds filters to those of the entry; a frame must match one of them. */
static void read_filters(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;
    const unsigned count = cfg_read_filter_list(self, key, value, traffic->filters,
                                                traffic->filter_count, CW_RULE_FILTERS_MAX);
    traffic->filter_count = (uint8_t)count;
}

/* Reads the file up to its first frame, as a rule. Replaying the file, or `canwire check`, finds
 * later errors. */
static void look_into_file(schema *self, const yaml_node_t *at, const cfg_traffic *traffic)
{
    char problem[TRACE_PROBLEM_MAX];
    trace_record record = {.kind = TRACE_OTHER};
    trace_result result = TRACE_RECORD;
    trace_reader *reader = trace_open(traffic->file, traffic->format, problem);

    if (!reader) {
        /* an error in the file has its place behind the name */
        if (strncmp(problem + strlen(traffic->file), ": ", 2) == 0)
            schema_complain(self, at, "replay: %s", problem);
        else
            schema_complain_elsewhere(self, at, problem);
        return;
    }
    trace_record first = {.kind = TRACE_OTHER}; /* frame without a time: its line may be torn */
    bool found = false;
    for (unsigned i = 0; i < LOOK_ENTRIES && result == TRACE_RECORD && !found; i++) {
        result = trace_next(reader, &record);
        const bool frame = result == TRACE_RECORD && record.kind == TRACE_FRAME;
        found = frame && (record.timed || traffic->fast);
        if (frame && first.kind == TRACE_OTHER)
            first = record;
    }
    if (result != TRACE_BAD && first.kind == TRACE_FRAME && !found) {
        trace_complain_no_time(problem, reader, &first);
        schema_complain_elsewhere(self, at, problem);
    }
    if (result == TRACE_BAD)
        schema_complain_elsewhere(self, at, trace_problem(reader));
    trace_close(reader);
}

/* Completes a replay, and looks into its file whether it has frames. */
static void complete_replay(schema *self, yaml_node_t *map, cfg_traffic *traffic)
{
    yaml_node_t *count = schema_find(self, map, "count");
    yaml_node_t *gap = schema_find(self, map, "gap");

    if (count && traffic->loop)
        schema_complain(self, count, "count: not together with 'loop'");
    if (gap && traffic->fast)
        schema_complain(self, gap, "gap: with 'speed: max' the file is repeated at once");
    if (!count && !traffic->loop)
        traffic->count = 1;
    if (traffic->file && cfg_reads_files(self))
        look_into_file(self, schema_find(self, map, "replay"), traffic);
}

/* ---- reply ----------------------------------------------------------------------------------- */

/* Reads a delay, rounded to bits: the answer comes from a rule, which acts at bits. */
static void read_delay(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_time *delay = schema_member(key, object);

    cfg_read_time(self, key, value, object);
    cfg_warn_rounded(self, key, value, text_time_ticks(*delay, cfg_of(self)->rate));
}

/* Completes a reply. Without `to` it answers the remote frame of its own identifier. */
static void complete_reply(schema *self, yaml_node_t *map, cfg_traffic *traffic)
{
    cfg *config = cfg_of(self);
    bool extended = traffic->frame.flags & CW_FRAME_EXTENDED;

    if (++config->reply_count > CW_RULES_MAX)
        schema_complain(self, map, "traffic: at most %u replies", CW_RULES_MAX);
    if (traffic->filter_count > 0)
        return;
    traffic->filter_count = 1;
    traffic->filters[0] = (cw_filter){
        .value = cw_frame_can_id(&traffic->frame) | CW_FILTER_REMOTE,
        .mask = CW_FILTER_REMOTE | (extended ? CW_FILTER_EXTENDED_MASK : CW_FILTER_BASE_MASK)};
}
