/* SPDX-License-Identifier: MIT
 *
 * pairs.c - two nodes of a bus: how far their clocks and their places may be apart.
 */
#include "timing/pairs.h"

#include "base/text/wide.h"

#define PPM 1000000
#define PRODUCT_BITS_MAX 62 /* two of them can be added */
#define EDGE_BITS 10u       /* most bits between two edges of a frame without errors */
/* An extended frame with 8 bytes: 118 bits up to the end of the CRC, of which 117 can make 29 stuff
 * bits. The CRC delimiter follows, and then ACK. */
#define STUFFED_BITS 147u
#define ACK_BIT (STUFFED_BITS + 1)

/* The bit rates of two nodes, by a common factor. */
typedef struct rates {
    uint64_t a;
    uint64_t b;
} rates;

static wide rate_of(const timing_node *node, const timing_node *other)
{
    const uint64_t clock = node->bit.clock_hz * (uint64_t)(PPM + node->ppm);

    return wide_product(clock, timing_bit_clocks(&other->bit));
}

static void halve(wide *number)
{
    number->low = number->low >> 1 | number->high << 63;
    number->high >>= 1;
}

static bool is_long(wide number)
{
    return number.high > 0 || number.low >> PRODUCT_BITS_MAX;
}

/* Equal rates stay equal, and what is cut off is less than 2^-60 of them. */
static rates rates_of(const timing_node *a, const timing_node *b)
{
    wide rate_a = rate_of(a, b);
    wide rate_b = rate_of(b, a);

    while (is_long(rate_a) || is_long(rate_b)) {
        halve(&rate_a);
        halve(&rate_b);
    }
    return (rates){rate_a.low, rate_b.low};
}

/* Returns |a - b| / (a + b): both are then f (1 + need) and f (1 - need). */
static uint32_t need_ppb(const timing_node *a, const timing_node *b)
{
    const rates r = rates_of(a, b);
    const uint64_t difference = r.a > r.b ? r.a - r.b : r.b - r.a;
    const uint64_t sum = r.a + r.b;
    uint64_t rest;
    const wide need = wide_divide(&rest, wide_product(difference, TIMING_ONE_PPB), sum);

    return (uint32_t)need.low + (rest > 0);
}

uint64_t timing_way_ps(const timing_node *a, const timing_node *b)
{
    const uint64_t line = a->place_ps > b->place_ps ? a->place_ps - b->place_ps
                                                    : b->place_ps - a->place_ps;

    return line + a->stub_ps + b->stub_ps;
}

/* Returns the shorter one of two spans, each in the time quanta of its own node. */
static uint64_t least_ps(const timing_node *a, const timing_node *b, uint32_t a_tq, uint32_t b_tq)
{
    const uint64_t of_a = timing_quanta_ps(&a->bit, a_tq);
    const uint64_t of_b = timing_quanta_ps(&b->bit, b_tq);

    return of_a < of_b ? of_a : of_b;
}

/* Returns the longer time quantum of two nodes: a shorter round trip is not seen. */
static uint64_t longest_tq_ps(const timing_node *a, const timing_node *b)
{
    const uint64_t of_a = timing_quanta_ps(&a->bit, 1);
    const uint64_t of_b = timing_quanta_ps(&b->bit, 1);

    return of_a > of_b ? of_a : of_b;
}

timing_pair timing_pair_of(const timing_node *a, const timing_node *b)
{
    const uint64_t transfers = a->transfer_ps + b->transfer_ps;
    timing_pair pair = {
        .need_ppb = need_ppb(a, b),
        .tolerance_ppb = timing_least(timing_tolerance_ppb(&a->bit), timing_tolerance_ppb(&b->bit)),
        .sufficient_ppb =
            timing_least(timing_sufficient_ppb(&a->bit), timing_sufficient_ppb(&b->bit)),
        .round_trip_ps = transfers + 2 * timing_way_ps(a, b),
        .delays_ps = least_ps(a, b, a->delay_tq, b->delay_tq),
    };

    pair.longest_ps = pair.delays_ps > transfers ? (pair.delays_ps - transfers) / 2 : 0;
    pair.trip_is_seen = pair.round_trip_ps >= longest_tq_ps(a, b);
    return pair;
}

int64_t timing_tolerance_left_ppb(const timing_pair *pair)
{
    return (int64_t)pair->tolerance_ppb - pair->need_ppb;
}

int64_t timing_sufficient_left_ppb(const timing_pair *pair)
{
    return (int64_t)pair->sufficient_ppb - pair->need_ppb;
}

int64_t timing_delays_left_ps(const timing_pair *pair)
{
    return (int64_t)pair->delays_ps - (int64_t)pair->round_trip_ps;
}

uint32_t timing_limit_ppb(const timing_pair *pair)
{
    return pair->trip_is_seen ? pair->tolerance_ppb : pair->sufficient_ppb;
}

timing_worst timing_worst_of(const timing_node *nodes, size_t count, size_t i)
{
    const size_t first = i == 0;
    timing_worst worst = {.clock = first,
                          .line = first,
                          .clock_pair = timing_pair_of(&nodes[i], &nodes[first])};
    uint32_t most_ppb = worst.clock_pair.need_ppb;

    worst.line_pair = worst.clock_pair;
    for (size_t k = first + 1; k < count; k++) {
        const timing_pair pair = timing_pair_of(&nodes[i], &nodes[k]);
        if (k == i)
            continue;
        most_ppb = pair.need_ppb > most_ppb ? pair.need_ppb : most_ppb;
        if (timing_tolerance_left_ppb(&pair) < timing_tolerance_left_ppb(&worst.clock_pair)) {
            worst.clock = k;
            worst.clock_pair = pair;
        }
        if (timing_delays_left_ps(&pair) < timing_delays_left_ps(&worst.line_pair)) {
            worst.line = k;
            worst.line_pair = pair;
        }
    }
    worst.resynchronisations = timing_resynchronisations(&nodes[i].bit, most_ppb);
    return worst;
}

unsigned timing_resynchronisations(const bit_timing *t, uint32_t need)
{
    const uint64_t drift = (uint64_t)timing_quanta(t) * 2 * need; /* of a bit, in 1e-9 tq */
    uint64_t error = 0;
    unsigned count = 0;

    for (unsigned bit = 0; bit < ACK_BIT;) {
        const unsigned next = bit + EDGE_BITS < STUFFED_BITS ? bit + EDGE_BITS : ACK_BIT;
        error += (next - bit) * drift;
        bit = next;
        if (error < TIMING_ONE_PPB)
            continue;
        count++;
        error -= timing_least((uint32_t)(error / TIMING_ONE_PPB), t->sjw) * TIMING_ONE_PPB;
    }
    return count;
}
