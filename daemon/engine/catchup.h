/* SPDX-License-Identifier: MIT
 *
 * catchup.h - limits the time that a bus behind real time has to catch up with.
 *
 * A daemon that was stopped, or a machine that is too slow or was suspended, leaves the bus behind.
 * When it is too far behind, bus time stands still for the missed time, which is counted and
 * reported.
 */
#ifndef CANWIRE_ENGINE_CATCHUP_H
#define CANWIRE_ENGINE_CATCHUP_H

#include <stdbool.h>
#include <stdint.h>

#define CATCHUP_LOG_NS INT64_C(10000000000) /* a line in the log at most once in this time */

/* Starts all zero. */
typedef struct catchup {
    uint64_t skips;
    uint64_t skipped_ns;
    uint64_t logged_ns;   /* the part of it that is in the log */
    bool logged;          /* ... and there is such a line */
    int64_t last_log_ns;  /* CLOCK_MONOTONIC */
    int64_t suspended_ns; /* time that the machine has been suspended since its start */
} catchup;

/* Returns the time that a bus has to skip, a whole number of ticks and of nanoseconds (an even
 * number of ticks). It is 0 up to the limit, otherwise the whole lag. due: tick of the first event
 * that should have happened, CW_NEVER: none. All times are in ticks. */
uint64_t catchup_excess(uint64_t due, uint64_t now, uint64_t limit);

/* Notes the clocks at the start. Read boot_ns (CLOCK_BOOTTIME) after monotonic_ns, so that the
 * difference is rather too large. */
void catchup_begin(catchup *c, int64_t boot_ns, int64_t monotonic_ns);

/* Returns the time in ns that the machine was suspended since the last call, or 0. Read boot_ns
 * before monotonic_ns, so that the difference is rather too small. */
uint64_t catchup_suspended(catchup *c, int64_t boot_ns, int64_t monotonic_ns);

/* Counts skipped time. */
void catchup_note(catchup *c, uint64_t skipped_ns);

/* Logs time that was skipped since the last line, if that line is old enough. */
void catchup_log(catchup *c, int64_t monotonic_ns);

#endif
