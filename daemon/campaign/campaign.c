/* SPDX-License-Identifier: MIT
 *
 * campaign.c - reads the file of a campaign and its scenario.
 */
#include "campaign/campaign.h"

#include "base/text/yamlfile.h"
#include "campaign/campaign_owner.h"
#include "campaign/space/jsonvalue.h"
#include "campaign/space/names.h"
#include "campaign/space/sample.h"
#include "config/rig.h"

#include <stdlib.h>
#include <string.h>

static schema_reader read_scenario, read_until, read_limit, read_sample, read_detected, read_ftti;

static const schema_range seed_range = {0, UINT64_MAX, sizeof(uint64_t)};
static const schema_range count_range = {1, UINT64_C(1) << 48, sizeof(uint64_t)};

static const schema_key sample_keys[] = {
    {.name = "random", .read = schema_read_uint, .arg = &count_range,
     .offset = offsetof(campaign, sample_count)},
    {.name = "low-discrepancy", .read = schema_read_uint, .arg = &count_range,
     .offset = offsetof(campaign, sample_count)},
    {.name = NULL, .type = "{'minProperties': 1, 'maxProperties': 1}"},
};

const schema_key campaign_file_keys[] = {
    {.name = "scenario", .read = read_scenario, .required = true,
     .type = TYPE_ANY(TYPE_STRING ", " "{'type': 'object'}"),
     .help = "The file of a bus or of a rig, or the configuration itself."},
    {.name = "until", .read = read_until, .type = "time",
     .help = "Bus time at which each run ends; needed where traffic has no end."},
    {.name = "seed", .read = schema_read_uint,
     .offset = offsetof(campaign_owner, campaign.seed), .arg = &seed_range,
     .preset = "0",
     .help = "Of what the sample draws; default 0."},
    {.name = "limit", .read = read_limit,
     .type = "{'type': 'string', 'pattern': "
             "'^(?:[1-9][0-9]{9,}(?:\\.[0-9]+)?ns|[1-9][0-9]{6,}(?:\\.[0-9]+)?us|[1-9][0-9]{3,}("
             "?:\\.[0-9]+)?ms|[1-9][0-9]*(?:\\.[0-9]+)?s|(?:0|[1-9][0-9]*)(?:\\.[0-9]+)?(?:min|h"
             "))$', 'examples': ['10s']}",
     .help = "Real time for one run, 1s to 24h; default 60s."},
    {.name = "ecu", .read = campaign_read_ecus, .map = campaign_ecu_keys, .as = "ecu",
     .type = TYPE_ANY("@, {'type': 'array', 'minItems': 1, 'maxItems': 16, 'items': @, 'if': "
             "{'contains': {'required': ['bus'], " "'properties': {'bus': {'const': 'own'}}}}, "
             "'then': {'maxItems': 1}}"),
     .help = "Programs at nodes: real ECUs."},
    {.name = "network", .read = campaign_read_network, .type = "{'enum': ['own', 'host']}",
     .help = "own (the default): programs have a network namespace of their own for each row, "
             "where the system allows it. host: they have that of the campaign."},
    {.name = "virtual", .read = campaign_read_virtual, .type = "boolean",
     .help = "on: programs and bus have virtual time, and rows are the same each time."},
    {.name = "sample", .read = read_sample, .map = sample_keys,
     .type = TYPE_ANY("{'enum': ['full', 'pairwise']}, @"),
     .help = "The rows: all combinations (the default), enough for each pair of values, or so "
             "many."},
    {.name = "detected", .read = read_detected,
     .type = TYPE_SOME(256, "{'type': ['string', 'integer', 'number']}"),
     .help = "Names of expectations that tell of a detection, for canwire campaign report."},
    {.name = "ftti", .read = read_ftti,
     .type = "{'type': 'string', 'pattern': '^[0-9]+(\\.[0-9]+)?(ns|us|ms|s|min|h)$'}",
     .help = "The limit of detection latencies, for canwire campaign report."},
    {.name = "vary", .read = campaign_read_factors, .required = true,
     .map = campaign_factor_keys, .as = "factor",
     .type = TYPE_LIST(1, 64, "@"),
     .help = "The factors."},
    {.name = NULL},
};

/* ---- Scenarios without an end ---------------------------------------------------------------- */

/* Notes what never ends in a bus of the scenario, if it is the first such bus. `inside`: the bus is
 * in the text of the scenario, and not in another file. */
static void ends_note(campaign_owner *o, schema *self, const cfg *config, bool inside)
{
    cfg_unending found;
    if (o->unending || !cfg_find_unending(config, &found))
        return;
    o->unending = schema_print(self, "%s:%d:%d: %s never ends: give `until` in the campaign",
                               found.file, found.place.line, found.place.column, found.what);
    o->unending_at = found.place;
    o->unending_inside = inside;
    o->unending_rule = found.is_rule;
}

static bool is_before(const yaml_mark_t *mark, const cfg_place *place)
{
    const size_t line = (size_t)place->line - 1;
    return mark->line < line ||
           (mark->line == line && mark->column < (size_t)place->column);
}

/* Returns the node of the bus that a place is in, or NULL. */
static const yaml_node_t *find_item(campaign_owner *o, const cfg_place *place)
{
    schema self = {.document = &o->document};
    yaml_node_t *root = yaml_document_get_root_node(&o->document);
    yaml_node_t *nodes = schema_find(&self, root, "nodes");
    const yaml_node_t *found = NULL;
    if (!nodes || nodes->type != YAML_SEQUENCE_NODE)
        return NULL;
    const size_t count =
        (size_t)(nodes->data.sequence.items.top - nodes->data.sequence.items.start);
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = schema_item(&self, nodes, i);
        if (is_before(&item->start_mark, place))
            found = item;
    }
    return found;
}

/* Returns true when a factor may change a node of the bus, or replace it. */
static bool touches(const campaign *c, const factor *f, const yaml_node_t *item)
{
    const size_t begin = splice_offset(c->text, c->size, item->start_mark.index);
    const size_t end = splice_offset(c->text, c->size, item->end_mark.index);
    return f->edit.before && f->edit.begin <= end && f->edit.end >= begin;
}

static bool begins_with(const char *path, const char *key)
{
    return strncmp(path, key, strlen(key)) == 0;
}

/* A bus in a file of its own is changed by the name of this file alone. A rule may stand in a
 * profile, whose parameters may end it: each row is asked again. */
static bool may_change(campaign_owner *o, const factor *f)
{
    if (f->rules || !f->path)
        return f->rules && o->unending_rule;
    if (!o->unending_inside)
        return begins_with(f->path, "buses");
    if (o->unending_rule)
        return begins_with(f->path, "faults") || begins_with(f->path, "profiles");
    const yaml_node_t *item = find_item(o, &o->unending_at);
    return !item || touches(&o->campaign, f, item);
}

/* Complains at the key `scenario` about what never ends, if there is no `until`, no program that
 * ends, and no factor can change that. The factors have been read. */
static void ends_check(schema *self, const yaml_node_t *root, campaign_owner *o)
{
    const campaign *c = &o->campaign;
    if (!o->unending || c->until || c->ecus.count > 0)
        return;
    for (size_t i = 0; i < c->factor_count; i++)
        if (may_change(o, &c->factors[i]))
            return;
    const yaml_node_t *scenario = schema_find(self, root, "scenario");
    schema_complain_elsewhere(self, scenario ? scenario : root, o->unending);
}

/* ---- The scenario ---------------------------------------------------------------------------- */

/* Cuts a scenario out of the campaign. Its lines and columns stay what they are in the file. */
static bool cut_out(campaign_owner *o, schema *self, const yaml_node_t *value, const char *text,
                    size_t size)
{
    const size_t begin = splice_offset(text, size, value->start_mark.index);
    const size_t end = splice_offset(text, size, value->end_mark.index);
    const size_t lines = value->start_mark.line;
    const size_t blanks = value->start_mark.column;
    campaign *c = &o->campaign;
    char *cut = schema_alloc(self, lines + blanks + end - begin + 1, 1);
    if (!cut)
        return false;
    memset(cut, '\n', lines);
    memset(cut + lines, ' ', blanks);
    memcpy(cut + lines + blanks, text + begin, end - begin);
    c->text = cut;
    c->size = lines + blanks + end - begin;
    c->scenario_name = c->file;
    return true;
}

/* Takes a text over. */
static bool keep_text(campaign_owner *o, schema *self, char *text, size_t size)
{
    char *copy = text ? schema_alloc(self, size + 1, 1) : NULL;
    if (copy)
        memcpy(copy, text, size);
    free(text);
    o->campaign.text = copy;
    o->campaign.size = size;
    return copy;
}

/* Reads the text of a scenario, which is a file or a map. */
static bool campaign_read_text(campaign_owner *o, schema *self, const schema_key *key,
                               const yaml_node_t *value)
{
    size_t size = 0;
    if (value->type == YAML_MAPPING_NODE) {
        char *text = yaml_file_read(&size, o->campaign.file, false, self->errors);
        const bool good = text && cut_out(o, self, value, text, size);
        free(text);
        return good;
    }
    const char *name = schema_text(self, key, value, "a file, or the configuration itself");
    const char *slash = name && *name != '/' ? strrchr(o->campaign.file, '/') : NULL;
    if (!name)
        return false;
    o->campaign.scenario_name =
        slash ? schema_print(self, "%.*s/%s", (int)(slash - o->campaign.file), o->campaign.file,
                             name)
              : schema_copy(self, name);
    if (!o->campaign.scenario_name)
        return false;
    diag found = {.file.name = o->campaign.scenario_name};
    char *text = yaml_file_read(&size, o->campaign.scenario_name, true, &found);
    diag_flush(&found, o->errors);
    return keep_text(o, self, text, size);
}

/* Reads the configuration without any factor, for names of nodes and for early errors. */
static bool check_scenario(campaign_owner *o, schema *self)
{
    const campaign *c = &o->campaign;
    const cfg_file file = {.name = c->scenario_name, .text = c->text, .size = c->size};
    rig *several;
    const bool good = rig_load_either(&several, &o->config, &file, o->errors);
    for (size_t i = 0; several && i < several->bus_count; i++)
        ends_note(o, self, several->buses[i], false);
    if (o->config)
        ends_note(o, self, o->config, true);
    o->campaign.scenario_seed = o->config ? o->config->seed : 0;
    rig_free(several);
    return good;
}

/* Reads the scenario, as a whole and as a document: values are put into its text. */
static void read_scenario(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    diag found = {.file.name = o->campaign.file};
    if (!campaign_read_text(o, self, key, value) || !check_scenario(o, self)) {
        schema_complain(self, value, "%s: there are errors in the scenario", key->name);
        return;
    }
    o->has_document = yaml_text_load(&o->document, o->campaign.text, o->campaign.size,
                                     &yaml_file_limits, &found);
    diag_flush(&found, o->errors);
    if (!o->has_document)
        schema_complain(self, value, "%s: there are errors in the scenario", key->name);
}

/* ---- Other keys ------------------------------------------------------------------------------ */

/* Reads the end of each row. The buses of a rig need not agree in the length of a bit. */
static void read_until(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    const char *text = schema_text(self, key, value, "a time such as 100ms");
    if (!text)
        return;
    schema_problem(self, key, value, text_parse_time(&o->campaign.until_time, text));
    if (o->campaign.until_time.bits > 0 && o->has_document && !o->config)
        schema_complain(self, value, "%s: a rig has bits of several lengths; give a time such as "
                        "10ms", key->name);
    o->campaign.until = schema_copy(self, text);
}

/* Reads how much real time a row may take. */
static void read_limit(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    cfg_time limit = {.ns = 0};
    const char *text = schema_text(self, key, value, "a time such as 60s");
    if (!text)
        return;
    const char *wrong = text_parse_time(&limit, text);
    schema_problem(self, key, value, wrong);
    if (wrong)
        return;
    if (limit.bits > 0 || limit.ns < UINT64_C(1000000000) || limit.ns > UINT64_C(86400000000000))
        schema_expected(self, key, value, "a real time from 1s to 24h");
    o->campaign.limit_ms = (int64_t)(limit.ns / 1000000);
}

/* Reads which rows of the product are taken: a word, or a number with its kind. */
static void read_sample(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_choice words[] = {
        {.name = "full", .value = SAMPLE_FULL}, {.name = "pairwise", .value = SAMPLE_PAIRWISE},
        {.name = NULL}};
    campaign_owner *o = object;
    unsigned chosen = SAMPLE_FULL;
    if (value->type == YAML_SCALAR_NODE) {
        (void)schema_choose(self, &chosen, key, value, words);
        o->campaign.sample = (campaign_sample)chosen;
        return;
    }
    schema_map(self, "sample", value, sample_keys, &o->campaign);
    if (value->type != YAML_MAPPING_NODE)
        return;
    const bool random = schema_find(self, value, "random");
    o->campaign.sample = random ? SAMPLE_RANDOM : SAMPLE_LOW_DISCREPANCY;
    if (random == (schema_find(self, value, "low-discrepancy") != NULL))
        schema_complain(self, value, "sample: expected full, pairwise, { random: N } or "
                        "{ low-discrepancy: N }");
}

/* ---- Detection ------------------------------------------------------------------------------- */

static bool has_expectation(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->expect_count; i++)
        if (config->expects[i].name && strcmp(config->expects[i].name, name) == 0)
            return true;
    return false;
}

/* Reads names of expectations. Those of a rig are in the files of its buses. */
static void read_detected(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    campaign *c = &o->campaign;
    const size_t count = schema_count_one(self, key, value, 1, CAMPAIGN_DETECTED_MAX);
    c->detected = schema_alloc(self, count, sizeof *c->detected);
    for (size_t i = 0; i < count && c->detected; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        const char *name = schema_text(self, key, item, "the name of an expectation");
        if (name && o->config && !has_expectation(o->config, name))
            schema_complain(self, item, "%s: the scenario has no expectation with the name '%s'",
                            key->name, name);
        else if (name)
            c->detected[c->detected_count++] = schema_copy(self, name);
    }
}

/* Reads the fault-tolerant time interval: more than 0, and not in bits. */
static void read_ftti(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    cfg_time time = {.ns = 0};
    const char *text = schema_text(self, key, value, "a time such as 50ms");
    if (!text)
        return;
    schema_problem(self, key, value, text_parse_time(&time, text));
    if (time.bits > 0 || time.ns == 0)
        schema_expected(self, key, value, "a time such as 50ms, in units of seconds");
    o->campaign.ftti_ns = time.ns;
}

/* ---- The file -------------------------------------------------------------------------------- */

/* Reads the campaign, then checks what concerns several keys, as far as the keys are good. */
static void campaign_read_root(campaign_owner *o, diag *errors, yaml_document_t *document)
{
    schema self = {.errors = errors, .arena = &o->arena, .document = document, .user = o};
    yaml_node_t *root = yaml_document_get_root_node(document);
    if (!root) {
        diag_add(errors, 1, 1, "the file is empty; it needs the keys scenario and vary");
        return;
    }
    schema_map(&self, "campaign", root, campaign_file_keys, o);
    if (errors->errors == 0)
        ends_check(&self, root, o);
    if (errors->errors == 0)
        campaign_check_virtual(&self, root, o);
    yaml_node_t *list = schema_find(&self, root, "vary");
    const char *wrong = errors->errors == 0 ? sample_prepare(&o->campaign) : NULL;
    if (wrong)
        schema_complain(&self, root, "%s", wrong);
    else if (errors->errors == 0 && o->campaign.rows == 0)
        schema_complain(&self, root, "the campaign has no rows: all values are pruned");
    else if (errors->errors == 0)
        names_check_keys(&self, list, o);
}

/* Reads all keys of the file of the campaign. The document is gone afterwards; texts are copies. */
static bool campaign_read_file(campaign_owner *o, diag *errors)
{
    yaml_document_t document;
    size_t size = 0;
    char *text = yaml_file_read(&size, o->campaign.file, false, errors);
    const bool loaded = text && yaml_text_load(&document, text, size, &yaml_file_limits, errors);
    free(text);
    if (!loaded)
        return false;
    campaign_read_root(o, errors, &document);
    yaml_document_delete(&document);
    return errors->errors == 0;
}

campaign *campaign_load(const char *file, FILE *errors)
{
    diag found = {.file.name = file};
    campaign_owner *o = calloc(1, sizeof *o);
    if (!o) {
        fprintf(errors, "%s: out of memory\n", file);
        return NULL;
    }
    o->errors = errors;
    o->json_left = JSONVALUE_ALL_MAX;
    o->campaign.limit_ms = CAMPAIGN_LIMIT_MS;
    o->campaign.file = arena_print(&o->arena, "%s", file);
    if (!o->campaign.file)
        diag_add(&found, 0, 0, "out of memory");
    const bool good = o->campaign.file && campaign_read_file(o, &found);
    diag_flush(&found, errors);
    if (good)
        return &o->campaign;
    campaign_free(&o->campaign);
    return NULL;
}

void campaign_free(campaign *c)
{
    campaign_owner *o = (campaign_owner *)c;
    if (!o)
        return;
    if (o->has_document)
        yaml_document_delete(&o->document);
    cfg_free(o->config);
    free(c->pairs);
    arena_free(&o->arena);
    free(o);
}
