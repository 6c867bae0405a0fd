/* SPDX-License-Identifier: MIT
 *
 * gateways.c - carries frames between the buses of a rig.
 */
#include "run/gateways.h"

#include "base/jsonput.h"
#include "config/values.h"

#include <stdlib.h>
#include <string.h>

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

/* An event that waits for those of other buses. */
typedef struct noted {
    size_t bus;
    size_t number; /* keeps the order of events of one bus */
    cw_event event;
} noted;

struct gateways {
    const rig *config;
    gateways_send *send;
    void *user;
    side (*sides)[2];         /* of each gateway */
    unsigned (*nodes)[2];     /* in the same way: the present places of its nodes */
    uint64_t set[RIG_BUSES_MAX]; /* of these nodes, by bus */
    uint32_t given;           /* buses that have been given frames by the last meeting */
    noted *list;              /* events since that */
    size_t count;
    size_t room;
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

/* Collects the nodes of all gateways by bus. */
static void set_nodes(gateways *self)
{
    memset(self->set, 0, sizeof self->set);
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++)
            self->set[self->config->gateways[g].ends[end].bus] |=
                UINT64_C(1) << self->nodes[g][end];
}

gateways *gateways_new(const rig *config, gateways_send *send, void *user)
{
    gateways *self = calloc(1, sizeof *self);
    if (!self)
        return NULL;
    *self = (gateways){.config = config, .send = send, .user = user};
    self->sides = calloc(config->gateway_count + 1, sizeof *self->sides);
    self->nodes = calloc(config->gateway_count + 1, sizeof *self->nodes);
    bool good = self->sides && self->nodes;
    for (size_t g = 0; good && g < config->gateway_count; g++)
        for (unsigned end = 0; good && end < 2; end++)
            good = make_side(&self->sides[g][end], &config->gateways[g]);
    if (!good) {
        gateways_free(self);
        return NULL;
    }
    for (size_t g = 0; g < config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++)
            self->nodes[g][end] = config->gateways[g].ends[end].node;
    set_nodes(self);
    return self;
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
    free(self->nodes);
    free(self->list);
    free(self);
}

uint64_t gateways_nodes(const gateways *self, size_t bus)
{
    return self->set[bus];
}

void gateways_remap(gateways *self, size_t bus, const uint8_t from[CW_NODES_MAX])
{
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++) {
            unsigned node = 0;
            if (self->config->gateways[g].ends[end].bus != bus)
                continue;
            while (node < CW_NODES_MAX && from[node] != self->nodes[g][end])
                node++;
            if (node < CW_NODES_MAX)
                self->nodes[g][end] = node;
        }
    set_nodes(self);
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

static void forward(gateways *self, lane *l, size_t bus, unsigned node, const cw_event *event)
{
    const uint64_t due = cw_after(event->tick, l->delay_ticks);
    cw_frame frame = event->frame;
    forget_past(l, event->tick);
    set_id(&frame, l->rule);
    if (l->waiting == l->rule->queue || self->send(self->user, bus, node, &frame, due) != CW_OK) {
        l->lost++;
        return;
    }
    self->given |= UINT32_C(1) << bus;
    l->due[(l->first + l->waiting++) % l->rule->queue] = due;
    l->forwarded++;
}

static void look(gateways *self, size_t g, unsigned end, const cw_event *event)
{
    const rig_gateway *gateway = &self->config->gateways[g];
    side *s = &self->sides[g][end];
    const rig_rule *rule = event->kind == CW_EVENT_RX
                               ? rig_find_rule(gateway, end, &event->frame) : NULL;
    if (event->kind == CW_EVENT_DROP)
        self->sides[g][1 - end].dropped++;
    if (rule)
        forward(self, &s->lanes[rule - gateway->rules], gateway->ends[1 - end].bus,
                self->nodes[g][1 - end], event);
}

static void pass_on(gateways *self, size_t bus, const cw_event *event)
{
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++)
            if (self->config->gateways[g].ends[end].bus == bus &&
                event->nodes >> self->nodes[g][end] & 1u)
                look(self, g, end, event);
}

/* ---- Meetings -------------------------------------------------------------------------------- */

bool gateways_note(gateways *self, size_t bus, const cw_event *event)
{
    if ((event->kind != CW_EVENT_RX && event->kind != CW_EVENT_DROP) ||
        !(event->nodes & self->set[bus]))
        return true;
    if (self->count == self->room) {
        const size_t room = self->room > 0 ? 2 * self->room : 64;
        noted *list = realloc(self->list, room * sizeof *list);
        if (!list)
            return false;
        self->list = list;
        self->room = room;
    }
    self->list[self->count] = (noted){.bus = bus, .number = self->count, .event = *event};
    self->count++;
    return true;
}

static int compare_numbers(uint64_t a, uint64_t b)
{
    return (a > b) - (a < b);
}

static int compare_noted(const void *left, const void *right)
{
    const noted *a = left;
    const noted *b = right;
    int order = compare_numbers(a->event.tick, b->event.tick);
    if (order == 0)
        order = compare_numbers(a->bus, b->bus);
    return order != 0 ? order : compare_numbers(a->number, b->number);
}

uint32_t gateways_meet(gateways *self)
{
    self->given = 0;
    if (self->count > 1)
        qsort(self->list, self->count, sizeof *self->list, compare_noted);
    for (size_t i = 0; i < self->count; i++)
        pass_on(self, self->list[i].bus, &self->list[i].event);
    self->count = 0;
    return self->given;
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

uint64_t gateways_lost(const gateways *self, size_t gateway, unsigned end)
{
    uint64_t lost = 0;
    for (size_t r = 0; r < self->config->gateways[gateway].rule_count; r++)
        lost += self->sides[gateway][end].lanes[r].lost;
    return lost;
}

/* Returns the nodes of a gateway as in the rig. */
static json_t *between(const gateways *self, size_t g)
{
    json_t *list = json_array();
    for (unsigned end = 0; end < 2; end++) {
        char text[2 * NODE_NAME_MAX + 2];
        const rig_end *of = &self->config->gateways[g].ends[end];
        (void)snprintf(text, sizeof text, "%s:%s", of->bus_name, of->name);
        put_text_last(list, text);
    }
    return list;
}

json_t *gateways_stats(const gateways *self, size_t bus)
{
    static const char *const names[2] = {"forward", "backward"};
    json_t *list = json_array();
    for (size_t g = 0; g < self->config->gateway_count; g++) {
        const rig_gateway *gateway = &self->config->gateways[g];
        if (bus != GATEWAYS_ALL && gateway->ends[0].bus != bus && gateway->ends[1].bus != bus)
            continue;
        json_t *object = json_object();
        put_text(object, "name", gateway->name);
        put(object, "between", between(self, g));
        for (unsigned end = 0; end < 2; end++)
            put(object, names[end], side_stats(&self->sides[g][end], gateway, end));
        put_last(list, object);
    }
    return list;
}
