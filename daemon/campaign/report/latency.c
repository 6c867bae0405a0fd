/* SPDX-License-Identifier: MIT
 *
 * latency.c - the distribution of detection latencies, in nanoseconds.
 */
#include "campaign/report/latency.h"

#define FINE_BITS 7u /* of a value behind its highest bit */

/* Values below 256 are classes of their own; each power of two above has 128 classes. */
static unsigned class_of_value(uint64_t ns)
{
    if (ns >> (FINE_BITS + 1) == 0)
        return (unsigned)ns;
    const unsigned shift = 63u - (unsigned)__builtin_clzll(ns) - FINE_BITS;
    return (shift << FINE_BITS) + (unsigned)(ns >> shift);
}

uint64_t latency_class_end(unsigned number)
{
    if (number >> (FINE_BITS + 1) == 0)
        return number;
    const unsigned shift = (number >> FINE_BITS) - 1;
    const uint64_t fine = (number & ((1u << FINE_BITS) - 1)) | 1u << FINE_BITS;
    return ((fine + 1) << shift) - 1;
}

/* Counts a detection. A latency that equals the limit is within it. */
void latency_add(latency *l, uint64_t ns)
{
    l->min_ns = l->rows == 0 || ns < l->min_ns ? ns : l->min_ns;
    l->max_ns = ns > l->max_ns ? ns : l->max_ns;
    l->within += l->has_limit && ns <= l->limit_ns;
    l->classes[class_of_value(ns)]++;
    l->rows++;
}

uint64_t latency_percentile(const latency *l, unsigned permille)
{
    const uint64_t rank = l->rows / 1000 * permille + (l->rows % 1000 * permille + 999) / 1000;
    uint64_t passed = 0;
    for (unsigned i = 0; i < LATENCY_CLASSES; i++) {
        passed += l->classes[i];
        if (passed >= rank && passed > 0) {
            const uint64_t end = latency_class_end(i);
            return end < l->max_ns ? end : l->max_ns;
        }
    }
    return 0;
}
