/* SPDX-License-Identifier: MIT
 *
 * outfile.h - a file that is written to: what it had stays until there is something to write.
 */
#ifndef CANWIRE_CLI_OUTFILE_H
#define CANWIRE_CLI_OUTFILE_H

#include <stdbool.h>
#include <stdio.h>

/* All zeros is one that is not wanted. */
typedef struct outfile {
    const char *name; /* not owned; "-": standard output */
    FILE *stream;     /* NULL: not open */
    char *buffer;     /* of the stream, larger than that of stdio; NULL: it has that */
    bool made;        /* it was not there before */
    bool begun;
} outfile;

/* Opens it for writing; a file that is there is not changed yet. NULL as name: it is not wanted.
 * One that another program records into is refused.
 * False after a message that begins with `program`. */
bool outfile_open(outfile *self, const char *name, const char *program);

/* Where to write, from the start; the first call empties it. NULL when it is not open. */
FILE *outfile_begin(outfile *self);

/* Closes it. One that has not been begun stays as it was, or goes if it was not there. False after
 * a message, when not all could be written. May be called again. */
bool outfile_close(outfile *self, const char *program);

#endif
