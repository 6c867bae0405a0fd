/* SPDX-License-Identifier: MIT
 *
 * action_time.c - the actions that act for parts of bits: pulses, jitter, clocks that drift.
 */
#include "config/parts.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <string.h>

#define MILLION 1000000
#define PPM_MAX 100000 /* either way */

static schema_reader read_offset, read_place, read_ppm_range;

static const schema_choice levels[] = {
    {.name = "dominant", .value = CW_DOMINANT},
    {.name = "recessive", .value = CW_RECESSIVE},
    {.name = NULL},
};

static void read_level(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    unsigned level;

    if (schema_choose(self, &level, key, value, levels))
        rule->level = level;
}

#define MEMBER(m) .offset = offsetof(cw_rule, m)

const schema_key cfg_pulse_keys[] = {
    {.name = "pulse", .read = read_level},
    {.name = "from", .read = cfg_read_position},
    {.name = "offset", .read = read_offset},
    {.name = "for", .read = cfg_read_fine_min, MEMBER(pulse_length), .required = true},
    {.name = "at", .read = read_place},
    {.name = NULL},
};

const schema_key cfg_jitter_keys[] = {
    {.name = "jitter", .read = cfg_read_fine_min, MEMBER(jitter)},
    {.name = "at", .read = cfg_read_node_set, MEMBER(nodes), .required = true},
    {.name = "for", .read = cfg_read_bits, MEMBER(for_ticks)},
    {.name = NULL},
};

/* The keys of `ramp: { ... }`. */
static const schema_key ramp_keys[] = {
    {.name = "ppm", .read = read_ppm_range, .required = true},
    {.name = "over", .read = cfg_read_ticks_min, MEMBER(for_ticks), .required = true},
    {.name = NULL},
};

/* ---- Pulses ---------------------------------------------------------------------------------- */

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

/* ---- Clocks that drift ----------------------------------------------------------------------- */

/* Reads one whole number of a range, from -PPM_MAX to PPM_MAX. Returns its end, or NULL. */
static const char *parse_ppm(int32_t *ppm, const char *text)
{
    const bool negative = *text == '-';
    int32_t number = 0;

    text += negative;
    if (*text < '0' || *text > '9')
        return NULL;
    for (; *text >= '0' && *text <= '9' && number <= PPM_MAX; text++)
        number = 10 * number + (*text - '0');
    *ppm = negative ? -number : number;
    return number <= PPM_MAX ? text : NULL;
}

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

void cfg_read_ramp(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;

    schema_map(self, key->name, value, ramp_keys, rule);
    rule->action = CW_ACTION_RAMP;
}

static cw_span drifted(cw_span quantum, cw_span ppm)
{
    return quantum - quantum / (MILLION + ppm) * ppm;
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
    rule->quantum_from = drifted(quantum, rule->quantum_from);
    rule->quantum_to = drifted(quantum, rule->quantum_to);
}
