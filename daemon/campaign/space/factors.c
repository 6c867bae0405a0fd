/* SPDX-License-Identifier: MIT
 *
 * factors.c - reads the key `vary` of a campaign.
 */
#include "campaign/campaign_owner.h"

#include "base/text/jsontext.h"
#include "campaign/space/jsonvalue.h"
#include "campaign/space/names.h"
#include "campaign/space/space.h"
#include "campaign/space/variant.h"
#include "trace/frametext.h"

#include <string.h>

#define NAME_MAX_BYTES 64u
#define RULE_NAME_BYTES 56u /* of a space: it is a rule's name with .1 behind it */

/* A factor that is being read. */
typedef struct reading {
    campaign_owner *owner;
    factor *factor;
    unsigned kinds; /* keys that say what the values are */
    bool has_frame;
    cw_frame frame;
} reading;

/* The map of a space of faults. */
typedef struct space_map {
    reading *reading;
    bool has_frame;
    cw_frame frame;
    uint8_t from; /* CW_NO_NODE: any */
    const char *field;
    space space;
} space_map;

static schema_reader factors_read_name, read_set, factors_read_frame, read_values, read_range,
    read_uniform, read_normal, read_positions, read_nodes, read_bits, read_pairs,
    factors_read_number, read_space_frame,
    read_space_from, read_space_at, read_space_field;

static const schema_range draw_range = {1, CAMPAIGN_VALUES_MAX, sizeof(uint64_t)};
static const schema_range skip_range = {0, UINT32_MAX, sizeof(uint64_t)};

#define NUMBER(text, m)                                                                            \
    {                                                                                              \
        .name = text, .read = factors_read_number, .offset = offsetof(factor, m),                  \
        .required = true, .type = "number",                                                        \
        .help = "A number, with or without a unit."                                                \
    }
#define DRAWS                                                                                      \
    {                                                                                              \
        .name = "draws", .read = schema_read_uint, .offset = offsetof(factor, count),              \
        .arg = &draw_range, .help = "How many values a full product or pairwise has of it."        \
    }

static const schema_key range_keys[] = {
    NUMBER("from", from), NUMBER("to", to), NUMBER("step", step), {.name = NULL},
};
static const schema_key uniform_keys[] = {
    NUMBER("from", from), NUMBER("to", to), NUMBER("step", step), DRAWS, {.name = NULL},
};
static const schema_key normal_keys[] = {
    NUMBER("mean", from), NUMBER("deviation", to), NUMBER("step", step), DRAWS, {.name = NULL},
};

static const schema_key space_keys[] = {
    {.name = "from", .read = read_space_from, .type = "node",
     .help = "The node that sends the frames."},
    {.name = "frame", .read = read_space_frame, .type = "frame",
     .help = "A frame as can-utils write it."},
    {.name = "at", .read = read_space_at,
     .type = TYPE_ANY(TYPE_REF("node") ", " TYPE_SET(64, TYPE_REF("node"))),
     .help = "The nodes that sample the bits wrong; without it all do."},
    {.name = "field", .read = read_space_field, .type = TYPE_STRING,
     .help = "Only bits of this field."},
    {.name = "skip", .read = schema_read_uint, .arg = &skip_range,
     .offset = offsetof(space_map, space.skip),
     .preset = "0",
     .help = "Frames that are passed over first."},
    {.name = NULL},
};

const schema_key campaign_factor_keys[] = {
    {.name = "name", .read = factors_read_name, .type = TYPE_TEXT("^[A-Za-z0-9_.-]{1,64}$"),
     .help = "Its name in rows; by default the path."},
    {.name = "set", .read = read_set, .type = TYPE_STRING,
     .help = "The path of the value in the scenario, such as nodes.engine.ppm."},
    {.name = "frame", .read = factors_read_frame, .type = "frame",
     .help = "With positions: those that this frame lacks are left out."},
    {.name = "values", .read = read_values, .type = "{'type': 'array', 'minItems': 1}",
     .help = "Values of any kind."},
    {.name = "range", .read = read_range, .map = range_keys,
     .help = "Numbers from, from + step, ... up to to."},
    {.name = "uniform", .read = read_uniform, .map = uniform_keys,
     .help = "Drawn from the numbers of such a range."},
    {.name = "normal", .read = read_normal, .map = normal_keys,
     .help = "Drawn from a normal distribution, rounded to step."},
    {.name = "positions", .read = read_positions,
     .type = TYPE_ANY(TYPE_REF("positions") ", {'type': 'array', 'minItems': 1, 'items': "
                      TYPE_REF("positions") "}"),
     .help = "Positions in a frame: crc[3], crc[0..14], data[0..7].*, crc.*"},
    {.name = "nodes", .read = read_nodes, .type = TYPE_SOME(64, TYPE_REF("node")),
     .help = "Names of nodes, or all."},
    {.name = "each-bit", .read = read_bits, .map = space_keys, .as = "space",
     .type = "{'allOf': [@, {'properties': {'field': false}}]}",
     .help = "Each wire bit of a frame, or of each frame that a node sends, is inverted once."},
    {.name = "pairs-of-bits", .read = read_pairs, .map = space_keys, .as = "space",
     .type = "{'allOf': [@, " TYPE_NEEDS("at") "]}",
     .help = "Each pair of bits is inverted once."},
    {.name = NULL,
     .type = "{'oneOf': [" TYPE_NEEDS("values") ", " TYPE_NEEDS("range") ", "
             TYPE_NEEDS("uniform") ", " TYPE_NEEDS("normal") ", " TYPE_NEEDS("positions") ", "
             TYPE_NEEDS("nodes") ", " TYPE_NEEDS("each-bit") ", " TYPE_NEEDS("pairs-of-bits") "]}"},
};

/* ---- Where the values go in the scenario ----------------------------------------------------- */

/* Finds the places of the rules of spaces, which come together. */
static void place_spaces(schema *self, const yaml_node_t *list, campaign_owner *o)
{
    campaign *c = &o->campaign;
    const splice_text t = {.text = c->text, .size = c->size, .document = &o->document,
                           .memory = self->arena};
    size_t count = 0;
    size_t placed = 0;
    for (size_t i = 0; i < c->factor_count; i++)
        count += c->factors[i].rules != NULL;
    for (size_t i = 0; i < c->factor_count; i++) {
        if (!c->factors[i].rules)
            continue;
        const char *wrong =
            splice_find_rules(&c->factors[i].edit, &t, placed == 0, placed + 1 == count);
        if (wrong)
            schema_complain(self, list, "%s", wrong);
        placed++;
    }
}

/* Returns true when two factors put the same key in. */
static bool is_same_key(const factor *a, const factor *b)
{
    const size_t length = strcspn(a->edit.before, ":");
    return !(a->rules && b->rules) && length == strcspn(b->edit.before, ":") &&
           strncmp(a->edit.before, b->edit.before, length) == 0;
}

/* Complains about two edits of the text, the first of which comes before the other one. */
static void check_edits(schema *self, yaml_node_t *list, const campaign *c, size_t first,
                        size_t second)
{
    const factor *a = &c->factors[first];
    const factor *b = &c->factors[second];
    const yaml_node_t *last = schema_item(self, list, first > second ? first : second);
    if (b->edit.begin < a->edit.end)
        schema_complain(self, last, "'%s' is part of what '%s' varies", b->name, a->name);
    else if (a->edit.begin == b->edit.begin && b->edit.begin < b->edit.end)
        schema_complain(self, last, "'%s' is part of what '%s' varies", a->name, b->name);
    else if (a->edit.begin == b->edit.begin && is_same_key(a, b))
        schema_complain(self, last, "'%s' and '%s' vary the same", a->name, b->name);
}

/* Compares each edit with all before it: one that is put in at the same place may be between. */
static void check_all_edits(schema *self, yaml_node_t *list, const campaign *c)
{
    size_t order[CAMPAIGN_FACTORS_MAX];
    size_t count = 0;
    uint64_t done = 0;
    for (size_t i; (i = variant_next_edit(c, done)) != SIZE_MAX; done |= UINT64_C(1) << i) {
        for (size_t k = 0; k < count; k++)
            check_edits(self, list, c, order[k], i);
        order[count++] = i;
    }
}

/* Finds the places of the rules of spaces. Complains, at entries of the list of factors, about
 * values that would be put into each other. */
static void campaign_place_edits(schema *self, yaml_node_t *list, campaign_owner *o)
{
    place_spaces(self, list, o);
    check_all_edits(self, list, &o->campaign);
}

/* ---- Names and paths ------------------------------------------------------------------------- */

/* The name becomes a key of rows and a part of names of rules. */
static void factors_read_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                  "_.-";
    reading *r = object;
    const char *text = schema_text(self, key, value, "a name");
    if (text && (strlen(text) > NAME_MAX_BYTES || text[strspn(text, letters)] != '\0'))
        schema_expected(self, key, value, "up to 64 letters, digits, '_', '.' and '-'");
    else if (text)
        r->factor->name = schema_copy(self, text);
}

/* Reads the path of the value that varies, and finds its place in the text of the scenario. It is
 * the name of the factor, too, unless that has one. */
static void read_set(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    factor *f = r->factor;
    const campaign *c = &r->owner->campaign;
    const char *text = schema_text(self, key, value, "the path of a value, such as bus.bitrate");
    if (!text || !r->owner->has_document)
        return;
    f->path = schema_copy(self, text);
    f->is_seed = strcmp(text, "seed") == 0;
    if (!f->name)
        f->name = f->path;
    if (f->is_seed && !r->owner->config)
        return; /* the seeds of a rig are in the files of its buses */
    const splice_text t = {.text = c->text, .size = c->size, .document = &r->owner->document,
                           .memory = self->arena};
    const char *wrong = splice_find(&f->edit, &t, text, &f->rule_names[0]);
    if (wrong)
        schema_complain(self, value, "%s: '%s': %s", key->name, text, wrong);
}

/* Reads a frame. *has says if there is a good one: a frame of zeros is good, too. */
static void parse_frame(schema *self, const schema_key *key, const yaml_node_t *value,
                        cw_frame *frame, bool *has)
{
    const char *text = schema_text(self, key, value, "a frame such as 123#DEADBEEF");
    const char *wrong = text ? text_parse_frame(frame, text) : NULL;
    schema_problem(self, key, value, wrong);
    *has = text && !wrong;
}

static void factors_read_frame(schema *self, const schema_key *key, yaml_node_t *value,
                               void *object)
{
    reading *r = object;
    parse_frame(self, key, value, &r->frame, &r->has_frame);
}

/* ---- Lists ----------------------------------------------------------------------------------- */

static const char *as_json(const reading *r, schema *self, const yaml_node_t *value)
{
    return jsonvalue_of(self, value, &r->owner->json_left);
}

/* Makes the list the values of the factor. One whose values are all pruned has none to run. */
static void take_list(reading *r, schema *self, const yaml_node_t *value, const space_list *list)
{
    factor *f = r->factor;
    f->kind = FACTOR_LIST;
    f->texts = list->texts;
    f->count = list->count;
    f->pruned = list->pruned;
    if (list->too_many)
        schema_complain(self, value, "a factor has at most %u values", CAMPAIGN_VALUES_MAX);
    else if (list->no_memory)
        schema_complain(self, value, "out of memory");
    else if (list->count == 0 && list->pruned > 0)
        schema_complain(self, value, "all its values are pruned");
}

/* Values are any of YAML. They are kept as JSON, the form that the scenario and the rows get. */
static void read_values(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    space_list list = {.memory = self->arena};
    const size_t count = schema_count(self, key, value, 1, CAMPAIGN_VALUES_MAX);
    r->kinds++;
    for (size_t i = 0; i < count; i++) {
        const char *text = as_json(r, self, schema_item(self, value, i));
        if (text)
            space_add(&list, text);
    }
    take_list(r, self, value, &list);
}

/* Takes positions and patterns of them. Those that the frame of the factor lacks are pruned. */
static void read_positions(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    space_list list = {.memory = self->arena};
    const size_t count = schema_count_one(self, key, value, 1, CAMPAIGN_VALUES_MAX);
    r->kinds++;
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = schema_item(self, value, i);
        const char *text = schema_text(self, key, item, "a position such as crc[3]");
        if (text)
            schema_problem(self, key, item,
                           space_add_positions(&list, text, r->has_frame ? &r->frame : NULL));
    }
    take_list(r, self, value, &list);
}

static bool is_all(const yaml_node_t *value)
{
    return value->type == YAML_SCALAR_NODE &&
           strcmp((const char *)value->data.scalar.value, "all") == 0;
}

/* Complains about a node that does not exist. Returns its number, or CW_NO_NODE. */
static uint8_t factors_find_node(schema *self, const schema_key *key, const yaml_node_t *value,
                                 const char *name)
{
    const campaign_owner *o = self->user;
    const uint8_t node = o->config ? cfg_find_node(o->config, name) : CW_NO_NODE;
    if (o->config && node == CW_NO_NODE)
        schema_complain(self, value, "%s: the scenario has no node '%s'", key->name, name);
    else if (!o->config)
        schema_complain(self, value, "%s: it is for the file of one bus", key->name);
    return node;
}

static const char *quoted_text(arena *memory, const char *text)
{
    buffer quoted = {.data = NULL};
    jsontext_quoted(&quoted, text);
    return jsontext_keep(&quoted, memory);
}

/* Takes names of nodes, or `all` for those of the scenario in its order. */
static void read_nodes(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    const cfg *config = r->owner->config;
    space_list list = {.memory = self->arena};
    r->kinds++;
    if (!config && is_all(value))
        schema_complain(self, value, "%s: it is for the file of one bus", key->name);
    for (size_t i = 0; config && is_all(value) && i < config->node_count; i++)
        space_add(&list, quoted_text(self->arena, config->nodes[i].name));
    const size_t count =
        is_all(value) ? 0 : schema_count_one(self, key, value, 1, CW_NODES_MAX);
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = schema_item(self, value, i);
        const char *text = schema_text(self, key, item, "the name of a node, or all");
        if (text && factors_find_node(self, key, item, text) != CW_NO_NODE)
            space_add(&list, quoted_text(self->arena, text));
    }
    take_list(r, self, value, &list);
}

/* ---- Numbers --------------------------------------------------------------------------------- */

/* A number is decimal and exact; its unit is any that the scenario takes there. */
static void factors_read_number(schema *self, const schema_key *key, yaml_node_t *value,
                                void *object)
{
    const char *text = schema_text(self, key, value, "a number, perhaps with a unit");
    if (text && !number_text_parse(schema_member(key, object), text))
        schema_expected(self, key, value,
                        "a number such as -50, 0.25 or 12.5us, of up to 15 digits");
}

/* Reads a map of three numbers. */
static bool read_numbers(schema *self, const schema_key *key, yaml_node_t *value, reading *r,
                         factor_kind kind)
{
    factor f = {.step = {.mantissa = 0}};
    const size_t errors = self->errors->errors;
    r->kinds++;
    r->factor->kind = kind;
    schema_map(self, key->name, value, key->map, &f);
    if (self->errors->errors > errors)
        return false;
    if (!number_text_align((number_text *const[]){&f.from, &f.to, &f.step}, 3)) {
        schema_complain(self, value, "%s: the numbers have different units, other than ns, us, ms "
                        "and s, or too many digits",
                        key->name);
        return false;
    }
    r->factor->from = f.from;
    r->factor->to = f.to;
    r->factor->step = f.step;
    r->factor->count = f.count;
    if (f.step.mantissa > 0)
        return true;
    schema_complain(self, value, "%s: 'step' is more than 0", key->name);
    return false;
}

/* Counts the values of a range, `from` and each step up to `to`. */
static void read_range(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    factor *f = r->factor;
    if (!read_numbers(self, key, value, r, FACTOR_RANGE))
        return;
    if (f->to.mantissa < f->from.mantissa)
        schema_complain(self, value, "%s: 'to' is below 'from'", key->name);
    else
        f->count = (uint64_t)((f->to.mantissa - f->from.mantissa) / f->step.mantissa) + 1;
}

/* A drawn factor has no number of values by itself; samples that combine values need one. */
static void check_draws(schema *self, const schema_key *key, const yaml_node_t *value, reading *r)
{
    const campaign_sample sample = r->owner->campaign.sample;
    const bool product = sample == SAMPLE_FULL || sample == SAMPLE_PAIRWISE;
    if (product && r->factor->count == 0)
        schema_complain(self, value, "%s: 'draws' says how many values there are; only a random or "
                        "low-discrepancy sample needs none", key->name);
    r->factor->count = r->factor->count > 0 ? r->factor->count : 1;
}

/* Values are drawn from `from` to `to` in whole steps. */
static void read_uniform(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    if (!read_numbers(self, key, value, r, FACTOR_UNIFORM))
        return;
    if (r->factor->to.mantissa < r->factor->from.mantissa)
        schema_complain(self, value, "%s: 'to' is below 'from'", key->name);
    check_draws(self, key, value, r);
}

/* `from` is the mean and `to` the deviation, which may be 0. */
static void read_normal(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    reading *r = object;
    if (!read_numbers(self, key, value, r, FACTOR_NORMAL))
        return;
    if (r->factor->to.mantissa < 0)
        schema_complain(self, value, "%s: 'deviation' is not below 0", key->name);
    check_draws(self, key, value, r);
}

/* ---- Spaces of faults ------------------------------------------------------------------------ */

static void read_space_frame(schema *self, const schema_key *key, yaml_node_t *value,
                             void *object)
{
    space_map *m = object;
    parse_frame(self, key, value, &m->frame, &m->has_frame);
}

/* The sender must be a node of the scenario. Rules have its name, as JSON. */
static void read_space_from(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    space_map *m = object;
    const char *text = schema_text(self, key, value, "the node that sends the frames");
    m->from = text ? factors_find_node(self, key, value, text) : CW_NO_NODE;
    if (m->from != CW_NO_NODE)
        m->space.from = as_json(m->reading, self, value);
}

/* Reads the nodes that sample the faulty bits. They are kept only when all of them exist. */
static void read_space_at(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    space_map *m = object;
    const size_t errors = self->errors->errors;
    const size_t count = schema_count_one(self, key, value, 1, CW_NODES_MAX);
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = schema_item(self, value, i);
        const char *text = schema_text(self, key, item, "the name of a node");
        if (text)
            (void)factors_find_node(self, key, item, text);
    }
    if (self->errors->errors == errors)
        m->space.at = as_json(m->reading, self, value);
}

static void read_space_field(schema *self, const schema_key *key, yaml_node_t *value,
                             void *object)
{
    space_map *m = object;
    m->field = schema_text(self, key, value, "a field such as crc");
}

/* Returns true when an earlier entry sends the same identifier. */
static bool is_sent_before(const cfg_node *node, size_t entry)
{
    const cw_frame *frame = &node->traffic[entry].frame;
    for (size_t i = 0; i < entry; i++)
        if (node->traffic[i].kind == CFG_TRAFFIC_SEND && node->traffic[i].frame.id == frame->id &&
            ((node->traffic[i].frame.flags ^ frame->flags) & CW_FRAME_EXTENDED) == 0)
            return true;
    return false;
}

/* The lists of a space. */
typedef struct space_lists {
    space_list values;
    space_list rules;
    bool pairs;
} space_lists;

/* Adds the faults of a frame, of one bit or of two each. */
static const char *add_frame(space_lists *l, const space_map *m, const cw_frame *frame)
{
    if (l->pairs)
        return space_add_pairs(&l->values, &l->rules, &m->space, frame, m->field);
    space_add_bits(&l->values, &l->rules, &m->space, frame);
    return NULL;
}

/* Adds the faults of the frame, or of all frames that the node sends. */
static const char *add_frames(space_lists *l, const space_map *m)
{
    const campaign_owner *o = m->reading->owner;
    const char *wrong = NULL;
    if (m->has_frame)
        return add_frame(l, m, &m->frame);
    if (m->from == CW_NO_NODE)
        return "it needs 'frame', or 'from' with a node that has traffic";
    const cfg_node *node = &o->config->nodes[m->from];
    for (size_t i = 0; i < node->traffic_count && !wrong && !l->values.too_many; i++)
        if (node->traffic[i].kind == CFG_TRAFFIC_SEND && !is_sent_before(node, i))
            wrong = add_frame(l, m, &node->traffic[i].frame);
    return wrong || l->values.count > 0 ? wrong : "the node of 'from' sends no frames";
}

/* Reads a space of faults: each value of the factor has a rule of its own, or two for a pair of
 * bits. It needs the nodes of one bus. */
static void read_space(schema *self, const schema_key *key, yaml_node_t *value, reading *r,
                       bool pairs)
{
    factor *f = r->factor;
    space_map m = {.reading = r, .from = CW_NO_NODE};
    space_lists l = {.values.memory = self->arena, .rules.memory = self->arena, .pairs = pairs};
    r->kinds++;
    m.space.name = f->name ? f->name : key->name;
    schema_map(self, key->name, value, space_keys, &m);
    if (strlen(m.space.name) > RULE_NAME_BYTES - 2 || !r->owner->config)
        schema_complain(self, value, "%s: it needs the file of one bus, and a short name",
                        key->name);
    else if (!pairs && m.field)
        schema_complain(self, value, "%s: 'field' is for pairs-of-bits", key->name);
    else if (pairs && !schema_find(self, value, "at"))
        schema_complain(self, value, "%s: it needs 'at', the nodes that sample the bits: on the "
                        "wire the sender stops at the first one", key->name);
    else if (value->type == YAML_MAPPING_NODE)
        schema_problem(self, key, value, add_frames(&l, &m));
    take_list(r, self, value, &l.values);
    f->name = f->name ? f->name : key->name;
    f->rules = l.rules.texts;
    f->rule_names[0] = pairs ? schema_print(self, "%s.1", f->name) : f->name;
    f->rule_names[1] = pairs ? schema_print(self, "%s.2", f->name) : NULL;
}

static void read_bits(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    read_space(self, key, value, object, false);
}

static void read_pairs(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    read_space(self, key, value, object, true);
}

/* ---- All factors ----------------------------------------------------------------------------- */

/* A seed is a whole number. */
static bool is_seed_value(const char *text)
{
    uint64_t seed;
    return !text_parse_uint(&seed, text);
}

/* A seed is a whole number, so nothing that draws fractions or has units may vary it. */
static void check_seed(schema *self, const yaml_node_t *item, const factor *f)
{
    bool good = f->kind == FACTOR_LIST || (f->from.decimals == 0 && !f->from.unit[0] &&
                                           f->from.mantissa >= 0 && f->kind != FACTOR_NORMAL);
    for (uint64_t i = 0; f->kind == FACTOR_LIST && i < f->count; i++)
        good = good && is_seed_value(f->texts[i]);
    if (!good)
        schema_complain(self, item, "seeds are whole numbers from 0 on");
}

/* A factor has one kind of values, a place for them, and a name that no earlier one has. */
static void check_factor(schema *self, const yaml_node_t *item, const reading *r, size_t index)
{
    const factor *f = r->factor;
    const factor *all = r->owner->campaign.factors;
    if (r->kinds != 1)
        schema_complain(self, item, "expected one of values, range, uniform, normal, positions, "
                        "nodes, each-bit and pairs-of-bits");
    else if (!f->path == !f->rules)
        schema_complain(self, item, f->path ? "a space of faults has no 'set'"
                                            : "expected 'set', the path of what varies");
    for (size_t i = 0; i < index && f->name; i++)
        if (all[i].name && strcmp(all[i].name, f->name) == 0)
            schema_complain(self, item, "duplicate factor '%s'", f->name);
    if (f->is_seed && r->kinds == 1)
        check_seed(self, item, f);
}

/* Reads all factors, then checks the names of rules and places of values, which concern several of
 * them. */
void campaign_read_factors(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    campaign_owner *o = object;
    const size_t count = schema_count(self, key, value, 1, CAMPAIGN_FACTORS_MAX);
    if (!o->has_document)
        return;
    o->campaign.factor_count = count;
    for (size_t i = 0; i < count; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        reading r = {.owner = o, .factor = &o->campaign.factors[i]};
        r.factor->place = (cfg_place){.line = (int)item->start_mark.line + 1,
                                      .column = (int)item->start_mark.column + 1};
        schema_map(self, "factor", item, campaign_factor_keys, &r);
        if (item->type == YAML_MAPPING_NODE)
            check_factor(self, item, &r, i);
    }
    names_check_rules(self, value, o);
    campaign_place_edits(self, value, o);
}
