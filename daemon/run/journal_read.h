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
    JOURNAL_MARK,   /* counters */
    JOURNAL_END,    /* the bus was stopped; counters */
    JOURNAL_GAP,    /* what was done up to here is not known; why, missing */
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
    const char *why;    /* JOURNAL_GAP */
    uint64_t missing;   /* the same: lines */
} journal_entry;

/* Reads the first line. Messages go to errors, one a line, as FILE:LINE:COLUMN: text. NULL after
 * one. */
journal_reader *journal_open(const char *file, FILE *errors);

/* NULL is fine. */
void journal_close(journal_reader *r);

/* The next entry. After one that ends the journal, or is bad, there is no other. */
void journal_next(journal_reader *r, journal_entry *entry);

/* After a bad entry: there may be others behind it, which are not to be played. False: there are
 * none. */
bool journal_go_on(journal_reader *r);

/* Whether there is nothing behind the present entry. */
bool journal_is_at_end(journal_reader *r);

/* Of the present entry, or where the next one was to be: the line, from 1, and its first byte, from
 * 0. And up to which tick the journal had come before. */
size_t journal_line(const journal_reader *r);
uint64_t journal_byte(const journal_reader *r);
uint64_t journal_tick(const journal_reader *r);

/* What the first line says. Texts are "" when it does not. */
unsigned journal_version(const journal_reader *r);
const char *journal_bus(const journal_reader *r);
const char *journal_started(const journal_reader *r);

/* The version of canwire that wrote it. */
const char *journal_writer(const journal_reader *r);

/* Complains about the value of a key in the present line; NULL: about the line. */
void journal_complain(journal_reader *r, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
