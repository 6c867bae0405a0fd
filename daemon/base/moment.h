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

#endif
