/* SPDX-License-Identifier: MIT
 *
 * folder.h - the folder that a path ends in, held open, and the name there.
 *
 * What is done with both (openat(), renameat() ...) stays in that folder, whoever puts another one,
 * or a symbolic link, into the path meanwhile.
 */
#ifndef CANWIRE_BASE_FOLDER_H
#define CANWIRE_BASE_FOLDER_H

typedef struct folder {
    int fd;           /* O_PATH; -1: none */
    const char *name; /* part of the path */
} folder;

#define FOLDER_NONE {.fd = -1}

/* The path must live as long as the name is used. Returns 0 or an errno. */
int folder_open(folder *f, const char *path);

/* Of none: nothing. */
void folder_close(folder *f);

#endif
