/* SPDX-License-Identifier: MIT
 *
 * data_timing.c - the bit timing of a node in the data phase of CAN FD frames (D10, D13).
 */
#include "record/data_timing.h"

/* Returns the data phase that the bus has now, or that it began with. */
static cw_data_timing data_of(const cfg *config, const cw_settings *settings, unsigned node)
{
    return settings->which & CW_SET_DATA ? settings->data : config->nodes[node].time.timing.data;
}

bool data_timing_now(data_timing *out, const cfg *config, const cw_bus *bus, unsigned node)
{
    cw_settings settings;
    cw_data_stats stats = {.tdcv = 0};
    int64_t ppm;

    if (cw_node_get_settings(bus, node, &settings) != CW_OK)
        return false;
    const cw_data_timing data = data_of(config, &settings, node);
    if (data.data_brp == 0)
        return false;
    (void)cw_node_get_data_stats(bus, node, &stats);
    *out = (data_timing){.tdc = data.tdc, .tdcv = stats.tdcv};
    cfg_timing_now(&out->bit, &ppm, config, node, &settings.timing);
    out->bit.brp = (uint32_t)((uint64_t)out->bit.brp * data.data_brp / data.brp);
    out->bit.prop_seg = data.bit.prop_seg;
    out->bit.phase_seg1 = data.bit.phase_seg1;
    out->bit.phase_seg2 = data.bit.phase_seg2;
    out->bit.sjw = data.bit.sjw;
    return true;
}

const char *data_timing_tdc_name(cw_tdc_mode mode)
{
    static const char *const names[] = {
        [CW_TDC_OFF] = "off",
        [CW_TDC_AUTO] = "auto",
        [CW_TDC_MANUAL] = "manual",
    };
    return names[mode];
}
