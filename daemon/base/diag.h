/* SPDX-License-Identifier: MIT
 *
 * diag.h - collects the errors of a file and of the files that it names; prints them in order.
 */
#ifndef CANWIRE_BASE_DIAG_H
#define CANWIRE_BASE_DIAG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#define DIAG_MAX 200         /* messages kept */
#define DIAG_TOLD_MAX 400    /* errors, including repeated ones; further ones are not kept */
#define DIAG_WARNINGS_MAX 50 /* of these: errors always have room */

/* A file that messages are about; files are sorted by number. */
typedef struct diag_file {
    const char *name; /* lives until diag_flush() */
    size_t number;
} diag_file;

typedef struct diag_message {
    diag_file file;
    size_t line;   /* from 1; 0: about the file itself */
    size_t column; /* from 1, in characters */
    size_t number; /* keeps the order of messages about one place */
    bool elsewhere; /* see diag_add_elsewhere() */
    bool warning;   /* see diag_warn() */
    char *text;
} diag_message;

/* All zeros and a file name is an empty collection. */
typedef struct diag {
    diag_file file; /* of the messages to come */
    size_t errors;  /* reported, including those that are not kept; 0: all is good so far */
    size_t count;   /* messages kept */
    size_t warnings; /* reported */
    bool overflow;   /* more than DIAG_MAX or DIAG_TOLD_MAX messages came */
    diag_message messages[DIAG_MAX];
} diag;

/* Adds a message, but not the same one twice. */
void diag_add(diag *self, size_t line, size_t column, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Adds a warning, about text that is valid but perhaps not intended. */
void diag_warn(diag *self, size_t line, size_t column, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Adds a message about another file, whose text begins with the place in that file. Line and column
 * only decide the order among the messages. */
void diag_add_elsewhere(diag *self, size_t line, size_t column, const char *text);

/* Makes another file the subject of the messages to come. Returns the present file, to be
 * restored. */
diag_file diag_enter(diag *self, const char *name, size_t number);

/* Writes and forgets all messages: a line per error, FILE:LINE:COLUMN: message. Without errors it
 * writes a line per warning, FILE:LINE:COLUMN: warning: message. */
void diag_flush(diag *self, FILE *out);

#endif
