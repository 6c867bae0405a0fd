/* SPDX-License-Identifier: MIT
 *
 * controller.c - the part of a node's controller that its host sees: filters and buffers.
 */
#include "config/parts.h"

#include "base/nearest.h"
#include "config/values.h"
#include "config/walk.h"
#include "trace/frametext.h"

#include <string.h>

/* One of the buffers takes the frame on the wire. The others hold frames that the host has not
 * fetched. */
#define BUFFERS_DEFAULT 2u

static const schema_range buffers_range = {2, CW_RECEIVE_BUFFERS_MAX + 1, sizeof(uint32_t)};

/* Keys of a model. */
#define HAS_BUFFERS 1u   /* receive-buffers */
#define HAS_SERVICE 2u   /* service-time */
#define HAS_OVERLOAD 4u  /* overload-when-full */
#define HAS_MAILBOXES 8u /* mailboxes, transmit */

#define MAILBOXES_DEFAULT 16u
#define MODEL_NAMES "queue, basic, full"

static const struct {
    const char *name;
    cfg_model model;
    unsigned keys;
    const char *why; /* for what its controller has no keys */
} models[] = {
    {"queue", CFG_MODEL_QUEUE, 0, "its host takes each frame at once"},
    {"basic", CFG_MODEL_BASIC, HAS_BUFFERS | HAS_SERVICE | HAS_OVERLOAD,
     "it has buffers and no mailboxes"},
    {"full", CFG_MODEL_FULL, HAS_SERVICE | HAS_MAILBOXES, "it has mailboxes, which are never full"},
};

static const schema_choice transmits[] = {
    {.name = "priority", .value = CW_TRANSMIT_PRIORITY},
    {.name = "number", .value = CW_TRANSMIT_NUMBER},
    {.name = "request", .value = CW_TRANSMIT_REQUEST},
    {.name = NULL},
};

static schema_reader read_model_name;

/* Ways in which a controller is not as others, their CW_VARIANT_*. They are there with `off`. */
static const uint8_t no_high_ids = CW_VARIANT_NO_HIGH_IDS;
static const uint8_t no_long_dlc = CW_VARIANT_NO_LONG_DLC;
static const uint8_t rec_holds = CW_VARIANT_REC_HOLDS;
static const uint8_t silent_passive = CW_VARIANT_SILENT_PASSIVE;

static schema_reader read_variant;

#define MEMBER(member) .offset = offsetof(cfg_node, controller.member)
/* The model comes first: the other keys change what it says. */
static const schema_key model_keys[] = {
    {.name = "model", .read = read_model_name},
    {.name = "receive-buffers", .read = schema_read_uint, MEMBER(receive_buffers),
     .arg = &buffers_range},
    {.name = "service-time", .read = cfg_read_ticks_min, MEMBER(service_ticks)},
    {.name = "overload-when-full", .read = schema_read_bool, MEMBER(overload_when_full)},
    {.name = "mailboxes", .read = cfg_read_mailboxes},
    {.name = "transmit", .read = schema_read_choice, MEMBER(transmit), .arg = transmits},
    {.name = "high-identifiers", .read = read_variant, .arg = &no_high_ids},
    {.name = "dlc-over-8", .read = read_variant, .arg = &no_long_dlc},
    {.name = "rec-when-passive", .read = read_variant, .arg = &rec_holds},
    {.name = "report-passive", .read = read_variant, .arg = &silent_passive},
    {.name = NULL},
};

static const unsigned keys_of[] = {0, HAS_BUFFERS, HAS_SERVICE, HAS_OVERLOAD, HAS_MAILBOXES,
                                   HAS_MAILBOXES};

/* ---- Models ---------------------------------------------------------------------------------- */

const char *cfg_model_name(cfg_model model)
{
    return models[model].name;
}

static void read_model_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_controller *controller = &((cfg_node *)object)->controller;
    const char *text = schema_text(self, key, value, "one of " MODEL_NAMES);

    if (!text)
        return;
    for (size_t i = 0; i < sizeof models / sizeof models[0]; i++) {
        if (strcmp(models[i].name, text) != 0)
            continue;
        controller->model = models[i].model;
        if (controller->model == CFG_MODEL_FULL)
            cfg_add_mailboxes(self, controller, MAILBOXES_DEFAULT / 2, MAILBOXES_DEFAULT / 2);
        return;
    }
    schema_expected(self, key, value, "one of " MODEL_NAMES);
}

/* Complains about keys that the model does not have. */
static void check_keys(schema *self, const yaml_node_t *map, cfg_model model)
{
    for (size_t i = 1; i < sizeof keys_of / sizeof keys_of[0]; i++) {
        const yaml_node_t *const value = schema_find(self, map, model_keys[i].name);
        if (value && !(models[model].keys & keys_of[i]))
            schema_complain(self, value, "%s: a controller with `model: %s` has none; %s",
                            model_keys[i].name, models[model].name, models[model].why);
    }
}

/* Leaves the filters, which have a key of their own. */
static void forget_model(cfg_controller *controller)
{
    *controller = (cfg_controller){.receive_buffers = BUFFERS_DEFAULT,
                                   .filter_count = controller->filter_count,
                                   .filters = controller->filters};
}

static void read_variant(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint8_t *const variants = &((cfg_node *)object)->controller.variants;
    const uint8_t variant = *(const uint8_t *)key->arg;
    bool usual = true;

    (void)schema_choose_bool(self, &usual, key, value);
    *variants = (uint8_t)(usual ? *variants & ~variant : *variants | variant);
}

static void read_model(schema *self, const schema_key *key, yaml_node_t *value, cfg_node *node)
{
    forget_model(&node->controller);
    schema_map(self, key->name, value, model_keys, node);
    check_keys(self, value, node->controller.model);
}

/* The frames of a node wait for its transmit buffer, or its mailboxes, in the order in which its
 * host writes them. The configuration may say another order for mailboxes. */
static void complete_order(schema *self, yaml_node_t *map, cfg_node *node)
{
    const cfg_walk *walk = self->user;
    const yaml_node_t *const own = schema_find(self, map, "order");
    const bool basic = node->controller.model == CFG_MODEL_BASIC;

    if (basic && own && node->order != CW_ORDER_FIFO)
        schema_complain(self, own, "order: a basic controller has one transmit buffer, so "
                        "its frames go in the order in which its host writes them: fifo");
    if (basic || (!own && !(walk->default_map && schema_find(self, walk->default_map, "order"))))
        node->order = CW_ORDER_FIFO;
}

void cfg_complete_controllers(schema *self, yaml_node_t *nodes)
{
    cfg *config = cfg_of(self);

    for (size_t i = 0; i < config->node_count; i++)
        if (config->nodes[i].controller.model != CFG_MODEL_QUEUE)
            complete_order(self, schema_item(self, nodes, i), &config->nodes[i]);
}

/* ---- The name of a real one ------------------------------------------------------------------ */

static void read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                      cfg_node *node)
{
    const char *text = schema_text(self, key, value, "a controller such as sja1000, or a map");
    const timing_limits *found = text ? timing_controller(text) : NULL;
    nearest guess = {.word = text};
    const char *list = "";
    size_t count;
    const timing_limits *all = timing_controllers(&count);

    forget_model(&node->controller);
    if (found)
        node->time.limits = found;
    if (!text || found)
        return;
    for (size_t i = 0; i < count; i++) {
        nearest_consider(&guess, all[i].name);
        list = schema_join(self, list, all[i].name);
    }
    schema_complain(self, value, "%s: there is no controller '%.40s'%s; allowed: %s", key->name,
                    text, schema_suggestion(self, &guess), list);
}

bool cfg_is_model(const char *key, const yaml_node_t *value)
{
    return strcmp(key, "controller") == 0 && value->type == YAML_MAPPING_NODE;
}

void cfg_read_controller(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    if (value->type == YAML_MAPPING_NODE)
        read_model(self, key, value, object);
    else
        read_name(self, key, value, object);
}

/* ---- Filters --------------------------------------------------------------------------------- */

static void read_filter(schema *self, const schema_key *key, const yaml_node_t *value,
                        cfg_controller *controller)
{
    const char *text = schema_text(self, key, value, "a frame filter such as 123 or 100:700");
    unsigned more = 0;

    if (!text)
        return;
    schema_problem(self, key, value,
                   text_parse_filters(&controller->filters[controller->filter_count], &more,
                                      CW_NODE_FILTERS_MAX - controller->filter_count, text));
    controller->filter_count = (uint16_t)(controller->filter_count + more);
}

void cfg_read_acceptance(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_controller *controller = &((cfg_node *)object)->controller;
    const size_t count = schema_count_one(self, key, value, 1, CW_NODE_FILTERS_MAX);

    controller->filter_count = 0; /* `defaults` may have others */
    controller->filters = schema_alloc(self, CW_NODE_FILTERS_MAX, sizeof *controller->filters);
    for (size_t i = 0; controller->filters && i < count; i++)
        read_filter(self, key, schema_item(self, value, i), controller);
}
