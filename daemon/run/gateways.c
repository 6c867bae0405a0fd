/* SPDX-License-Identifier: MIT
 *
 * gateways.c - carries frames between the buses of a rig.
 */
#include "run/gateways.h"

#include "base/text/jsonput.h"
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

/* A frame that a gateway has received. */
typedef struct noted {
    uint64_t tick;
    size_t bus;
    size_t number; /* keeps the order of frames of one bus */
    size_t gateway;
    unsigned end;
    const rig_rule *rule;
    cw_frame frame;
} noted;

/* The gateways of a bus that carry a frame, as a set of their nodes. */
typedef struct wish {
    uint64_t nodes;
    bool known;
} wish;

/* Those of a bus for data of base format, by their identifiers. */
typedef struct wishes {
    uint64_t none[(CW_BASE_ID_MAX + 1) / 64]; /* set of identifiers known to have no nodes. Most
                                                 questions are about them; it is small, and so
                                                 stays in the nearest cache */
    wish of[CW_BASE_ID_MAX + 1];
} wishes;

struct gateways {
    const rig *config;
    gateways_send *send;
    void *user;
    side (*sides)[2];         /* of each gateway */
    unsigned (*nodes)[2];     /* in the same way: the present places of its nodes */
    uint64_t set[RIG_BUSES_MAX]; /* of these nodes, by bus */
    uint64_t own[RIG_BUSES_MAX];  /* of these, the ones that get what they send */
    uint32_t answering;           /* buses on which any frame may make nodes send, as a set */
    wishes *wishes;               /* by bus */
    gateways_way ways[RIG_BUSES_MAX * RIG_BUSES_MAX];
    size_t way_count;
    uint32_t feeds;           /* buses from which ways go, as a set */
    noted *list;              /* frames that no meeting has passed on */
    size_t count;
    size_t room;
    size_t next_number;
    uint64_t first[RIG_BUSES_MAX]; /* the ticks of the first ones, by bus */
};

/* Makes a lane with room for the frames that wait for its delay. False: without memory. */
static bool make_lane(lane *self, const rig_rule *rule)
{
    *self = (lane){.rule = rule};
    self->delay_ticks = text_time_ticks(rule->delay, cw_rate_of(1)); /* it has no bits */
    self->due = calloc(rule->queue, sizeof *self->due);
    return self->due != NULL;
}

/* Makes what one end of a gateway knows: a lane for each rule, in the order of the rules. */
static bool make_side(side *self, const rig_gateway *gateway)
{
    bool good = true;
    self->lanes = calloc(gateway->rule_count, sizeof *self->lanes);
    for (size_t r = 0; self->lanes && r < gateway->rule_count; r++)
        good = make_lane(&self->lanes[r], &gateway->rules[r]) && good;
    return self->lanes && good;
}

/* Returns the way from one bus to another; it is made when a rule needs it first. */
static gateways_way *find_way(gateways *self, size_t from, size_t to)
{
    for (size_t i = 0; i < self->way_count; i++)
        if (self->ways[i].from == from && self->ways[i].to == to)
            return &self->ways[i];
    gateways_way *way = &self->ways[self->way_count++];
    *way = (gateways_way){.from = from, .to = to, .delay = CW_NEVER};
    self->feeds |= UINT32_C(1) << from;
    return way;
}

/* Adds the ways of a gateway. The least delay of its rules is how early a frame can come to the
 * other bus. */
static void add_ways(gateways *self, size_t g)
{
    const rig_gateway *gateway = &self->config->gateways[g];
    for (unsigned end = 0; end < 2; end++)
        for (size_t r = 0; r < gateway->rule_count; r++) {
            const uint64_t delay = self->sides[g][end].lanes[r].delay_ticks;
            if (!(gateway->rules[r].direction >> end & 1u))
                continue;
            gateways_way *way =
                find_way(self, gateway->ends[end].bus, gateway->ends[1 - end].bus);
            way->delay = delay < way->delay ? delay : way->delay;
        }
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
    self->wishes = calloc(config->bus_count, sizeof *self->wishes);
    bool good = self->sides && self->nodes && self->wishes;
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
    for (size_t g = 0; g < config->gateway_count; g++)
        add_ways(self, g);
    for (size_t i = 0; i < RIG_BUSES_MAX; i++)
        self->first[i] = CW_NEVER;
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
    free(self->wishes);
    free(self->list);
    free(self);
}

uint64_t gateways_nodes(const gateways *self, size_t bus)
{
    return self->set[bus];
}

const uint64_t *gateways_first(const gateways *self)
{
    return self->first;
}

bool gateways_wait(const gateways *self, uint64_t before)
{
    bool wait = false;
    for (size_t i = 0; !wait && self->count > 0 && i < self->config->bus_count; i++)
        wait = self->first[i] < before;
    return wait;
}

uint32_t gateways_feeds(const gateways *self)
{
    return self->feeds;
}

const gateways_way *gateways_ways(const gateways *self, size_t *count)
{
    *count = self->way_count;
    return self->ways;
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
    memset(&self->wishes[bus], 0, sizeof self->wishes[bus]);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Frames whose delay is over by now need no room any more. */
static void forget_past(lane *self, uint64_t now)
{
    while (self->waiting > 0 && self->due[self->first] <= now) {
        self->first = (self->first + 1) % self->rule->queue;
        self->waiting--;
    }
}

/* Gives the frame the identifier of the rule, if the rule has one, and the format that goes with
 * it. */
static void set_id(cw_frame *frame, const rig_rule *rule)
{
    if (!rule->has_id)
        return;
    frame->id = rule->id & CW_EXTENDED_ID_MAX;
    frame->flags &= (uint8_t)~CW_FRAME_EXTENDED;
    if (rule->id & CW_FILTER_EXTENDED)
        frame->flags |= CW_FRAME_EXTENDED;
}

/* ---- Receptions ------------------------------------------------------------------------------ */

/* Returns the nodes of gateways on that bus whose rules pass such a frame on. */
static uint64_t find_wish(const gateways *self, size_t bus, const cw_frame *frame)
{
    uint64_t nodes = 0;
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++)
            if (self->config->gateways[g].ends[end].bus == bus &&
                rig_find_rule(&self->config->gateways[g], end, frame))
                nodes |= UINT64_C(1) << self->nodes[g][end];
    return nodes;
}

/* The same, remembered for base identifiers. There are too many extended ones for a table. */
static uint64_t wish_of(const gateways *self, size_t bus, const cw_frame *frame)
{
    const uint32_t id = cw_frame_can_id(frame);
    if (id > CW_BASE_ID_MAX)
        return find_wish(self, bus, frame);
    wishes *all = &self->wishes[bus];
    if (all->none[id / 64] >> id % 64 & 1u)
        return 0;
    wish *w = &all->of[id];
    if (!w->known)
        *w = (wish){.known = true, .nodes = find_wish(self, bus, frame)};
    all->none[id / 64] |= (uint64_t)(w->nodes == 0) << id % 64;
    return w->nodes;
}

bool gateways_want(const void *bus, unsigned node, const cw_frame *frame)
{
    const gateways_bus *of = bus;
    const uint64_t deaf = (UINT64_C(1) << node) & ~of->gateways->own[of->bus];
    return wish_of(of->gateways, of->bus, frame) & ~deaf;
}

void gateways_hear_own(gateways *self, size_t bus, uint64_t nodes)
{
    self->own[bus] = nodes;
}

void gateways_answer(gateways *self, size_t bus, bool answers)
{
    const uint32_t one = UINT32_C(1) << bus;
    self->answering = answers ? self->answering | one : self->answering & ~one;
}

/* Returns the next entry of the list of frames that wait for the other bus, or NULL without
 * memory. */
static noted *gateways_add(gateways *self)
{
    if (self->count == self->room) {
        const size_t room = self->room > 0 ? 2 * self->room : 64;
        noted *list = realloc(self->list, room * sizeof *list);
        if (!list)
            return NULL;
        self->list = list;
        self->room = room;
    }
    return &self->list[self->count++];
}

/* Notes a frame that a gateway has received at one end and a rule passes on. False: no memory. */
static bool gateways_receive(gateways *self, size_t g, unsigned end, const cw_event *event)
{
    const rig_gateway *gateway = &self->config->gateways[g];
    const rig_rule *rule = rig_find_rule(gateway, end, &event->frame);
    if (!rule)
        return true;
    noted *n = gateways_add(self);
    if (!n)
        return false;
    *n = (noted){.tick = event->tick, .bus = gateway->ends[end].bus, .number = self->next_number++,
                 .gateway = g, .end = end, .rule = rule};
    if (n->tick < self->first[n->bus])
        self->first[n->bus] = n->tick;
    memcpy(&n->frame, &event->frame,
           offsetof(cw_frame, data) + cw_frame_length(&event->frame)); /* there may be no more */
    return true;
}

bool gateways_note(gateways *self, size_t bus, const cw_event *event)
{
    bool good = true;
    if ((event->kind != CW_EVENT_RX && event->kind != CW_EVENT_DROP) ||
        !(event->nodes & self->set[bus]) ||
        (event->kind == CW_EVENT_RX && !(event->nodes & wish_of(self, bus, &event->frame))))
        return true;
    for (size_t g = 0; g < self->config->gateway_count; g++)
        for (unsigned end = 0; end < 2; end++) {
            if (self->config->gateways[g].ends[end].bus != bus ||
                !(event->nodes >> self->nodes[g][end] & 1u))
                continue;
            if (event->kind == CW_EVENT_DROP)
                self->sides[g][1 - end].dropped++;
            else
                good = gateways_receive(self, g, end, event) && good;
        }
    return good;
}

/* ---- Meetings -------------------------------------------------------------------------------- */

/* given: see gateways_meet() */
static void forward(gateways *self, const noted *n, uint64_t *given)
{
    const unsigned far = 1 - n->end;
    const rig_gateway *gateway = &self->config->gateways[n->gateway];
    lane *l = &self->sides[n->gateway][n->end].lanes[n->rule - gateway->rules];
    const size_t bus = gateway->ends[far].bus;
    const uint64_t due = cw_after(n->tick, l->delay_ticks);
    cw_frame frame = n->frame;
    forget_past(l, n->tick);
    set_id(&frame, l->rule);
    if (l->waiting == l->rule->queue ||
        self->send(self->user, bus, self->nodes[n->gateway][far], &frame, n->tick, due) != CW_OK) {
        l->lost++;
        return;
    }
    if (given && due < given[bus] &&
        ((self->answering >> bus & 1u) ||
         gateways_want(&(gateways_bus){.gateways = self, .bus = bus},
                       self->nodes[n->gateway][far], &frame)))
        given[bus] = due;
    l->due[(l->first + l->waiting++) % l->rule->queue] = due;
    l->forwarded++;
}

static int compare_numbers(uint64_t a, uint64_t b)
{
    return (a > b) - (a < b);
}

/* Sorts by tick, then bus, then the order of receipt, so that a run always has the same order. */
static int compare_noted(const void *left, const void *right)
{
    const noted *a = left;
    const noted *b = right;
    int order = compare_numbers(a->tick, b->tick);
    if (order == 0)
        order = compare_numbers(a->bus, b->bus);
    return order != 0 ? order : compare_numbers(a->number, b->number);
}

/* Buses that go on meanwhile, for want of room, note frames behind the others. These are too late
 * for this meeting, and come to no bus too late. */
void gateways_meet(gateways *self, uint64_t before, uint64_t given[RIG_BUSES_MAX])
{
    size_t passed = 0;
    for (size_t i = 0; given && i < self->config->bus_count; i++)
        given[i] = CW_NEVER;
    if (self->count > 1)
        qsort(self->list, self->count, sizeof *self->list, compare_noted);
    for (; passed < self->count && self->list[passed].tick < before; passed++) {
        const noted n = self->list[passed];
        forward(self, &n, given);
    }
    self->count -= passed;
    if (passed > 0 && self->count > 0)
        memmove(self->list, self->list + passed, self->count * sizeof *self->list);
    for (size_t i = 0; i < self->config->bus_count; i++)
        self->first[i] = CW_NEVER;
    for (size_t i = self->count; i > 0; i--)
        self->first[self->list[i - 1].bus] = self->list[i - 1].tick;
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Returns the counters of what one end passes on. Rules of the other direction are left out. */
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
