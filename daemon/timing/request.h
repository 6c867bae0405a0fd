/* SPDX-License-Identifier: MIT
 *
 * request.h - finds a bit timing for a bit rate and a clock, by one of two methods.
 *
 * Both return false when there is none. The message then says why and what is allowed, without a
 * full stop, and *out is undefined.
 */
#ifndef CANWIRE_TIMING_REQUEST_H
#define CANWIRE_TIMING_REQUEST_H

#include "timing/bittiming.h"
#include "timing/controllers.h"

/* Quanta of a bit in classical CAN (T1). */
#define TIMING_QUANTA_MIN 8u
#define TIMING_QUANTA_MAX 25u

/* Sample points that can be wished for, in permille. */
#define TIMING_SAMPLE_MIN 100u
#define TIMING_SAMPLE_MAX 999u

typedef struct timing_request {
    const timing_limits *limits;
    uint32_t clock_hz;        /* at least 1 */
    uint32_t bitrate_bps;     /* at least 1 */
    uint32_t sample_permille; /* wish; 0: none, the method decides */
    uint32_t sjw;             /* in tq; 0: the method decides */
    uint32_t quanta;          /* of a bit; 0: the method decides. Segments only */
    bool has_round_trip;      /* segments only */
    uint64_t round_trip_ns;   /* 2 x (transmitter + line + receiver), at most TIMING_NS_MAX */
    uint32_t linux_version;   /* 100 x major + minor; 0: the newest. Kernel only */
} timing_request;

/* By the steps of classical CAN (T1, T10). A bit has 8 to 25 tq, and exactly the bit rate. Prop_Seg
 * covers the round trip. The rest, 3 to 16 tq, is halved for the phase segments; of an odd one
 * Phase_Seg2 gets more. sjw is min(4, Phase_Seg1, Phase_Seg2).
 *
 * With a wished sample point Phase_Seg2 comes from it, Phase_Seg1 is as long if there is room, and
 * Prop_Seg takes what is left. This is also done without a round trip, for the point that CiA
 * recommends. Without `quanta` all are tried: the nearest sample point wins, then the largest
 * tolerance, then more tq. */
bool timing_by_segments(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                        const timing_request *request);

/* The oldest Linux whose results timing_by_kernel() knows. */
#define TIMING_LINUX_MIN 408u

/* As Linux does for a bit rate (can_calc_bittiming()). It takes the nearest bit rate, with an error
 * of at most 5 %. Of these it takes the nearest sample point that is not later than the wish, and
 * of these most tq. sjw is max(1, min(Phase_Seg1, Phase_Seg2 / 2)). Before Linux 6.3 it was 1, and
 * before 5.19 fewest tq were taken. Linux may return segments that the controller lacks; here they
 * are refused. */
bool timing_by_kernel(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                      const timing_request *request);

/* Finds one prescaler for both rates of CAN FD, so that a quantum is the same in both, as CiA
 * recommends. It takes the smallest one with which timing_by_kernel() finds exactly these rates,
 * with the sample points that it finds without that condition. Returns 0 when there is none. */
uint32_t timing_common_brp(const timing_request *nominal, const timing_request *data);

#endif
