/* SPDX-License-Identifier: MIT
 *
 * journal_read.h - reads a journal (journal.h) line by line.
 */
#ifndef CANWIRE_JOURNAL_READ_H
#define CANWIRE_JOURNAL_READ_H

#include "inputs.h"
#include "journal.h"

typedef struct journal_reader journal_reader;

typedef enum journal_kind {
    JOURNAL_CONFIG = 0, /* the first entry: files */
    JOURNAL_INPUT,
    JOURNAL_MARK,   /* counters */
    JOURNAL_END,    /* the bus was stopped; counters */
    JOURNAL_BROKEN, /* what was done from here on is not known */
    JOURNAL_CUT,    /* the same; the file ends */
    JOURNAL_BAD,    /* a line that cannot be understood, after a message */
} journal_kind;

/* Pointers are good until the next entry. */
typedef struct journal_entry {
    journal_kind kind;
    uint64_t at;        /* tick */
    const char *node;   /* of an input that concerns one */
    input what;         /* but for node and config; now and advanced are set */
    cw_frame frame;     /* what.frame points to it */
    cw_settings settings;
    const cfg_file *files; /* JOURNAL_CONFIG, INPUT_RELOAD; at least one */
    size_t file_count;
    uint64_t counters[JOURNAL_COUNTERS];
} journal_entry;

/* Reads the first line. Messages go to errors, one a line, as FILE:LINE:COLUMN: text. NULL after
 * one. */
journal_reader *journal_open(const char *file, FILE *errors);

/* NULL is fine. */
void journal_close(journal_reader *r);

/* The next entry. After one that ends the journal there is no other. */
void journal_next(journal_reader *r, journal_entry *entry);

/* The version of canwire that wrote it. */
const char *journal_writer(const journal_reader *r);

/* Complains about the value of a key in the present line; NULL: about the line. */
void journal_complain(journal_reader *r, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
