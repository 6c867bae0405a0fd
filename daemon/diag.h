/* SPDX-License-Identifier: MIT
 *
 * diag.h - collects the errors of one file and prints them in the order of the file.
 */
#ifndef CANWIRE_DIAG_H
#define CANWIRE_DIAG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#define DIAG_MAX 200 /* errors kept of one file */

typedef struct diag_message {
    size_t line;   /* from 1; 0: about the file itself */
    size_t column; /* from 1, in characters */
    size_t number; /* keeps the order of messages about one place */
    char *text;
} diag_message;

/* All zeros and a file name is an empty collection. */
typedef struct diag {
    const char *file;
    size_t count;
    bool overflow; /* there were more than DIAG_MAX */
    diag_message messages[DIAG_MAX];
} diag;

void diag_add(diag *self, size_t line, size_t column, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Writes a line per error, FILE:LINE:COLUMN: message, and forgets them. */
void diag_flush(diag *self, FILE *out);

#endif
