/* SPDX-License-Identifier: MIT
 *
 * journal_read.h - reads a journal (journal.h) line by line.
 */
#ifndef CANWIRE_RUN_JOURNAL_READ_H
#define CANWIRE_RUN_JOURNAL_READ_H

#include "run/inputs.h"
#include "run/journal.h"

typedef struct journal_reader journal_reader;

typedef enum journal_kind {
    JOURNAL_CONFIG = 0, /* the first entry: files */
    JOURNAL_INPUT,
    JOURNAL_SENT,   /* the tick that the bus has reached */
    JOURNAL_MARK,   /* counters, digest */
    JOURNAL_END,    /* the bus was stopped; counters, digest */
    JOURNAL_GAP,    /* the inputs up to here are unknown; why, missing */
    JOURNAL_BROKEN, /* the inputs from here on are unknown */
    JOURNAL_CUT,    /* in the same way; the file ends */
    JOURNAL_BAD,    /* a line that cannot be understood, after a message */
} journal_kind;

/* An entry. Its pointers are valid until the next entry. */
typedef struct journal_entry {
    journal_kind kind;
    uint64_t at;        /* tick */
    size_t bus;         /* of a rig, in the order of the configurations */
    bool last;          /* nothing may follow */
    uint64_t sent;      /* frames before it that the configuration determines */
    const char *node;   /* of an input about one node */
    bool late;          /* INPUT_SEND: it is such a frame, but comes late */
    input what;         /* without node and config; now and advanced are set */
    cw_frame frame;     /* target of what.frame */
    cw_settings settings;
    cfg_retime time;
    const cfg_file *files; /* JOURNAL_CONFIG, INPUT_RELOAD; at least one */
    size_t file_count;
    uint64_t counters[JOURNAL_COUNTERS];
    bool has_digest;
    uint64_t digest;    /* of all frames that the configuration has determined */
    const char *why;    /* JOURNAL_GAP */
    uint64_t missing;   /* in the same way: lines */
} journal_entry;

/* Opens a journal and reads its first line. Messages go to `errors`, one per line, as
 * FILE:LINE:COLUMN: text. Returns NULL after a message. */
journal_reader *journal_open(const char *file, FILE *errors);

/* Closes the journal. NULL is allowed. */
void journal_close(journal_reader *r);

/* Reads the next entry. No entry follows a bad one, or one that ends the journal. */
void journal_next(journal_reader *r, journal_entry *entry);

/* Goes on behind a bad entry; later entries must not be played. Returns false when there are
 * none. */
bool journal_go_on(journal_reader *r);

/* Returns true when nothing follows the present entry. */
bool journal_is_at_end(journal_reader *r);

/* Return the place in the text of the present or the missing next entry: the line, from 1, and its
 * first byte, from 0. */
size_t journal_line(const journal_reader *r);
uint64_t journal_byte(const journal_reader *r);

/* Return the contents of the first line. Missing texts are "". */
unsigned journal_version(const journal_reader *r);
const char *journal_bus(const journal_reader *r);
const char *journal_started(const journal_reader *r);

/* Returns the number of buses of a rig; 0: the journal is that of one bus. */
size_t journal_buses(const journal_reader *r);

/* Returns true for a readable journal of a rig in a regular file. Writes no messages. */
bool journal_is_of_rig(const char *file);

/* Returns the version of canwire that wrote the journal. */
const char *journal_writer(const journal_reader *r);

/* Complains about the value of a key in the present line, or about the line for NULL. */
void journal_complain(journal_reader *r, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
