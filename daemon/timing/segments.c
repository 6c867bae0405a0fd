/* SPDX-License-Identifier: MIT
 *
 * segments.c - a bit timing by the steps of classical CAN: the segments follow from the delays.
 */
#include "timing/request.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#define PHASE_MAX 8u  /* tq of a classical phase segment (T1) */
#define PHASE2_MIN 2u /* the information processing time */
#define REST_MIN 3u   /* tq of both phase segments */
#define SJW_MAX 4u    /* of classical CAN */
#define PERMILLE 1000u

/* A bit of so many quanta that is to be divided into segments. */
typedef struct division {
    uint32_t quanta;
    uint32_t sample_permille; /* 0: the phase segments are halves */
    uint64_t prop_least;      /* tq that the round trip takes, at least 1 */
} division;

/* The best bit timing so far. */
typedef struct choice {
    bit_timing timing;
    bool found;
} choice;

/* Returns the point to aim at: a wish, or else what CiA recommends where no delay decides. */
static uint32_t wished_sample(const timing_request *r)
{
    if (r->sample_permille > 0 || r->has_round_trip)
        return r->sample_permille;
    return timing_cia_sample_permille(r->bitrate_bps);
}

/* Returns the clocks of a tq, 0: it is not a whole number. */
static uint64_t whole_brp(const timing_request *r, uint32_t quanta)
{
    uint64_t quanta_hz = (uint64_t)r->bitrate_bps * quanta;

    return r->clock_hz % quanta_hz == 0 ? r->clock_hz / quanta_hz : 0;
}

static uint64_t prop_least(const timing_request *r, uint32_t brp)
{
    uint64_t prop = r->has_round_trip ? timing_quanta_of_ns(r->clock_hz, brp, r->round_trip_ns) : 0;

    return prop > 0 ? prop : 1;
}

/* ---- Segments -------------------------------------------------------------------------------- */

/* Returns true when Prop_Seg leaves enough for the phase segments. */
static bool rest_suffices(char problem[TIMING_PROBLEM_MAX], const division *d)
{
    uint64_t rest = d->quanta - TIMING_SYNC_SEG;

    rest = d->prop_least < rest ? rest - d->prop_least : 0;
    if (rest >= REST_MIN)
        return true;
    snprintf(problem, TIMING_PROBLEM_MAX,
             "the round trip takes %" PRIu64 " of %" PRIu32 " tq: %" PRIu64
             " tq left for the phase segments, %u needed",
             d->prop_least, d->quanta, rest, REST_MIN);
    return false;
}

/* Halves what Prop_Seg leaves. Phase segments have 8 tq at most, so Prop_Seg takes what is over. */
static void divide_in_halves(bit_timing *out, const division *d)
{
    uint32_t rest = d->quanta - TIMING_SYNC_SEG - (uint32_t)d->prop_least;

    rest = timing_least(rest, 2 * PHASE_MAX);
    out->prop_seg = d->quanta - TIMING_SYNC_SEG - rest;
    out->phase_seg1 = rest / 2;
    out->phase_seg2 = rest - rest / 2;
}

/* Returns the distance of the sample point from the wish, in 1/1000 tq. */
static uint64_t distance(const division *d, uint32_t phase_seg2)
{
    int64_t there = (int64_t)PERMILLE * (d->quanta - phase_seg2);

    return (uint64_t)llabs(there - (int64_t)d->sample_permille * d->quanta);
}

/* Finds the Phase_Seg2 whose sample point is nearest; of two the longer one. It leaves at least
 * 1 tq for Phase_Seg1. */
static uint32_t nearest_phase2(const division *d, uint32_t longest)
{
    uint32_t best = PHASE2_MIN;

    for (uint32_t phase2 = PHASE2_MIN + 1; phase2 <= longest; phase2++)
        if (distance(d, phase2) <= distance(d, best))
            best = phase2;
    return best;
}

/* Puts the sample point at the wish, or as near as delays and limits let it. Prop_Seg takes the
 * rest. */
static void divide_at_sample(bit_timing *out, const division *d)
{
    uint32_t rest = d->quanta - TIMING_SYNC_SEG - (uint32_t)d->prop_least;

    out->phase_seg2 = nearest_phase2(d, timing_least(rest - 1, PHASE_MAX));
    out->phase_seg1 = timing_least(rest - out->phase_seg2, out->phase_seg2);
    out->prop_seg = d->quanta - TIMING_SYNC_SEG - out->phase_seg1 - out->phase_seg2;
}

/* Writes why this number of quanta is impossible. Returns false. */
static bool refuse_brp(char problem[TIMING_PROBLEM_MAX], const timing_request *r, uint32_t quanta)
{
    snprintf(problem, TIMING_PROBLEM_MAX,
             "a clock of %" PRIu32 " Hz cannot be divided into %" PRIu32 " tq at %" PRIu32 " bit/s",
             r->clock_hz, quanta, r->bitrate_bps);
    return false;
}

/* Finds the bit timing with this number of quanta. */
static bool divide(bit_timing *out, char problem[TIMING_PROBLEM_MAX], const timing_request *r,
                   uint32_t quanta)
{
    uint64_t brp = whole_brp(r, quanta);

    if (brp == 0)
        return refuse_brp(problem, r, quanta);
    division d = {.quanta = quanta, .sample_permille = wished_sample(r)};
    *out = (bit_timing){.clock_hz = r->clock_hz, .brp = (uint32_t)brp};
    d.prop_least = prop_least(r, out->brp);
    if (!rest_suffices(problem, &d))
        return false;
    if (d.sample_permille > 0)
        divide_at_sample(out, &d);
    else
        divide_in_halves(out, &d);
    uint32_t longest = timing_least(timing_least(SJW_MAX, r->limits->sjw_max),
                                    timing_least(out->phase_seg1, out->phase_seg2));
    out->sjw = r->sjw > 0 ? r->sjw : longest;
    return timing_fits(problem, out, r->limits);
}

/* ---- Number of quanta ------------------------------------------------------------------------ */

/* Returns true when a new timing is better than the one so far, which has fewer quanta. */
static bool is_better(const bit_timing *t, const choice *so_far, const timing_request *r)
{
    uint32_t sample = wished_sample(r);

    if (!so_far->found)
        return true;
    if (sample > 0) {
        const division mine = {.quanta = timing_quanta(t), .sample_permille = sample};
        const division other = {.quanta = timing_quanta(&so_far->timing),
                                .sample_permille = sample};
        uint64_t here = distance(&mine, t->phase_seg2) * other.quanta;
        uint64_t there = distance(&other, so_far->timing.phase_seg2) * mine.quanta;
        if (here != there)
            return here < there;
    }
    return timing_tolerance_ppb(t) >= timing_tolerance_ppb(&so_far->timing);
}

/* Writes why no number of quanta is possible. Returns false. */
static bool refuse_all(char problem[TIMING_PROBLEM_MAX], const timing_request *r)
{
    snprintf(problem, TIMING_PROBLEM_MAX,
             "a clock of %" PRIu32 " Hz cannot be divided into %u to %u tq at %" PRIu32 " bit/s",
             r->clock_hz, TIMING_QUANTA_MIN, TIMING_QUANTA_MAX, r->bitrate_bps);
    return false;
}

/* Tries all numbers of quanta. When none is possible, the message is about the largest one that
 * the clock can be divided into. */
static bool segments_choose(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                            const timing_request *r)
{
    choice best = {.found = false};
    bool divisible = false;

    for (uint32_t quanta = TIMING_QUANTA_MIN; quanta <= TIMING_QUANTA_MAX; quanta++) {
        bit_timing tried;
        if (whole_brp(r, quanta) == 0)
            continue;
        divisible = true;
        if (divide(&tried, problem, r, quanta) && is_better(&tried, &best, r))
            best = (choice){.timing = tried, .found = true};
    }
    if (!divisible)
        return refuse_all(problem, r);
    *out = best.timing;
    return best.found;
}

bool timing_by_segments(bit_timing *out, char problem[TIMING_PROBLEM_MAX],
                        const timing_request *request)
{
    assert(request->clock_hz > 0 && request->bitrate_bps > 0);
    assert(request->round_trip_ns <= TIMING_NS_MAX);
    if (request->quanta > 0)
        return divide(out, problem, request, request->quanta);
    return segments_choose(out, problem, request);
}
