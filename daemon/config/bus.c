/* SPDX-License-Identifier: MIT
 *
 * bus.c - the keys of `bus`: its name, its bit rates and its line.
 */
#include "config/parts.h"

#include "config/values.h"

#include <inttypes.h>

#define BITRATE_MIN 5000u
#define BITRATE_MAX 1000000u
#define DBITRATE_MAX 10000000u
#define LINE_PS_MAX 100000u /* of a metre */
#define BITRATE_ERROR_INVERSE 1000u /* the used rate differs by at most 1/1000 */

static schema_reader read_bus_name, read_bitrate, read_dbitrate, bus_read_line, read_line_delay;
static const schema_range bitrate_range = {BITRATE_MIN, BITRATE_MAX, sizeof(uint32_t)};

static const schema_range dbitrate_range = {BITRATE_MIN, DBITRATE_MAX, sizeof(uint32_t)};

static const schema_choice terminations[] = {
    {.name = "both", .value = CFG_TERMINATION_BOTH},
    {.name = "one", .value = CFG_TERMINATION_ONE},
    {.name = "none", .value = CFG_TERMINATION_NONE},
    {.name = NULL},
};

static const schema_choice starts[] = {
    {.name = "bit", .value = CFG_START_BIT},
    {.name = "tick", .value = CFG_START_TICK},
    {.name = NULL},
};

static const schema_key line_keys[] = {
    {.name = "delay", .read = read_line_delay, .offset = offsetof(cfg, line_ps_per_m),
     .required = true,
     .type = "{'type': 'string', 'pattern': '^(?:0|[1-9][0-9]*)(?:\\.[0-9]+)?(?:ps|ns)/m$', "
             "'examples': ['5ns/m']}", .preset = "5ns/m",
     .help = "Of a metre."},
    {.name = NULL},
};

const schema_key cfg_bus_keys[] = {
    {.name = "name", .read = read_bus_name, .type = "name", .preset = "can",
     .help = "Names LCM channels and the control socket."},
    {.name = "bitrate", .read = read_bitrate, .offset = offsetof(cfg, bitrate_bps),
     .arg = &bitrate_range, .required = true,
     .type = TYPE_UINT,
     .help = "In bit/s; within 0.1 % of 80 MHz / n."},
    {.name = "sample-point", .read = cfg_read_sample_point,
     .offset = offsetof(cfg, sample_permille),
     .help = "Of all nodes that do not say it themselves. Default: what Linux takes for the bit "
             "rate."},
    {.name = "dbitrate", .read = read_dbitrate, .offset = offsetof(cfg, dbitrate_bps),
     .arg = &dbitrate_range,
     .type = TYPE_UINT,
     .help = "Of the data phase of CAN FD frames, in bit/s; at least bitrate."},
    {.name = "dsample-point", .read = cfg_read_sample_point,
     .offset = offsetof(cfg, dsample_permille),
     .needs = "dbitrate",
     .help = "In the data phase, of all nodes that do not say it themselves. Default: what Linux "
             "takes for the bit rate."},
    {.name = "fd-non-iso", .read = schema_read_bool, .offset = offsetof(cfg, fd_non_iso),
     .preset = "false",
     .help = "CAN FD frames have the format from before ISO 11898-1:2015."},
    {.name = "line", .read = bus_read_line, .map = line_keys,
     .help = "The line between the nodes, see position."},
    {.name = "termination", .read = schema_read_choice, .offset = offsetof(cfg, termination),
     .arg = terminations,
     .preset = "both",
     .help = "The terminators that are there. With `one`, or `none`, every node has one round "
             "trip along the line, or three, more of ringing."},
    {.name = "start", .read = schema_read_choice, .offset = offsetof(cfg, start), .arg = starts,
     .preset = "bit",
     .help = "A frame for a bus at rest waits for the next bit. With `tick` it begins when it is "
             "handed in, and the bits of all nodes with it."},
    {.name = NULL},
};

void cfg_bus_presets(schema *self, cfg *config)
{
    schema_read_presets(self, cfg_bus_keys, config);
    schema_read_presets(self, line_keys, config);
}

/* Reads the keys of the bus. A sample point of the data phase needs a data rate, which may follow
 * it. */
void cfg_read_bus(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, cfg_bus_keys, object);
    if (value->type != YAML_MAPPING_NODE || schema_find(self, value, "dbitrate"))
        return;
    const yaml_node_t *point = schema_find(self, value, "dsample-point");
    if (point)
        schema_complain(self, point, "dsample-point: the bus has no dbitrate, so it has no data "
                        "phase of its own");
}

/* Returns true when the bits of a node are those of another one and of the bus, and no edge is
 * late. */
static bool has_common_bits(const cfg *config, const cfg_node *node, const cfg_node *other)
{
    const cw_node_timing *t = &node->time.timing;
    const cw_bit_timing *a = &t->bit, *b = &other->time.timing.bit;
    const cw_span bit = (cw_span)cw_rate_ticks(config->rate, 1) * CW_TICK;
    const bool same = a->quantum == b->quantum && a->prop_seg == b->prop_seg &&
                      a->phase_seg1 == b->phase_seg1 && a->phase_seg2 == b->phase_seg2 &&
                      a->sjw == b->sjw && a->triple_sampling == b->triple_sampling;
    return same && (a->quantum == 0 || a->quantum * cw_bit_timing_quanta(a) == bit) &&
           t->tx_delay[0] == 0 && t->tx_delay[1] == 0 && t->rx_delay[0] == 0 &&
           t->rx_delay[1] == 0 && t->place == 0 && t->stub == 0 && t->ringing == 0;
}

void cfg_check_start(schema *self, const yaml_node_t *bus)
{
    const cfg *config = cfg_of(self);

    for (size_t i = 0; config->start == CFG_START_TICK && i < config->node_count; i++) {
        if (has_common_bits(config, &config->nodes[i], &config->nodes[0]))
            continue;
        schema_complain(self, schema_find(self, bus, "start"),
                        "start: 'tick' needs nodes with the same bits; %s has a clock, segments or "
                        "delays of its own", config->nodes[i].name);
        return;
    }
}

/* The name is a part of a socket's path and of channels, so it has the letters of names of
 * nodes. */
static void read_bus_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->bus_name_place = cfg_place_of(value);
    config->bus_name = cfg_read_name(self, key, value, NODE_NAME_MAX);
}

static void bus_read_line(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    schema_map(self, key->name, value, line_keys, object);
}

/* Reads the delay of a metre in ps, at most 100 ns. */
static void read_line_delay(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *ps = schema_member(key, object);
    const char *text = schema_text(self, key, value, "the delay of a metre such as 5ns/m");

    if (text)
        schema_problem(self, key, value, text_parse_line_delay(ps, text));
    if (*ps > LINE_PS_MAX)
        schema_complain(self, value, "%s: at most 100ns/m is allowed", key->name);
}

/* Returns true when a bit of ticks / CW_CLOCK_HZ is near enough to the rate. */
static bool is_near(uint32_t bitrate, uint32_t ticks)
{
    uint64_t product = (uint64_t)bitrate * ticks;
    uint64_t error = product > CW_CLOCK_HZ ? product - CW_CLOCK_HZ : CW_CLOCK_HZ - product;

    return error * BITRATE_ERROR_INVERSE <= product;
}

static uint32_t rounded_rate(uint32_t ticks)
{
    return (CW_CLOCK_HZ + ticks / 2) / ticks;
}

/* Reads the bit rate, of which a bit must be a whole number of ticks. */
static void read_bitrate(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->bitrate_place = cfg_place_of(value);
    schema_read_uint(self, key, value, object);
    if (config->bitrate_bps == 0)
        return;
    uint32_t fast = CW_CLOCK_HZ / config->bitrate_bps;
    uint32_t ticks = rounded_rate(config->bitrate_bps);
    if (is_near(config->bitrate_bps, ticks))
        config->rate = cw_rate_of(ticks);
    else
        schema_complain(self, value,
                        "%s: %" PRIu32 " is not within 0.1 %% of a rate that %u MHz can make; the "
                        "nearest are %" PRIu32 " and %" PRIu32,
                        key->name, config->bitrate_bps, CW_CLOCK_HZ / 1000000u,
                        rounded_rate(fast + 1), rounded_rate(fast));
}

/* Reads the rate of data phases, in the limits that the bit rate gives. */
static void read_dbitrate(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    schema_read_uint(self, key, value, object);
    const uint64_t most = UINT64_C(64) * config->bitrate_bps; /* a limit of the library */
    if (config->dbitrate_bps == 0 ||
        (config->dbitrate_bps >= config->bitrate_bps && config->dbitrate_bps <= most))
        return;
    schema_complain(self, value,
                    config->dbitrate_bps > most
                        ? "%s: a bit of the data phase lasts at least 1/64 of the others: %" PRIu32
                          " to %" PRIu64 " are allowed"
                        : "%s: the data phase is not slower than the rest of the frame: %" PRIu32
                          " to %" PRIu64 " are allowed",
                    key->name, config->bitrate_bps, most < DBITRATE_MAX ? most : DBITRATE_MAX);
}
