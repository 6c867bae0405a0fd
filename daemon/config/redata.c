/* SPDX-License-Identifier: MIT
 *
 * redata.c - keys of a node's data phase that change while the node is in use (D10, D13).
 */
#include "config/redata.h"

#include "config/phases.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define SEGMENTS                                                                                   \
    (CFG_DATA_BRP | CFG_DATA_PROP_SEG | CFG_DATA_PHASE_SEG1 | CFG_DATA_PHASE_SEG2)

static const char *const tdc_names[] = {
    [CFG_TDC_OFF] = "off",
    [CFG_TDC_AUTO] = "auto",
    [CFG_TDC_MANUAL] = "manual",
};

const char *cfg_tdc_name(cfg_tdc tdc)
{
    return tdc_names[tdc];
}

bool cfg_parse_tdc(cfg_tdc *out, const char *text)
{
    for (cfg_tdc tdc = CFG_TDC_OFF; tdc <= CFG_TDC_MANUAL; tdc++)
        if (strcmp(tdc_names[tdc], text) == 0) {
            *out = tdc;
            return true;
        }
    return false;
}

static cfg_tdc wish_of(cw_tdc_mode mode)
{
    if (mode == CW_TDC_OFF)
        return CFG_TDC_OFF;
    return mode == CW_TDC_AUTO ? CFG_TDC_AUTO : CFG_TDC_MANUAL;
}

cfg_redata cfg_data_present(const cfg_node_time *time)
{
    const cw_tdc tdc = cfg_data_timing(time).tdc;
    return (cfg_redata){.bit = time->data,
                        .tdc = wish_of(tdc.mode),
                        .tdco = tdc.tdco,
                        .tdcv = tdc.tdcv};
}

/* Returns false, for the caller to return. */
static bool refuse(char *problem, size_t size, const char *why)
{
    (void)snprintf(problem, size, "%s", why);
    return false;
}

/* ---- Segments -------------------------------------------------------------------------------- */

static void take(uint32_t *out, uint32_t value, bool given)
{
    if (given)
        *out = value;
}

static void take_segments(bit_timing *bit, const bit_timing *change, unsigned given)
{
    take(&bit->brp, change->brp, given & CFG_DATA_BRP);
    take(&bit->prop_seg, change->prop_seg, given & CFG_DATA_PROP_SEG);
    take(&bit->phase_seg1, change->phase_seg1, given & CFG_DATA_PHASE_SEG1);
    take(&bit->phase_seg2, change->phase_seg2, given & CFG_DATA_PHASE_SEG2);
    take(&bit->sjw, change->sjw, given & CFG_DATA_SJW);
}

/* Finds the arbitration phase once more when that gives it another prescaler, common to both
 * phases. Returns true when it has changed. */
static bool find_common(cfg_node_time *time, const cfg *config)
{
    char unused[TIMING_PROBLEM_MAX];
    cfg_node_time other = *time;
    other.bit.sjw = 0;
    if (!time->found || time->bit.brp == time->data.brp ||
        !cfg_find_segments(&other, unused, config) || other.bit.brp != other.data.brp)
        return false;
    time->bit = other.bit;
    return true;
}

static bool change_segments(cfg_node_time *time, char *problem, size_t size, const cfg *config,
                            const cfg_redata *change, unsigned given, bool found_anew)
{
    const bool other_clock = time->data.clock_hz != time->bit.clock_hz;
    const bool finds = (given & CFG_DATA_SAMPLE_POINT) ||
                       (found_anew && !(given & SEGMENTS) && (time->data_found || other_clock));
    char wrong[TIMING_PROBLEM_MAX];
    if ((given & SEGMENTS) && (given & CFG_DATA_SAMPLE_POINT))
        return refuse(problem, size,
                      "dsample-point: the segments say where it is; use one or the other");
    time->data.clock_hz = time->bit.clock_hz;
    if (finds)
        time->data.sjw = 0;
    if (given & CFG_DATA_SAMPLE_POINT)
        time->dsample_permille = change->sample_permille;
    if (given & SEGMENTS)
        time->data_found = false;
    take_segments(&time->data, &change->bit, given);
    if (finds ? cfg_find_data(time, wrong, config) : cfg_fit_data(time, wrong))
        return true;
    (void)snprintf(problem, size, "data phase: %s", wrong);
    return false;
}

/* ---- Compensation ---------------------------------------------------------------------------- */

static bool change_tdc(cfg_node_time *time, char *problem, size_t size, const cfg_redata *change,
                       unsigned given)
{
    const uint64_t most = CW_TDC_BITS_MAX * timing_bit_clocks(&time->data);
    if (given & CFG_DATA_TDC_MODE)
        time->tdc = change->tdc;
    take(&time->tdco, change->tdco, given & CFG_DATA_TDCO);
    take(&time->tdcv, change->tdcv, given & CFG_DATA_TDCV);
    const cw_tdc tdc = cfg_data_timing(time).tdc;
    if ((given & CFG_DATA_TDCO) && tdc.mode == CW_TDC_OFF)
        return refuse(problem, size, "tdco: tdc-mode is off; auto or manual is needed");
    if ((given & CFG_DATA_TDCV) && tdc.mode != CW_TDC_MANUAL)
        return refuse(problem, size, "tdcv: only tdc-mode manual has it; auto measures it");
    if (tdc.mode == CW_TDC_MANUAL && tdc.tdcv == 0)
        return refuse(problem, size,
                      "tdcv is missing: tdc-mode manual needs it, in clocks");
    if ((uint64_t)tdc.tdco + tdc.tdcv < most)
        return true;
    (void)snprintf(problem, size, "tdco and tdcv together are less than %u bits of the data "
                   "phase, here %" PRIu64 " clocks", CW_TDC_BITS_MAX, most);
    return false;
}

bool cfg_change_data(cfg_node_time *time, char *problem, size_t size, bool *bit_changes,
                     const cfg *config, const cfg_redata *change, unsigned given, bool found_anew)
{
    *bit_changes = false;
    if (!change_segments(time, problem, size, config, change, given, found_anew) ||
        !change_tdc(time, problem, size, change, given))
        return false;
    if (given & CFG_DATA_SAMPLE_POINT)
        *bit_changes = find_common(time, config);
    return true;
}
