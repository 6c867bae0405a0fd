/* SPDX-License-Identifier: MIT
 *
 * controllers.h - what the segments of known controllers may be (T1).
 */
#ifndef CANWIRE_TIMING_CONTROLLERS_H
#define CANWIRE_TIMING_CONTROLLERS_H

#include "timing/bittiming.h"

#include <stddef.h>

#define TIMING_PROBLEM_MAX 200 /* bytes of a message with its final 0 */

/* Limits of the nominal bit timing, all in tq but for the prescaler. Each least value not named
 * here is 1. */
typedef struct timing_limits {
    const char *name;
    uint16_t tseg1_min; /* prop_seg + phase_seg1 */
    uint16_t tseg1_max;
    uint16_t tseg2_min; /* phase_seg2 */
    uint16_t tseg2_max;
    uint16_t sjw_max;
    uint16_t brp_min;
    uint16_t brp_max;
    uint16_t brp_step; /* the prescaler is a multiple of it */
} timing_limits;

/* Returns all controllers, for lists. The first one is "any": limits of no controller in
 * particular, but what today's controllers for CAN FD have. */
const timing_limits *timing_controllers(size_t *count);

/* Returns the limits of a controller, or NULL for an unknown name. Names are those of Linux
 * drivers, and some of chips. */
const timing_limits *timing_controller(const char *name);

/* Returns the limits of the data phase of CAN FD frames, or NULL for those of a controller that
 * knows no such frames. */
const timing_limits *timing_data_limits(const timing_limits *limits);

/* The longest way to a secondary sample point (D13) in clocks, as far as anybody says. */
#define TIMING_TDCO_MAX 65535u

/* The largest prescaler of the data phase with which Linux compensates the delay. */
#define TIMING_TDC_BRP_MAX 2u

/* Returns the longest one that the register of a controller holds, or TIMING_TDCO_MAX if its Linux
 * driver does not say that. */
uint32_t timing_tdco_max(const timing_limits *limits);

/* Returns the one that Linux takes: the way to the sample point, or the longest possible one
 * (can_calc_tdco()). `limits` are those of the controller. */
uint32_t timing_linux_tdco(const bit_timing *data, const timing_limits *limits);

/* Returns true when the controller can do that, and sjw is not longer than a phase segment (T1).
 * Otherwise the message says what is wrong and what is allowed. */
bool timing_fits(char problem[TIMING_PROBLEM_MAX], const bit_timing *t,
                 const timing_limits *limits);

/* Returns true when the controller has this prescaler. */
bool timing_has_brp(const timing_limits *limits, uint64_t brp);

#endif
