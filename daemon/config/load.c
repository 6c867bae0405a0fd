/* SPDX-License-Identifier: MIT
 *
 * load.c - the keys of a configuration file, but for the fault rules.
 */
#include "config/config.h"

#include "base/yamlfile.h"
#include "config/portname.h"
#include "config/read.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define NETNS_NAME_MAX 64u
#define LCM_EVENTS_MAX 64u   /* words in one list */
#define BITRATE_MIN 5000u
#define BITRATE_MAX 1000000u
#define BITRATE_ERROR_INVERSE 1000u /* the rate that is used lies within 1/1000 */

#define QUEUE_DEFAULT 16u
/* Of a node on an interface. Nothing holds a program back there: kernel ISO-TP writes all 586
 * frames of 4095 bytes at once, J1939's transport protocol 255. */
#define QUEUE_DEFAULT_INTERFACE 1024u
#define WARNING_LIMIT_DEFAULT 96u
#define CATCH_UP_DEFAULT_NS 1000000000u
#define LCM_URL_DEFAULT "udpm://239.255.76.67:7667?ttl=0"
#define LCM_PERIOD_DEFAULT_NS 1000000000u
#define LCM_EVENTS_DEFAULT                                                                         \
    (1u << CW_EVENT_ERROR | 1u << CW_EVENT_STATE | 1u << CW_EVENT_RESTART |                        \
     1u << CW_EVENT_OVERLOAD | 1u << CW_EVENT_DROP | 1u << CW_EVENT_FAULT)

#define BUS_INBOX 4096u  /* frames handed in for later than now */
#define BUS_EVENTS 1024u /* the library raises it to what it needs */

/* What cfg_load() returns is the first member of this. */
typedef struct cfg_owner {
    cfg config;
    arena arena;
} cfg_owner;

static schema_reader read_bus, read_bus_name, read_bitrate, read_defaults, read_nodes,
    read_node_name, read_port,
    read_peer, read_peer_name, read_netns, read_mode, read_lcm,
    read_lcm_url, read_lcm_events, read_control, read_when_full, read_vxcan;

static const schema_range bitrate_range = {BITRATE_MIN, BITRATE_MAX, sizeof(uint32_t)};
static const schema_range seed_range = {0, UINT64_MAX, sizeof(uint64_t)};
static const schema_range restart_range = {0, UINT32_MAX, sizeof(uint32_t)};
static const schema_range queue_range = {1, CW_QUEUE_MAX, sizeof(uint16_t)};
static const schema_range warning_range = {1, 255, sizeof(uint16_t)};

static const schema_choice modes[] = {
    {.name = "one-shot", .value = CW_MODE_ONE_SHOT},
    {.name = "listen-only", .value = CW_MODE_LISTEN_ONLY},
    {.name = "loopback", .value = CW_MODE_LOOPBACK},
    {.name = "presume-ack", .value = CW_MODE_PRESUME_ACK},
    {.name = "berr-reporting", .value = CW_MODE_BERR_REPORTING},
    {.name = "lost-arbitration-reporting", .value = CW_MODE_LOST_ARBITRATION_REPORTING},
    {.name = NULL},
};

const schema_choice cfg_orders[] = {
    {.name = "priority", .value = CW_ORDER_PRIORITY},
    {.name = "fifo", .value = CW_ORDER_FIFO},
    {.name = NULL},
};

static const schema_choice when_full_choices[] = {
    {.name = "drop", .value = CFG_WHEN_FULL_DROP},
    {.name = "wait", .value = CFG_WHEN_FULL_WAIT},
    {.name = NULL},
};

static const schema_choice pacings[] = {
    {.name = "precise", .value = CFG_PACING_PRECISE},
    {.name = "tick", .value = CFG_PACING_TICK},
    {.name = "spin", .value = CFG_PACING_SPIN},
    {.name = NULL},
};

static const schema_choice missing_ports[] = {
    {.name = "fail", .value = CFG_MISSING_PORT_FAIL},
    {.name = "wait", .value = CFG_MISSING_PORT_WAIT},
    {.name = NULL},
};

/* In the order of reading: nodes need the bus, vxcan and their defaults, faults need the nodes and
 * may name the rules of profiles, what is expected may name all rules. */
static const schema_key file_keys[] = {
    {.name = "bus", .read = read_bus, .required = true},
    {.name = "seed", .read = schema_read_uint, .offset = offsetof(cfg, seed), .arg = &seed_range},
    {.name = "vxcan", .read = read_vxcan},
    {.name = "defaults", .read = read_defaults},
    {.name = "nodes", .read = read_nodes, .required = true},
    {.name = "profiles", .read = cfg_read_profiles},
    {.name = "faults", .read = cfg_read_faults},
    {.name = "expect", .read = cfg_read_expect},
    {.name = "record", .read = cfg_read_record},
    {.name = "lcm", .read = read_lcm},
    {.name = "control", .read = read_control},
    {.name = "pacing", .read = schema_read_choice, .offset = offsetof(cfg, pacing), .arg = pacings},
    {.name = "missing-port",
     .read = schema_read_choice,
     .offset = offsetof(cfg, missing_port),
     .arg = missing_ports},
    {.name = "catch-up", .read = cfg_read_span, .offset = offsetof(cfg, catch_up)},
    {.name = NULL},
};

static const schema_key bus_keys[] = {
    {.name = "name", .read = read_bus_name},
    {.name = "bitrate",
     .read = read_bitrate,
     .offset = offsetof(cfg, bitrate_bps),
     .arg = &bitrate_range,
     .required = true},
    {.name = NULL},
};

/* Keys of nodes that `defaults` has, too. */
#define RESTART_AND_MODES                                                                          \
    {.name = "restart-ms",                                                                         \
     .read = schema_read_uint,                                                                     \
     .offset = offsetof(cfg_node, restart_ms),                                                     \
     .arg = &restart_range},                                                                       \
        {.name = "berr-reporting", .read = read_mode}, {.name = "one-shot", .read = read_mode},    \
        {.name = "listen-only", .read = read_mode}, {.name = "loopback", .read = read_mode},       \
        {.name = "presume-ack", .read = read_mode}, {                                              \
        .name = "lost-arbitration-reporting", .read = read_mode                                    \
    }
#define QUEUE                                                                                      \
    {                                                                                              \
        .name = "queue", .read = schema_read_uint, .offset = offsetof(cfg_node, queue),            \
        .arg = &queue_range                                                                        \
    }
#define ORDER                                                                                      \
    {                                                                                              \
        .name = "order", .read = schema_read_choice, .offset = offsetof(cfg_node, order),          \
        .arg = cfg_orders                                                                          \
    }
#define WARNING_LIMIT                                                                              \
    {                                                                                              \
        .name = "warning-limit", .read = schema_read_uint,                                         \
        .offset = offsetof(cfg_node, warning_limit), .arg = &warning_range                         \
    }

/* Of a cfg_node. The others are of one node alone. */
static const schema_key default_keys[] = {
    RESTART_AND_MODES,
    QUEUE,
    {.name = "when-full",
     .read = schema_read_choice,
     .offset = offsetof(cfg_node, when_full),
     .arg = when_full_choices},
    ORDER,
    WARNING_LIMIT,
    {.name = NULL},
};

/* `traffic` after `port`, which it excludes; `peer` and `when-full` after `port`, which they need;
 * `queue` and `when-full` after `port`, on which their defaults depend. */
static const schema_key node_keys[] = {
    {.name = "name", .read = read_node_name, .required = true},
    {.name = "port", .read = read_port},
    {.name = "peer", .read = read_peer},
    RESTART_AND_MODES,
    QUEUE,
    {.name = "when-full",
     .read = read_when_full,
     .offset = offsetof(cfg_node, when_full),
     .arg = when_full_choices},
    ORDER,
    WARNING_LIMIT,
    {.name = "traffic", .read = cfg_read_traffic},
    {.name = NULL},
};

static const schema_key peer_keys[] = {
    {.name = "name", .read = read_peer_name, .required = true},
    {.name = "netns", .read = read_netns},
    {.name = NULL},
};

static const schema_key lcm_keys[] = {
    {.name = "url", .read = read_lcm_url},
    {.name = "period", .read = cfg_read_span, .offset = offsetof(cfg_lcm, period)},
    {.name = "events", .read = read_lcm_events},
    {.name = NULL},
};

/* What a file may be. */
typedef enum wanted { WANTED_CONFIGURATION, WANTED_ANY } wanted;

char cfg_no_name[] = "";

static cfg_owner *make_owner(const char *file);
static bool read_file(cfg_owner *owner, bool *is_profile, const cfg_walk *walk, diag *errors,
                      wanted kind);

static void free_owner(cfg_owner *owner)
{
    if (!owner)
        return;
    arena_free(&owner->arena);
    free(owner);
}

bool cfg_keep_warnings(const char **warnings, arena *memory, diag *found)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);

    *warnings = NULL;
    if (out) {
        diag_flush(found, out);
        bool written = fclose(out) == 0;
        *warnings = written ? arena_print(memory, "%s", text) : NULL;
    }
    free(text);
    if (!*warnings)
        diag_add(found, 0, 0, "out of memory");
    return *warnings != NULL;
}

static cfg *load(const char *file, const cfg_walk *walk, FILE *errors)
{
    diag found = {.file.name = file};
    cfg_owner *owner = make_owner(file);
    bool is_profile;

    if (!owner)
        diag_add(&found, 0, 0, "out of memory");
    else if (read_file(owner, &is_profile, walk, &found, WANTED_CONFIGURATION) &&
             cfg_keep_warnings(&owner->config.warnings, &owner->arena, &found))
        return &owner->config;
    diag_flush(&found, errors);
    free_owner(owner);
    return NULL;
}

cfg *cfg_load(const char *file, FILE *errors)
{
    const cfg_walk walk = {.given = NULL};

    return load(file, &walk, errors);
}

cfg *cfg_load_regular(const char *file, FILE *errors)
{
    const cfg_walk walk = {.regular = true};

    return load(file, &walk, errors);
}

cfg *cfg_load_given(const cfg_file *files, size_t count, FILE *errors)
{
    const cfg_walk walk = {.given = files, .given_count = count};

    return load(files[0].name, &walk, errors);
}

bool cfg_check(cfg **config, size_t *rule_count, const char *file, FILE *errors)
{
    diag found = {.file.name = file};
    cfg_owner *owner = make_owner(file);
    const cfg_walk walk = {.given = NULL};
    bool is_profile = false;
    bool good = owner && read_file(owner, &is_profile, &walk, &found, WANTED_ANY) &&
                cfg_keep_warnings(&owner->config.warnings, &owner->arena, &found);

    if (!owner)
        diag_add(&found, 0, 0, "out of memory");
    diag_flush(&found, errors);
    *rule_count = good ? owner->config.rule_count : 0;
    *config = good && !is_profile ? &owner->config : NULL;
    if (!*config)
        free_owner(owner);
    return good;
}

void cfg_free(cfg *config)
{
    free_owner((cfg_owner *)config);
}

uint8_t cfg_find_node(const cfg *config, const char *name)
{
    for (size_t i = 0; *name && i < config->node_count; i++)
        if (strcmp(config->nodes[i].name, name) == 0)
            return (uint8_t)i;
    return CW_NO_NODE;
}

void cfg_match_nodes(uint8_t from[CW_NODES_MAX], const cfg *config, const cfg *old)
{
    for (size_t i = 0; i < CW_NODES_MAX; i++)
        from[i] = i < config->node_count ? cfg_find_node(old, config->nodes[i].name) : CW_NO_NODE;
}

void cfg_bus_config(cw_bus_config *out, cw_node_config *nodes, const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        nodes[i] = (cw_node_config){
            .modes = node->modes,
            .order = node->order,
            .queue = node->queue,
            .warning_limit = node->warning_limit,
            .restart_ticks = node->restart_ms * (uint64_t)(CW_CLOCK_HZ / 1000),
        };
    }
    *out = (cw_bus_config){
        .bit_ticks = config->bit_ticks,
        .seed = config->seed,
        .node_count = (uint8_t)config->node_count,
        .inbox = BUS_INBOX,
        .events = BUS_EVENTS,
        .rule_count = (uint16_t)config->rule_count,
        .rule_room = (uint16_t)config->reply_count,
        .nodes = nodes,
        .rules = config->rules,
    };
}

uint8_t cfg_mode(const char *name)
{
    const schema_choice *mode = modes;

    while (strcmp(mode->name, name) != 0)
        mode++;
    return (uint8_t)mode->value;
}

char *cfg_resolve_path(schema *self, const char *file, const char *path)
{
    const char *slash = strrchr(file, '/');

    size_t directory = path[0] == '/' || !slash ? 0 : (size_t)(slash - file) + 1;
    char *resolved = schema_alloc(self, directory + strlen(path) + 1, 1);

    if (resolved) {
        memcpy(resolved, file, directory);
        strcpy(resolved + directory, path);
    }
    return resolved;
}

bool cfg_name_valid(const char *name, size_t length_max)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
                                  "0123456789_.-";
    size_t length = strlen(name);

    return length > 0 && length <= length_max && strspn(name, allowed) == length;
}

char *cfg_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                    size_t length_max)
{
    char expected[80];

    snprintf(expected, sizeof expected, "a name of 1 to %zu letters, digits, '_', '.' or '-'",
             length_max);
    const char *text = schema_text(self, key, value, expected);
    if (!text)
        return NULL;
    if (!cfg_name_valid(text, length_max))
        schema_expected(self, key, value, expected);
    return schema_copy(self, text);
}

void cfg_read_time(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a time such as 10ms");

    if (text)
        schema_problem(self, key, value, text_parse_time(schema_member(key, object), text));
}

void cfg_read_span(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_time *time = schema_member(key, object);
    size_t errors = self->errors->errors;

    cfg_read_time(self, key, value, object);
    if (self->errors->errors == errors && time->ns == 0 && time->bits == 0)
        schema_complain(self, value, "%s: the time must be more than 0", key->name);
}

void cfg_read_ticks(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *ticks = schema_member(key, object);
    cfg_time time = {0};
    const char *text = schema_text(self, key, value, "a time such as 10ms");

    if (text)
        schema_problem(self, key, value, text_parse_time(&time, text));
    *ticks = text_time_ticks(time, cfg_of(self)->bit_ticks);
}

void cfg_read_ticks_min(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);
    size_t errors = self->errors->errors;

    cfg_read_ticks(self, key, value, object);
    if (self->errors->errors == errors && *ticks == 0)
        schema_complain(self, value, "%s: the time must be more than 0", key->name);
}

void cfg_warn_rounded(schema *self, const schema_key *key, const yaml_node_t *value,
                      uint64_t ticks)
{
    const cfg_walk *walk = self->user;
    const uint32_t bit_ticks = walk->config->bit_ticks;
    uint64_t bits = ticks / bit_ticks + (ticks % bit_ticks != 0);
    char bit[TIME_TEXT_MAX];
    char whole[TIME_TEXT_MAX];

    /* A profile alone has no bit rate. */
    if (ticks % bit_ticks == 0 || ticks == CW_NEVER || walk->any_node)
        return;
    text_print_span(bit, bit_ticks);
    text_print_span(whole, bits * bit_ticks);
    schema_warn(self, value,
                "%s: no whole number of bits of %s, at which it acts: it is rounded up to %" PRIu64
                " bit%s, %s",
                key->name, bit, bits, bits == 1 ? "" : "s", whole);
}

void cfg_read_bits(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);

    cfg_read_ticks(self, key, value, object);
    cfg_warn_rounded(self, key, value, *ticks);
}

void cfg_read_bits_min(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);

    cfg_read_ticks_min(self, key, value, object);
    cfg_warn_rounded(self, key, value, *ticks);
}

void cfg_read_frame(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a frame such as 123#DEADBEEF");

    if (text)
        schema_problem(self, key, value, text_parse_frame(schema_member(key, object), text));
}

/* An empty configuration, or NULL without memory. */
static cfg_owner *make_owner(const char *file)
{
    cfg_owner *owner = calloc(1, sizeof *owner);

    if (!owner)
        return NULL;
    owner->config.file = arena_print(&owner->arena, "%s", file);
    if (owner->config.file)
        return owner;
    free_owner(owner);
    return NULL;
}

static void read_root(schema *self, yaml_node_t *root, bool *is_profile, wanted kind)
{
    cfg_walk *walk = self->user;

    *is_profile = cfg_is_profile(self, root);
    walk->any_node = *is_profile;
    if (*is_profile && kind == WANTED_CONFIGURATION)
        schema_complain(self, root,
                        "this is a fault profile; a configuration loads it with "
                        "'profiles: [{ file: ... }]'");
    else if (*is_profile)
        cfg_read_profile(self, root);
    else
        schema_map(self, "configuration", root, file_keys, walk->config);
}

/* A file that has been read before; NULL: not yet. */
static const cfg_file *find_file(const cfg_file *files, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(files[i].name, name) == 0)
            return &files[i];
    return NULL;
}

static const cfg_file *keep_file(schema *self, const char *name, const char *text, size_t size)
{
    cfg *config = cfg_of(self);
    cfg_file *files = schema_alloc(self, config->file_count + 1, sizeof *files);
    char *copy = schema_alloc(self, size + 1, 1);
    char *own_name = schema_copy(self, name);

    if (!files || !copy || !own_name)
        return NULL;
    if (config->file_count > 0)
        memcpy(files, config->files, config->file_count * sizeof *files);
    memcpy(copy, text, size);
    config->files = files;
    files[config->file_count] = (cfg_file){.name = own_name, .text = copy, .size = size};
    return &files[config->file_count++];
}

static const cfg_file *read_new_file(schema *self, const char *name)
{
    const cfg_walk *walk = self->user;
    size_t size;
    char *text = yaml_file_read(&size, name, walk->regular, self->errors);
    const cfg_file *kept = text ? keep_file(self, name, text, size) : NULL;

    free(text);
    return kept;
}

bool cfg_load_file(schema *self, yaml_document_t *document, const char *file)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;
    const cfg_file *found = find_file(config->files, config->file_count, file);
    const cfg_file *given = find_file(walk->given, walk->given_count, file);

    if (!found && given)
        found = keep_file(self, file, given->text, given->size);
    else if (!found && !walk->given)
        found = read_new_file(self, file);
    else if (!found)
        diag_add(self->errors, 0, 0, "this file is not among those that are given");
    return found && yaml_text_load(document, found->text, found->size, self->errors);
}

/* What those who get a configuration rely on. */
static bool is_whole(const cfg *config)
{
    bool whole = config->bus_name && config->node_count > 0 && config->bitrate_bps > 0;

    for (size_t i = 0; i < config->node_count; i++)
        whole = whole && *config->nodes[i].name != '\0';
    for (size_t i = 0; i < config->rule_count; i++)
        whole = whole && config->rules[i].name;
    return whole;
}

static bool read_file(cfg_owner *owner, bool *is_profile, const cfg_walk *start, diag *errors,
                      wanted kind)
{
    yaml_document_t document;
    cfg_walk walk = *start;
    schema self = {
        .errors = errors,
        .arena = &owner->arena,
        .document = &document,
        .user = &walk,
    };

    walk.config = &owner->config;
    walk.defaults = (cfg_node){
        .name = cfg_no_name,
        .queue = QUEUE_DEFAULT,
        .warning_limit = WARNING_LIMIT_DEFAULT,
    };
    if (!cfg_load_file(&self, &document, owner->config.file))
        return false;
    owner->config.bit_ticks = 1; /* for what is computed while the bit rate is wrong */
    owner->config.bus_name = schema_copy(&self, "can");
    owner->config.catch_up.ns = CATCH_UP_DEFAULT_NS;
    yaml_node_t *root = yaml_document_get_root_node(&document);
    if (!root)
        diag_add(errors, 1, 1, "the file is empty; it needs at least the keys bus and nodes");
    else
        read_root(&self, root, is_profile, kind);
    yaml_document_delete(&document);
    assert(errors->errors > 0 || *is_profile || is_whole(&owner->config));
    return errors->errors == 0;
}

static void read_bus(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, bus_keys, object);
}

static void read_bus_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->bus_name_place = cfg_place_of(value);
    config->bus_name = cfg_read_name(self, key, value, NODE_NAME_MAX);
}

/* Whether ticks / CW_CLOCK_HZ is a bit near enough to the rate. */
static bool is_near(uint32_t bitrate, uint32_t ticks)
{
    uint64_t product = (uint64_t)bitrate * ticks;
    uint64_t error = product > CW_CLOCK_HZ ? product - CW_CLOCK_HZ : CW_CLOCK_HZ - product;

    return error * BITRATE_ERROR_INVERSE <= product;
}

static uint32_t rounded_rate(uint32_t ticks)
{
    return (CW_CLOCK_HZ + ticks / 2) / ticks;
}

static void read_bitrate(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->bitrate_place = cfg_place_of(value);
    schema_read_uint(self, key, value, object);
    if (config->bitrate_bps == 0)
        return;
    uint32_t fast = CW_CLOCK_HZ / config->bitrate_bps;
    uint32_t ticks = rounded_rate(config->bitrate_bps);
    if (is_near(config->bitrate_bps, ticks))
        config->bit_ticks = ticks;
    else
        schema_complain(self, value,
                        "%s: %" PRIu32 " is not within 0.1 %% of a rate that %u MHz can make; the "
                        "nearest are %" PRIu32 " and %" PRIu32,
                        key->name, config->bitrate_bps, CW_CLOCK_HZ / 1000000u,
                        rounded_rate(fast + 1), rounded_rate(fast));
}

static void read_vxcan(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    (void)schema_choose_bool(self, &config->vxcan, key, value);
}

static void check_peer(schema *self, const schema_key *key, const yaml_node_t *value,
                       const cfg_node *node);

/* With `vxcan` the ECU's interface is called as its node, where nothing else is said. */
static void name_peer(schema *self, const yaml_node_t *value, cfg_node *node)
{
    static const schema_key key = {.name = "peer"};

    if (portname_is_interface(node->name)) {
        node->peer = schema_copy(self, node->name);
        check_peer(self, &key, value, node);
    } else {
        schema_complain(self, value,
                        "peer: with vxcan an ECU's interface is called as its node, but '%s' is "
                        "too long for one (15 bytes); peer: NAME gives it another name",
                        node->name);
    }
}

static void read_node(schema *self, yaml_node_t *value, cfg_node *node)
{
    cfg_walk *walk = self->user;

    *node = walk->defaults;
    node->when_full = CFG_WHEN_FULL_DROP; /* without port */
    node->line = (int)value->start_mark.line + 1;
    schema_map(self, "node", value, node_keys, node);
    walk->unnamed = walk->unnamed || *node->name == '\0';
    if (walk->config->vxcan && portname_is_interface(node->port) && *node->name && !node->peer)
        name_peer(self, value, node);
}

/* What those have that do not say otherwise. */
static void read_defaults(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_walk *walk = self->user;

    (void)object;
    schema_map(self, key->name, value, default_keys, &walk->defaults);
    if (value->type != YAML_MAPPING_NODE)
        return;
    walk->default_queue = schema_find(self, value, "queue");
    walk->default_when_full = schema_find(self, value, "when-full");
}

static void read_nodes(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    size_t count = schema_count(self, key, value, 1, CW_NODES_MAX);

    config->nodes = schema_alloc(self, count + 1, sizeof *config->nodes);
    if (!config->nodes)
        return;
    for (; config->node_count < count; config->node_count++)
        read_node(self, schema_item(self, value, config->node_count),
                  &config->nodes[config->node_count]);
}

static void read_node_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg *config = cfg_of(self);
    cfg_node *node = object;
    char *name = cfg_read_name(self, key, value, NODE_NAME_MAX);

    if (!name)
        return;
    uint8_t other = cfg_find_node(config, name);
    if (other != CW_NO_NODE)
        schema_complain(self, value, "duplicate %s '%s' (also of the node in line %d)", key->name,
                        name, config->nodes[other].line);
    node->name = name;
}

/* A copy of the name of an interface, or NULL where there is no text. */
static char *read_interface(schema *self, const schema_key *key, const yaml_node_t *value)
{
    const char *text = schema_text(self, key, value, PORTNAME_INTERFACE_EXPECTED);

    if (!text)
        return NULL;
    if (!portname_is_interface(text))
        schema_expected(self, key, value, PORTNAME_INTERFACE_EXPECTED);
    return schema_copy(self, text);
}

/* The path of unix:PATH is relative to the file. */
static char *resolve_port(schema *self, const schema_key *key, const yaml_node_t *value,
                          const portname *name)
{
    char *path = cfg_resolve_path(self, cfg_of(self)->file, name->path);
    char *port = path ? schema_alloc(self, strlen("unix:") + strlen(path) + 1, 1) : NULL;

    if (!port)
        return NULL;
    strcpy(stpcpy(port, "unix:"), path);
    if (strlen(path) > PORTNAME_PATH_MAX)
        schema_complain(self, value, "%s: the path of a socket has at most %u bytes, not %zu (%s)",
                        key->name, PORTNAME_PATH_MAX, strlen(path), path);
    return port;
}

static char *read_port_name(schema *self, const schema_key *key, const yaml_node_t *value)
{
    const char *text = schema_text(self, key, value, PORTNAME_EXPECTED);

    if (!text)
        return NULL;
    const portname name = portname_parse(text);
    if (name.kind == PORTNAME_INVALID)
        schema_expected(self, key, value, PORTNAME_EXPECTED);
    return name.kind == PORTNAME_UNIX ? resolve_port(self, key, value, &name)
                                      : schema_copy(self, text);
}

static bool same_text(const char *a, const char *b)
{
    return a == b || (a && b && strcmp(a, b) == 0);
}

/* Whether a node has an interface of this name in this namespace, NULL: that of the ports. */
static bool has_interface(const cfg_node *node, const char *name, const char *netns)
{
    return (!netns && node->port && strcmp(node->port, name) == 0) ||
           (node->peer && strcmp(node->peer, name) == 0 && same_text(node->netns, netns));
}

/* Complains when a node read before has this interface already. */
static void check_interface(schema *self, const schema_key *key, const yaml_node_t *value,
                            const char *name, const char *netns)
{
    const cfg *config = cfg_of(self);

    for (size_t i = 0; name && i < config->node_count; i++)
        if (has_interface(&config->nodes[i], name, netns)) {
            schema_complain(self, value, "duplicate %s '%s' (also of the node in line %d)",
                            key->name, name, config->nodes[i].line);
            return;
        }
}

static void read_port(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    cfg_node *node = object;

    node->port_place = cfg_place_of(value);
    node->port = read_port_name(self, key, value);
    bool interface = portname_is_interface(node->port);
    if (interface && !walk->default_queue)
        node->queue = QUEUE_DEFAULT_INTERFACE;
    if (walk->default_when_full)
        node->when_full = walk->defaults.when_full;
    else if (!interface)
        node->when_full = CFG_WHEN_FULL_WAIT;
    check_interface(self, key, value, node->port, NULL);
}

static void read_when_full(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_node *node = object;

    if (!node->port)
        schema_complain(self, value, "%s: only a node with port can be held back", key->name);
    schema_read_choice(self, key, value, object);
}

static void check_peer(schema *self, const schema_key *key, const yaml_node_t *value,
                       const cfg_node *node)
{
    check_interface(self, key, value, node->peer, node->netns);
    if (!node->netns && node->peer && same_text(node->peer, node->port))
        schema_complain(self, value, "duplicate %s '%s' (also its port)", key->name, node->peer);
}

static void read_peer(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;

    if (!node->port)
        schema_complain(self, value, "%s: only a node with port has a peer", key->name);
    else if (!portname_is_interface(node->port))
        schema_complain(self, value, "%s: only a port that is an interface has a peer", key->name);
    if (value->type == YAML_SCALAR_NODE) /* short for { name: … } */
        read_peer_name(self, key, value, object);
    else
        schema_map(self, key->name, value, peer_keys, node);
    check_peer(self, key, value, node);
}

static void read_peer_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;

    node->peer = read_interface(self, key, value);
}

static void read_netns(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "the name of a network namespace as in `ip netns`";
    cfg_node *node = object;
    const char *text = schema_text(self, key, value, expected);

    if (!text)
        return;
    if (strlen(text) > NETNS_NAME_MAX || strpbrk(text, "/ \t\r\n") || text[0] == '.')
        schema_expected(self, key, value, expected);
    node->netns = schema_copy(self, text);
}

static void read_mode(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    uint8_t mode = cfg_mode(key->name);
    bool on;

    if (!schema_choose_bool(self, &on, key, value))
        return;
    node->modes = (uint8_t)(on ? node->modes | mode : node->modes & ~mode);
    node->berr_reporting = node->modes & CW_MODE_BERR_REPORTING;
}

static void read_lcm(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->lcm = (cfg_lcm){
        .enabled = true,
        .place = cfg_place_of(value),
        .url_place = cfg_place_of(value),
        .url = schema_copy(self, LCM_URL_DEFAULT),
        .period.ns = LCM_PERIOD_DEFAULT_NS,
        .events = LCM_EVENTS_DEFAULT,
    };
    schema_map(self, key->name, value, lcm_keys, &config->lcm);
}

static void read_lcm_url(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "an LCM URL such as " LCM_URL_DEFAULT;
    cfg_lcm *lcm = object;
    const char *text = schema_text(self, key, value, expected);

    lcm->url_place = cfg_place_of(value);
    if (text && !strstr(text, "://"))
        schema_expected(self, key, value, expected);
    if (text)
        lcm->url = schema_copy(self, text);
}

/* Bits of the kinds of events that one word stands for, 0 after a complaint. */
static uint32_t read_event_kind(schema *self, const schema_key *key, const yaml_node_t *value)
{
    schema_choice choices[CW_EVENT_COUNT + 1] = {{.name = NULL}};
    size_t count = 0;
    unsigned kind;

    for (unsigned i = 0; i < CW_EVENT_COUNT; i++)
        if (i != CW_EVENT_TOLERATED) /* not in event streams */
            choices[count++] = (schema_choice){.name = cw_event_name((cw_event_kind)i), .value = i};
    return schema_choose(self, &kind, key, value, choices) ? 1u << kind : 0;
}

static void read_lcm_events(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_lcm *lcm = object;
    size_t count = schema_count_one(self, key, value, 0, LCM_EVENTS_MAX);

    lcm->events = 0;
    for (size_t i = 0; i < count; i++)
        lcm->events |= read_event_kind(self, key, schema_item(self, value, i));
}

static void read_control(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    const char *text = schema_text(self, key, value, "the path of a socket");

    config->control_place = cfg_place_of(value);
    if (!text)
        return;
    config->control = cfg_resolve_path(self, config->file, text);
    if (config->control && strlen(config->control) > PORTNAME_PATH_MAX)
        schema_complain(self, value, "%s: the path of a socket has at most %u bytes, not %zu (%s)",
                        key->name, PORTNAME_PATH_MAX, strlen(config->control), config->control);
}
