/* SPDX-License-Identifier: MIT
 *
 * retime.c - keys of a node's bit timing and of its place as texts. They change a node that is in
 * use.
 */
#include "config/change/retime.h"

#include "config/change/live.h"
#include "config/node/phases.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define BIT(key) RETIME_BIT(key)
#define SEGMENTS RETIME_SEGMENTS
#define DATA_MASK (BIT(RETIME_TDCV + 1) - BIT(RETIME_DSAMPLE_POINT))

/* ---- The data phase -------------------------------------------------------------------------- */

static cfg_tdc wish_of(cw_tdc_mode mode)
{
    if (mode == CW_TDC_OFF)
        return CFG_TDC_OFF;
    return mode == CW_TDC_AUTO ? CFG_TDC_AUTO : CFG_TDC_MANUAL;
}

/* Puts the values that a node has at present. */
static void cfg_data_present(cfg_retime *out, const cfg_node_time *time)
{
    const cw_tdc tdc = cfg_data_timing(time).tdc;
    out->phase[1].bit = time->phase[1].bit;
    out->tdc = wish_of(tdc.mode);
    out->tdco = tdc.tdco;
    out->tdcv = tdc.tdcv;
}

/* Returns false, for the caller to return. */
static bool redata_refuse(char *problem, size_t size, const char *why)
{
    (void)snprintf(problem, size, "%s", why);
    return false;
}

/* ---- Segments -------------------------------------------------------------------------------- */

/* Finds the arbitration phase once more when that gives it another prescaler, common to both
 * phases. Returns true when it has changed. */
static bool find_common(cfg_node_time *time, const cfg *config)
{
    char unused[TIMING_PROBLEM_MAX];
    cfg_node_time other = *time;
    other.phase[0].bit.sjw = 0;
    if (!time->phase[0].found || time->phase[0].bit.brp == time->phase[1].bit.brp ||
        !cfg_find_phase(&other, 0, unused, config) ||
        other.phase[0].bit.brp != other.phase[1].bit.brp)
        return false;
    time->phase[0].bit = other.phase[0].bit;
    return true;
}

/* Changes the segments of the data phase, or finds them anew when its clock or sample point has
 * changed. */
static bool change_segments(cfg_node_time *time, char *problem, size_t size, const cfg *config,
                            const cfg_retime *change, bool found_anew)
{
    const unsigned given = change->given >> RETIME_PHASE_KEYS;
    const bool other_clock = time->phase[1].bit.clock_hz != time->phase[0].bit.clock_hz;
    const bool finds = (given & RETIME_BIT(RETIME_SAMPLE_POINT)) ||
                       (found_anew && !(given & RETIME_SEGMENTS) &&
                        (time->phase[1].found || other_clock));
    char wrong[TIMING_PROBLEM_MAX];
    if ((given & RETIME_SEGMENTS) && (given & RETIME_BIT(RETIME_SAMPLE_POINT)))
        return redata_refuse(problem, size,
                             "dsample-point: the segments say where it is; use one or the other");
    time->phase[1].bit.clock_hz = time->phase[0].bit.clock_hz;
    if (finds)
        time->phase[1].bit.sjw = 0;
    if (given & RETIME_BIT(RETIME_SAMPLE_POINT))
        time->phase[1].sample_permille = change->phase[1].sample_permille;
    if (given & RETIME_SEGMENTS)
        time->phase[1].found = false;
    cfg_take_segments(&time->phase[1].bit, &change->phase[1].bit, given);
    if (finds ? cfg_find_phase(time, 1, wrong, config) : cfg_fit_phase(time, 1, wrong))
        return true;
    (void)snprintf(problem, size, "data phase: %s", wrong);
    return false;
}

/* ---- Compensation ---------------------------------------------------------------------------- */

/* Changes the transmitter delay compensation, whose keys must fit each other after the change. */
static bool change_tdc(cfg_node_time *time, char *problem, size_t size, const cfg_retime *change)
{
    const unsigned given = change->given;
    const uint64_t most = CW_TDC_BITS_MAX * timing_bit_clocks(&time->phase[1].bit);
    if (given & RETIME_BIT(RETIME_TDC_MODE))
        time->tdc = change->tdc;
    if (given & RETIME_BIT(RETIME_TDCO))
        time->tdco = change->tdco;
    if (given & RETIME_BIT(RETIME_TDCV))
        time->tdcv = change->tdcv;
    const cw_tdc tdc = cfg_data_timing(time).tdc;
    if ((given & RETIME_BIT(RETIME_TDCO)) && tdc.mode == CW_TDC_OFF)
        return redata_refuse(problem, size, "tdco: tdc-mode is off; auto or manual is needed");
    if ((given & RETIME_BIT(RETIME_TDCV)) && tdc.mode != CW_TDC_MANUAL)
        return redata_refuse(problem, size, "tdcv: only tdc-mode manual has it; auto measures it");
    if (tdc.mode == CW_TDC_MANUAL && tdc.tdcv == 0)
        return redata_refuse(problem, size, "tdcv is missing: tdc-mode manual needs it, in clocks");
    if ((uint64_t)tdc.tdco + tdc.tdcv < most)
        return true;
    (void)snprintf(problem, size, "tdco and tdcv together are less than %u bits of the data "
                   "phase, here %" PRIu64 " clocks", CW_TDC_BITS_MAX, most);
    return false;
}

/* Changes a data phase. The node's clock and bit timing are changed already. found_anew: its
 * segments were found. Then those of the data phase are found, too, if no keys give them or the
 * clock is another one. *bit_changes becomes true when a common prescaler has changed both.
 * Otherwise it returns false with a message, and *time is undefined. */
static bool cfg_change_data(cfg_node_time *time, char *problem, size_t size, bool *bit_changes,
                            const cfg *config, const cfg_retime *change, bool found_anew)
{
    *bit_changes = false;
    if (!change_segments(time, problem, size, config, change, found_anew) ||
        !change_tdc(time, problem, size, change))
        return false;
    if (change->given & RETIME_BIT(RETIME_DSAMPLE_POINT))
        *bit_changes = find_common(time, config);
    return true;
}

/* ---- A change -------------------------------------------------------------------------------- */

/* Returns the keys of a node in use. Without any it has the default of the library, whose clock is
 * not known. */
static cfg_node_time present(const cfg *config, unsigned node)
{
    cfg_node_time time = config->nodes[node].time;
    if (time.phase[0].bit.phase_seg2 == 0)
        time.phase[0].bit = (bit_timing){.brp = 1, .prop_seg = 6, .phase_seg1 = 7, .phase_seg2 = 2,
                                .sjw = 1};
    if (!time.limits)
        time.limits = timing_controller("any");
    return time;
}

/* Returns the keys of the place that are not 0. */
static unsigned present_way(const cw_node_timing *t, const cfg_node_time *time)
{
    return (t->tx_delay[0] || t->tx_delay[1] ? BIT(RETIME_TX_DELAY) : 0) |
           (t->rx_delay[0] || t->rx_delay[1] ? BIT(RETIME_RX_DELAY) : 0) |
           (time->position_mm ? BIT(RETIME_POSITION) : 0) |
           (time->stub_mm ? BIT(RETIME_STUB) : 0) | (t->ringing ? BIT(RETIME_RINGING) : 0);
}

/* Returns the keys of the data phase that mean anything. */
static unsigned present_data(const cfg_retime *values)
{
    unsigned given = DATA_MASK & ~BIT(RETIME_DSAMPLE_POINT);
    if (values->phase[1].bit.clock_hz == 0)
        return 0;
    if (values->tdc == CFG_TDC_OFF)
        given &= ~BIT(RETIME_TDCO);
    if (values->tdc != CFG_TDC_MANUAL)
        given &= ~BIT(RETIME_TDCV);
    return given;
}

/* Returns delays and place in the units of their keys. */
static cfg_way way_of(const cfg_node_time *time)
{
    const cw_node_timing *t = &time->timing;
    return (cfg_way){.tx_delay = {cfg_delay_of(t->tx_delay[0]), cfg_delay_of(t->tx_delay[1])},
                     .rx_delay = {cfg_delay_of(t->rx_delay[0]), cfg_delay_of(t->rx_delay[1])},
                     .position_mm = time->position_mm,
                     .stub_mm = time->stub_mm,
                     .ringing = cfg_delay_of(t->ringing)};
}

cfg_retime cfg_retime_present(const cfg_node_time *time)
{
    const unsigned bit = SEGMENTS | BIT(RETIME_SJW) | BIT(RETIME_CLOCK);
    const unsigned known = time->phase[0].bit.clock_hz ? bit : 0;
    cfg_retime values = {.way = way_of(time),
                         .phase[0].bit = time->phase[0].bit,
                         .ppm = time->ppm,
                         .triple_sampling = time->triple_sampling};
    cfg_data_present(&values, time);
    values.given = known | BIT(RETIME_PPM) | BIT(RETIME_TRIPLE_SAMPLING) |
                   present_way(&time->timing, time) | present_data(&values);
    return values;
}

/* Returns the first key of the segments that is missing. */
static const char *first_missing(unsigned given)
{
    retime_key key = RETIME_BRP;
    while (given & BIT(key))
        key++;
    return cfg_retime_row(key)->name;
}

/* Checks the keys of a change against each other, and whether some are missing. */
static bool keys_agree(char problem[RETIME_PROBLEM_MAX], unsigned given, bool clock_known)
{
    const unsigned segments = given & SEGMENTS;
    if (segments && (given & BIT(RETIME_SAMPLE_POINT)))
        return cfg_refuse(problem,
                      "sample-point: the segments say where it is; use one or the other");
    if (!clock_known && segments && segments != SEGMENTS)
        return cfg_refuse(problem, "%s is missing: brp, prop-seg, phase-seg1 and phase-seg2 are "
                      "needed together, as the configuration has none of them",
                      first_missing(segments));
    return true;
}

/* Changes the bit. A node without segments of its own finds them with its clock. */
static bool change_bit(cfg_node_time *time, char problem[RETIME_PROBLEM_MAX], const cfg *config,
                       const cfg_retime *change, unsigned *which)
{
    const unsigned given = change->given;
    const bool clock_known = time->phase[0].bit.clock_hz > 0;
    const bool finds = (given & BIT(RETIME_SAMPLE_POINT)) ||
                       (!clock_known && (given & BIT(RETIME_CLOCK)) && !(given & SEGMENTS));
    char wrong[TIMING_PROBLEM_MAX];
    if (given & BIT(RETIME_CLOCK))
        time->phase[0].bit.clock_hz = change->phase[0].bit.clock_hz;
    else if (!clock_known && (finds || (given & SEGMENTS)))
        time->phase[0].bit.clock_hz = CFG_CLOCK_DEFAULT_HZ;
    if (finds || (!clock_known && (given & SEGMENTS)))
        time->phase[0].bit.sjw = 0;
    if (given & SEGMENTS)
        time->phase[0].found = false;
    cfg_take_segments(&time->phase[0].bit, &change->phase[0].bit, given);
    if (given & BIT(RETIME_SAMPLE_POINT))
        time->phase[0].sample_permille = change->phase[0].sample_permille;
    if (finds ? !cfg_find_phase(time, 0, wrong, config) : !cfg_fit_phase(time, 0, wrong))
        return cfg_refuse(problem, "%s", wrong);
    if (finds || (given & (BIT(RETIME_BRP) | BIT(RETIME_CLOCK) | BIT(RETIME_PPM))))
        *which |= CW_SET_QUANTUM;
    if (finds || (given & (SEGMENTS & ~BIT(RETIME_BRP))) || (given & BIT(RETIME_SJW)))
        *which |= CW_SET_SEGMENTS;
    return true;
}

/* Complains about the first key of the data phase. Says why the node has none. Returns false. */
static bool refuse_data(char problem[RETIME_PROBLEM_MAX], const cfg *config, unsigned node,
                     unsigned given)
{
    retime_key key = RETIME_DSAMPLE_POINT;
    while (!(given & BIT(key)))
        key++;
    return cfg_refuse(problem, "%s: %s", cfg_retime_row(key)->name,
                  cfg_knows_fd(config, &config->nodes[node])
                      ? "the bus has no data rate; bus: { dbitrate } gives it one"
                      : "only a node of kind fd has a data phase");
}

/* Changes the data phase. Whenever a quantum is given, that of the other phase is, too: what rules
 * have done to it ends. */
static bool change_data(cfg_node_time *time, char problem[RETIME_PROBLEM_MAX], const cfg *config,
                        unsigned node, const cfg_retime *change, unsigned *which)
{
    const unsigned given = change->given & DATA_MASK;
    const bool found_anew = change->given & BIT(RETIME_SAMPLE_POINT);
    bool bit_changes;
    if (time->phase[1].bit.clock_hz == 0)
        return !given || refuse_data(problem, config, node, given);
    if (!given && !(*which & CW_SET_QUANTUM))
        return true;
    if (!cfg_change_data(time, problem, RETIME_PROBLEM_MAX, &bit_changes, config, change,
                         found_anew))
        return false;
    *which |= CW_SET_QUANTUM | CW_SET_DATA | (bit_changes ? CW_SET_SEGMENTS : 0);
    return true;
}

cw_span cfg_nominal_quantum(const cfg *config, unsigned node)
{
    const bit_timing *bit = &config->nodes[node].time.phase[0].bit;

    /* without keys the default of the library: a bit in 16 quanta */
    return bit->clock_hz ? cw_quantum(bit->clock_hz, bit->brp, 0)
                         : (cw_span)cw_rate_ticks(config->rate, 1) * (CW_TICK / 16);
}

/* Asks the library if the node can have these settings on its bus. */
static bool bus_takes(const cfg *config, unsigned node, const cw_settings *settings)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus;
    cfg_bus_config(&bus, nodes, config);
    return cw_bus_config_takes(&bus, node, settings);
}

/* Returns the keys of the place that are given, as CW_SET_*. */
static unsigned ways_given(const cfg_retime *change)
{
    unsigned given = 0;
    for (retime_key key = RETIME_TX_DELAY; key < RETIME_KEYS; key++)
        given |= change->given & BIT(key) ? cfg_live_of(cfg_retime_row(key))->which : 0;
    return given;
}

bool cfg_retime_node(cfg_node_time *out, cw_settings *set, char problem[RETIME_PROBLEM_MAX],
                     const cfg *config, unsigned node, const cfg_retime *change)
{
    cfg_node_time time = present(config, node);
    unsigned which = 0;
    if (change->given & BIT(RETIME_PPM))
        time.ppm = change->ppm;
    if (change->given & BIT(RETIME_TRIPLE_SAMPLING)) {
        time.triple_sampling = change->triple_sampling;
        which |= CW_SET_SAMPLING;
    }
    if (!keys_agree(problem, change->given, time.phase[0].bit.clock_hz > 0) ||
        !change_bit(&time, problem, config, change, &which) ||
        !change_data(&time, problem, config, node, change, &which))
        return false;
    set->which = (uint16_t)((set->which & ~(CW_SET_TIMING | CW_SET_UNIT)) | which);
    set->timing = cfg_bit_timing(&time, cfg_nominal_quantum(config, node));
    set->data = cfg_data_timing(&time);
    if ((which & CW_SET_QUANTUM) && config->nodes[node].local.bits) {
        set->which |= CW_SET_UNIT;
        set->unit = cfg_local_unit(&config->nodes[node], time.ppm);
    }
    if (!bus_takes(config, node, set))
        return cfg_refuse(problem, "a bit of the node would be too long or too short for this bus");
    set->which |= (uint16_t)cfg_change_way(&time, set, config, &change->way, ways_given(change));
    *out = time;
    return bus_takes(config, node, set) ||
           cfg_refuse(problem, "no edge is under way and no wire rings for longer than 16 of the "
                  "shortest bits");
}
