/* SPDX-License-Identifier: MIT
 *
 * node_data.c - CAN FD in nodes: their kind, and the bit timing of the data phase (D10, D13).
 */
#include "config/parts.h"

#include "config/change/live.h"
#include "config/node/phases.h"
#include "config/change/reway.h"
#include "config/values.h"

#include <inttypes.h>

#define RATE_ERROR_INVERSE 100u /* a larger one than 1 % is worth a warning */
#define SSP_BITS_MAX 6u         /* of the data phase, that M_CAN and others have room for */

static const char no_rate[] = "the bus has no data rate; bus: { dbitrate } gives it one";

/* ---- Kinds and keys -------------------------------------------------------------------------- */

/* Complains about the keys of a data phase that there is not. */
static void refuse_data_keys(schema *self, const yaml_node_t *item, const char *why)
{
    const cfg_walk *walk = self->user;

    for (const schema_key *key = walk->node_keys; key->name; key++) {
        const yaml_node_t *value = cfg_is_data(key) ? schema_find(self, item, key->name) : NULL;
        if (value)
            schema_complain(self, value, "%s: %s", key->name, why);
    }
}

/* `fd` and `kind` set the same member, so one map has one of them. */
static void check_kind(schema *self, const yaml_node_t *map)
{
    const yaml_node_t *fd = schema_find(self, map, "fd");

    if (fd && schema_find(self, map, "kind"))
        schema_complain(self, fd, "fd: kind says it, too; use one or the other");
}

/* Only nodes that see the bit after FDF can leave a frame by a protocol exception. */
static void check_exception(schema *self, const yaml_node_t *item, const cfg_node *node)
{
    const yaml_node_t *value = schema_find(self, item, "protocol-exception");

    if (value && node->kind != CFG_KIND_FD_TOLERANT && !cfg_knows_fd(cfg_of(self), node))
        schema_complain(self, value, "protocol-exception: a classical node has none; nodes of "
                        "kind fd-tolerant and fd have");
}

/* Checks the keys of compensation, which need each other. */
static void check_tdc(schema *self, const yaml_node_t *item, const cfg_node_time *time)
{
    const yaml_node_t *tdco = schema_find(self, item, "tdco");
    const yaml_node_t *tdcv = schema_find(self, item, "tdcv");

    if (tdco && time->tdc == CFG_TDC_OFF)
        schema_complain(self, tdco, "tdco: tdc-mode is off; auto or manual is needed");
    if (tdcv && time->tdc != CFG_TDC_MANUAL)
        schema_complain(self, tdcv, "tdcv: only tdc-mode manual has it; auto measures it");
    else if (time->tdc == CFG_TDC_MANUAL && time->tdcv == 0)
        schema_complain(self, item, "tdcv is missing: tdc-mode manual needs it, in clocks");
}

/* Checks keys of the data phase that a node has, before segments are sought. */
static void node_data_check_node(schema *self, const yaml_node_t *item, const cfg_node *node)
{
    const cfg *config = cfg_of(self);
    const bool knows_fd = cfg_knows_fd(config, node);

    check_kind(self, item);
    check_exception(self, item, node);
    if (!knows_fd)
        refuse_data_keys(self, item, "only a node of kind fd has a data phase");
    else if (config->dbitrate_bps == 0)
        refuse_data_keys(self, item, no_rate);
    else
        check_tdc(self, item, &node->time);
    cfg_check_together(self, item, "d");
}

/* Checks keys of `defaults` alone. Segments are sought for each node. */
static void check_defaults(schema *self, const yaml_node_t *map)
{
    check_kind(self, map);
    cfg_check_together(self, map, "d");
    if (cfg_of(self)->dbitrate_bps == 0)
        refuse_data_keys(self, map, no_rate);
}

void cfg_check_fd(schema *self, yaml_node_t *nodes)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;

    if (walk->default_map)
        check_defaults(self, walk->default_map);
    for (size_t i = 0; i < config->node_count; i++)
        node_data_check_node(self, cfg_node_map(self, nodes, i), &config->nodes[i]);
    if ((config->dbitrate_bps > 0 || config->fd_non_iso) && !cfg_has_fd(config))
        schema_complain(self, nodes, "nodes: none is of kind fd, so the bus has no use for %s",
                        config->dbitrate_bps > 0 ? "dbitrate" : "fd-non-iso");
}

/* ---- The data phase -------------------------------------------------------------------------- */

/* Returns the value of a key of the data phase that the node has, this one first, or the node. */
static yaml_node_t *node_data_place_of(schema *self, yaml_node_t *item, const char *first)
{
    const cfg_walk *walk = self->user;
    yaml_node_t *found = schema_find(self, item, first);

    for (const schema_key *key = walk->node_keys; !found && key->name; key++)
        if (cfg_is_data(key))
            found = schema_find(self, item, key->name);
    return found ? found : item;
}

/* Compares the data rate that the segments give with that of the bus. A small error is a
 * warning. */
static void check_rate(schema *self, yaml_node_t *item, const bit_timing *data)
{
    const uint32_t wanted = cfg_of(self)->dbitrate_bps;
    const uint64_t bus = wanted * timing_bit_clocks(data);
    const uint64_t error = bus > data->clock_hz ? bus - data->clock_hz : data->clock_hz - bus;

    if (timing_bit_clocks(data) * 64u * cfg_of(self)->bitrate_bps < data->clock_hz &&
        wanted <= UINT64_C(64) * cfg_of(self)->bitrate_bps)
        schema_complain(self, node_data_place_of(self, item, "dbrp"),
                        "a bit of the data phase lasts at least 1/64 of a bit of the bus; the "
                        "node's data bit rate is %" PRIu32 " bit/s",
                        timing_bitrate_bps(data));
    else if (error * RATE_ERROR_INVERSE > bus)
        schema_warn(self, node_data_place_of(self, item, "dbrp"),
                    "the node's data bit rate is %" PRIu32 " bit/s, the bus has %" PRIu32,
                    timing_bitrate_bps(data), wanted);
}

/* Checks that the secondary sample point is not further away than the library can look back. */
static void check_delay(schema *self, yaml_node_t *item, const cfg_node_time *time)
{
    const cw_tdc *tdc = &time->timing.data.tdc;
    const uint64_t most = CW_TDC_BITS_MAX * timing_bit_clocks(&time->phase[1].bit);

    if ((uint64_t)tdc->tdco + tdc->tdcv >= most)
        schema_complain(self, node_data_place_of(self, item, "tdco"),
                        "tdco and tdcv together are less than %u bits of the data phase, here "
                        "%" PRIu64 " clocks",
                        CW_TDC_BITS_MAX, most);
}

/* ---- The delay of the transmitter ------------------------------------------------------------ */

/* Without compensation a bit must be back before its sample point (D13, T12). */
static void warn_of_late_bits(schema *self, yaml_node_t *item, const cfg_late_sample *sample)
{
    if (sample->at <= sample->from)
        schema_warn(self, node_data_place_of(self, item, "tdc-mode"),
                    "without delay compensation the node cannot send at the data rate: its bits "
                    "come back after %" PRIu64 " ns, and are sampled after %" PRIu64
                    " ns; tdc-mode: auto measures the delay",
                    cfg_delay_of(sample->from).ns, cfg_delay_of(sample->at).ns);
}

/* Warns of secondary sample points that a controller cannot have. */
static void warn_of_offset(schema *self, yaml_node_t *item, const cfg_node_time *time,
                           const cfg_late_sample *sample)
{
    const uint32_t tdco = time->timing.data.tdc.tdco;
    const uint32_t held = timing_tdco_max(time->limits);
    const uint64_t late = sample->tdcv + tdco;
    const uint64_t most = SSP_BITS_MAX * timing_bit_clocks(&time->phase[1].bit);

    if (tdco > held)
        schema_warn(self, node_data_place_of(self, item, "tdco"),
                    "tdco: %s holds at most %" PRIu32 " clocks, not %" PRIu32, time->limits->name,
                    held, tdco);
    if (late >= most)
        schema_warn(self, node_data_place_of(self, item, "tdco"),
                    "the secondary sample point is %" PRIu64 " clocks behind the begin of its "
                    "bit; controllers compare within %u bits of the data phase, %" PRIu64 " clocks",
                    late, SSP_BITS_MAX, most);
}

/* At the secondary sample point the bit has to be back, and the next one must not be. */
static void warn_of_compare(schema *self, yaml_node_t *item, const cfg_node_time *time,
                            const cfg_late_sample *sample)
{
    const bool given = time->timing.data.tdc.mode == CW_TDC_MANUAL;

    if (sample->at > sample->from && sample->at <= sample->until)
        return;
    schema_warn(self, node_data_place_of(self, item, given ? "tdcv" : "tdco"),
                "the node cannot send at the data rate: its bits come back from %" PRIu64
                " ns to %" PRIu64 " ns behind their begin, and it compares them after %" PRIu64
                " ns (tdcv %" PRIu64 " and tdco %" PRIu32 " clocks); %s",
                cfg_delay_of(sample->from).ns, cfg_delay_of(sample->until).ns,
                cfg_delay_of(sample->at).ns, sample->tdcv, time->timing.data.tdc.tdco,
                given ? "tdc-mode: auto measures tdcv" : "without tdco it is the sample point");
}

/* Warns of a data phase in which a transmitter would see wrong bits for its own. */
static void warn_of_delay(schema *self, yaml_node_t *item, const cfg_node_time *time)
{
    const cfg_late_sample sample = cfg_find_late_sample(time);

    if (time->timing.data.tdc.mode == CW_TDC_OFF) {
        warn_of_late_bits(self, item, &sample);
        return;
    }
    warn_of_offset(self, item, time, &sample);
    warn_of_compare(self, item, time, &sample);
}

void cfg_complete_data(schema *self, yaml_node_t *item, cfg_node *node)
{
    cfg_node_time *time = &node->time;
    const cfg *config = cfg_of(self);
    char problem[TIMING_PROBLEM_MAX];

    if (!cfg_knows_fd(config, node) || config->dbitrate_bps == 0) {
        time->phase[1].bit = (bit_timing){.clock_hz = 0};
        return;
    }
    if (!timing_data_limits(time->limits)) {
        schema_complain(self, item, "controller %s knows no CAN FD frames; its node is one of "
                        "kind: classical", time->limits->name);
        return;
    }
    if (cfg_gives_segments(self, item, "d") ? !cfg_fit_phase(time, 1, problem)
                                            : !cfg_find_phase(time, 1, problem, config)) {
        schema_complain(self, node_data_place_of(self, item, "dbrp"), "data phase: %s", problem);
        return;
    }
    time->timing.data = cfg_data_timing(time);
    check_rate(self, item, &time->phase[1].bit);
    check_delay(self, item, time);
    warn_of_delay(self, item, time);
}
