/* SPDX-License-Identifier: MIT
 *
 * moment.c - the present time.
 */
#include "base/moment.h"

#define NS_PER_S INT64_C(1000000000)

int64_t clock_ns(clockid_t id)
{
    struct timespec t;
    (void)clock_gettime(id, &t);
    return t.tv_sec * NS_PER_S + t.tv_nsec;
}
