/* SPDX-License-Identifier: MIT
 *
 * recorder.h - records what happens on a bus into a file: candump log, pcapng or VCD.
 *
 * It goes on in another file when `size` bytes have been reached; each file is complete on its own.
 * It never waits for the disk: what the disk is too slow for is left out and counted. When a file
 * cannot be written (the disk is full) the recording has ended.
 */
#ifndef CANWIRE_RECORD_RECORDER_H
#define CANWIRE_RECORD_RECORDER_H

#include "base/spool.h"
#include "canwire.h"
#include "config/config.h"

typedef struct recorder recorder;

/* Begins a recording of what is still to come on a bus. config must stay where it is and have
 * the nodes of the bus; what is copied, but its file must live longer. bus may be NULL unless
 * the format is VCD. news is called in another thread when the recording has ended. NULL with
 * *error, an errno as of spool_open(). */
recorder *recorder_start(const cfg_record *what, const cfg *config, const cw_bus *bus,
                         spool_news *news, void *user, int *error);

/* The same without waiting for the disk: see spool_open_later(). */
recorder *recorder_start_later(const cfg_record *what, const cfg *config, const cw_bus *bus,
                               spool_news *news, void *user, int *error);

/* Whether its file has been opened. */
bool recorder_is_open(const recorder *r);

/* Whether it is to be told of each bit, too. */
bool recorder_wants_bits(const recorder *r);

/* Each event, in order, with its time in nanoseconds since 1970; before the bit at whose end it
 * came. */
void recorder_event(recorder *r, const cw_event *event, uint64_t time_ns);

/* Each bit that the bus has simulated by itself; bits may be left out where nothing changes. */
void recorder_bit(recorder *r, const cw_bus *bus);

/* The nodes of config have changed: goes on in another file where the format has to. */
void recorder_nodes_changed(recorder *r, const cw_bus *bus);

/* Other limits from now on. */
void recorder_set_limits(recorder *r, uint64_t size, unsigned files);

/* Nothing more is recorded; does not wait for what is still to be written. */
void recorder_end(recorder *r);

/* The same, and waits up to that moment of CLOCK_MONOTONIC. Whether it has been written, or cannot
 * be. */
bool recorder_wait(recorder *r, const struct timespec *until);

/* Whether that has been written, or cannot be. */
bool recorder_has_ended(const recorder *r);

/* The errno that has ended it, or 0. */
int recorder_error(const recorder *r);

/* Waits up to that time for what is still to be written, then frees. False when it has not been
 * written by then; the memory is then lost. NULL is fine. */
bool recorder_close(recorder *r, unsigned patience_s);

/* What went on so far: entries (frames and error frames; bits of a VCD) that were recorded and that
 * were left out, bytes, files begun. */
typedef struct recorder_stats {
    uint64_t entries;
    uint64_t lost;
    uint64_t bytes;
    uint64_t begun;
} recorder_stats;

void recorder_get_stats(const recorder *r, recorder_stats *stats);

#endif
