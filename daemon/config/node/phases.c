/* SPDX-License-Identifier: MIT
 *
 * phases.c - the bit timing of both phases of a node: segments that keys give, or that are found.
 */
#include "config/node/phases.h"

#include "config/change/retime.h"

#include "timing/request.h"

/* ---- Segments -------------------------------------------------------------------------------- */

/* Returns the limits of the controller for a phase, or NULL for one that it has not. */
static const timing_limits *limits_of(const cfg_node_time *time, unsigned phase)
{
    return phase == 0 ? time->limits : timing_data_limits(time->limits);
}

bool cfg_fit_phase(cfg_node_time *time, unsigned phase, char problem[TIMING_PROBLEM_MAX])
{
    const timing_limits *limits = limits_of(time, phase);
    bit_timing *bit = &time->phase[phase].bit;
    bit->clock_hz = time->phase[0].bit.clock_hz;
    if (bit->sjw == 0) /* as Linux does */
        bit->sjw = timing_least(bit->phase_seg1,
                                timing_least(limits->sjw_max, bit->phase_seg2 / 2));
    if (bit->sjw == 0)
        bit->sjw = 1;
    return timing_fits(problem, bit, limits);
}

/* The rates of the phases of a node, and limits with one prescaler, where that is possible. */
typedef struct rates {
    timing_request phase[CFG_PHASES];
    timing_limits narrow[CFG_PHASES];
} rates;

static void narrow_to(timing_request *request, timing_limits *narrow, uint32_t brp)
{
    *narrow = *request->limits;
    narrow->brp_min = narrow->brp_max = (uint16_t)brp;
    request->limits = narrow;
}

/* Returns what segments are sought for a phase. */
static timing_request request_of(const cfg_node_time *time, unsigned phase, uint32_t bitrate_bps,
                                 uint16_t sample_permille)
{
    const cfg_phase *p = &time->phase[phase];
    return (timing_request){
        .limits = limits_of(time, phase),
        .clock_hz = time->phase[0].bit.clock_hz,
        .bitrate_bps = bitrate_bps,
        .sample_permille = p->sample_permille ? p->sample_permille : sample_permille,
        .sjw = p->bit.sjw,
    };
}

/* Makes the requests for both phases. One prescaler for both is asked for, where there is one. */
static void rates_of(rates *r, const cfg_node_time *time, const cfg *config)
{
    r->phase[0] = request_of(time, 0, config->bitrate_bps, config->sample_permille);
    r->phase[1] = request_of(time, 1, config->dbitrate_bps, config->dsample_permille);
    if (config->dbitrate_bps == 0 || !r->phase[1].limits)
        return;
    const uint32_t brp = timing_common_brp(&r->phase[0], &r->phase[1]);
    for (unsigned i = 0; brp > 0 && i < CFG_PHASES; i++)
        narrow_to(&r->phase[i], &r->narrow[i], brp);
}

bool cfg_find_phase(cfg_node_time *time, unsigned phase, char problem[TIMING_PROBLEM_MAX],
                    const cfg *config)
{
    rates r;
    rates_of(&r, time, config);
    time->phase[phase].found = true;
    return timing_by_kernel(&time->phase[phase].bit, problem, &r.phase[phase]);
}

/* ---- The data phase -------------------------------------------------------------------------- */

/* As Linux does: compensation goes with a prescaler of 1 or 2, and compares at the sample point. */
static cw_tdc tdc_of(const cfg_node_time *time)
{
    const bit_timing *data = &time->phase[1].bit;
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
    const bit_timing *data = &time->phase[1].bit;
    if (data->clock_hz == 0)
        return (cw_data_timing){.brp = 0};
    return (cw_data_timing){
        .bit = {.quantum = cw_quantum(data->clock_hz, data->brp, time->ppm),
                .prop_seg = (uint16_t)data->prop_seg,
                .phase_seg1 = (uint16_t)data->phase_seg1,
                .phase_seg2 = (uint16_t)data->phase_seg2,
                .sjw = (uint16_t)data->sjw},
        .brp = time->phase[0].bit.brp,
        .data_brp = data->brp,
        .tdc = tdc_of(time),
    };
}

cw_bit_timing cfg_bit_timing(const cfg_node_time *time, cw_span nominal)
{
    const bit_timing *bit = &time->phase[0].bit;
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
