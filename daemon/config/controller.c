/* SPDX-License-Identifier: MIT
 *
 * controller.c - the part of a node's controller that its host sees: filters and buffers.
 */
#include "config/parts.h"

#include "base/nearest.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <string.h>

/* One of the buffers takes the frame on the wire. The others hold frames that the host has not
 * fetched. */
#define BUFFERS_DEFAULT 2u

static const schema_range buffers_range = {2, CW_RECEIVE_BUFFERS_MAX + 1, sizeof(uint32_t)};

static const schema_choice models[] = {
    {.name = "queue", .value = CFG_MODEL_QUEUE},
    {.name = "basic", .value = CFG_MODEL_BASIC},
    {.name = NULL},
};

#define MEMBER(member) .offset = offsetof(cfg_node, controller.member)
static const schema_key model_keys[] = {
    {.name = "model", .read = schema_read_choice, MEMBER(model), .arg = models, .required = true},
    {.name = "receive-buffers", .read = schema_read_uint, MEMBER(receive_buffers),
     .arg = &buffers_range},
    {.name = "service-time", .read = cfg_read_ticks_min, MEMBER(service_ticks)},
    {.name = "overload-when-full", .read = schema_read_bool, MEMBER(overload_when_full)},
    {.name = NULL},
};

/* ---- Models ---------------------------------------------------------------------------------- */

/* Complains about keys that a queue does not have. */
static void check_queue(schema *self, const yaml_node_t *map)
{
    if (!schema_find(self, map, model_keys[0].name))
        return; /* that is the complaint */
    for (const schema_key *key = model_keys + 1; key->name; key++) {
        const yaml_node_t *const value = schema_find(self, map, key->name);
        if (value)
            schema_complain(self, value, "%s: a controller with `model: queue` has none; its host "
                            "takes each frame at once", key->name);
    }
}

/* Leaves the filters, which have a key of their own. */
static void forget_model(cfg_controller *controller)
{
    controller->model = CFG_MODEL_QUEUE;
    controller->receive_buffers = BUFFERS_DEFAULT;
    controller->service_ticks = 0;
    controller->overload_when_full = false;
}

static void read_model(schema *self, const schema_key *key, yaml_node_t *value, cfg_node *node)
{
    forget_model(&node->controller);
    schema_map(self, key->name, value, model_keys, node);
    if (node->controller.model == CFG_MODEL_QUEUE)
        check_queue(self, value);
}

void cfg_complete_controllers(schema *self, yaml_node_t *nodes)
{
    cfg *config = cfg_of(self);

    for (size_t i = 0; i < config->node_count; i++) {
        cfg_node *node = &config->nodes[i];
        const yaml_node_t *const order = schema_find(self, schema_item(self, nodes, i), "order");
        if (node->controller.model != CFG_MODEL_BASIC)
            continue;
        if (order && node->order != CW_ORDER_FIFO)
            schema_complain(self, order, "order: a basic controller has one transmit buffer, so "
                            "its frames go in the order in which its host writes them: fifo");
        node->order = CW_ORDER_FIFO;
    }
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
