/* SPDX-License-Identifier: MIT
 *
 * redata.c - keys of a node's data phase that change while the node is in use (D10, D13).
 */
#include "config/change/redata.h"

#include "config/node/phases.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static cfg_tdc wish_of(cw_tdc_mode mode)
{
    if (mode == CW_TDC_OFF)
        return CFG_TDC_OFF;
    return mode == CW_TDC_AUTO ? CFG_TDC_AUTO : CFG_TDC_MANUAL;
}

void cfg_data_present(cfg_retime *out, const cfg_node_time *time)
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

bool cfg_change_data(cfg_node_time *time, char *problem, size_t size, bool *bit_changes,
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
