/* SPDX-License-Identifier: MIT
 *
 * fileuse.h - files that are read and written by one program: none may be written that is also
 * something else, by whatever name.
 *
 * A file that is written in place of another use of it is lost, or is not what it seems to be. So
 * all are compared before the first is opened for writing: by device and inode, and those that are
 * not there yet by their folder and name; with the names that they get when they are rotated.
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
    bool socket;      /* a socket is made there, which is never what a link leads to */
    bool lock;        /* it is PATH.lock, of the socket at PATH */
    unsigned older;   /* when it is rotated it becomes PATH.1, and so on to this number */
    const char *file; /* which names it, at this place (from 1 on); NULL: the command line */
    int line;
    int column;
} fileuse;

/* All zeros is none. */
typedef struct fileuses {
    fileuse *uses; /* texts are not owned */
    size_t count;
    bool incomplete; /* for want of memory */
} fileuses;

void fileuses_add(fileuses *all, const fileuse *use);

void fileuses_free(fileuses *all);

/* Adds the socket that is made at use->path, and its lock (lockfile.h). */
void fileuses_add_socket(fileuses *all, const fileuse *use);

/* Whether no file that is written has another use. What is there and neither a regular file nor a
 * socket (/dev/null, a pipe, a terminal) may have many. Else one line for each to errors:
 * FILE:LINE:COLUMN: message, or with the name of the program in place of that. */
bool fileuses_check(const fileuses *all, const char *program, FILE *errors);

#endif
