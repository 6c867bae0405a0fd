/* SPDX-License-Identifier: MIT
 *
 * outfile.h - an output file, which keeps its old content until the first output.
 */
#ifndef CANWIRE_CLI_OUTFILE_H
#define CANWIRE_CLI_OUTFILE_H

#include <stdbool.h>
#include <stdio.h>

/* All zeros is an output that is not wanted. */
typedef struct outfile {
    const char *name; /* not owned; "-": standard output */
    FILE *stream;     /* NULL: not open */
    char *buffer;     /* of the stream, larger than that of stdio; NULL: stdio's own */
    bool made;        /* the file did not exist before */
    bool begun;
} outfile;

/* Opens the file for writing; an existing one is not changed yet. NULL as name: it is not wanted. A
 * file that another program records into is refused. Returns false after a message that begins with
 * `program`. */
bool outfile_open(outfile *self, const char *name, const char *program);

/* Returns the stream; the first call empties the file. Returns NULL when it is not open. */
FILE *outfile_begin(outfile *self);

/* Closes the file. A file that has not been begun keeps its content, or is removed if it is new.
 * Returns false after a message when output was lost. It may be called again. */
bool outfile_close(outfile *self, const char *program);

#endif
