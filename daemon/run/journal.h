/* SPDX-License-Identifier: MIT
 *
 * journal.h - records all inputs of the buses of a process, so that the run can be repeated.
 *
 * A file of lines, each a JSON object, packed (journal_pack.h); canwire-journal(7) describes them.
 * A thread packs and writes them (spool.h): the bus never waits for the disk. Frames that the
 * configuration determines are not written, only how many there were, and what they come to. A
 * line that cannot be written breaks the journal: no run can go on behind it. Writing is tried
 * again from time to time. Later lines follow a line that describes the gap; they can be read, but
 * not run.
 */
#ifndef CANWIRE_RUN_JOURNAL_H
#define CANWIRE_RUN_JOURNAL_H

#include "base/file/sink.h"
#include "config/rig.h"
#include "run/inputs.h"

#include <jansson.h>

#define JOURNAL_VERSION 4
#define JOURNAL_VERSION_SEALS 2 /* the first one with seals (journal_seal.h) and gaps */
#define JOURNAL_VERSION_RIG 3   /* ... of a rig: each line names its bus; 4 may be of either */
#define JOURNAL_VERSION_GROUPS 4 /* ... in which a seal is of several lines, and frames that the
                                    configuration determines are missing */
#define JOURNAL_ERROR_MAX 300

/* Counters of a bus that are noted from time to time, to check a run against them. */
#define JOURNAL_COUNTERS 6
extern const cw_stat journal_counters[JOURNAL_COUNTERS];

typedef struct journal journal;
typedef struct journal_part journal_part;

/* Begins a journal of a fresh bus. An existing file is kept as FILE.1, and so on, up to that many
 * files: journal_keep.h. The configuration is the live one. Returns NULL after writing the reason
 * to error. */
journal *journal_start(const char *file, unsigned files, const cfg *config,
                       char error[JOURNAL_ERROR_MAX]);

/* Begins a journal of the fresh buses of a rig in the same way. */
journal *journal_start_rig(const char *file, unsigned files, const inputs *const *buses,
                           size_t count, char error[JOURNAL_ERROR_MAX]);

/* Records an input, as an input_observer; user is the journal of one bus. */
void journal_input(void *user, const input *what);

/* Records an input of a bus of a rig; user is the result of journal_part_at(). */
void journal_part_input(void *user, const input *what);
journal_part *journal_part_at(journal *j, size_t bus);

/* Records the progress of all buses and their counters; call it about once a second. It logs a
 * broken journal, and resumes it with a line about the gap when it can be written. `in`, also
 * below, is for a journal of one bus. */
void journal_mark(journal *j, const inputs *in);

/* Resumes a broken journal now, if possible. */
void journal_retry(journal *j, const inputs *in);

/* Ends the journal at the present tick, with a line about missing lines. NULL is allowed. */
void journal_stop(journal *j, const inputs *in);

/* Returns the number of lines that could not be written. */
uint64_t journal_lost(const journal *j);

/* Returns the object of canwire-control(7), to be released by the caller. */
json_t *journal_to_json(const journal *j);

/* Adds it. */
void journal_sink(const journal *j, sink_list *out);

#endif
