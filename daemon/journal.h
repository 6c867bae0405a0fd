/* SPDX-License-Identifier: MIT
 *
 * journal.h - writes down all that is done to a bus, so that it can be run again.
 *
 * A file of lines, each a JSON object; config/journal.md describes them. They are written by a
 * thread (spool.h): the bus never waits for the disk. When a line cannot be taken, the journal is
 * broken from there: nothing behind it could be run again, so nothing more is written but that.
 */
#ifndef CANWIRE_JOURNAL_H
#define CANWIRE_JOURNAL_H

#include "inputs.h"

#define JOURNAL_VERSION 1
#define JOURNAL_FILES 2u /* that are kept: this one and the one before */
#define JOURNAL_ERROR_MAX 300

/* Counters of a bus that are noted now and then, so that a run can be held against them. */
typedef struct journal_counter {
    const char *name;
    uint64_t (*read)(const cw_bus_stats *stats);
} journal_counter;

#define JOURNAL_COUNTERS 6
extern const journal_counter journal_counters[JOURNAL_COUNTERS];

typedef struct journal journal;

/* Begins a journal of a bus that nothing has been done to yet. A file of that name that is there is
 * kept as FILE.1. The configuration is the live one. NULL after writing why to error. */
journal *journal_start(const char *file, const cfg *config, char error[JOURNAL_ERROR_MAX]);

/* An input_observer; user is the journal. */
void journal_input(void *user, const input *what);

/* Notes how far the bus has come and what it has counted; to be called about once a second. Logs
 * when the journal has broken. */
void journal_mark(journal *j, const inputs *in);

/* Ends it where the bus is now, with a line about what could not be written. NULL is fine. */
void journal_stop(journal *j, const inputs *in);

/* Lines that could not be written. */
uint64_t journal_lost(const journal *j);

#endif
