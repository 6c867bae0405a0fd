/* SPDX-License-Identifier: MIT
 *
 * controllers.c - what the segments of known controllers may be.
 */
#include "timing/controllers.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* All but the first are limits that Linux drivers state. */
static const timing_limits controllers[] = {
    {"any", 1, 256, 1, 128, 128, 1, 1024, 1},
    {"at91", 4, 16, 2, 8, 4, 2, 128, 1},
    {"at91_can", 4, 16, 2, 8, 4, 2, 128, 1},
    {"bxcan", 1, 16, 1, 8, 4, 1, 1024, 1},
    {"c_can", 2, 16, 1, 8, 4, 1, 1024, 1},
    {"cc770", 1, 16, 1, 8, 4, 1, 64, 1},
    {"ctucanfd", 2, 190, 1, 63, 31, 1, 8, 1},
    {"d_can", 2, 16, 1, 8, 4, 1, 1024, 1},
    {"ems_usb", 1, 16, 1, 8, 4, 1, 64, 1},
    {"es58x_fd", 2, 256, 2, 128, 128, 1, 512, 1},
    {"esd_usb2", 1, 16, 1, 8, 4, 1, 1024, 1},
    {"flexcan", 4, 16, 2, 8, 4, 1, 256, 1},
    {"flexcan_fd", 2, 96, 2, 32, 16, 1, 1024, 1},
    {"grcan", 2, 16, 2, 8, 4, 1, 256, 1},
    {"hi311x", 2, 16, 2, 8, 4, 1, 64, 1},
    {"ifi_canfd", 1, 256, 2, 256, 128, 2, 512, 1},
    {"kvaser_pciefd", 1, 512, 1, 32, 16, 1, 8192, 1},
    {"kvaser_usb", 1, 16, 1, 8, 4, 1, 64, 1},
    {"m_can", 2, 256, 2, 128, 128, 1, 512, 1},
    {"m_can_30x", 2, 64, 1, 16, 16, 1, 1024, 1},
    {"mcp2515", 3, 16, 2, 8, 4, 1, 64, 1},
    {"mcp251x", 3, 16, 2, 8, 4, 1, 64, 1},
    {"mcp251xfd", 2, 256, 1, 128, 128, 1, 256, 1},
    {"mscan", 4, 16, 2, 8, 4, 1, 64, 1},
    {"peak_canfd", 1, 256, 1, 128, 128, 1, 1024, 1},
    {"rcar_can", 4, 16, 2, 8, 4, 1, 1024, 1},
    {"rcar_canfd", 2, 128, 2, 32, 32, 1, 1024, 1},
    {"rcar_canfd_gen4", 2, 256, 2, 128, 128, 1, 1024, 1},
    {"rockchip_canfd", 1, 256, 1, 128, 128, 2, 512, 2},
    {"sja1000", 1, 16, 1, 8, 4, 1, 64, 1},
    {"softing", 1, 16, 1, 8, 4, 1, 32, 1},
    {"sun4i_can", 1, 16, 1, 8, 4, 1, 64, 1},
    {"ti_hecc", 1, 16, 1, 8, 4, 1, 256, 1},
    {"usb_8dev", 1, 16, 1, 8, 4, 1, 1024, 1},
    {"xilinx_can", 1, 16, 1, 8, 4, 1, 256, 1},
    {"xilinx_canfd", 1, 64, 1, 16, 16, 1, 256, 1},
    {"xilinx_canfd2", 1, 256, 1, 128, 128, 1, 256, 1},
};

typedef struct data_phase {
    timing_limits limits;
    uint16_t tdco_max; /* of its register, in clocks; 0: Linux does not say it */
} data_phase;

/* The data phase of those that have one. "any" is as most of them. */
static const data_phase data_phases[] = {
    {{"any", 1, 32, 1, 16, 16, 1, 1024, 1}, 0},
    {{"ctucanfd", 2, 94, 1, 31, 31, 1, 2, 1}, 0},
    {{"es58x_fd", 2, 32, 1, 16, 8, 1, 32, 1}, 127},
    {{"flexcan_fd", 2, 39, 2, 8, 4, 1, 1024, 1}, 31},
    {{"ifi_canfd", 1, 256, 2, 256, 128, 2, 512, 1}, 16383},
    {{"kvaser_pciefd", 1, 512, 1, 32, 16, 1, 8192, 1}, 0},
    {{"m_can", 1, 32, 1, 16, 16, 1, 32, 1}, 127},
    {{"m_can_30x", 2, 16, 1, 8, 4, 1, 32, 1}, 127},
    {{"mcp251xfd", 1, 32, 1, 16, 16, 1, 256, 1}, 63},
    {{"peak_canfd", 1, 32, 1, 16, 16, 1, 1024, 1}, 0},
    {{"rcar_canfd", 2, 16, 2, 8, 8, 1, 256, 1}, 128},
    {{"rcar_canfd_gen4", 2, 32, 2, 16, 16, 1, 256, 1}, 256},
    {{"rockchip_canfd", 1, 32, 1, 16, 16, 2, 512, 2}, 63},
    {{"xilinx_canfd", 1, 16, 1, 8, 8, 1, 256, 1}, 32},
    {{"xilinx_canfd2", 1, 32, 1, 16, 16, 1, 256, 1}, 64},
};
#define CONTROLLER_COUNT (sizeof controllers / sizeof controllers[0])

static bool within(char problem[TIMING_PROBLEM_MAX], const char *what, uint32_t value,
                   const uint32_t range[2], const char *controller);
static bool step_is_short(char problem[TIMING_PROBLEM_MAX], const bit_timing *t);

const timing_limits *timing_controllers(size_t *count)
{
    *count = CONTROLLER_COUNT;
    return controllers;
}

const timing_limits *timing_controller(const char *name)
{
    for (size_t i = 0; i < CONTROLLER_COUNT; i++)
        if (strcmp(controllers[i].name, name) == 0)
            return &controllers[i];
    return NULL;
}

/* Returns the data phase of a controller, NULL for a classical one. */
static const data_phase *data_phase_of(const timing_limits *limits)
{
    for (size_t i = 0; i < sizeof data_phases / sizeof data_phases[0]; i++)
        if (strcmp(data_phases[i].limits.name, limits->name) == 0)
            return &data_phases[i];
    return NULL;
}

const timing_limits *timing_data_limits(const timing_limits *limits)
{
    const data_phase *phase = data_phase_of(limits);
    return phase ? &phase->limits : NULL;
}

uint32_t timing_tdco_max(const timing_limits *limits)
{
    const data_phase *phase = data_phase_of(limits);
    return phase && phase->tdco_max > 0 ? phase->tdco_max : TIMING_TDCO_MAX;
}

uint32_t timing_linux_tdco(const bit_timing *data, const timing_limits *limits)
{
    const uint32_t to_sample = data->brp * (TIMING_SYNC_SEG + timing_tseg1(data));

    return timing_least(to_sample, timing_tdco_max(limits));
}

bool timing_has_brp(const timing_limits *limits, uint64_t brp)
{
    return brp >= limits->brp_min && brp <= limits->brp_max && brp % limits->brp_step == 0;
}

bool timing_fits(char problem[TIMING_PROBLEM_MAX], const bit_timing *t, const timing_limits *limits)
{
    const uint32_t tseg1[] = {limits->tseg1_min, limits->tseg1_max};
    const uint32_t tseg2[] = {limits->tseg2_min, limits->tseg2_max};
    const uint32_t sjw[] = {1, limits->sjw_max};
    const uint32_t brp[] = {limits->brp_min, limits->brp_max};

    if (!within(problem, "prop-seg + phase-seg1", timing_tseg1(t), tseg1, limits->name) ||
        !within(problem, "phase-seg2", t->phase_seg2, tseg2, limits->name) ||
        !within(problem, "sjw", t->sjw, sjw, limits->name) || !step_is_short(problem, t) ||
        !within(problem, "brp", t->brp, brp, limits->name))
        return false;
    if (timing_has_brp(limits, t->brp))
        return true;
    snprintf(problem, TIMING_PROBLEM_MAX, "brp would be %" PRIu32 ", %s has multiples of %u",
             t->brp, limits->name, (unsigned)limits->brp_step);
    return false;
}

/* Returns true when a segment is within its range, else writes what it would be. */
static bool within(char problem[TIMING_PROBLEM_MAX], const char *what, uint32_t value,
                   const uint32_t range[2], const char *controller)
{
    bool any = strcmp(controller, controllers[0].name) == 0;

    if (value >= range[0] && value <= range[1])
        return true;
    snprintf(problem, TIMING_PROBLEM_MAX, "%s would be %" PRIu32 ", %s has %" PRIu32 " to %" PRIu32,
             what, value, any ? "a controller" : controller, range[0], range[1]);
    return false;
}

/* A longer step could leave the phase segment that it shortens. */
static bool step_is_short(char problem[TIMING_PROBLEM_MAX], const bit_timing *t)
{
    if (t->sjw <= t->phase_seg1 && t->sjw <= t->phase_seg2)
        return true;
    snprintf(problem, TIMING_PROBLEM_MAX,
             "sjw would be %" PRIu32 ", at most %" PRIu32 " and %" PRIu32
             " are allowed, the length of the phase segments",
             t->sjw, t->phase_seg1, t->phase_seg2);
    return false;
}
