/* SPDX-License-Identifier: MIT
 *
 * rowfile.h - the file of rows: it is there when all rows are in it, and never in part.
 *
 * Until then the rows are in FILE.part, which a later run may continue.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_ROWFILE_H
#define CANWIRE_CLI_CAMPAIGN_ROWFILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

typedef struct rowfile {
    const char *name; /* NULL: standard output */
    char *real;       /* the file that a link with this name leads to; NULL: there is none */
    char *part;       /* its name while rows are missing */
    FILE *stream;
    bool whole; /* the file is there, and is not written */
    bool kept;  /* a part that is not done stays */
} rowfile;

/* Takes a line that is there already. Returns false for one that does not belong there. */
typedef bool rowfile_check(void *user, const char *line, size_t length);

/* Opens the file. resume: whole lines that are there stay, and each is given to `check`. Without
 * `check` it is one whose part no later run continues, and a device or a pipe is written as it is.
 * Returns false after a message. */
bool rowfile_open(rowfile *f, const char *name, bool resume, rowfile_check *check, void *user);

/* Closes it. done: all rows are in it, and it gets its name. Returns false after a message. */
bool rowfile_close(rowfile *f, bool done);

#endif
