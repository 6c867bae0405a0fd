/* SPDX-License-Identifier: MIT
 *
 * load.c - reads a whole configuration file or profile.
 */
#include "config/config.h"

#include "base/unit.h"
#include "config/change/live.h"
#include "config/parts.h"
#include "config/node/portname.h"
#include "config/source.h"
#include "config/values.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

/* The owner of a configuration; cfg_load() returns its first member. */
typedef struct cfg_owner {
    cfg config;
    arena arena;
} cfg_owner;

static schema_reader read_control, read_vxcan;
static const schema_range seed_range = {0, UINT64_MAX, sizeof(uint64_t)};

static const schema_choice pacings[] = {
    {.name = "precise", .value = CFG_PACING_PRECISE},
    {.name = "tick", .value = CFG_PACING_TICK},
    {.name = "spin", .value = CFG_PACING_SPIN},
    {.name = "virtual", .value = CFG_PACING_VIRTUAL},
    {.name = NULL},
};

#define IS_VIRTUAL "{'required': ['pacing'], 'properties': {'pacing': {'const': 'virtual'}}}"

/* The keys in the order of reading. Nodes need the bus, vxcan and their defaults. Faults need the
 * nodes and may name the rules of profiles. Expectations may name all rules. */
const schema_key cfg_file_keys[] = {
    {.name = "bus", .read = cfg_read_bus, .required = true, .map = cfg_bus_keys,
     .help = "The bus."},
    {.name = "seed", .read = schema_read_uint, .offset = offsetof(cfg, seed), .arg = &seed_range,
     .preset = "0",
     .help = "Of everything that is random."},
    {.name = "vxcan", .read = read_vxcan, .type = "boolean", .preset = "false",
     .help = "Ports that are interfaces are ends of vxcan pairs, whose other ends the ECUs open, "
             "called as their nodes where `peer` says nothing else."},
    {.name = "defaults", .read = cfg_read_defaults, .map = cfg_node_keys, .within = CFG_IN_DEFAULTS,
     .as = "nodeDefaults",
     .help = "What nodes have that do not say otherwise."},
    {.name = "guests", .read = cfg_read_guests, .map = cfg_node_keys, .within = CFG_IN_GUESTS,
     .as = "guests",
     .help = "Nodes that are on the bus while a client is connected (canwire-ports(7))."},
    {.name = "nodes", .read = cfg_read_nodes, .required = true, .map = cfg_node_keys,
     .within = CFG_IN_NODES, .as = "nodeConfig",
     .type = TYPE_LIST_UP_TO(64, "@"),
     .help = "The controllers on the bus. Only a bus with guests may have none. Their order "
             "matters only for output at equal times."},
    {.name = "profiles", .read = cfg_read_profiles, .map = cfg_profile_use_keys, .as = "profileUse",
     .type = TYPE_LIST_UP_TO(100, "@"),
     .help = "Fault profiles to load; their rules come before 'faults'."},
    {.name = "faults", .read = cfg_read_faults, .map = cfg_rule_keys, .as = "rule",
     .type = TYPE_LIST_UP_TO(1024, "@"),
     .help = "Fault rules."},
    {.name = "expect", .read = cfg_read_expect, .map = cfg_expect_keys, .as = "expectation",
     .type = TYPE_LIST_UP_TO(1000, "@"),
     .help = "What a run is judged by (exit status 3)."},
    {.name = "expect-report", .read = cfg_read_expect_report, .type = "text",
     .help = "The file to which canwired writes its verdict at its end, as JUnit XML; relative to "
             "this file. The directory must exist."},
    {.name = "record", .read = cfg_read_record, .map = cfg_record_keys, .as = "recording",
     .type = TYPE_LIST_UP_TO(16, "@"),
     .help = "What canwired writes down while the bus runs; see canwire-record(7)."},
    {.name = "lcm", .read = cfg_read_lcm, .map = cfg_lcm_keys,
     .help = "Publishes statistics and events over LCM."},
    {.name = "control", .read = read_control, .type = "text",
     .help = "Path of the control socket, relative to this file. Default: none; as a service "
             "/run/canwire/NAME.sock."},
    {.name = "metrics", .read = cfg_read_metrics, .type = "metricsAddress",
     .help = "Where programs read all counters as OpenMetrics over HTTP: [HOST:]PORT, HOST "
             "127.0.0.1 by default, or unix:PATH, relative to this file. In a rig, those of all "
             "buses. Default: nowhere."},
    {.name = "pacing", .read = schema_read_choice, .offset = offsetof(cfg, pacing), .arg = pacings,
     .preset = "precise",
     .help = "precise: a wake-up per frame end; tick: one a millisecond at most; spin: precise, "
             "awake for the last 50 us of each wait; virtual: bus time goes on only while all "
             "programs of canwire run --virtual wait."},
    {.name = "virtual", .read = cfg_read_virtual, .map = cfg_virtual_keys,
     .help = "Virtual time, with pacing: virtual."},
    {.name = "missing-port", .read = schema_read_choice, .offset = offsetof(cfg, missing_port),
     .arg = cfg_missing_ports, .preset = "fail",
     .help = "What to do at the start, and at a reload, when the interface of a port is not "
             "there. One that goes later is waited for in any case. With wait, `canwire vcan up` "
             "leaves can0 and the like to hardware. A node may say otherwise."},
    {.name = "catch-up", .read = cfg_read_span, .offset = offsetof(cfg, catch_up), .preset = "1s",
     .help = "How far the bus may fall behind real time; when it is further behind, it skips "
             "that time and says so."},
    {.name = NULL,
     .type = "{'required': ['bus'], 'if': {'not': " TYPE_NEEDS("guests") "}, 'then': "
             "{'required': ['nodes'], 'properties': {'nodes': {'minItems': 1}}}, 'allOf': ["
             TYPE_IF(IS_VIRTUAL, TYPE_ANY(TYPE_NEEDS("control") ", {'required': ['virtual'], "
                     "'properties': {'virtual': " TYPE_NEEDS("socket") "}}")) ", "
             TYPE_IF(TYPE_NEEDS("virtual"), IS_VIRTUAL) "]}"},
};

/* The files that a caller accepts. */
typedef enum wanted { WANTED_CONFIGURATION, WANTED_ANY } wanted;
static cfg_owner *make_owner(const char *file);

static bool load_read_file(cfg_owner *owner, bool *is_profile, const cfg_walk *walk, diag *errors,
                           wanted kind);

static void free_owner(cfg_owner *owner)
{
    if (!owner)
        return;
    arena_free(&owner->arena);
    free(owner);
}

/* Loads a configuration. Returns NULL after all errors have been written. */
static cfg *load_text(const char *file, const cfg_walk *walk, FILE *errors)
{
    diag found = {.file.name = file};
    cfg_owner *owner = make_owner(file);
    bool is_profile;

    if (!owner)
        diag_add(&found, 0, 0, "out of memory");
    else if (load_read_file(owner, &is_profile, walk, &found, WANTED_CONFIGURATION) &&
             cfg_keep_warnings(&owner->config.warnings, &owner->arena, &found))
        return &owner->config;
    diag_flush(&found, errors);
    free_owner(owner);
    return NULL;
}

cfg *cfg_load(const char *file, FILE *errors)
{
    const cfg_walk walk = {.given = NULL};

    return load_text(file, &walk, errors);
}

cfg *cfg_load_regular(const char *file, FILE *errors)
{
    const cfg_walk walk = {.regular = true};

    return load_text(file, &walk, errors);
}

cfg *cfg_load_given(const cfg_file *files, size_t count, FILE *errors)
{
    const cfg_walk walk = {.given = files, .given_count = count};

    return load_text(files[0].name, &walk, errors);
}

cfg *cfg_load_text(const cfg_file *file, FILE *errors)
{
    const cfg_walk walk = {.given = file, .given_count = 1, .others = true};

    return load_text(file->name, &walk, errors);
}

bool cfg_check(cfg **config, size_t *rule_count, const char *file, FILE *errors)
{
    diag found = {.file.name = file};
    cfg_owner *owner = make_owner(file);
    const cfg_walk walk = {.given = NULL};
    bool is_profile = false;
    bool good = owner && load_read_file(owner, &is_profile, &walk, &found, WANTED_ANY) &&
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

/* Makes an empty configuration; returns NULL without memory. */
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

/* Gives a bus of guests alone an empty list of nodes. Nodes of the document have other addresses
 * then. */
static void complete_root(yaml_document_t *document, schema *self)
{
    yaml_node_t *root = yaml_document_get_root_node(document);
    if (root->type != YAML_MAPPING_NODE || !schema_find(self, root, "guests") ||
        schema_find(self, root, "nodes"))
        return;
    const int key = yaml_document_add_scalar(document, NULL, (const yaml_char_t *)"nodes", -1,
                                             YAML_PLAIN_SCALAR_STYLE);
    const int list = yaml_document_add_sequence(document, NULL, YAML_FLOW_SEQUENCE_STYLE);
    if (key == 0 || list == 0 || !yaml_document_append_mapping_pair(document, 1, key, list))
        diag_add(self->errors, 0, 0, "out of memory");
}

/* Gives a bus of the service a control socket where its clients look. It has the name of the unit,
 * in a rig that of the bus. */
static void complete_control(schema *self, cfg *config)
{
    const char *instance = unit_instance();
    const char *slash = strrchr(config->file, '/');
    const char *file = slash ? slash + 1 : config->file;
    if (!instance || config->control)
        return;
    const size_t length = strlen(instance);
    const bool own = strncmp(file, instance, length) == 0 && strcmp(file + length, ".yaml") == 0;
    config->control =
        schema_print(self, UNIT_RUN_FOLDER "/%s.sock", own ? instance : config->bus_name);
}

/* Reads the map of the whole file, which may be a configuration or a fault profile. */
static void load_read_root(schema *self, yaml_node_t *root, bool *is_profile, wanted kind)
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
    else if (root->type == YAML_MAPPING_NODE && schema_find(self, root, "buses"))
        schema_complain(self, root, "this is a rig of several buses; expected the file of one bus");
    else
        schema_map(self, "configuration", root, cfg_file_keys, walk->config);
    if (!*is_profile)
        complete_control(self, walk->config);
    if (root->type == YAML_MAPPING_NODE && !*is_profile)
        cfg_complete_virtual(self, root, walk->config);
    if (self->errors->errors == 0 && !*is_profile)
        cfg_check_limits(self, schema_find(self, root, "nodes"), false);
    if (self->errors->errors == 0 && !*is_profile)
        cfg_check_start(self, schema_find(self, root, "bus"));
}

/* Returns true when a configuration has all parts that its users rely on. */
static bool is_whole(const cfg *config)
{
    bool whole = config->bus_name && config->node_count > 0 && config->bitrate_bps > 0;

    for (size_t i = 0; i < config->node_count; i++)
        whole = whole && *config->nodes[i].name != '\0';
    for (size_t i = 0; i < config->rule_count; i++)
        whole = whole && config->rules[i].name;
    return whole;
}

/* Reads a file into its owner. Checks of the whole come after all keys. */
static bool load_read_file(cfg_owner *owner, bool *is_profile, const cfg_walk *start, diag *errors,
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
    cfg_node_defaults(&walk.defaults);
    if (!cfg_load_file(&self, &document, owner->config.file))
        return false;
    owner->config.rate = cw_rate_of(1); /* for computations while the bit rate is wrong */
    cfg_bus_presets(&self, &owner->config);
    schema_read_presets(&self, cfg_file_keys, &owner->config);
    if (!yaml_document_get_root_node(&document)) {
        diag_add(errors, 1, 1, "the file is empty; it needs at least the keys bus and nodes");
    } else {
        complete_root(&document, &self);
        load_read_root(&self, yaml_document_get_root_node(&document), is_profile, kind);
    }
    yaml_document_delete(&document);
    assert(errors->errors > 0 || *is_profile || is_whole(&owner->config));
    return errors->errors == 0;
}

static void read_vxcan(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    (void)schema_choose_bool(self, &config->vxcan, key, value);
}

/* Reads the path of the control socket, which must fit into an address of the kernel. */
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
