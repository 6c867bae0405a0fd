/* SPDX-License-Identifier: MIT
 *
 * failure.c - errors at random: how likely it is that a message comes too late.
 */
#include "cli/analyse/failure.h"

#include <math.h>

#define SURELY 10000.0 /* so many expected errors are more than FAILURE_ERRORS_MAX for sure */
#define TERMS_MAX 20000

void failure_find(const response_bus *bus, int *survived)
{
    response_bus with = *bus;
    bool any = true;
    with.error_every = CW_NEVER;
    for (size_t i = 0; i < bus->count; i++)
        survived[i] = -1;
    for (unsigned errors = 0; any && errors <= FAILURE_ERRORS_MAX; errors++) {
        with.errors = errors;
        response_find(&with);
        any = false;
        for (size_t i = 0; i < with.count; i++) {
            const bool was_early = survived[i] == (int)errors - 1;
            const bool once = errors > 0 && with.messages[i].slot > 0; /* it is not repeated */
            if (!was_early || once || response_is_late(&with.messages[i]))
                continue;
            survived[i] = (int)errors;
            any = true;
        }
    }
}

/* Adds the terms of the Poisson distribution behind the last one, which loses nothing where they
 * are small. */
double failure_probability(int survived, double mean)
{
    double sum = 0;
    if (survived < 0 || mean > SURELY)
        return 1;
    if (mean <= 0)
        return 0;
    for (int n = survived + 1; n < survived + TERMS_MAX; n++) {
        const double term = exp(n * log(mean) - mean - lgamma(n + 1.0));
        sum += term;
        if (n > mean && term < sum * 1e-17)
            break;
    }
    return sum < 1 ? sum : 1;
}

double failure_of_frame(unsigned bits, double per_bit)
{
    return -expm1(bits * log1p(-per_bit));
}
