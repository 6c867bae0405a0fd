/* SPDX-License-Identifier: MIT
 *
 * epoch.h - the clocks of a bus in virtual time when its bus time is 0. Constants, so that each run
 * is like the others.
 */
#ifndef CANWIRE_BASE_EPOCH_H
#define CANWIRE_BASE_EPOCH_H

#include <stdint.h>

#define EPOCH_MONOTONIC_NS INT64_C(1000000000000)      /* 1000 s: no program takes it for "unset" */
#define EPOCH_REALTIME_NS INT64_C(1000000000000000000) /* 2001-09-09 01:46:40 UTC */

#endif
