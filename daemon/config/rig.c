/* SPDX-License-Identifier: MIT
 *
 * rig.c - reads a rig: several buses, and the gateways between their nodes.
 */
#include "config/rig.h"

#include "base/schema.h"
#include "base/text/yamlfile.h"
#include "config/node/portname.h"
#include "config/source.h"
#include "config/values.h"

#include <stdlib.h>
#include <string.h>

#define QUEUE_DEFAULT 16u
#define SIDES "a list of two nodes, [ BUS:NODE, BUS:NODE ]"

/* The owner of a rig; rig_load() returns its first member. */
typedef struct rig_owner {
    rig rig;
    arena arena;
} rig_owner;

/* The state of the readers (schema.user). */
typedef struct rig_walk {
    rig *rig;
    FILE *errors; /* of the files of buses */
    const cfg_file *given; /* buses that are texts, by the names in the rig */
    size_t given_count;
} rig_walk;

static schema_reader read_buses, read_gateways, rig_read_name, read_between, read_rules,
    read_filter, rig_read_id, read_delay;

static const schema_range queue_range = {1, RIG_QUEUE_MAX, sizeof(uint32_t)};

static const schema_choice directions[] = {
    {.name = "forward", .value = RIG_FORWARD},
    {.name = "backward", .value = RIG_BACKWARD},
    {.name = "both", .value = RIG_BOTH},
    {.name = NULL},
};

#define MEMBER(m) .offset = offsetof(rig_rule, m)

static const schema_key rule_keys[] = {
    {.name = "filter", .read = read_filter, .type = TYPE_SOME(8, "{'type': ['string', 'integer']}"),
     .help = "Frames as candump's filters name them; by default all."},
    {.name = "id", .read = rig_read_id,
     .type = "{'type': ['string', 'integer'], 'pattern': "
             "'^([0-7][0-9A-Fa-f]{2}|[01][0-9A-Fa-f]{7})$'}",
     .help = "The new identifier, 3 digits or 8."},
    {.name = "delay", .read = read_delay, MEMBER(delay), .type = "realTime",
     .help = "From the reception to the other node; default 0."},
    {.name = "queue", .read = schema_read_uint, MEMBER(queue), .arg = &queue_range,
     .type = "{'type': ['string', 'integer'], 'pattern': "
             "'^([1-9][0-9]{0,2}|10[01][0-9]|102[0-4])$'}",
     .help = "Frames that wait for the end of their delay; default 16."},
    {.name = "direction", .read = schema_read_choice, MEMBER(direction), .arg = directions,
     .help = "Default both."},
    {.name = NULL},
};

static const schema_key gateway_keys[] = {
    {.name = "name", .read = rig_read_name, .required = true,
     .type = "{'type': 'string', 'pattern': '^[A-Za-z0-9_.-]{1,32}$'}",
     .help = "Its name in statistics."},
    {.name = "between", .read = read_between, .required = true,
     .type = TYPE_LIST(2, 2, "{'type': 'string', 'pattern': '^[^:]*:.'}"),
     .help = "Its nodes, of two buses, as BUS:NODE. They have no port."},
    {.name = "rules", .read = read_rules, .required = true, .map = rule_keys, .as = "rule",
     .type = TYPE_LIST(1, 64, "@"),
     .help = "The first rule that matches a frame decides; other frames stay."},
    {.name = NULL},
};

const schema_key rig_file_keys[] = {
    {.name = "buses", .read = read_buses, .required = true, .type = TYPE_LIST(1, 16, TYPE_STRING),
     .help = "Files with the configurations of the buses."},
    {.name = "gateways", .read = read_gateways, .map = gateway_keys, .as = "gateway",
     .type = TYPE_LIST_UP_TO(64, "@"),
     .help = "What carries frames from bus to bus."},
    {.name = NULL},
};

static rig *rig_of(const schema *self)
{
    const rig_walk *walk = self->user;
    return walk->rig;
}

/* ---- Buses ----------------------------------------------------------------------------------- */

/* Complains about what only one bus of a rig can have. */
static void rig_compare(schema *self, const schema_key *key, const yaml_node_t *item,
                        const cfg *one, const cfg *other)
{
    if (strcmp(one->file, other->file) == 0)
        schema_complain(self, item, "%s: duplicate file '%s'", key->name, one->file);
    else if (strcmp(one->bus_name, other->bus_name) == 0)
        schema_complain(self, item, "%s: duplicate bus '%s', in %s and in %s", key->name,
                        one->bus_name, other->file, one->file);
    if (one->control && other->control && strcmp(one->control, other->control) == 0)
        schema_complain(self, item, "%s: duplicate control socket '%s', in %s and in %s", key->name,
                        one->control, other->file, one->file);
    if (one->metrics.name && other->metrics.name &&
        strcmp(one->metrics.name, other->metrics.name) == 0)
        schema_complain(self, item, "%s: duplicate metrics '%s', in %s and in %s, whose page has "
                        "all buses", key->name, one->metrics.name, other->file, one->file);
    for (size_t i = 0; i < one->node_count; i++)
        for (size_t k = 0; k < other->node_count; k++) {
            const char *port = one->nodes[i].guest <= 1 ? one->nodes[i].port : NULL;
            if (other->nodes[k].guest > 1)
                continue; /* they share one */
            if (port && other->nodes[k].port && strcmp(port, other->nodes[k].port) == 0)
                schema_complain(self, item, "%s: duplicate port '%s', in %s and in %s", key->name,
                                port, other->file, one->file);
        }
}

/* Loads a bus from its file, or from its text if that is given under the name in the rig. */
static cfg *load_bus(const rig_walk *walk, const char *name, const char *file)
{
    for (size_t i = 0; i < walk->given_count; i++) {
        const cfg_file *given = &walk->given[i];
        if (strcmp(given->name, name) == 0)
            return cfg_load_text(&(cfg_file){.name = file, .text = given->text,
                                             .size = given->size}, walk->errors);
    }
    return cfg_load_regular(file, walk->errors);
}

/* Loads the file of a bus, and checks it against the buses before it. */
static void read_bus(schema *self, const schema_key *key, const yaml_node_t *item)
{
    const rig_walk *walk = self->user;
    rig *r = walk->rig;
    const char *text = schema_text(self, key, item, "the file of a bus");
    const char *file = text ? cfg_resolve_path(self, r->file, text) : NULL;
    if (!file)
        return;
    cfg *config = load_bus(walk, text, file);
    if (!config) {
        schema_complain(self, item, "%s: there are errors in '%s'", key->name, file);
        return;
    }
    if (config->pacing == CFG_PACING_VIRTUAL)
        schema_complain(self, item, "%s: '%s' has 'pacing: virtual', which a bus of a rig cannot "
                        "have", key->name, file);
    for (size_t i = 0; i < r->bus_count; i++)
        rig_compare(self, key, item, config, r->buses[i]);
    r->names[r->bus_count] = schema_copy(self, config->bus_name);
    r->buses[r->bus_count++] = config;
}

/* Loads the buses in their order, which numbers of buses keep. */
static void read_buses(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig *r = object;
    const size_t count = schema_count(self, key, value, 1, RIG_BUSES_MAX);

    r->buses = schema_alloc(self, count + 1, sizeof(cfg *));
    for (size_t i = 0; r->buses && i < count; i++)
        read_bus(self, key, schema_item(self, value, i));
}

/* ---- Gateways -------------------------------------------------------------------------------- */

/* The name must be unique, since statistics have one object for each. */
static void rig_read_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig_gateway *gateway = object;
    const rig *r = rig_of(self);
    char *name = cfg_read_name(self, key, value, NODE_NAME_MAX);

    for (size_t i = 0; name && i < r->gateway_count; i++)
        if (r->gateways[i].name && strcmp(r->gateways[i].name, name) == 0)
            schema_complain(self, value, "%s: duplicate gateway '%s'", key->name, name);
    gateway->name = name;
}

/* Complains about a bus that does not exist, and lists those that do. */
static void complain_bus(schema *self, const schema_key *key, const yaml_node_t *value,
                         const char *name)
{
    const rig *r = rig_of(self);
    nearest guess = {.word = name};
    const char *list = "";
    for (size_t i = 0; i < r->bus_count; i++) {
        nearest_consider(&guess, r->buses[i]->bus_name);
        list = schema_join(self, list, r->buses[i]->bus_name);
    }
    schema_complain(self, value, "%s: there is no bus '%.40s'%s", key->name, name,
                    schema_allowed(self, &guess, list));
}

/* Complains about a node that the bus does not have, with a guess. */
static void complain_node(schema *self, const schema_key *key, const yaml_node_t *value,
                          const cfg *bus, const char *name)
{
    nearest guess = {.word = name};
    for (size_t i = 0; i < bus->node_count; i++)
        nearest_consider(&guess, bus->nodes[i].name);
    schema_complain(self, value, "%s: there is no node '%.40s' on bus %s%s", key->name, name,
                    bus->bus_name, schema_suggestion(self, &guess));
}

/* Finds BUS:NODE. Returns false after a complaint. */
static bool read_end(schema *self, rig_end *out, const schema_key *key, const yaml_node_t *value)
{
    static const char expected[] = "BUS:NODE";
    const rig *r = rig_of(self);
    const char *text = schema_text(self, key, value, expected);
    const char *colon = text ? strchr(text, ':') : NULL;
    if (text && !colon)
        schema_expected(self, key, value, expected);
    char *bus = colon ? schema_copy(self, text) : NULL;
    if (!bus)
        return false;
    bus[colon - text] = '\0';
    for (out->bus = 0; out->bus < r->bus_count; out->bus++)
        if (strcmp(r->buses[out->bus]->bus_name, bus) == 0)
            break;
    if (out->bus == r->bus_count) {
        complain_bus(self, key, value, bus);
        return false;
    }
    out->node = cfg_find_node(r->buses[out->bus], colon + 1);
    if (out->node == CW_NO_NODE)
        complain_node(self, key, value, r->buses[out->bus], colon + 1);
    out->bus_name = bus;
    out->name = schema_copy(self, colon + 1);
    return out->node != CW_NO_NODE && out->name;
}

/* Reads the two nodes of a gateway, which are on different buses and have no port. */
static void read_between(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig_gateway *gateway = object;
    if (value->type != YAML_SEQUENCE_NODE) {
        schema_expected(self, key, value, SIDES);
        return;
    }
    if (schema_count(self, key, value, 2, 2) != 2 || rig_of(self)->bus_count == 0)
        return;
    bool good = true;
    for (unsigned i = 0; i < 2; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        good = read_end(self, &gateway->ends[i], key, item) && good;
        const rig_end *end = &gateway->ends[i];
        if (good && rig_of(self)->buses[end->bus]->nodes[end->node].port)
            schema_complain(self, item, "%s: the node of a gateway has no port of its own",
                            key->name);
    }
    if (good && gateway->ends[0].bus == gateway->ends[1].bus)
        schema_complain(self, value, "%s: both nodes are on bus %s; a gateway connects two buses",
                        key->name, rig_of(self)->buses[gateway->ends[0].bus]->bus_name);
}

/* Reads gateways one by one, so that each name is compared with those before it. */
static void read_gateways(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig *r = object;
    const size_t count = schema_count(self, key, value, 0, RIG_GATEWAYS_MAX);

    r->gateways = schema_alloc(self, count + 1, sizeof *r->gateways);
    for (; r->gateways && r->gateway_count < count; r->gateway_count++)
        schema_map(self, "gateway", schema_item(self, value, r->gateway_count), gateway_keys,
                   &r->gateways[r->gateway_count]);
}

/* ---- Rules ----------------------------------------------------------------------------------- */

static void read_filter(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig_rule *rule = object;
    rule->filter_count = (uint8_t)cfg_read_filter_list(self, key, value, rule->filters,
                                                       rule->filter_count, CW_RULE_FILTERS_MAX);
}

/* The number of digits says the format that the frame has on the other bus. */
static void rig_read_id(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig_rule *rule = object;
    const char *text = schema_text(self, key, value, "an identifier such as 123 or 12345678");
    uint8_t flags = 0;
    const char *problem = text ? text_parse_id(&rule->id, &flags, text) : NULL;

    schema_problem(self, key, value, problem);
    rule->has_id = text && !problem;
    if (flags & CW_FRAME_EXTENDED)
        rule->id |= CW_FILTER_EXTENDED;
}

/* Takes real time alone: two buses have bits of two lengths. */
static void read_delay(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_time *delay = schema_member(key, object);

    cfg_read_time(self, key, value, object);
    if (delay->bits > 0)
        schema_complain(self, value, "%s: bits of which bus? Expected a time such as 200us",
                        key->name);
}

/* Their order counts: the first rule that matches a frame decides. */
static void read_rules(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    rig_gateway *gateway = object;
    const size_t count = schema_count(self, key, value, 1, RIG_RULES_MAX);

    gateway->rules = schema_alloc(self, count + 1, sizeof *gateway->rules);
    for (; gateway->rules && gateway->rule_count < count; gateway->rule_count++) {
        yaml_node_t *item = schema_item(self, value, gateway->rule_count);
        rig_rule *rule = &gateway->rules[gateway->rule_count];
        *rule = (rig_rule){
            .place = cfg_place_of(item), .queue = QUEUE_DEFAULT, .direction = RIG_BOTH};
        schema_map(self, "rule", item, rule_keys, rule);
    }
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* Complains about gateways that pass a frame round for ever. */
static void check_loop(rig *r, diag *errors)
{
    rig_loop loop;
    char frame[FRAME_TEXT_MAX];
    char names[RIG_LOOP_MAX * (NODE_NAME_MAX + 2)] = "";
    if (!rig_find_loop(&loop, r))
        return;
    for (unsigned i = 0; i < loop.count; i++) {
        strcat(names, loop.gateways[i]->name);
        strcat(names, ", ");
    }
    (void)text_print_frame(frame, &loop.frame);
    diag_add(errors, (size_t)loop.rule->place.line, (size_t)loop.rule->place.column,
             "rules: a loop: a frame such as %s goes round for ever, through %sand %s again",
             frame, names, loop.gateways[0]->name);
}

/* Reads the map of a rig, and looks for loops when all else is right. */
static bool rig_read_root(rig_owner *owner, rig_walk *walk, yaml_document_t *document, diag *found)
{
    schema self = {
        .errors = found, .arena = &owner->arena, .document = document, .user = walk};
    yaml_node_t *root = yaml_document_get_root_node(document);

    if (root)
        schema_map(&self, "rig", root, rig_file_keys, &owner->rig);
    else
        diag_add(found, 1, 1, "the file is empty; a rig needs the key buses");
    if (found->errors == 0)
        check_loop(&owner->rig, found);
    return found->errors == 0;
}

/* Returns a copy of a text, or NULL after a complaint. */
static char *copy_text(size_t *size, const cfg_file *file, diag *found)
{
    char *copy = malloc(file->size + 1);

    if (!copy) {
        diag_add(found, 0, 0, "out of memory");
        return NULL;
    }
    memcpy(copy, file->text, file->size);
    copy[file->size] = '\0';
    *size = file->size;
    return copy;
}

/* Returns the text of a file, to be freed, or NULL after a complaint. */
static char *read_text(size_t *size, const cfg_file *file, diag *found)
{
    return file->text ? copy_text(size, file, found)
                      : yaml_file_read(size, file->name, true, found);
}

/* Loads the document of a file, or of its text if there is one. The caller frees *text. Returns
 * false after a complaint. */
static bool load_document(yaml_document_t *document, char **text, size_t *size,
                          const cfg_file *file, diag *found)
{
    *text = read_text(size, file, found);
    return *text && yaml_text_load(document, *text, *size, &yaml_file_limits, found);
}

bool rig_is_same(const char *file, const char *text, size_t size, FILE *errors)
{
    diag found = {.file.name = file};
    size_t now_size = 0;
    char *now = yaml_file_read(&now_size, file, true, &found);
    const bool same = now && now_size == size && memcmp(now, text, size) == 0;

    if (now && !same)
        diag_add(&found, 1, 1, "a rig cannot change while it runs: restart canwired");
    diag_flush(&found, errors);
    free(now);
    return same;
}

rig *rig_load_given(const cfg_file *file, const cfg_file *buses, size_t count, FILE *errors)
{
    diag found = {.file.name = file->name};
    rig_owner *owner = calloc(1, sizeof *owner);
    yaml_document_t document;
    rig_walk walk = {.errors = errors, .given = buses, .given_count = count};
    bool good = false;

    if (owner)
        walk.rig = &owner->rig;
    if (owner)
        owner->rig.file = arena_print(&owner->arena, "%s", file->name);
    if (!owner || !owner->rig.file)
        diag_add(&found, 0, 0, "out of memory");
    else if (load_document(&document, &owner->rig.text, &owner->rig.size, file, &found)) {
        good = rig_read_root(owner, &walk, &document, &found);
        yaml_document_delete(&document);
    }
    diag_flush(&found, errors);
    if (good)
        return &owner->rig;
    rig_free(owner ? &owner->rig : NULL);
    return NULL;
}

rig *rig_load(const char *file, FILE *errors)
{
    return rig_load_given(&(cfg_file){.name = file}, NULL, 0, errors);
}

rig *rig_load_text(const cfg_file *file, FILE *errors)
{
    return rig_load_given(file, NULL, 0, errors);
}

void rig_free(rig *self)
{
    rig_owner *owner = (rig_owner *)self;

    if (!owner)
        return;
    for (size_t i = 0; i < self->bus_count; i++)
        cfg_free(self->buses[i]);
    free(self->text);
    arena_free(&owner->arena);
    free(owner);
}

#define BUSES "buses" /* the key that each rig has */

/* Returns false for the text of most files that are not rigs: a key is written as it is, or with an
 * escape. */
static bool may_be_rig(const char *text, size_t size)
{
    return memmem(text, size, BUSES, strlen(BUSES)) || memchr(text, '\\', size);
}

/* Returns true for the file of a rig. It is read as a whole only when its text makes that
 * likely. */
static bool is_rig(const cfg_file *file)
{
    diag found = {.file.name = file->name};
    arena memory = {.blocks = NULL};
    yaml_document_t document;
    schema self = {.errors = &found, .arena = &memory, .document = &document};
    bool is = false;

    size_t text_size = 0;
    char *text = read_text(&text_size, file, &found);
    if (text && may_be_rig(text, text_size) &&
        yaml_text_load(&document, text, text_size, &yaml_file_limits, &found)) {
        yaml_node_t *root = yaml_document_get_root_node(&document);
        is = root && root->type == YAML_MAPPING_NODE && schema_find(&self, root, BUSES);
        yaml_document_delete(&document);
    }
    diag_flush(&found, NULL); /* rig_load() tells about the same file */
    free(text);
    arena_free(&memory);
    return is;
}

bool rig_is_rig(const char *file)
{
    return is_rig(&(cfg_file){.name = file});
}

bool rig_load_either(rig **several, cfg **alone, const cfg_file *file, FILE *errors)
{
    *several = NULL;
    *alone = NULL;
    if (is_rig(file))
        *several = file->text ? rig_load_text(file, errors) : rig_load(file->name, errors);
    else
        *alone = file->text ? cfg_load_text(file, errors) : cfg_load_regular(file->name, errors);
    return *several || *alone;
}
