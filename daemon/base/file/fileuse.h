/* SPDX-License-Identifier: MIT
 *
 * fileuse.h - files that are read and written by one program: no file that is written may have
 * another use, under any name.
 *
 * Writing a file that has another use would destroy its content. So all files are compared before
 * the first is opened for writing. Existing files are compared by device and inode, missing ones by
 * folder and name. The names after a rotation count, too.
 */
#ifndef CANWIRE_BASE_FILEUSE_H
#define CANWIRE_BASE_FILEUSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

typedef struct fileuse {
    const char *what; /* "--log", "record", "control"; it begins the message about it */
    const char *path; /* "-": standard output */
    bool written;
    bool socket;      /* a socket is made there, which never follows a link */
    bool lock;        /* it is PATH.lock, of the socket at PATH */
    unsigned older;   /* rotation renames it to PATH.1, and so on to this number */
    const char *file; /* configuration that names it, at this line (from 1 on); NULL: the command
                         line */
    int line;
    int column;
} fileuse;

/* All zeros is an empty list. */
typedef struct fileuses {
    fileuse *uses; /* texts are not owned */
    size_t count;
    bool incomplete; /* there was no memory */
} fileuses;

void fileuses_add(fileuses *all, const fileuse *use);

void fileuses_free(fileuses *all);

/* Adds the socket that is made at use->path, and its lock (lockfile.h). */
void fileuses_add_socket(fileuses *all, const fileuse *use);

/* Returns true when no file that is written has another use. Devices and pipes (/dev/null, a
 * terminal) may have many uses.
 *
 * Each clash is one line to errors: FILE:LINE:COLUMN: message, or with the name of the program in
 * place of that. */
bool fileuses_check(const fileuses *all, const char *program, FILE *errors);

#endif
