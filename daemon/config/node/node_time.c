/* SPDX-License-Identifier: MIT
 *
 * node_time.c - the clock, the bit timing and the place of each node (T1, T2).
 */
#include "config/parts.h"

#include "config/change/live.h"
#include "config/node/phases.h"
#include "config/change/retime.h"
#include "config/change/reway.h"
#include "config/values.h"

#include <inttypes.h>
#include <string.h>

#define RATE_ERROR_INVERSE 100u /* a larger one than 1 % is worth a warning */

/* ---- Values ---------------------------------------------------------------------------------- */

/* Reads permille, from 100 to 999. */
void cfg_read_sample_point(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a part of the bit such as 87.5%");

    if (text)
        schema_problem(self, key, value,
                       text_parse_sample_point(schema_member(key, object), text));
}

/* Reads Hz. A wrong value leaves the default, so that segments can still be found. */
void cfg_read_clock(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    uint64_t hz = CFG_CLOCK_DEFAULT_HZ;
    const char *text = schema_text(self, key, value, "a frequency such as 16MHz");
    const char *problem = text ? text_parse_frequency(&hz, text) : NULL;

    schema_problem(self, key, value, problem);
    if (!cfg_clock_valid(hz))
        schema_expected(self, key, value, CFG_CLOCK_RANGE);
    else
        node->time.phase[0].bit.clock_hz = (uint32_t)hz;
}

/* A positive error is a fast clock. */
void cfg_read_ppm(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    const char *text = schema_text(self, key, value, CFG_PPM_RANGE);

    if (text && !cfg_parse_ppm(&node->time.ppm, text))
        schema_expected(self, key, value, CFG_PPM_RANGE);
}

/* Reads mm. A wrong length becomes 0, so that it causes no further complaint. */
void cfg_read_length(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *mm = schema_member(key, object);
    const char *text = schema_text(self, key, value, "a length such as 12m");

    if (text)
        schema_problem(self, key, value, text_parse_length(mm, text));
    if (*mm > CFG_LENGTH_MAX_MM) {
        schema_expected(self, key, value, CFG_LENGTH_RANGE);
        *mm = 0;
    }
}

const schema_key cfg_edge_keys[] = {
    {.name = "dominant", .read = cfg_read_fine, .offset = CW_DOMINANT * sizeof(cw_span),
     .required = true},
    {.name = "recessive", .read = cfg_read_fine, .offset = CW_RECESSIVE * sizeof(cw_span),
     .required = true},
    {.name = NULL},
};

/* Reads a delay: one time, or one for each kind of edge. */
void cfg_read_edge_delays(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_span *delays = schema_member(key, object);

    if (value->type == YAML_MAPPING_NODE) {
        schema_map(self, key->name, value, cfg_edge_keys, delays);
        return;
    }
    cfg_read_fine(self, key, value, object);
    delays[1] = delays[0];
}

/* ---- Bit timing ------------------------------------------------------------------------------ */

/* Returns the value of the first of these keys that the node has, or the node. */
static yaml_node_t *node_time_place_of(schema *self, yaml_node_t *item, const char *const *names)
{
    yaml_node_t *found = NULL;

    for (; !found && *names; names++)
        found = schema_find(self, item, *names);
    return found ? found : item;
}

/* Completes the segments that keys give. */
static void use_segments(schema *self, yaml_node_t *item, cfg_node_time *time)
{
    char problem[TIMING_PROBLEM_MAX];

    if (!cfg_fit_phase(time, 0, problem)) {
        const char *const first = schema_print(self, "%.*s", (int)strcspn(problem, " "), problem);
        const char *const names[] = {first, NULL};
        schema_complain(self, node_time_place_of(self, item, names), "%s", problem);
    }
}

/* Finds segments as Linux does. */
static void find_segments(schema *self, yaml_node_t *item, cfg_node_time *time)
{
    static const char *const names[] = {"sjw", "sample-point", "controller", "clock", NULL};
    char problem[TIMING_PROBLEM_MAX];

    if (!cfg_find_phase(time, 0, problem, cfg_of(self)))
        schema_complain(self, node_time_place_of(self, item, names), "%s", problem);
}

/* Warns about a bit rate that is far from the bus's. */
static void check_rate(schema *self, yaml_node_t *item, const bit_timing *bit)
{
    static const char *const names[] = {"brp", "clock", NULL};
    const uint64_t bus = cfg_of(self)->bitrate_bps * timing_bit_clocks(bit);
    const uint64_t error = bus > bit->clock_hz ? bus - bit->clock_hz : bit->clock_hz - bus;

    if (error * RATE_ERROR_INVERSE > bus)
        schema_warn(self, node_time_place_of(self, item, names),
                    "the node's bit rate is %" PRIu32 " bit/s, the bus has %" PRIu32,
                    timing_bitrate_bps(bit), cfg_of(self)->bitrate_bps);
}

/* Finds the nominal bit timing of a node: by segments that are given, or by its sample point. */
static void complete_bit(schema *self, yaml_node_t *item, cfg_node_time *time)
{
    const size_t errors = self->errors->errors;
    bit_timing *bit = &time->phase[0].bit;

    cfg_check_together(self, item, "");
    if (self->errors->errors > errors)
        return;
    if (bit->clock_hz == 0)
        bit->clock_hz = CFG_CLOCK_DEFAULT_HZ;
    if (cfg_gives_segments(self, item, ""))
        use_segments(self, item, time);
    else
        find_segments(self, item, time);
    if (self->errors->errors > errors)
        return;
    check_rate(self, item, bit);
    time->timing.bit = cfg_bit_timing(time, 0);
}

/* ---- All nodes ------------------------------------------------------------------------------- */

/* Returns true when a node, or `defaults`, has a key of time, but for those of the data phase. */
static bool uses_time(schema *self, const yaml_node_t *map)
{
    const cfg_walk *walk = self->user;

    for (const schema_key *key = walk->node_keys; key->name; key++) {
        const yaml_node_t *const value = schema_find(self, map, key->name);
        if (value && (key->read == cfg_read_controller ? !cfg_is_model(self, key->name, value)
                                                       : cfg_is_retime(key) && !cfg_is_data(key)))
            return true;
    }
    return false;
}

/* Returns true when a key says anything about time. */
static bool any_uses_time(schema *self, yaml_node_t *nodes)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;
    bool used = config->sample_permille > 0 || config->dbitrate_bps > 0 ||
                config->termination != CFG_TERMINATION_BOTH ||
                (walk->default_map && uses_time(self, walk->default_map));

    for (size_t i = 0; i < config->node_count; i++)
        used = used || uses_time(self, cfg_node_map(self, nodes, i));
    return used;
}

/* Completes the time of a node. The data phase comes after the nominal bit, whose clock it
 * shares. */
static void complete_node(schema *self, yaml_node_t *item, cfg_node *node)
{
    const uint64_t ps_per_m = cfg_of(self)->line_ps_per_m;
    const size_t errors = self->errors->errors;
    cfg_node_time *time = &node->time;

    time->used = true;
    if (!time->limits)
        time->limits = timing_controller("any");
    complete_bit(self, item, time);
    if (self->errors->errors == errors)
        cfg_complete_data(self, item, node);
    time->timing.place = cfg_span_of_way(time->position_mm, ps_per_m);
    time->timing.stub = cfg_span_of_way(time->stub_mm, ps_per_m);
}

/* Completes the time of all nodes, once one of them has keys of time. */
static void complete_nodes(schema *self, yaml_node_t *nodes)
{
    const cfg_walk *walk = self->user;
    cfg *config = walk->config;
    const size_t errors = self->errors->errors;

    if (walk->default_map)
        cfg_check_together(self, walk->default_map, "");
    if (self->errors->errors > errors)
        return;
    for (size_t i = 0; i < config->node_count; i++)
        complete_node(self, cfg_node_map(self, nodes, i), &config->nodes[i]);
    cfg_add_ringing(self, nodes);
}

/* Without any key of time all nodes have the bits of the bus. */
static void complete_time(schema *self, yaml_node_t *nodes)
{
    const size_t errors = self->errors->errors;

    if (errors > 0)
        return;
    cfg_check_fd(self, nodes);
    if (self->errors->errors == 0 && any_uses_time(self, nodes))
        complete_nodes(self, nodes);
    if (self->errors->errors == errors)
        cfg_check_limits(self, nodes, true);
    if (self->errors->errors == errors)
        cfg_check_pairs(self, nodes);
}

void cfg_complete_time(schema *self, yaml_node_t *nodes)
{
    cfg_walk *walk = self->user;

    complete_time(self, nodes);
    walk->untimed = self->errors->errors > 0;
}
