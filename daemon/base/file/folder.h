/* SPDX-License-Identifier: MIT
 *
 * folder.h - the folder that a path ends in, held open, and the name there.
 *
 * Calls with both (openat(), renameat() ...) stay in that folder, even when somebody replaces it in
 * the path by another folder or a link.
 */
#ifndef CANWIRE_BASE_FOLDER_H
#define CANWIRE_BASE_FOLDER_H

typedef struct folder {
    int fd;           /* O_PATH; -1: none */
    const char *name; /* part of the path */
} folder;

#define FOLDER_NONE {.fd = -1}

/* Opens the folder of a path. The path must live as long as the name is used. Returns 0 or an
 * errno. */
int folder_open(folder *f, const char *path);

/* Closes the folder, if one is open. */
void folder_close(folder *f);

#endif
