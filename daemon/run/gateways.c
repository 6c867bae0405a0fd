/* SPDX-License-Identifier: MIT
 *
 * gateways.c - carries frames between the buses of a rig.
 */
#include "run/gateways.h"

#include "base/jsonput.h"

#include <stdlib.h>

/* A rule in one direction. The ticks at which its frames are handed over are in order, since all of
 * them wait for the same time. */
typedef struct lane {
    const rig_rule *rule;
    uint64_t delay_ticks;
    uint64_t forwarded; /* handed to the other node */
    uint64_t lost;      /* there was no room in the queue of the rule */
    uint64_t *due;      /* ring of rule->queue ticks */
    uint32_t first;
    uint32_t waiting;
} lane;

typedef struct side {
    lane *lanes;      /* of each rule; the end of this index receives */
    uint64_t dropped; /* events of drops at the node that sends: at the far queue, say */
} side;

struct gateways {
    const rig *config;
    side (*sides)[2]; /* of each gateway */
};

static bool make_lane(lane *self, const rig_rule *rule)
{
    *self = (lane){.rule = rule};
    self->delay_ticks = text_time_ticks(rule->delay, cw_rate_of(1)); /* it has no bits */
    self->due = calloc(rule->queue, sizeof *self->due);
    return self->due != NULL;
}

static bool make_side(side *self, const rig_gateway *gateway)
{
    bool good = true;
    self->lanes = calloc(gateway->rule_count, sizeof *self->lanes);
    for (size_t r = 0; self->lanes && r < gateway->rule_count; r++)
        good = make_lane(&self->lanes[r], &gateway->rules[r]) && good;
    return self->lanes && good;
}

gateways *gateways_new(const rig *config)
{
    gateways *self = calloc(1, sizeof *self);
    if (!self)
        return NULL;
    self->config = config;
    self->sides = calloc(config->gateway_count + 1, sizeof *self->sides);
    bool good = self->sides != NULL;
    for (size_t g = 0; good && g < config->gateway_count; g++)
        for (unsigned end = 0; good && end < 2; end++)
            good = make_side(&self->sides[g][end], &config->gateways[g]);
    if (good)
        return self;
    gateways_free(self);
    return NULL;
}

static void free_side(side *self, size_t rules)
{
    for (size_t r = 0; self->lanes && r < rules; r++)
        free(self->lanes[r].due);
    free(self->lanes);
}

void gateways_free(gateways *self)
{
    if (!self)
        return;
    for (size_t g = 0; self->sides && g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++)
            free_side(&self->sides[g][end], self->config->gateways[g].rule_count);
    free(self->sides);
    free(self);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

static void forget_past(lane *self, uint64_t now)
{
    while (self->waiting > 0 && self->due[self->first] <= now) {
        self->first = (self->first + 1) % self->rule->queue;
        self->waiting--;
    }
}

static void set_id(cw_frame *frame, const rig_rule *rule)
{
    if (!rule->has_id)
        return;
    frame->id = rule->id & CW_EXTENDED_ID_MAX;
    frame->flags &= (uint8_t)~CW_FRAME_EXTENDED;
    if (rule->id & CW_FILTER_EXTENDED)
        frame->flags |= CW_FRAME_EXTENDED;
}

static void forward(lane *self, cw_bus *bus, unsigned node, const cw_event *event)
{
    const uint64_t due = cw_after(event->tick, self->delay_ticks);
    cw_frame frame = event->frame;
    forget_past(self, event->tick);
    set_id(&frame, self->rule);
    if (self->waiting == self->rule->queue || cw_node_send(bus, node, &frame, due) != CW_OK) {
        self->lost++;
        return;
    }
    self->due[(self->first + self->waiting++) % self->rule->queue] = due;
    self->forwarded++;
}

static void look(gateways *self, cw_bus *const *buses, size_t g, unsigned end,
                 const cw_event *event)
{
    const rig_gateway *gateway = &self->config->gateways[g];
    side *s = &self->sides[g][end];
    const rig_end *to = &gateway->ends[1 - end];
    const rig_rule *rule = event->kind == CW_EVENT_RX
                               ? rig_find_rule(gateway, end, &event->frame) : NULL;
    if (event->kind == CW_EVENT_DROP)
        self->sides[g][1 - end].dropped++;
    if (rule)
        forward(&s->lanes[rule - gateway->rules], buses[to->bus], to->node, event);
}

void gateways_event(gateways *self, cw_bus *const *buses, size_t bus, const cw_event *event)
{
    if (event->kind != CW_EVENT_RX && event->kind != CW_EVENT_DROP)
        return;
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++) {
            const rig_end *from = &self->config->gateways[g].ends[end];
            if (from->bus == bus && event->nodes >> from->node & 1u)
                look(self, buses, g, end, event);
        }
}

/* ---- Statistics ------------------------------------------------------------------------------ */

static json_t *side_stats(const side *self, const rig_gateway *gateway, unsigned end)
{
    json_t *object = json_object();
    json_t *rules = json_array();
    for (size_t r = 0; r < gateway->rule_count; r++) {
        json_t *rule = json_object();
        if (!(gateway->rules[r].direction >> end & 1u)) {
            json_decref(rule);
            continue;
        }
        put_count(rule, "rule", r);
        put_count(rule, "forwarded", self->lanes[r].forwarded);
        put_count(rule, "lost", self->lanes[r].lost);
        put_last(rules, rule);
    }
    put(object, "rules", rules);
    put_count(object, "dropped", self->dropped);
    return object;
}

json_t *gateways_stats(const gateways *self)
{
    static const char *const names[2] = {"forward", "backward"};
    json_t *list = json_array();
    for (size_t g = 0; g < self->config->gateway_count; g++) {
        const rig_gateway *gateway = &self->config->gateways[g];
        json_t *object = json_object();
        put_text(object, "name", gateway->name);
        for (unsigned end = 0; end < 2; end++)
            put(object, names[end], side_stats(&self->sides[g][end], gateway, end));
        put_last(list, object);
    }
    return list;
}
