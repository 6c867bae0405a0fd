/* SPDX-License-Identifier: MIT
 *
 * moment.h - the present time.
 */
#ifndef CANWIRE_BASE_MOMENT_H
#define CANWIRE_BASE_MOMENT_H

#include <stdint.h>
#include <time.h>

/* Returns the time of one of the machine's clocks, in ns. */
int64_t clock_ns(clockid_t id);

/* Returns a time of that many ns, which are not negative. */
static inline struct timespec moment_of(int64_t ns)
{
    return (struct timespec){.tv_sec = (time_t)(ns / 1000000000),
                             .tv_nsec = (long)(ns % 1000000000)};
}

#endif
