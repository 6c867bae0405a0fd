/* SPDX-License-Identifier: MIT
 *
 * diag.h - collects the errors of a file and of those that it names, prints them in their order.
 */
#ifndef CANWIRE_BASE_DIAG_H
#define CANWIRE_BASE_DIAG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#define DIAG_MAX 200         /* messages kept */
#define DIAG_TOLD_MAX 400    /* errors, also those that were told before; then no more is kept */
#define DIAG_WARNINGS_MAX 50 /* of these: errors always have a place */

/* A file that messages are about; the files come in the order of their numbers. */
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
    size_t errors;  /* that were told, also those that are not kept; 0: all is good so far */
    size_t count;   /* messages kept */
    size_t warnings; /* that were told */
    bool overflow;   /* there were more than DIAG_MAX or DIAG_TOLD_MAX */
    diag_message messages[DIAG_MAX];
} diag;

/* Adds a message, but not the same one twice. */
void diag_add(diag *self, size_t line, size_t column, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* The same about what is good, but perhaps not what is meant. */
void diag_warn(diag *self, size_t line, size_t column, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* As diag_add(), about what is wrong in a file that is named there: the text begins with the place
 * in that file, and line and column only say which messages it stands among. */
void diag_add_elsewhere(diag *self, size_t line, size_t column, const char *text);

/* The messages to come are about another file; returns the present one, to be set again. */
diag_file diag_enter(diag *self, const char *name, size_t number);

/* Writes a line per error, FILE:LINE:COLUMN: message, or, when there is no error, a line per
 * warning, FILE:LINE:COLUMN: warning: message; and forgets them all. */
void diag_flush(diag *self, FILE *out);

#endif
