/* SPDX-License-Identifier: MIT
 *
 * recorder.h - records the events of a bus in a file: candump log, pcapng or VCD.
 *
 * It goes on in another file when `size` bytes have been reached; each file is complete on its own.
 * It never waits for the disk: entries that a slow disk cannot take are left out and counted. When
 * a file cannot be written (the disk is full) the recording has ended.
 */
#ifndef CANWIRE_RECORD_RECORDER_H
#define CANWIRE_RECORD_RECORDER_H

#include "base/file/spool.h"
#include "canwire.h"
#include "config/config.h"

typedef struct recorder recorder;

/* Begins a recording of the later events of a bus. config must stay in place and have the nodes of
 * the bus. `what` is copied, but its file must live longer. bus may be NULL unless the format is
 * VCD. Another thread calls `notify` when the recording has ended. Returns NULL with *error, an
 * errno as for spool_open(). */
recorder *recorder_start(const cfg_record *what, const cfg *config, const cw_bus *bus,
                         spool_notify *notify, void *user, int *error);

/* Begins a recording without waiting for the disk: see spool_open_later(). */
recorder *recorder_start_later(const cfg_record *what, const cfg *config, const cw_bus *bus,
                               spool_notify *notify, void *user, int *error);

/* Records into an open descriptor, which is closed at the end, in place of what->file, see
 * spool_stream(). No second file is begun: nodes that change become further ones of the capture. */
recorder *recorder_start_stream(const cfg_record *what, const cfg *config, int fd,
                                spool_notify *notify, void *user, int *error);

/* Returns true when its file has been opened. */
bool recorder_is_open(const recorder *r);

/* Returns whether an event makes an entry of that format, for those that come while nothing is
 * recorded. Of a VCD it is false: bits make its entries. */
bool recorder_takes(cfg_record_format of, const cw_event *event);

/* Returns true when it needs each bit, too. */
bool recorder_wants_bits(const recorder *r);

/* Records each event, in order, with its time in nanoseconds since 1970. The event precedes the bit
 * at whose end it came. */
void recorder_event(recorder *r, const cw_event *event, uint64_t time_ns);

/* Records each simulated bit; bits may be left out where nothing changes. */
void recorder_bit(recorder *r, const cw_bus *bus);

/* Adapts to changed nodes of config: some formats go on in another file. */
void recorder_nodes_changed(recorder *r, const cw_bus *bus);

/* Lets its thread look at the file. Another program may have renamed, removed or shortened it:
 * recorder_begin_anew() then tells which, after `notify` or the next call, and begins the file
 * anew. */
void recorder_look(recorder *r);
spool_found recorder_begin_anew(recorder *r, const cw_bus *bus);

/* Sets other limits from now on. */
void recorder_set_limits(recorder *r, uint64_t size, unsigned files);

/* Ends the recording; does not wait for pending writes. */
void recorder_end(recorder *r);

/* Ends it and waits up to that moment of CLOCK_MONOTONIC. Returns true when the file is written, or
 * cannot be. */
bool recorder_wait(recorder *r, const struct timespec *until);

/* Returns true when the file is written, or cannot be. */
bool recorder_has_ended(const recorder *r);

/* Returns the errno that has ended it, or 0. */
int recorder_error(const recorder *r);

/* Waits up to that time for pending writes and frees the recorder. Returns false when the writes
 * take longer; the memory is then lost. NULL is allowed. */
bool recorder_close(recorder *r, unsigned patience_s);

/* Statistics so far: recorded and left-out entries (frames and error frames; bits of a VCD), bytes,
 * and files begun. */
typedef struct recorder_stats {
    uint64_t entries;
    uint64_t lost;
    uint64_t bytes;
    uint64_t begun;
    uint64_t headless; /* of those lost: left out since somebody has shortened the file */
    uint64_t unwritten; /* ... in the queue when an error ended the recording */
} recorder_stats;

void recorder_get_stats(const recorder *r, recorder_stats *stats);

#endif
