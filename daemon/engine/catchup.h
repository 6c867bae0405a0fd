/* SPDX-License-Identifier: MIT
 *
 * catchup.h - what a bus does that has fallen behind real time: it catches up, but not with hours.
 *
 * A daemon that was stopped, or a machine that is too slow or was suspended, leaves the bus behind.
 * When it is too far behind, bus time stands still for what was missed; that is counted and told.
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
    uint64_t logged_ns;   /* of these, what the log knows of */
    bool logged;          /* ... and that it has a line at all */
    int64_t last_log_ns;  /* CLOCK_MONOTONIC */
    int64_t suspended_ns; /* that the machine has spent suspended since it was started */
} catchup;

/* Time that a bus has to skip, as a whole number of ticks and of nanoseconds (both even ticks):
 * none when it is at most limit behind, else all it is behind. due: tick of the first thing that
 * should have happened, CW_NEVER: none. All in ticks. */
uint64_t catchup_excess(uint64_t due, uint64_t now, uint64_t limit);

/* Notes the clocks at the start. boot_ns (CLOCK_BOOTTIME) has to be read after monotonic_ns, so
 * that the difference is rather too large. */
void catchup_begin(catchup *c, int64_t boot_ns, int64_t monotonic_ns);

/* How long the machine was suspended since the last call, in ns; 0 when it was not. boot_ns has
 * to be read before monotonic_ns, so that the difference is rather too small. */
uint64_t catchup_suspended(catchup *c, int64_t boot_ns, int64_t monotonic_ns);

/* Counts what was skipped. */
void catchup_note(catchup *c, uint64_t skipped_ns);

/* Logs what has been skipped since the last line, now or when the last line is old enough. */
void catchup_log(catchup *c, int64_t monotonic_ns);

#endif
