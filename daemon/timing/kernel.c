/* SPDX-License-Identifier: MIT
 *
 * kernel.c - a bit timing as Linux finds it for `ip link set can0 type can bitrate N`.
 *
 * The order in which it tries, and its rounding in permille and in bit/s, decide between equals, so
 * they are kept.
 */
#include "timing/request.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>

#define PERMILLE 1000u
#define ERROR_MAX 5u    /* percent of the bit rate */
#define NONE UINT32_MAX /* the error of what is not possible */

/* Versions that changed the result, as in timing_request. */
#define LINUX_SMALL_BRP 519u  /* of equals the smallest prescaler, not the largest */
#define LINUX_HALF_SJW 603u   /* sjw is half of Phase_Seg2, not 1, and a wish is not shortened */
#define LINUX_TWO_DIGITS 619u /* errors of the bit rate count in 0.01 %, not in 0.1 % */

/* Both parts of a bit beside Sync_Seg. */
typedef struct parts {
    uint32_t tseg1;
    uint32_t tseg2;
    uint32_t sample_error; /* permille before the wished sample point, or NONE */
} parts;

/* The best so far. */
typedef struct search {
    const timing_request *request;
    uint32_t sample_permille;
    uint32_t brp;
    uint32_t tseg;          /* tseg1 + tseg2 */
    uint32_t bitrate_error; /* bit/s */
    uint32_t sample_error;
} search;

static bool is_since(const timing_request *r, uint32_t version)
{
    return r->linux_version == 0 || r->linux_version >= version;
}

static uint32_t clamped(uint32_t value, uint32_t lowest, uint32_t highest)
{
    if (value < lowest)
        return lowest;
    return value < highest ? value : highest;
}

/* Divides tseg with this tseg2, or one as near as the controller can. */
static parts divide(const search *s, uint32_t tseg, uint32_t wished_tseg2)
{
    const timing_limits *limits = s->request->limits;
    uint32_t tseg2 = clamped(wished_tseg2, limits->tseg2_min, limits->tseg2_max);
    parts result = {.sample_error = NONE};

    if (tseg2 > tseg)
        return result;
    result.tseg1 = tseg - tseg2 < limits->tseg1_max ? tseg - tseg2 : limits->tseg1_max;
    result.tseg2 = tseg - result.tseg1;
    uint32_t sample = PERMILLE * (TIMING_SYNC_SEG + result.tseg1) / (TIMING_SYNC_SEG + tseg);
    if (sample <= s->sample_permille)
        result.sample_error = s->sample_permille - sample;
    return result;
}

/* Finds the latest sample point that is not behind the wished one. Rounding down makes tseg2 of the
 * first attempt long enough; the second is 1 tq shorter. */
static parts best_parts(const search *s, uint32_t tseg)
{
    uint32_t quanta = TIMING_SYNC_SEG + tseg;
    uint32_t tseg2 = quanta - s->sample_permille * quanta / PERMILLE;
    parts first = divide(s, tseg, tseg2);
    parts second = divide(s, tseg, tseg2 - 1);

    return second.sample_error < first.sample_error ? second : first;
}

/* Returns the prescaler for bits of so many quanta: rounded down, or 1 more, and then down to what
 * the controller has. */
static uint64_t prescaler(const timing_request *r, uint32_t quanta, bool up)
{
    uint64_t brp = r->clock_hz / ((uint64_t)quanta * r->bitrate_bps) + up;

    return brp / r->limits->brp_step * r->limits->brp_step;
}

static uint32_t bitrate_error(const timing_request *r, uint64_t brp, uint32_t quanta)
{
    uint32_t bitrate = (uint32_t)(r->clock_hz / (brp * quanta));

    return bitrate < r->bitrate_bps ? r->bitrate_bps - bitrate : bitrate - r->bitrate_bps;
}

/* Takes this tseg if it is better than all before. A nearer bit rate begins anew with sample
 * points, even if it then has none. */
static void consider(search *s, uint32_t tseg, bool up)
{
    const timing_request *r = s->request;
    uint64_t brp = prescaler(r, TIMING_SYNC_SEG + tseg, up);

    if (!timing_has_brp(r->limits, brp))
        return;
    uint32_t error = bitrate_error(r, brp, TIMING_SYNC_SEG + tseg);
    if (error > s->bitrate_error)
        return;
    if (error < s->bitrate_error)
        s->sample_error = NONE;
    parts found = best_parts(s, tseg);
    bool equal_is_worse = is_since(r, LINUX_SMALL_BRP);
    if (found.sample_error > s->sample_error ||
        (found.sample_error == s->sample_error && equal_is_worse))
        return;
    s->sample_error = found.sample_error;
    s->bitrate_error = error;
    s->brp = (uint32_t)brp;
    s->tseg = tseg;
}

/* Tries the longest bits first, with the prescaler rounded up before it is rounded down. */
static void try_all(search *s)
{
    const timing_limits *limits = s->request->limits;
    uint32_t shortest = (uint32_t)limits->tseg1_min + limits->tseg2_min;

    for (uint32_t tseg = (uint32_t)limits->tseg1_max + limits->tseg2_max; tseg >= shortest; tseg--)
        for (unsigned up = 2; up-- > 0;) {
            consider(s, tseg, up == 1);
            if (s->bitrate_error == 0 && s->sample_error == 0)
                return;
        }
}

/* Writes that no segments fit, with all that was given. Returns false. */
static bool refuse_all(char problem[TIMING_PROBLEM_MAX], const search *s)
{
    const timing_request *r = s->request;

    snprintf(problem, TIMING_PROBLEM_MAX,
             "%s has no segments for %" PRIu32 " bit/s at a clock of %" PRIu32
             " Hz with a sample point up to %" PRIu32 ".%" PRIu32 " %%",
             r->limits->name, r->bitrate_bps, r->clock_hz, s->sample_permille / 10,
             s->sample_permille % 10);
    return false;
}

/* Returns true when the nearest bit rate is near enough. */
static bool bitrate_is_near(char problem[TIMING_PROBLEM_MAX], const search *s)
{
    uint32_t per_percent = is_since(s->request, LINUX_TWO_DIGITS) ? 100 : 10;
    uint64_t error = (uint64_t)s->bitrate_error * 100 * per_percent / s->request->bitrate_bps;

    if (error <= (uint64_t)ERROR_MAX * per_percent)
        return true;
    snprintf(problem, TIMING_PROBLEM_MAX,
             "the nearest bit rate is %" PRIu64 ".%0*" PRIu64 " %% off, %u %% are allowed",
             error / per_percent, per_percent == 100 ? 2 : 1, error % per_percent, ERROR_MAX);
    return false;
}

/* Returns the sjw of that version of Linux. A wish was shortened before 6.3; later it is refused if
 * it is too long. */
static uint32_t choose_sjw(const timing_request *r, const bit_timing *t)
{
    bool newer = is_since(r, LINUX_HALF_SJW);
    uint32_t half = timing_least(t->phase_seg1, t->phase_seg2 / 2);

    if (r->sjw > 0)
        return newer ? r->sjw
                     : timing_least(r->sjw, timing_least(r->limits->sjw_max, t->phase_seg2));
    return newer && half > 0 ? half : 1;
}

bool timing_by_kernel(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                      const timing_request *request)
{
    search s = {.request = request,
                .sample_permille = request->sample_permille,
                .bitrate_error = NONE,
                .sample_error = NONE};

    assert(request->clock_hz > 0 && request->bitrate_bps > 0);
    if (s.sample_permille == 0)
        s.sample_permille = timing_cia_sample_permille(request->bitrate_bps);
    assert(s.sample_permille >= TIMING_SAMPLE_MIN && s.sample_permille <= TIMING_SAMPLE_MAX);
    try_all(&s);
    if (s.bitrate_error == NONE)
        return refuse_all(problem, &s);
    if (!bitrate_is_near(problem, &s))
        return false;
    parts found = best_parts(&s, s.tseg);
    if (found.sample_error == NONE)
        return refuse_all(problem, &s);
    *out = (bit_timing){.clock_hz = request->clock_hz,
                        .brp = s.brp,
                        .prop_seg = found.tseg1 / 2,
                        .phase_seg1 = found.tseg1 - found.tseg1 / 2,
                        .phase_seg2 = found.tseg2};
    out->sjw = choose_sjw(request, out);
    return timing_fits(problem, out, request->limits);
}
