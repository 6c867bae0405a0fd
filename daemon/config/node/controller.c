/* SPDX-License-Identifier: MIT
 *
 * controller.c - the part of a node's controller that its host sees: filters and buffers.
 */
#include "config/parts.h"

#include "base/text/nearest.h"
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

#define HAS_ALL (HAS_BUFFERS | HAS_SERVICE | HAS_OVERLOAD | HAS_MAILBOXES)

#define MODEL_NAMES "queue, basic, full, sja1000, mcp2515, m_can, flexcan, bxcan"

/* Receive buffers are counted with the one for the frame on the wire. Sources of the presets are
 * named in canwire-controller(7). */
static const struct {
    const char *name;
    unsigned keys;
    const char *why; /* for what its controller has no keys */
    uint8_t buffers; /* 0: received frames go into mailboxes */
    uint8_t bytes;
    uint8_t receive; /* mailboxes */
    uint8_t send;
    cw_transmit transmit;
    errframe_driver driver;
} models[CFG_MODELS] = {
    [CFG_MODEL_QUEUE] = {.name = "queue", .why = "its host takes each frame at once"},
    [CFG_MODEL_BASIC] = {.name = "basic", .keys = HAS_BUFFERS | HAS_SERVICE | HAS_OVERLOAD,
                         .why = "it has buffers and no mailboxes", .buffers = BUFFERS_DEFAULT},
    [CFG_MODEL_FULL] = {.name = "full", .keys = HAS_SERVICE | HAS_MAILBOXES,
                        .why = "its mailboxes take newer frames when they are full",
                        .receive = 8, .send = 8},
    [CFG_MODEL_SJA1000] = {.name = "sja1000", .keys = HAS_ALL, .buffers = 22, .bytes = 64,
                           .send = 1, .driver = ERRFRAME_SJA1000},
    [CFG_MODEL_MCP2515] = {.name = "mcp2515", .keys = HAS_ALL, .buffers = 3, .send = 1,
                           .driver = ERRFRAME_MCP251X},
    [CFG_MODEL_M_CAN] = {.name = "m_can", .keys = HAS_ALL, .buffers = 65, .send = 32,
                         .transmit = CW_TRANSMIT_REQUEST, .driver = ERRFRAME_M_CAN},
    [CFG_MODEL_FLEXCAN] = {.name = "flexcan", .keys = HAS_ALL, .buffers = 7, .send = 1,
                           .driver = ERRFRAME_FLEXCAN},
    [CFG_MODEL_BXCAN] = {.name = "bxcan", .keys = HAS_SERVICE | HAS_MAILBOXES,
                         .why = "its receive FIFO is never full", .receive = 3, .send = 3,
                         .transmit = CW_TRANSMIT_REQUEST, .driver = ERRFRAME_BXCAN},
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

/* Keys that others lack, in the words of JSON schema. */
#define NO_BUFFERS "'receive-buffers': false, 'overload-when-full': false"
#define NO_MAILBOXES "'mailboxes': false, 'transmit': false"
#define NOT_OF(model, keys)                                                                        \
    TYPE_IF("{'properties': {'model': {'const': '" model "'}}}", "{'properties': {" keys "}}")

#define MEMBER(member) .offset = offsetof(cfg_node, controller.member)
/* The model comes first: the other keys change what it says. */
const schema_key cfg_model_keys[] = {
    {.name = "model", .read = read_model_name, .type = "model", .preset = "queue",
     .help = "What sits between the controller and its host: nothing, the buffers of a basic "
             "controller, the mailboxes of a full one, or those of a real one with the habits of "
             "its Linux driver."},
    {.name = "receive-buffers", .read = schema_read_uint, MEMBER(receive_buffers),
     .arg = &buffers_range,
     .preset = "2",
     .help = "Receive buffers; one of them takes the frame on the wire."},
    {.name = "service-time", .read = cfg_read_ticks_min, MEMBER(service_ticks),
     .help = "Time that the host needs for each received frame."},
    {.name = "overload-when-full", .read = schema_read_bool, MEMBER(overload_when_full),
     .preset = "false",
     .help = "While its receive buffers are full after a frame, the controller sends overload "
             "frames, two at most."},
    {.name = "mailboxes", .read = cfg_read_mailboxes, .map = cfg_mailbox_keys,
     .type = TYPE_ANY(TYPE_INTEGER(8, 64) ", " TYPE_LIST(1, 64, "@")), .preset = "16",
     .help = "Mailboxes of a full controller. Of a number half receive frames of any identifier, "
             "and the others send."},
    {.name = "transmit", .read = schema_read_choice, MEMBER(transmit), .arg = transmits,
     .preset = "priority",
     .help = "Which mailbox goes next: the one with the most urgent identifier, the first one, "
             "or the one filled first."},
    {.name = "high-identifiers", .read = read_variant, .arg = &no_high_ids, .type = "boolean",
     .preset = "true",
     .help = "Off: it sends no identifier whose first seven bits are all recessive."},
    {.name = "dlc-over-8", .read = read_variant, .arg = &no_long_dlc, .type = "boolean",
     .preset = "true",
     .help = "Off: it sends no classical frame with a DLC above 8, and takes such a DLC for a "
             "form error."},
    {.name = "rec-when-passive", .read = read_variant, .arg = &rec_holds, .type = "boolean",
     .preset = "true",
     .help = "Off: its receive error counter does not go up from 128 on."},
    {.name = "report-passive", .read = read_variant, .arg = &silent_passive, .type = "boolean",
     .preset = "true",
     .help = "Off: its host is told error-warning in place of error-passive."},
    {.name = NULL,
     .type = "{'allOf': ["
             NOT_OF("queue", NO_BUFFERS ", 'service-time': false, " NO_MAILBOXES) ", "
             NOT_OF("basic", NO_MAILBOXES) ", "
             NOT_OF("full", NO_BUFFERS) ", " NOT_OF("bxcan", NO_BUFFERS) ", "
             TYPE_IF(TYPE_NEEDS("mailboxes"), "{'properties': {" NO_BUFFERS "}}") "]}"},
};

static const unsigned keys_of[] = {0, HAS_BUFFERS, HAS_SERVICE, HAS_OVERLOAD, HAS_MAILBOXES,
                                   HAS_MAILBOXES};

/* ---- Models ---------------------------------------------------------------------------------- */

const char *cfg_model_name(cfg_model model)
{
    return models[model].name;
}

static bool find_model(cfg_model *out, const char *name)
{
    for (unsigned i = 0; i < CFG_MODELS; i++)
        if (strcmp(models[i].name, name) == 0) {
            *out = (cfg_model)i;
            return true;
        }
    return false;
}

/* Returns false when a map names no model that there is. */
static bool model_of(schema *self, const yaml_node_t *map, cfg_model *out)
{
    const yaml_node_t *const name = schema_find(self, map, cfg_model_keys[0].name);

    return name && name->type == YAML_SCALAR_NODE &&
           find_model(out, (const char *)name->data.scalar.value);
}

static bool is_preset(cfg_model model)
{
    return model > CFG_MODEL_FULL;
}

/* A preset also has the bit timing of its controller. */
static void set_model(schema *self, cfg_node *node, cfg_model model)
{
    cfg_controller *controller = &node->controller;

    controller->model = model;
    controller->receive_buffers = models[model].buffers;
    controller->receive_bytes = models[model].bytes;
    controller->transmit = models[model].transmit;
    controller->driver = models[model].driver;
    if (models[model].receive || models[model].send)
        cfg_add_mailboxes(self, controller, models[model].receive, models[model].send);
    controller->receive_fifo = models[model].receive == 0;
    if (is_preset(model))
        node->time.limits = timing_controller(models[model].name);
}

/* The model sets what it brings before the other keys are read, which change that. */
static void read_model_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "one of " MODEL_NAMES);
    nearest guess = {.word = text};
    cfg_model model;

    if (!text)
        return;
    if (find_model(&model, text)) {
        set_model(self, object, model);
        return;
    }
    for (unsigned i = 0; i < CFG_MODELS; i++)
        nearest_consider(&guess, models[i].name);
    schema_complain(self, value, "%s: there is no model '%.40s'%s", key->name, text,
                    schema_allowed(self, &guess, MODEL_NAMES));
}

/* Complains about keys that the model does not have. */
static void controller_check_keys(schema *self, const yaml_node_t *map, cfg_model model)
{
    cfg_model known;

    if (schema_find(self, map, cfg_model_keys[0].name) && !model_of(self, map, &known))
        return; /* that is the complaint */
    for (size_t i = 1; i < sizeof keys_of / sizeof keys_of[0]; i++) {
        const yaml_node_t *const value = schema_find(self, map, cfg_model_keys[i].name);
        if (value && !(models[model].keys & keys_of[i]))
            schema_complain(self, value, "%s: a controller with `model: %s` has none; %s",
                            cfg_model_keys[i].name, models[model].name, models[model].why);
    }
}

/* A number of buffers takes the place of a number of bytes, and mailboxes that of buffers. */
static void check_reception(schema *self, const yaml_node_t *map, cfg_controller *controller)
{
    const yaml_node_t *const buffers = schema_find(self, map, "receive-buffers");
    const yaml_node_t *const overload = schema_find(self, map, "overload-when-full");
    const bool boxed = is_preset(controller->model) && schema_find(self, map, "mailboxes");

    if (is_preset(controller->model) && buffers)
        controller->receive_bytes = 0;
    if (boxed && buffers)
        schema_complain(self, buffers, "receive-buffers: received frames go into the mailboxes");
    if (boxed && overload)
        schema_complain(self, overload, "overload-when-full: received frames go into the "
                        "mailboxes, which take newer ones when they are full");
}

/* Leaves the filters, which have a key of their own. */
static void forget_model(cfg_controller *controller)
{
    *controller = (cfg_controller){.filter_count = controller->filter_count,
                                   .filters = controller->filters};
}

/* The bit is set for a deviation, which the key has as `off`. */
static void read_variant(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint8_t *const variants = &((cfg_node *)object)->controller.variants;
    const uint8_t variant = *(const uint8_t *)key->arg;
    bool usual = true;

    (void)schema_choose_bool(self, &usual, key, value);
    *variants = (uint8_t)(usual ? *variants & ~variant : *variants | variant);
}

/* Another model of `defaults` is forgotten as a whole, but for the filters. */
static void read_model(schema *self, const schema_key *key, yaml_node_t *value, cfg_node *node)
{
    if (is_preset(node->controller.model))
        node->time.limits = NULL; /* that of `defaults` */
    forget_model(&node->controller);
    schema_map(self, key->name, value, cfg_model_keys, node);
    controller_check_keys(self, value, node->controller.model);
    check_reception(self, value, &node->controller);
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
            complete_order(self, cfg_node_map(self, nodes, i), &config->nodes[i]);
}

/* ---- The name of a real one ------------------------------------------------------------------ */

/* Reads the name of a real controller, which gives limits of bit timings. */
static void controller_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                                 cfg_node *node)
{
    const char *text = schema_text(self, key, value, "a controller such as sja1000, or a map");
    const timing_limits *found = text ? timing_controller(text) : NULL;
    nearest guess = {.word = text};
    const char *list = "";
    cfg_model model;
    size_t count;
    const timing_limits *all = timing_controllers(&count);

    forget_model(&node->controller);
    if (found)
        node->time.limits = found;
    if (!text || found)
        return;
    if (find_model(&model, text)) {
        schema_complain(self, value, "%s: '%s' is a model, so write it as { model: %s }", key->name,
                        text, text);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        nearest_consider(&guess, all[i].name);
        list = schema_join(self, list, all[i].name);
    }
    schema_complain(self, value, "%s: there is no controller '%.40s'%s", key->name, text,
                    schema_allowed(self, &guess, list));
}

bool cfg_is_model(schema *self, const char *key, const yaml_node_t *value)
{
    cfg_model model;

    return strcmp(key, "controller") == 0 && value->type == YAML_MAPPING_NODE &&
           !(model_of(self, value, &model) && is_preset(model));
}

/* A map is a model; a name is that of a real controller, whose limits count for bit timings. */
void cfg_read_controller(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    if (value->type == YAML_MAPPING_NODE)
        read_model(self, key, value, object);
    else
        controller_read_name(self, key, value, object);
}

/* ---- Filters --------------------------------------------------------------------------------- */

/* A list takes the place of that in `defaults`; the two are never joined. */
void cfg_read_acceptance(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_controller *controller = &((cfg_node *)object)->controller;

    /* `defaults` may have others */
    controller->filter_count = 0;
    controller->filters = schema_alloc(self, CW_NODE_FILTERS_MAX, sizeof *controller->filters);
    if (controller->filters)
        controller->filter_count = (uint16_t)cfg_read_filter_list(
            self, key, value, controller->filters, 0, CW_NODE_FILTERS_MAX);
}
