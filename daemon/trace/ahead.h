/* SPDX-License-Identifier: MIT
 *
 * ahead.h - reads a recording ahead in a thread, for a bus that must not wait for a disk.
 */
#ifndef CANWIRE_TRACE_AHEAD_H
#define CANWIRE_TRACE_AHEAD_H

#include "trace/read.h"

#define TRACE_AHEAD_ENTRIES 4096u /* half a second of 8000 frames a second */

typedef struct trace_ahead trace_ahead;

/* Reads on from the reader's place and takes over the reader. With `again` it starts over at the
 * end of the file, for ever. Returns NULL without memory or a thread; the caller then keeps the
 * reader. */
trace_ahead *trace_ahead_start(trace_reader *reader, bool again);

/* Closes it without waiting for a read in progress; a thread that hangs ends when its read returns.
 * NULL is allowed. */
void trace_ahead_close(trace_ahead *a);

/* Returns the next entry, and the bytes of the file up to its end. Returns TRACE_LATER when the
 * entry has not been read yet. No entry follows TRACE_BAD, or TRACE_END without `again`. */
trace_result trace_ahead_next(trace_ahead *a, trace_record *record, uint64_t *position);

/* Waits until nothing more can be read ahead. */
void trace_ahead_fill(trace_ahead *a);

#endif
