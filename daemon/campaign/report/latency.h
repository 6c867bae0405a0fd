/* SPDX-License-Identifier: MIT
 *
 * latency.h - the distribution of detection latencies, in nanoseconds.
 *
 * A histogram with 128 classes for each power of two: a percentile is exact up to 256 ns, and at
 * most 0.8 % too high above. Minimum, maximum and the share within the limit are exact.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_LATENCY_H
#define CANWIRE_CAMPAIGN_REPORT_LATENCY_H

#include <stdbool.h>
#include <stdint.h>

#define LATENCY_CLASSES (58u * 128u)

/* All zeros is empty. */
typedef struct latency {
    uint64_t rows;
    uint64_t min_ns;
    uint64_t max_ns;
    bool has_limit;
    uint64_t limit_ns;
    uint64_t within; /* the limit */
    uint64_t classes[LATENCY_CLASSES];
} latency;

void latency_add(latency *l, uint64_t ns);

/* Returns the latency that `permille` of all rows do not exceed (nearest rank); 0 without rows. */
uint64_t latency_percentile(const latency *l, unsigned permille);

/* Returns the highest latency of a class. */
uint64_t latency_class_end(unsigned number);

#endif
