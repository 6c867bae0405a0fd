/* SPDX-License-Identifier: MIT
 *
 * ahead.h - reads a recording ahead in a thread, for a bus that must not wait for a disk.
 */
#ifndef CANWIRE_TRACE_AHEAD_H
#define CANWIRE_TRACE_AHEAD_H

#include "trace/read.h"

#define TRACE_AHEAD_ENTRIES 4096u /* half a second of 8000 frames a second */

typedef struct trace_ahead trace_ahead;

/* Goes on reading where the reader is, which is left to it. again: at the end of the file from the
 * beginning, for ever. NULL when there is no memory or thread; the reader is then still the
 * caller's. */
trace_ahead *trace_ahead_start(trace_reader *reader, bool again);

/* Does not wait for what is being read; a thread that hangs ends when it comes back. NULL is
 * fine. */
void trace_ahead_close(trace_ahead *a);

/* The next entry, and the bytes of the file up to its end; TRACE_LATER when it has not been read
 * yet. After TRACE_BAD, and after TRACE_END if not `again`, there is nothing more. */
trace_result trace_ahead_next(trace_ahead *a, trace_record *record, uint64_t *position);

/* Waits until nothing more can be read ahead. */
void trace_ahead_fill(trace_ahead *a);

#endif
