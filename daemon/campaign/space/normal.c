/* SPDX-License-Identifier: MIT
 *
 * normal.c - the standard normal distribution, and what is known of a share by a sample.
 */
#include "campaign/space/normal.h"

#include <math.h>

/* Bisection of erfc(): results are rounded to something far above its error. */
double normal_quantile(double probability)
{
    double low = -9;
    double high = 9;
    for (unsigned i = 0; i < 60; i++) {
        const double middle = (low + high) / 2;
        if (erfc(-middle / M_SQRT2) / 2 < probability)
            low = middle;
        else
            high = middle;
    }
    return (low + high) / 2;
}

share share_of(uint64_t count, uint64_t all, double confidence)
{
    if (all == 0)
        return (share){.high = 1};
    const double n = (double)all;
    const double p = (double)count / n;
    const double z = normal_quantile((1 + confidence) / 2);
    const double middle = p + z * z / (2 * n);
    const double half = z * sqrt(p * (1 - p) / n + z * z / (4 * n * n));
    const double scale = 1 + z * z / n;
    return (share){.value = p,
                   .low = count == 0 ? 0 : (middle - half) / scale,
                   .high = count == all ? 1 : (middle + half) / scale};
}
