/* SPDX-License-Identifier: MIT
 *
 * wall.h - the clock of the machine, for waits and for what is told of them.
 */
#ifndef CANWIRE_BASE_WALL_H
#define CANWIRE_BASE_WALL_H

#include <stdint.h>

/* Returns nanoseconds since some moment; no setting of the time changes them (CLOCK_MONOTONIC). */
int64_t wall_ns(void);

#endif
