/* SPDX-License-Identifier: MIT
 *
 * wall.c - the clock of the machine.
 */
#include "base/wall.h"

#include <time.h>

int64_t wall_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}
