/* SPDX-License-Identifier: MIT
 *
 * profile.c - fault rules from other sources: profiles with parameters, and texts to inject.
 *
 * A profile is a map of `parameters` (name: default, or nothing) and `faults`. In any text of
 * `faults`, $NAME or ${NAME} stands for a parameter, and $$ for a dollar.
 */
#include "base/text/yamlfile.h"
#include "config/parts.h"
#include "config/profilefile.h"
#include "config/source.h"
#include "config/values.h"

#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define PROFILES_MAX 100u         /* that one configuration loads */
#define PARAMETERS_MAX 64u        /* of one profile */
#define PARAMETER_NAME_MAX 32u    /* bytes */
#define PARAMETER_VALUE_MAX 256u  /* bytes */
#define EXPANDED_MAX 1024u        /* bytes of a text after all parameters have their values */
#define LAST_FILE SIZE_MAX        /* sorts a message behind those of all files */
#define ALONE_BITRATE_BPS 500000u /* converts bits to time without a bus */

#define PARAMETER_LETTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
#define PARAMETER_CHARACTERS PARAMETER_LETTERS "0123456789_-"

typedef struct parameter {
    const char *name;
    const char *value; /* NULL: none */
    const yaml_node_t *at;
} parameter;

typedef struct parameters {
    size_t count;
    parameter list[PARAMETERS_MAX];
} parameters;

/* A profile, as read from its file. */
typedef struct profile {
    parameters declared;
    parameters given; /* by the `with` of the profile itself */
    yaml_node_t *faults;
} profile;

/* One item of `profiles`. */
typedef struct item {
    const char *file;
    const char *prefix;
    parameters given;
} item;

/* The owner of rules; cfg_load_rules() returns its first member. */
typedef struct rules_owner {
    cfg_rules rules;
    arena arena;
} rules_owner;

static schema_reader read_file_name, read_prefix, read_parameters, read_value, read_about,
    read_about_text, read_faults;

static const schema_key about_keys[] = {
    {.name = "name", .read = read_about_text, .type = "text",
     .help = "What users call it."},
    {.name = "description", .read = read_about_text, .type = "text",
     .help = "One sentence."},
    {.name = NULL},
};

const schema_key cfg_profile_use_keys[] = {
    {.name = "file", .read = read_file_name, .required = true, .type = "text",
     .help = "The profile: a file, with or without `.yaml`. A path is relative to this file. A "
             "name without `/` is looked for beside this file, in `profiles/` there, and then in "
             "`share/canwire/profiles` of the installation, of `/usr/local` and of `/usr`. So is "
             "`profiles/NAME`. `canwire check` and `canwire inject` look in the same way, from the "
             "current folder; `inject` then looks beside the configuration of the bus."},
    {.name = "with", .read = read_parameters, .offset = offsetof(item, given),
     .type = "parameterValues",
     .help = "A map NAME: VALUE of its parameters, which are otherwise their defaults; unknown or "
             "missing ones are errors."},
    {.name = "as", .read = read_prefix, .type = "name",
     .help = "Its rules are named PREFIX.RULE; needed where names would clash, as when a profile "
             "is loaded twice."},
    {.name = NULL},
};

/* Only a text that is injected has `with`: nothing else gives it values. */
const schema_key cfg_profile_keys[] = {
    {.name = "profile", .read = read_about, .map = about_keys,
     .help = "About the profile."},
    {.name = "parameters", .read = read_parameters, .offset = offsetof(profile, declared),
     .type = "parameterValues",
     .help = "Parameters and their defaults; without value one must be given in 'with'. In the "
             "rules $NAME or ${NAME} stands for them, $$ for a dollar."},
    {.name = "with", .read = read_parameters, .offset = offsetof(profile, given),
     .where = CFG_IN_INJECTED},
    {.name = "faults", .read = read_faults, .required = true, .map = cfg_rule_keys, .as = "rule",
     .type = TYPE_LIST_UP_TO(1024, "@"),
     .help = "Fault rules."},
    {.name = NULL},
};

static const schema_key rules_key = {.name = "faults"};

static const char open_text[] = {SCHEMA_OPEN, '\0'};

static void load_item(schema *self, yaml_node_t *value, size_t number);
static void bind(schema *self, parameters *declared, const parameters *given,
                 const yaml_node_t *at);
static void expand_faults(schema *self, const yaml_node_t *root, yaml_node_t *faults,
                          const parameters *known);
static bool profile_read_text(rules_owner *owner, cfg_walk *walk, diag *errors, const char *text,
                              size_t size);
static bool put_in_order(rules_owner *owner, const cfg_walk *walk, diag *errors);

bool cfg_is_profile(schema *self, const yaml_node_t *root)
{
    if (root->type != YAML_MAPPING_NODE || schema_find(self, root, "bus") ||
        schema_find(self, root, "nodes"))
        return false;
    return schema_find(self, root, "faults") || schema_find(self, root, "parameters") ||
           schema_find(self, root, "profile");
}

/* Loads profiles in their order, which is that of their rules. */
void cfg_read_profiles(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    size_t count = schema_count(self, key, value, 0, PROFILES_MAX);

    (void)object;
    for (size_t i = 0; i < count; i++)
        load_item(self, schema_item(self, value, i), i + 1);
}

/* Sets a bit rate and makes room for nodes: a profile alone has neither. */
static bool prepare_alone(schema *self, cfg *config)
{
    config->rate = cw_rate_of(CW_CLOCK_HZ / ALONE_BITRATE_BPS);
    config->nodes = schema_alloc(self, CW_NODES_MAX, sizeof *config->nodes);
    return config->nodes != NULL;
}

void cfg_read_profile(schema *self, yaml_node_t *root)
{
    const cfg_walk *walk = self->user;
    profile *found = schema_alloc(self, 1, sizeof *found);

    if (!found || (walk->any_node && !prepare_alone(self, walk->config)))
        return;
    schema_map_in(self, "profile", root, cfg_profile_keys,
                  walk->any_node ? CFG_IN_PROFILES : CFG_IN_INJECTED, found);
    bind(self, &found->declared, &found->given, root);
    if (!found->faults)
        return;
    expand_faults(self, root, found->faults, &found->declared);
    cfg_read_rules(self, &rules_key, found->faults);
}

cfg_rules *cfg_load_rules(const char *text, size_t size, const char *name, const cfg *config,
                          const cfg_running *running, FILE *errors)
{
    diag found = {.file.name = name};
    cfg scratch = *config;
    const char *names[CW_RULES_MAX];
    cfg_running own = {.count = config->rule_count, .names = names};
    cfg_walk walk = {.config = &scratch, .running = running ? running : &own};
    rules_owner *owner = calloc(1, sizeof *owner);

    for (size_t i = 0; i < own.count; i++)
        names[i] = config->rules[i].name;
    scratch.rule_count = 0;
    scratch.rules = NULL;
    if (!owner)
        diag_add(&found, 0, 0, "out of memory");
    else if (profile_read_text(owner, &walk, &found, text, size) &&
             cfg_keep_warnings(&owner->rules.warnings, &owner->arena, &found))
        return &owner->rules;
    diag_flush(&found, errors);
    cfg_free_rules(owner ? &owner->rules : NULL);
    return NULL;
}

void cfg_free_rules(cfg_rules *rules)
{
    if (!rules)
        return;
    rules_owner *owner = (rules_owner *)rules;
    arena_free(&owner->arena);
    free(owner);
}

/* Finds the file of a profile, or what is in its place. Returns the path beside the configuration
 * when there is none. */
static const char *find_profile(schema *self, const profilefile *wanted)
{
    char path[PATH_MAX];

    for (int any = 0; any < 2; any++)
        for (unsigned i = 0; profilefile_place(path, wanted, i); i++)
            if (cfg_has_file(self, path, any))
                return schema_copy(self, path);
    return cfg_resolve_path(self, wanted->beside[0], wanted->name);
}

/* Complains about a profile that was not found, with all folders that were searched. */
static void complain_absent(schema *self, const yaml_node_t *value, const profilefile *wanted)
{
    char folders[PROFILEFILE_LIST_BYTES];

    profilefile_list(folders, wanted);
    schema_complain(self, value, "profiles: there is no %s in %s", wanted->name, folders);
}

/* Reads a profile's name, which is looked for in known folders, or its path. */
static void read_file_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    item *wanted = object;
    const char *text = schema_text(self, key, value, "the name of a profile, or its path");

    if (!text)
        return;
    const profilefile file = {.name = text, .beside = {cfg_of(self)->file}};
    wanted->file = find_profile(self, &file);
    if (wanted->file && profilefile_is_name(text) && !cfg_has_file(self, wanted->file, true)) {
        complain_absent(self, value, &file);
        wanted->file = NULL;
    }
}

static void read_prefix(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    item *wanted = object;

    wanted->prefix = cfg_read_name(self, key, value, NODE_NAME_MAX);
}

/* The first character is a letter, so that $1 and the like stay errors. */
static bool parameter_name_valid(const char *name)
{
    size_t length = strlen(name);

    return length <= PARAMETER_NAME_MAX && strspn(name, PARAMETER_LETTERS) > 0 &&
           strspn(name, PARAMETER_CHARACTERS) == length;
}

static parameter *find_parameter(parameters *all, const char *name)
{
    for (size_t i = 0; i < all->count; i++)
        if (strcmp(all->list[i].name, name) == 0)
            return &all->list[i];
    return NULL;
}

/* A parameter without a value, or with null, has no default. It must be given then. */
static void read_value(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    parameter *found = object;

    if (schema_is_null(value))
        return;
    const char *text = schema_text(self, key, value, "a single value");
    if (text && strlen(text) > PARAMETER_VALUE_MAX)
        schema_complain(self, value, "%s: a parameter has at most %u bytes", key->name,
                        PARAMETER_VALUE_MAX);
    else if (text)
        found->value = schema_copy(self, text);
}

/* Adds a parameter. The name is NULL without memory, which has been reported. */
static void add_parameter(schema *self, yaml_node_t *at, yaml_node_t *value, parameters *all,
                          const char *name)
{
    if (!name)
        return;
    schema_key own = {.name = name};
    parameter *added = &all->list[all->count++];

    *added = (parameter){.name = name, .at = at};
    read_value(self, &own, value, added);
}

/* Reads a parameter of a profile, with its default. */
static void read_parameter(schema *self, const schema_key *key, yaml_node_t *name,
                           yaml_node_t *value, parameters *all)
{
    const char *text = schema_text(self, key, name, "the name of a parameter");

    if (!text)
        return;
    if (!parameter_name_valid(text))
        schema_complain(self, name,
                        "%s: the name of a parameter is a letter, then letters, digits, '_' or "
                        "'-', at most %u in all, not '%.40s'",
                        key->name, PARAMETER_NAME_MAX, text);
    else if (find_parameter(all, text))
        schema_complain(self, name, "%s: duplicate parameter '%s'", key->name, text);
    else if (all->count == PARAMETERS_MAX)
        schema_complain(self, name, "%s: these are more than %u parameters", key->name,
                        PARAMETERS_MAX);
    else
        add_parameter(self, name, value, all, schema_copy(self, text));
}

/* Reads a map of names and values; null is an empty one. */
static void read_parameters(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    parameters *all = schema_member(key, object);
    yaml_node_t *name;
    yaml_node_t *of_name;

    if (schema_is_null(value))
        return;
    if (value->type != YAML_MAPPING_NODE) {
        schema_expected(self, key, value, "a map of parameters such as { victim: engine }");
        return;
    }
    for (size_t i = 0; !self->errors->overflow; i++) {
        name = schema_pair(self, &of_name, value, i);
        if (!name)
            return;
        read_parameter(self, key, name, of_name, all);
    }
}

static void read_about(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, about_keys, object);
}

static void read_about_text(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    (void)object;
    schema_text(self, key, value, "a text");
}

/* Keeps the rules until the parameters have values. */
static void read_faults(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    profile *found = object;

    if (value->type == YAML_SEQUENCE_NODE)
        found->faults = value;
    else
        schema_expected(self, key, value, "a list");
}

/* Complains about a parameter that the profile does not declare. */
static void complain_unknown(schema *self, const parameters *declared, const parameter *given)
{
    nearest guess = {.word = given->name};
    const char *list = "";

    for (size_t i = 0; i < declared->count; i++) {
        nearest_consider(&guess, declared->list[i].name);
        list = schema_join(self, list, declared->list[i].name);
    }
    schema_complain(self, given->at, "with: the profile has no parameter '%s'%s", given->name,
                    schema_allowed(self, &guess, *list ? list : "none"));
}

/* Gives the parameters their values; a missing one is reported at `at`. */
static void bind(schema *self, parameters *declared, const parameters *given, const yaml_node_t *at)
{
    const cfg_walk *walk = self->user;

    for (size_t i = 0; i < given->count; i++) {
        parameter *known = find_parameter(declared, given->list[i].name);

        if (!known)
            complain_unknown(self, declared, &given->list[i]);
        else if (given->list[i].value)
            known->value = given->list[i].value;
    }
    for (size_t i = 0; i < declared->count && !walk->any_node; i++)
        if (!declared->list[i].value)
            schema_complain(self, at, "with: the parameter '%s' of the profile needs a value",
                            declared->list[i].name);
}

/* Complains about a file that has no rules, or is a whole configuration. */
static bool check_profile(schema *self, const yaml_node_t *root)
{
    if (cfg_is_profile(self, root))
        return true;
    schema_complain(self, root, "this is no fault profile: it has no 'faults', or it has a bus");
    return false;
}

/* Reads the rules of a profile, whose document is loaded, into the configuration. */
static void read_document(schema *config, schema *self, const item *wanted, const yaml_node_t *at,
                          size_t number)
{
    yaml_node_t *root = yaml_document_get_root_node(self->document);
    profile *found = schema_alloc(self, 1, sizeof *found);

    if (!root)
        diag_add(self->errors, 1, 1, "the file is empty; a profile needs the key faults");
    if (!found || !root || !check_profile(self, root))
        return;
    schema_map_in(self, "profile", root, cfg_profile_keys, CFG_IN_PROFILES, found);
    diag_file inner = diag_enter(self->errors, cfg_of(self)->file, 0);
    bind(config, &found->declared, &wanted->given, at);
    diag_enter(self->errors, inner.name, number);
    if (!found->faults)
        return;
    expand_faults(self, root, found->faults, &found->declared);
    cfg_read_rules(self, &rules_key, found->faults);
}

/* Loads a profile. Its errors are reported under its own name. The file of the configuration gets
 * one error, too, behind all others: the first line, which may be all that is shown, has a
 * reason. */
static void load_profile(schema *config, const item *wanted, const yaml_node_t *at, size_t number)
{
    yaml_document_t document;
    cfg_walk walk = *(const cfg_walk *)config->user;
    schema self = *config;
    diag *errors = config->errors;
    diag_file outer = diag_enter(errors, wanted->file, number);
    size_t before = errors->count;

    walk.prefix = wanted->prefix;
    walk.first_rule = walk.config->rule_count;
    self.user = &walk;
    self.document = &document;
    if (cfg_load_file(&self, &document, wanted->file)) {
        read_document(config, &self, wanted, at, number);
        yaml_document_delete(&document);
    }
    bool bad = false;
    for (size_t i = before; i < errors->count; i++)
        bad = bad || (errors->messages[i].file.number == number && !errors->messages[i].warning);
    diag_enter(errors, outer.name, LAST_FILE);
    if (bad)
        schema_complain(config, at, "profiles: there are errors in %s", wanted->file);
    diag_enter(errors, outer.name, outer.number);
}

/* Loads the profile of one item. Without a file there has been a complaint. */
static void load_item(schema *self, yaml_node_t *value, size_t number)
{
    item *wanted = schema_alloc(self, 1, sizeof *wanted);

    if (!wanted)
        return;
    schema_map(self, "profiles", value, cfg_profile_use_keys, wanted);
    if (wanted->file)
        load_profile(self, wanted, value, number);
}

/* Returns the length of the name after a '$', 0 without a name; *text then points behind it. */
static size_t take_name(const char **name, const char **text)
{
    bool braces = **text == '{';
    const char *begin = *text + braces;
    size_t length = strspn(begin, PARAMETER_CHARACTERS);

    if (braces && begin[length] != '}')
        return 0;
    *name = begin;
    *text = begin + length + braces;
    return length;
}

/* Returns the value of the parameter that is named after a '$'; NULL after a complaint. */
static const char *take_parameter(schema *self, const yaml_node_t *at, const parameters *known,
                                  const char **text)
{
    const char *name;
    size_t length = take_name(&name, text);
    nearest guess = {.word = ""};

    if (length == 0) {
        schema_complain(self, at,
                        "'$' begins a parameter, $NAME or ${NAME}; $$ stands for a dollar");
        return NULL;
    }
    for (size_t i = 0; i < known->count; i++)
        if (strncmp(known->list[i].name, name, length) == 0 && !known->list[i].name[length])
            return known->list[i].value ? known->list[i].value : open_text;
    guess.word = schema_print(self, "%.*s", (int)length, name);
    if (!guess.word)
        return NULL;
    for (size_t i = 0; i < known->count; i++)
        nearest_consider(&guess, known->list[i].name);
    schema_complain(self, at, "there is no parameter '%.40s'%s", guess.word,
                    schema_suggestion(self, &guess));
    return NULL;
}

/* Replaces the parameters in a text by their values. Returns false after a complaint. *open: a
 * parameter has no value yet. */
static bool expand(schema *self, char out[EXPANDED_MAX + 1], bool *open, const yaml_node_t *at,
                   const parameters *known, const char *text)
{
    size_t length = 0;
    unsigned pieces = 0; /* limits the work: empty values make no text longer */

    while (*text) {
        size_t plain = strcspn(text, "$");
        const char *piece = text;

        text += plain;
        if (plain == 0 && text[1] == '$') {
            plain = 1;
            text += 2;
        } else if (plain == 0) {
            text++;
            piece = take_parameter(self, at, known, &text);
            if (!piece)
                return false;
            plain = strlen(piece);
            *open = *open || *piece == SCHEMA_OPEN;
        }
        if (plain > EXPANDED_MAX - length || ++pieces > EXPANDED_MAX) {
            schema_complain(self, at, "a text with parameters has at most %u bytes", EXPANDED_MAX);
            return false;
        }
        memcpy(out + length, piece, plain);
        length += plain;
    }
    out[length] = '\0';
    return true;
}

/* Gives a scalar a new text, in memory that libyaml frees with free(). */
static void replace(schema *self, yaml_node_t *node, const char *text)
{
    size_t length = strlen(text);
    yaml_char_t *value = realloc(node->data.scalar.value, length + 1);

    if (!value) {
        diag_add(self->errors, 0, 0, "out of memory");
        return;
    }
    memcpy(value, text, length + 1);
    node->data.scalar.value = value;
    node->data.scalar.length = length;
}

/* Replaces parameters in a text by their values. A text with one that is not known stays open. */
static void expand_node(schema *self, yaml_node_t *node, const parameters *known)
{
    const char *text = (const char *)node->data.scalar.value;
    bool open = false;

    if (!strchr(text, '$'))
        return;
    char expanded[EXPANDED_MAX + 1];
    bool good = expand(self, expanded, &open, node, known, text);
    /* A text that could not be expanded has been reported; its reader need not complain again. */
    open = open || !good;
    self->has_open = self->has_open || open;
    replace(self, node, open ? open_text : expanded);
}

/* Expands the texts of the faults, whose nodes are consecutive: libyaml stores nodes in the order
 * of the text. The nodes of `faults` end where the next key of the root begins. */
static void expand_faults(schema *self, const yaml_node_t *root, yaml_node_t *faults,
                          const parameters *known)
{
    const yaml_node_t *end = self->document->nodes.top;
    yaml_node_t *value;
    const yaml_node_t *key;

    for (size_t i = 0; (key = schema_pair(self, &value, root, i)) != NULL; i++)
        if (key > faults && key < end)
            end = key;
    for (yaml_node_t *node = faults; node < end; node++)
        if (node->type == YAML_SCALAR_NODE)
            expand_node(self, node, known);
}

/* Reads a rule, a list of rules, or a map that contains the rules. */
static void profile_read_root(schema *self, yaml_node_t *root)
{
    bool map = root->type == YAML_MAPPING_NODE;

    if (cfg_is_profile(self, root))
        cfg_read_profile(self, root);
    else if (root->type == YAML_SEQUENCE_NODE || (map && schema_find(self, root, "name")))
        cfg_read_rules(self, &rules_key, root);
    else
        schema_complain(self, root,
                        "expected a rule ({ name, when, do }), a list of rules, or a profile");
}

static bool profile_read_text(rules_owner *owner, cfg_walk *walk, diag *errors, const char *text,
                              size_t size)
{
    return cfg_read_text(&owner->arena, walk, errors, text, size, profile_read_root,
                         "there is no rule") &&
           put_in_order(owner, walk, errors);
}

/* Moves a rule behind the placed ones; from then on `after` counts by places. */
static void place(rules_owner *owner, const cfg_walk *walk, uint16_t *places, size_t rule)
{
    cw_rule *placed = &owner->rules.rules[owner->rules.count];
    size_t running = walk->running->count;

    *placed = walk->config->rules[rule];
    if (placed->has_after && placed->after >= running)
        placed->after = (uint16_t)(running + places[placed->after - running]);
    places[rule] = (uint16_t)owner->rules.count++;
}

/* Puts rules behind the rules that they name; the others keep the order of the text. */
static bool put_in_order(rules_owner *owner, const cfg_walk *walk, diag *errors)
{
    size_t count = walk->config->rule_count;
    size_t running = walk->running->count;
    const cw_rule *rules = walk->config->rules;
    uint16_t places[CW_RULES_MAX];
    bool placed;

    owner->rules.rules = arena_alloc(&owner->arena, (count + 1) * sizeof *rules);
    if (!owner->rules.rules) {
        diag_add(errors, 0, 0, "out of memory");
        return false;
    }
    memset(places, 0xFF, sizeof places);
    do {
        placed = false;
        for (size_t i = 0; i < count; i++) {
            bool waits = rules[i].has_after && rules[i].after >= running &&
                         places[rules[i].after - running] == UINT16_MAX;
            if (places[i] != UINT16_MAX || waits)
                continue;
            place(owner, walk, places, i);
            placed = true;
        }
    } while (placed);
    if (owner->rules.count < count)
        diag_add(errors, 0, 0,
                 "there are rules that come after each other in a circle; a running "
                 "bus cannot take them");
    return owner->rules.count == count;
}
