/* SPDX-License-Identifier: MIT
 *
 * normal.h - the standard normal distribution, and what is known of a share by a sample.
 */
#ifndef CANWIRE_CAMPAIGN_NORMAL_H
#define CANWIRE_CAMPAIGN_NORMAL_H

#include <stdint.h>

/* Returns the quantile of a probability above 0 and below 1, within 9 deviations. */
double normal_quantile(double probability);

/* A share with its confidence interval. */
typedef struct share {
    double value;
    double low;
    double high;
} share;

/* Returns the share of `count` among `all` with the score interval of Wilson (1927), without
 * continuity correction. It is 0 to 1 when all is 0. Confidence is above 0 and below 1. */
share share_of(uint64_t count, uint64_t all, double confidence);

#endif
