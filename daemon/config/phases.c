/* SPDX-License-Identifier: MIT
 *
 * phases.c - the bit timing of both phases of a node: segments that keys give, or that are found.
 */
#include "config/phases.h"

#include "config/retime.h"

#include "timing/request.h"

/* ---- Segments -------------------------------------------------------------------------------- */

bool cfg_fit_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX])
{
    bit_timing *bit = &time->bit;
    if (bit->sjw == 0) /* as Linux does */
        bit->sjw = timing_least(bit->phase_seg1,
                                timing_least(time->limits->sjw_max, bit->phase_seg2 / 2));
    if (bit->sjw == 0)
        bit->sjw = 1;
    return timing_fits(problem, bit, time->limits);
}

/* Both rates of a node, and limits for them with one prescaler, where that is possible. */
typedef struct rates {
    timing_request nominal;
    timing_request data;
    timing_limits narrow[2];
} rates;

static void narrow_to(timing_request *request, timing_limits *narrow, uint32_t brp)
{
    *narrow = *request->limits;
    narrow->brp_min = narrow->brp_max = (uint16_t)brp;
    request->limits = narrow;
}

static void rates_of(rates *r, const cfg_node_time *time, const cfg *config)
{
    r->nominal = (timing_request){
        .limits = time->limits,
        .clock_hz = time->bit.clock_hz,
        .bitrate_bps = config->bitrate_bps,
        .sample_permille = time->sample_permille ? time->sample_permille : config->sample_permille,
        .sjw = time->bit.sjw,
    };
    r->data = (timing_request){
        .limits = timing_data_limits(time->limits),
        .clock_hz = time->bit.clock_hz,
        .bitrate_bps = config->dbitrate_bps,
        .sample_permille =
            time->dsample_permille ? time->dsample_permille : config->dsample_permille,
        .sjw = time->data.sjw,
    };
    if (config->dbitrate_bps == 0 || !r->data.limits)
        return;
    const uint32_t brp = timing_common_brp(&r->nominal, &r->data);
    if (brp == 0)
        return;
    narrow_to(&r->nominal, &r->narrow[0], brp);
    narrow_to(&r->data, &r->narrow[1], brp);
}

bool cfg_find_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config)
{
    rates r;
    rates_of(&r, time, config);
    time->found = true;
    return timing_by_kernel(&time->bit, problem, &r.nominal);
}

/* ---- The data phase -------------------------------------------------------------------------- */

bool cfg_find_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config)
{
    rates r;
    rates_of(&r, time, config);
    time->data_found = true;
    return timing_by_kernel(&time->data, problem, &r.data);
}

bool cfg_fit_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX])
{
    const timing_limits *limits = timing_data_limits(time->limits);
    bit_timing *data = &time->data;
    data->clock_hz = time->bit.clock_hz;
    if (data->sjw == 0)
        data->sjw = timing_least(data->phase_seg1,
                                 timing_least(limits->sjw_max, data->phase_seg2 / 2));
    if (data->sjw == 0)
        data->sjw = 1;
    return timing_fits(problem, data, limits);
}

/* As Linux does: compensation goes with a prescaler of 1 or 2, and compares at the sample point. */
static cw_tdc tdc_of(const cfg_node_time *time)
{
    const bit_timing *data = &time->data;
    cw_tdc tdc = {.mode = CW_TDC_OFF};
    if (time->tdc == CFG_TDC_AUTO ||
        (time->tdc == CFG_TDC_BY_RATE && data->brp <= TIMING_TDC_BRP_MAX))
        tdc.mode = CW_TDC_AUTO;
    if (time->tdc == CFG_TDC_MANUAL)
        tdc = (cw_tdc){.mode = CW_TDC_MANUAL, .tdcv = time->tdcv};
    if (tdc.mode != CW_TDC_OFF)
        tdc.tdco = time->tdco ? time->tdco : timing_linux_tdco(data, time->limits);
    return tdc;
}

/* Returns the way of an own edge to a level, back to the controller. */
static cw_span loop_delay(const cfg_node_time *time, bool level)
{
    return time->timing.tx_delay[level] + time->timing.rx_delay[level];
}

/* Returns whole clocks before the one in which the own edge to res comes back. */
static uint64_t measured_clocks(const cfg_node_time *time, cw_span clock)
{
    return (uint64_t)(loop_delay(time, CW_DOMINANT) / clock);
}

cfg_late_sample cfg_find_late_sample(const cfg_node_time *time)
{
    const cw_data_timing *data = &time->timing.data;
    const cw_span clock = data->bit.quantum / data->data_brp;
    const cw_span bit = data->bit.quantum * cw_bit_timing_quanta(&data->bit);
    const cw_span dominant = loop_delay(time, CW_DOMINANT);
    const cw_span recessive = loop_delay(time, CW_RECESSIVE);
    cfg_late_sample found = {
        .at = data->bit.quantum * cw_bit_timing_sample_at(&data->bit),
        .from = dominant > recessive ? dominant : recessive,
        .until = (dominant < recessive ? dominant : recessive) + bit,
    };
    if (data->tdc.mode == CW_TDC_OFF)
        return found;
    found.tdcv = data->tdc.mode == CW_TDC_MANUAL ? data->tdc.tdcv : measured_clocks(time, clock);
    const uint64_t after = found.tdcv + data->tdc.tdco;
    found.at = (cw_span)(after ? after : 1) * clock;
    return found;
}

cw_span cfg_late_margin(const cfg_late_sample *s)
{
    const cw_span first = s->at - s->from, last = s->until - s->at;
    return first < last ? first : last;
}

cw_data_timing cfg_data_timing(const cfg_node_time *time)
{
    const bit_timing *data = &time->data;
    if (data->clock_hz == 0)
        return (cw_data_timing){.brp = 0};
    return (cw_data_timing){
        .bit = {.quantum = cw_quantum(data->clock_hz, data->brp, time->ppm),
                .prop_seg = (uint16_t)data->prop_seg,
                .phase_seg1 = (uint16_t)data->phase_seg1,
                .phase_seg2 = (uint16_t)data->phase_seg2,
                .sjw = (uint16_t)data->sjw},
        .brp = time->bit.brp,
        .data_brp = data->brp,
        .tdc = tdc_of(time),
    };
}

cw_bit_timing cfg_bit_timing(const cfg_node_time *time, cw_span nominal)
{
    const bit_timing *bit = &time->bit;
    return (cw_bit_timing){
        .quantum = bit->clock_hz ? cw_quantum(bit->clock_hz, bit->brp, time->ppm)
                                 : cfg_drifted(nominal, time->ppm),
        .prop_seg = (uint16_t)bit->prop_seg,
        .phase_seg1 = (uint16_t)bit->phase_seg1,
        .phase_seg2 = (uint16_t)bit->phase_seg2,
        .sjw = (uint16_t)bit->sjw,
        .triple_sampling = time->triple_sampling,
    };
}

void cfg_take_segments(bit_timing *bit, const bit_timing *change, unsigned given)
{
    bit->brp = given & RETIME_BIT(RETIME_BRP) ? change->brp : bit->brp;
    bit->prop_seg = given & RETIME_BIT(RETIME_PROP_SEG) ? change->prop_seg : bit->prop_seg;
    bit->phase_seg1 = given & RETIME_BIT(RETIME_PHASE_SEG1) ? change->phase_seg1 : bit->phase_seg1;
    bit->phase_seg2 = given & RETIME_BIT(RETIME_PHASE_SEG2) ? change->phase_seg2 : bit->phase_seg2;
    bit->sjw = given & RETIME_BIT(RETIME_SJW) ? change->sjw : bit->sjw;
}
