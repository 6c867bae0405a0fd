/* SPDX-License-Identifier: MIT
 *
 * action_time.c - the actions that act for parts of bits: pulses, jitter, clocks that drift.
 */
#include "base/text/counted.h"
#include "config/change/live.h"
#include "config/parts.h"
#include "config/change/retime.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <string.h>

#define PPM_MAX 100000 /* either way */

static schema_reader read_offset, read_place, read_ppm_range, read_jitter;

#define PULSE_OFFSET_BITS 16 /* as the library takes them */

#define MEMBER(m) .offset = offsetof(cw_rule, m)

const schema_key cfg_pulse_keys[] = {
    {.name = "pulse", .read = cfg_read_level, .type = TYPE_CHOICE, .arg = cfg_levels,
     .help = "A pulse of this level, so long after the begin of the bit."},
    {.name = "from", .read = cfg_read_position,
     .help = "The bit of the frame in which it comes. Without: the next bit time of the bus; "
             "then the rule must not wait for frames."},
    {.name = "offset", .read = read_offset,
     .type = TYPE_ANY(TYPE_TEXT("^[0-9.]+%$") ", " TYPE_REF("time")), .preset = "0",
     .help = "From the begin of the bit: a part of it such as `30%`, or a time, at most 16 bits."},
    {.name = "for", .read = cfg_read_fine_min, MEMBER(pulse_length), .required = true,
     .help = "How long it lasts, exactly."},
    {.name = "at", .read = read_place, .type = TYPE_ANY(TYPE_REF("line") ", " TYPE_REF("nodeSet")),
     .help = "`wire`, the line of one controller (`NODE.tx`, `NODE.rx`), or nodes: only what these "
             "see changes. Default: the wire."},
    {.name = NULL},
};

const schema_key cfg_jitter_keys[] = {
    {.name = "jitter", .read = read_jitter, MEMBER(jitter), .type = "span",
     .help = "Edges come up to so late, each one another time; at most a bit."},
    {.name = "at", .read = cfg_read_node_set, MEMBER(nodes), .required = true,
     .help = "The nodes whose edges these are."},
    {.name = "for", .read = cfg_read_bits, MEMBER(for_ticks),
     .help = "How long it lasts; 0, or without: until the rule's window of time ends or the rule "
             "is cleared."},
    {.name = NULL},
};

/* The keys of `ramp: { ... }`. */
const schema_key cfg_ramp_keys[] = {
    {.name = "ppm", .read = read_ppm_range, .required = true,
     .type = "{'type': 'string', 'pattern': '^-?[0-9]+\\.\\.-?[0-9]+$'}",
     .help = "Its error at the begin and at the end, in millionths; a positive one is fast."},
    {.name = "over", .read = cfg_read_ticks_min, MEMBER(for_ticks), .required = true,
     .help = "The time from begin to end; the clock stays as it is then."},
    {.name = NULL},
};

/* ---- Pulses and jitter ----------------------------------------------------------------------- */

/* Complains about a time of more bits than the library takes. A profile that is checked alone has
 * no bits. */
static void check_bits(schema *self, const schema_key *key, const yaml_node_t *value, cw_span span,
                       unsigned bits)
{
    const cfg_walk *walk = self->user;
    const cw_rate rate = walk->config->rate;
    const uint64_t most = cw_rate_ticks(rate, 1);

    if (walk->any_node || most == 0 || most > INT32_MAX || span / bits <= (cw_span)most * CW_TICK)
        return;
    schema_complain(self, value, "%s: at most %s, %" PRIu64 " ns at this bit rate", key->name,
                    counted(bits, "bit").text, text_ticks_ns(cw_rate_ticks(rate, bits)));
}

/* The library delays an edge by a bit at most. */
static void read_jitter(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cw_rule *rule = object;

    cfg_read_fine_min(self, key, value, object);
    check_bits(self, key, value, rule->jitter, 1);
}

/* Reads a part of the bit, such as 30%, or a time. */
static void read_offset(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a part of a bit such as 30%, or a time");
    const size_t length = text ? strlen(text) : 0;
    cfg_time time = {0};

    if (length > 0 && text[length - 1] == '%')
        schema_problem(self, key, value, text_parse_percent(&rule->pulse_permille, text));
    else if (text)
        schema_problem(self, key, value, text_parse_time(&time, text));
    rule->pulse_offset = text_time_fine(time, cfg_of(self)->rate);
    check_bits(self, key, value, rule->pulse_offset, PULSE_OFFSET_BITS);
}

static bool ends_with(const char *text, const char *end)
{
    const size_t length = strlen(text);
    return length > strlen(end) && strcmp(text + length - strlen(end), end) == 0;
}

/* Reads wire, NODE.tx, NODE.rx or nodes. A node may have such a name. */
static void read_place(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = value->type == YAML_SCALAR_NODE ? (const char *)value->data.scalar.value
                                                       : "";
    const cfg_walk *walk = self->user;
    const bool line = ends_with(text, ".tx") || ends_with(text, ".rx") ||
                      strcmp(text, "wire") == 0;

    if (line && cfg_find_node(walk->config, text) == CW_NO_NODE)
        cfg_read_line(self, key, value, object);
    else
        cfg_read_node_set(self, &(schema_key){.name = key->name, MEMBER(at)}, value, object);
}

/* ---- Bit timings ----------------------------------------------------------------------------- */

/* Delays of a rule that sets. */
typedef struct edge_delays {
    cfg_time time[2];
} edge_delays;

static schema_reader read_edge_delay;

static const schema_key edge_keys[] = {
    {.name = "dominant", .read = read_edge_delay, .offset = CW_DOMINANT * sizeof(cfg_time),
     .required = true,
     .type = "time"},
    {.name = "recessive", .read = read_edge_delay, .offset = CW_RECESSIVE * sizeof(cfg_time),
     .required = true,
     .type = "time"},
    {.name = NULL},
};

/* Checks the delay of one kind of edge. The text is read again when all keys are there. */
static void read_edge_delay(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, CFG_DELAY_RANGE);

    if (text && !cfg_parse_delay(schema_member(key, object), text))
        schema_expected(self, key, value, CFG_DELAY_RANGE);
}

/* Reads a key of `set` about time. cfg_complete_retime() takes all of them together. */
void cfg_read_retime(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    char problem[RETIME_PROBLEM_MAX];
    cfg_retime change = {.given = 0};
    edge_delays delays = {0};
    const cfg_live *live = cfg_live_of(key);

    (void)object;
    if (live->kind == CFG_LIVE_DELAYS && value->type == YAML_MAPPING_NODE) {
        schema_map(self, key->name, value, edge_keys, &delays);
        return;
    }
    const char *text = schema_text(self, key, value, "a text or a number");
    if (text && !cfg_retime_put(&change, problem, key, text))
        schema_complain(self, value, "%s", problem);
}

/* Puts the delays of a map, which has been checked. */
static void put_delays(schema *self, cfg_time delays[2], const yaml_node_t *map)
{
    for (unsigned level = 0; level < 2; level++) {
        const yaml_node_t *value = schema_find(self, map, edge_keys[level].name);
        if (value && value->type == YAML_SCALAR_NODE && !schema_is_open(self, value))
            (void)cfg_parse_delay(&delays[level], (const char *)value->data.scalar.value);
    }
}

/* Returns the keys of `set` about time. Those whose values are open are left out. */
static cfg_retime changes_of(schema *self, const yaml_node_t *map)
{
    char problem[RETIME_PROBLEM_MAX];
    cfg_retime change = {.given = 0};

    for (retime_key key = 0; key < RETIME_KEYS; key++) {
        const schema_key *row = cfg_retime_row(key);
        const yaml_node_t *value = schema_find(self, map, row->name);
        if (value && value->type == YAML_SCALAR_NODE && !schema_is_open(self, value))
            (void)cfg_retime_put(&change, problem, row, (const char *)value->data.scalar.value);
        if (!value || value->type != YAML_MAPPING_NODE)
            continue;
        put_delays(self, key == RETIME_TX_DELAY ? change.way.tx_delay : change.way.rx_delay, value);
        change.given |= 1u << key;
    }
    return change;
}

/* Compares all that a change of the data phase sets. */
static bool same_data(const cw_data_timing *a, const cw_data_timing *b)
{
    return a->brp == b->brp && a->data_brp == b->data_brp && a->bit.prop_seg == b->bit.prop_seg &&
           a->bit.phase_seg1 == b->bit.phase_seg1 && a->bit.phase_seg2 == b->bit.phase_seg2 &&
           a->bit.sjw == b->bit.sjw && a->tdc.mode == b->tdc.mode && a->tdc.tdco == b->tdc.tdco &&
           a->tdc.tdcv == b->tdc.tdcv;
}

/* Compares all that a change of the bit timing sets: one rule has room for one. */
static bool same_bits(const cw_settings *a, const cw_settings *b)
{
    const cw_bit_timing *s = &a->timing, *t = &b->timing;
    return a->which == b->which && s->quantum == t->quantum && s->prop_seg == t->prop_seg &&
           s->phase_seg1 == t->phase_seg1 && s->phase_seg2 == t->phase_seg2 && s->sjw == t->sjw &&
           s->triple_sampling == t->triple_sampling &&
           (!(a->which & CW_SET_DATA) || same_data(&a->data, &b->data));
}

/* A rule gives one bit timing to all of its nodes. Their bits are not known in a profile that is
 * checked alone, and after an error of the bus or a node. */
void cfg_complete_retime(schema *self, yaml_node_t *map, cw_rule *rule)
{
    const cfg_walk *walk = self->user;
    const cfg_retime change = changes_of(self, map);
    const bool known = !walk->any_node && !walk->untimed;
    cw_settings *all = &rule->settings;
    bool first = true;

    for (unsigned i = 0; change.given && known && i < walk->config->node_count; i++) {
        char problem[RETIME_PROBLEM_MAX];
        cfg_node_time time;
        cw_settings own = rule->settings;
        if (!(rule->nodes >> i & 1u))
            continue;
        if (!cfg_retime_node(&time, &own, problem, walk->config, i, &change)) {
            schema_complain(self, map, "set: %s", problem);
            return;
        }
        if (!first && !same_bits(all, &own)) {
            schema_complain(self, map, "set: the nodes of one rule have the same clock and bit "
                            "timing; use a rule for each other node");
            return;
        }
        *all = own;
        first = false;
    }
}

/* ---- Clocks that drift ----------------------------------------------------------------------- */

/* Reads one whole number of a range, from -PPM_MAX to PPM_MAX. Returns its end, or NULL. */
static const char *parse_ppm(int32_t *ppm, const char *text)
{
    const bool negative = *text == '-';
    uint64_t number;

    text += negative;
    if (!text_take_digits(&number, &text, PPM_MAX))
        return NULL;
    *ppm = negative ? -(int32_t)number : (int32_t)number;
    return text;
}

/* Reads the two errors of a clock, in ppm. cfg_complete_ramp() turns them into quanta. */
static void read_ppm_range(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a range such as 0..3000");
    int32_t from, to;

    if (!text)
        return;
    const char *end = parse_ppm(&from, text);
    end = end && strncmp(end, "..", 2) == 0 ? parse_ppm(&to, end + 2) : NULL;
    if (!end || *end != '\0') {
        schema_expected(self, key, value, "a range such as 0..3000, from -100000 to 100000 ppm");
        return;
    }
    rule->quantum_from = from;
    rule->quantum_to = to;
}

/* The rule is no longer one that sets: it has an action of its own. */
void cfg_read_ramp(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;

    schema_map(self, key->name, value, cfg_ramp_keys, rule);
    rule->action = CW_ACTION_RAMP;
}

/* All nodes of the rule get one quantum, so their clocks must be alike. */
void cfg_complete_ramp(schema *self, yaml_node_t *map, cw_rule *rule)
{
    const cfg *config = cfg_of(self);
    cw_span quantum = 0;

    for (unsigned i = 0; i < config->node_count; i++) {
        if (!(rule->nodes >> i & 1u))
            continue;
        const cw_span own = cfg_nominal_quantum(config, i);
        if (quantum && own != quantum) {
            schema_complain(self, map, "ramp: the nodes of one rule have the same clock and bit "
                            "timing; use a rule for each other node");
            return;
        }
        quantum = own;
    }
    rule->quantum_from = cfg_drifted(quantum, rule->quantum_from);
    rule->quantum_to = cfg_drifted(quantum, rule->quantum_to);
}
