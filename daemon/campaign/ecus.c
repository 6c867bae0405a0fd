/* SPDX-License-Identifier: MIT
 *
 * ecus.c - reads the keys of a campaign that are about programs at nodes.
 */
#include "campaign/ecus.h"

#include "campaign/campaign_owner.h"
#include "trace/frametext.h"

#include <net/if.h>
#include <stdlib.h>
#include <string.h>

#define NAME_MAX_BYTES 64u
#define NS_PER_MS UINT64_C(1000000)
#define SECOND_NS UINT64_C(1000000000)

static schema_reader ecus_read_name, read_node, read_run, read_interface, read_env, read_cwd,
    read_after, read_ready, ecus_read_line, ecus_read_frame, read_within, read_grace, read_preload,
    read_bus;

static const schema_key ready_keys[] = {
    {.name = "line", .read = ecus_read_line, .type = TYPE_STRING,
     .help = "A part of a line of its output."},
    {.name = "frame", .read = ecus_read_frame, .type = "{'type': ['string', 'integer']}",
     .help = "A frame that its node sends: a filter as can-utils write it."},
    {.name = "within", .read = read_within, .type = "realTime",
     .help = "Real time from its start on; default 10s."},
    {.name = NULL,
     .type = "{'oneOf': [" TYPE_NEEDS("line") ", " TYPE_NEEDS("frame") "]}"},
};

const schema_key campaign_ecu_keys[] = {
    {.name = "node", .read = read_node, .type = TYPE_STRING,
     .help = "The node that the program is; it has no traffic of its own."},
    {.name = "name", .read = ecus_read_name,
     .type = "{'type': 'string', 'pattern': '^[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}$'}",
     .help = "Of its files, and in rows; by default that of the node."},
    {.name = "run", .read = read_run, .required = true,
     .type = TYPE_ANY("{'type': ['string', 'integer'], 'minLength': 1}" ", " TYPE_LIST(1, 256,
             "{'type': ['string', 'number'], 'minLength': 1}")),
     .help = "The command: a text for a shell, or a list of words."},
    {.name = "interface", .read = read_interface,
     .type = "{'type': 'string', 'pattern': '^[^/: \\t\\n,]{1,15}$'}",
     .help = "The name of the CAN interface for the program, such as can0; by default that of "
             "the node."},
    {.name = "env", .read = read_env,
     .type = "{'type': 'object', 'propertyNames': {'pattern': '^[A-Za-z_][A-Za-z0-9_]*$'}, "
             "'maxProperties': 255, 'additionalProperties': {'type': ['string', 'number', "
             "'boolean', 'null']}}",
     .help = "Variables of its environment."},
    {.name = "cwd", .read = read_cwd, .type = TYPE_STRING,
     .help = "The folder that it runs in; by default one of its own."},
    {.name = "after", .read = read_after, .type = TYPE_STRING,
     .help = "The name of a program before it in the list: it starts when that one is ready."},
    {.name = "ready", .read = read_ready, .map = ready_keys, .type = TYPE_ANY(TYPE_STRING ", @"),
     .help = "The sign that it is ready: a part of a line of its output, or a frame of its node. "
             "By default it is when it has been started."},
    {.name = "grace", .read = read_grace, .type = "realTime",
     .help = "Real time from SIGTERM to SIGKILL at the end; default 2s."},
    {.name = "preload", .read = read_preload, .type = "boolean",
     .help = "off: it speaks the protocol of ports by itself, and does not run under canwire "
             "run."},
    {.name = "bus", .read = read_bus, .type = "{'enum': ['canwired', 'own']}",
     .help = "own: the program is the bus by itself, with canwire.row() of Python; it has no "
             "node and must be the only program. canwired (the default): it is a node."},
    {.name = NULL,
     .type = "{'oneOf': [{'required': ['node'], 'properties': {'bus': {'const': 'canwired'}}}, "
             "{'required': ['bus'], 'properties': {'bus': {'const': 'own'}, 'node': false, "
             "'interface': false, 'after': false, 'ready': false, 'preload': false}}]}"},
};

/* ---- Names ----------------------------------------------------------------------------------- */

/* Reads the name of a program, which names its files. */
static void ecus_read_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                  "_.-";
    ecu *e = object;
    const char *text = schema_text(self, key, value, "a name");
    if (text && (*text == '.' || strlen(text) > NAME_MAX_BYTES ||
                 text[strspn(text, letters)] != '\0'))
        schema_expected(self, key, value,
                        "up to 64 letters, digits, '_', '.' and '-', no '.' in front");
    else if (text)
        e->name = schema_copy(self, text);
}

static const cfg_node *ecus_find_node(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (strcmp(config->nodes[i].name, name) == 0)
            return &config->nodes[i];
    return NULL;
}

/* Reads the node of a program. The program is its only source of traffic. */
static void read_node(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const campaign_owner *o = self->user;
    ecu *e = object;
    const char *text = schema_text(self, key, value, "the name of a node");
    if (!text || !o->config)
        return;
    const cfg_node *node = ecus_find_node(o->config, text);
    if (!node)
        schema_complain(self, value, "%s: the scenario has no node '%s'", key->name, text);
    else if (node->traffic_count > 0)
        schema_complain(self, value,
                        "%s: '%s' has traffic of its own in the scenario; a program takes its "
                        "place", key->name, text);
    e->node = schema_copy(self, text);
}

/* The name is one that the kernel takes. It also becomes a part of paths and of lists with commas,
 * so it has neither slash nor comma. */
static void read_interface(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    const char *text = schema_text(self, key, value, "the name of an interface, such as can0");
    if (text && (strlen(text) >= IF_NAMESIZE || strpbrk(text, "/: \t\n,")))
        schema_expected(self, key, value, "at most 15 characters, no '/', ':', ',' or blank");
    else if (text)
        e->interface = schema_copy(self, text);
}

/* A program waits for one before it in the list, so no two wait for each other. */
static void read_after(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const campaign_owner *o = self->user;
    const ecu_plan *plan = &o->campaign.ecus;
    ecu *e = object;
    const char *text = schema_text(self, key, value, "the name of a program");
    for (size_t i = 0; i < plan->count && text; i++)
        if (plan->list[i].name && strcmp(plan->list[i].name, text) == 0)
            e->after = &plan->list[i];
    if (text && !e->after)
        schema_expected(self, key, value, "the name of a program before this one");
}

/* ---- The program ----------------------------------------------------------------------------- */

/* Reads the words of a command, or the text of one. */
static void read_run(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "a command, or a list of its words";
    ecu *e = object;
    e->shell = value->type == YAML_SCALAR_NODE;
    const size_t count = schema_count_one(self, key, value, 1, ECU_WORDS_MAX);
    e->command = schema_alloc(self, count + 1, sizeof *e->command);
    for (size_t i = 0; i < count && e->command; i++) {
        const char *word = schema_text(self, key, schema_item(self, value, i), expected);
        e->command[i] = word ? schema_copy(self, word) : "";
    }
}

static bool is_variable(const char *name)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789";
    return *name && (*name < '0' || *name > '9') && name[strspn(name, letters)] == '\0';
}

/* Takes NAME: VALUE; a value may be empty. */
static const char *read_variable(schema *self, const schema_key *key, const yaml_node_t *name,
                                 const yaml_node_t *value)
{
    const char *text = schema_text(self, key, name, "the name of a variable");
    if (text && !is_variable(text))
        schema_expected(self, key, name, "letters, digits and '_', no digit in front");
    else if (text && value->type != YAML_SCALAR_NODE)
        schema_expected(self, key, value, "a text");
    else if (text)
        return schema_print(self, "%s=%s", text, (const char *)value->data.scalar.value);
    return "";
}

/* Reads the variables of a program, which are the last in its environment. */
static void read_env(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    yaml_node_t *text;
    const yaml_node_t *name;
    size_t count = 0;
    if (value->type != YAML_MAPPING_NODE) {
        schema_expected(self, key, value, "a map of variables, such as { SPEED: 5 }");
        return;
    }
    e->env = schema_alloc(self, ECU_WORDS_MAX + 1, sizeof *e->env);
    while (e->env && (name = schema_pair(self, &text, value, count)) && count < ECU_WORDS_MAX)
        e->env[count++] = read_variable(self, key, name, text);
    if (count == ECU_WORDS_MAX)
        schema_complain(self, value, "%s: at most %u variables", key->name, ECU_WORDS_MAX - 1);
}

static void read_cwd(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    const char *text = schema_text(self, key, value, "a folder");
    if (text)
        e->cwd = schema_copy(self, text);
}

/* A program with `off` speaks the protocol of ports by itself, outside of canwire run. */
static void read_preload(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    bool wanted = true;
    if (schema_choose_bool(self, &wanted, key, value))
        e->direct = !wanted;
}

/* A program is at a node of canwired, or it is the bus itself and needs no canwired. */
static void read_bus(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_choice words[] = {
        {.name = "canwired", .value = false}, {.name = "own", .value = true}, {.name = NULL}};
    ecu *e = object;
    unsigned chosen = false;
    if (schema_choose(self, &chosen, key, value, words))
        e->own_bus = chosen;
}

/* ---- Times ----------------------------------------------------------------------------------- */

/* Reads real time up to an hour. */
static void read_time(schema *self, const schema_key *key, const yaml_node_t *value, int64_t *ms)
{
    cfg_time time = {.ns = 0};
    const char *text = schema_text(self, key, value, "a time such as 2s");
    const char *wrong = text ? text_parse_time(&time, text) : NULL;
    schema_problem(self, key, value, wrong);
    if (!text || wrong)
        return;
    if (time.bits > 0 || time.ns > 3600 * SECOND_NS)
        schema_expected(self, key, value, "a real time from 0s to 1h");
    *ms = (int64_t)(time.ns / NS_PER_MS);
}

static void read_within(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    read_time(self, key, value, &e->ready_ms);
}

static void read_grace(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    read_time(self, key, value, &e->grace_ms);
}

/* ---- Ready ----------------------------------------------------------------------------------- */

/* A program is ready when its output has a line with this part. */
static void ecus_read_line(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    const char *text = schema_text(self, key, value, "a part of a line of its output");
    e->sign = ECU_SIGN_LINE;
    e->line = text ? schema_copy(self, text) : NULL;
}

/* A program is ready when its node has sent a frame that passes this filter. */
static void ecus_read_frame(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    ecu *e = object;
    unsigned count = 0;
    const char *text = schema_text(self, key, value, "a filter of frames, such as 123");
    e->sign = ECU_SIGN_FRAME;
    if (text)
        schema_problem(self, key, value, text_parse_filters(&e->filter, &count, 1, text));
}

/* Reads the sign that a program is ready: a line of its output, or a frame. */
static void read_ready(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    if (value->type != YAML_MAPPING_NODE) {
        ecus_read_line(self, key, value, object);
        return;
    }
    schema_map(self, key->name, value, ready_keys, object);
    if (!schema_find(self, value, "line") == !schema_find(self, value, "frame"))
        schema_complain(self, value, "%s: either 'line' or 'frame' is needed", key->name);
}

/* ---- The list -------------------------------------------------------------------------------- */

/* Returns true for names that would meet files of the row: NAME is a folder, NAME.log a file. */
static bool is_taken(const char *name)
{
    static const char *const files[] = {"canwired", "journal", "scenario.yaml", "result.yaml"};
    const size_t length = strlen(name);
    bool taken = *name == '.' || (length >= 4 && strcmp(name + length - 4, ".log") == 0);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        taken = taken || strcmp(files[i], name) == 0;
    return taken;
}

/* Checks that no other file of a row has the name. */
static void check_name(schema *self, const ecu_plan *plan, const yaml_node_t *item)
{
    const ecu *e = &plan->list[plan->count];
    if (e->name && is_taken(e->name))
        schema_complain(self, item, "'%s' is a name of files of a row; give the program another "
                        "'name'", e->name);
    for (size_t i = 0; i < plan->count && e->name; i++)
        if (plan->list[i].name && strcmp(plan->list[i].name, e->name) == 0)
            schema_complain(self, item, "two programs are called '%s'; give one of them a name",
                            e->name);
}

/* A program that is the bus has all nodes. It is ready at once, and alone. */
static void check_own(schema *self, const yaml_node_t *item, ecu *e, size_t count)
{
    static const char *const others[] = {"node", "interface", "after", "ready", "preload"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (schema_find(self, item, others[i]))
            schema_complain(self, item, "%s: with 'bus: own' the program is all nodes; leave it "
                            "out", others[i]);
    if (count > 1)
        schema_complain(self, item, "bus: with 'own' the program must be the only one");
    e->direct = true;
    if (!e->name)
        e->name = "program";
}

/* Each program has a node, except one that is the bus itself. */
static void check_program(schema *self, const yaml_node_t *item, ecu *e, size_t count)
{
    if (item->type != YAML_MAPPING_NODE)
        return;
    if (e->own_bus)
        check_own(self, item, e, count);
    else if (!schema_find(self, item, "node"))
        schema_complain(self, item, "ecu: 'node' is missing; only with 'bus: own' there is none");
}

/* Reads the programs. A name that is missing is that of the node. */
void campaign_read_ecus(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    ecu_plan *plan = &o->campaign.ecus;
    const size_t count = schema_count_one(self, key, value, 1, ECUS_MAX);
    if (o->has_document && !o->config) {
        schema_complain(self, value, "%s: the scenario is a rig; programs need the file of a bus",
                        key->name);
        return;
    }
    for (size_t i = 0; i < count; i++, plan->count++) {
        const yaml_node_t *item = schema_item(self, value, i);
        ecu *e = &plan->list[i];
        *e = (ecu){.ready_ms = ECU_READY_MS, .grace_ms = ECU_GRACE_MS};
        schema_map(self, key->name, schema_item(self, value, i), campaign_ecu_keys, e);
        check_program(self, item, e, count);
        plan->own_bus = plan->own_bus || e->own_bus;
        if (!e->name)
            e->name = e->node;
        check_name(self, plan, item);
        if (e->direct && e->interface)
            schema_complain(self, item, "interface: a program with 'preload: off' has none; it "
                            "finds its port in CANWIRE_PORT");
    }
}

/* Programs of a row have a network namespace of their own, unless they need that of the host. */
void campaign_read_network(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_choice words[] = {
        {.name = "own", .value = false}, {.name = "host", .value = true}, {.name = NULL}};
    campaign_owner *o = object;
    unsigned chosen = false;
    if (schema_choose(self, &chosen, key, value, words))
        o->campaign.ecus.host_network = chosen;
}

unsigned ecus_virtual(const ecu_plan *plan)
{
    unsigned count = 0;
    for (size_t i = 0; i < plan->count && plan->virtual_time; i++)
        count += !plan->list[i].direct;
    return count;
}

/* Virtual time needs a program under canwire run: others read the clocks of the kernel. */
void campaign_read_virtual(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    ecu_plan *plan = &o->campaign.ecus;
    if (schema_choose_bool(self, &plan->virtual_time, key, value) && plan->virtual_time &&
        ecus_virtual(plan) == 0)
        schema_complain(self, value, "%s: no program in 'ecu' runs under canwire run", key->name);
}

void campaign_check_virtual(schema *self, yaml_node_t *root, const campaign_owner *o)
{
    const ecu_plan *plan = &o->campaign.ecus;
    if (plan->count > 0 && !plan->virtual_time && o->config->pacing == CFG_PACING_VIRTUAL)
        schema_complain(self, schema_find(self, root, "ecu"),
                        "ecu: the scenario has 'pacing: virtual'; leave that out, and give "
                        "'virtual: on' beside 'ecu'");
}

int64_t ecus_grace_ms(const ecu_plan *plan)
{
    int64_t sum = 0;
    for (size_t i = 0; i < plan->count; i++)
        sum += plan->list[i].grace_ms;
    return sum;
}
