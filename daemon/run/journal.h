/* SPDX-License-Identifier: MIT
 *
 * journal.h - writes down all that is done to a bus, so that it can be run again.
 *
 * A file of lines, each a JSON object; config/journal.md describes them. They are written by a
 * thread (spool.h): the bus never waits for the disk. When a line cannot be taken, the journal is
 * broken from there: nothing behind it could be run again. It is tried again now and then; what
 * follows is written behind a line that tells of the gap, to be read.
 */
#ifndef CANWIRE_RUN_JOURNAL_H
#define CANWIRE_RUN_JOURNAL_H

#include "run/inputs.h"

#include <jansson.h>

#define JOURNAL_VERSION 2 /* 1 had no seals (journal_seal.h) and no gaps */
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
 * kept as FILE.1, and so on, up to so many files: journal_keep.h. The configuration is the live
 * one. NULL after writing why to error. */
journal *journal_start(const char *file, unsigned files, const cfg *config,
                       char error[JOURNAL_ERROR_MAX]);

/* An input_observer; user is the journal. */
void journal_input(void *user, const input *what);

/* Notes how far the bus has come and what it has counted; to be called about once a second. Logs
 * when the journal has broken, and takes it up again when it can be written, with a line about the
 * gap. */
void journal_mark(journal *j, const inputs *in);

/* Takes up a broken one again now, if that can be. */
void journal_retry(journal *j, const inputs *in);

/* Ends it where the bus is now, with a line about what could not be written. NULL is fine. */
void journal_stop(journal *j, const inputs *in);

/* Lines that could not be written. */
uint64_t journal_lost(const journal *j);

/* Whether it is not being written now, or not known to be. Of none: false. */
bool journal_is_broken(const journal *j);

/* As config/control.md tells. To be released by the caller. */
json_t *journal_to_json(const journal *j);

#endif
