/* SPDX-License-Identifier: MIT
 *
 * seam.h - the shared part of the seam. Some calls of canwired (and of libev) do not go to the C
 * library but to seam_NAME here. Makefile renames them, from the list in `calls`.
 */
#ifndef CANWIRE_TESTS_WORLD_SEAM_H
#define CANWIRE_TESTS_WORLD_SEAM_H

#include "world.h"

#include <stdio.h>

/* Declares and begins the function that stands for a call. */
#define SEAM(type, name, ...)                                                                      \
    type seam_##name(__VA_ARGS__);                                                                 \
    type seam_##name(__VA_ARGS__)

#define FDS_MAX 1024

typedef enum fd_kind { FD_OTHER, FD_FILE, FD_TIMER, FD_NETLINK, FD_CONNECTION } fd_kind;

typedef struct seam_fd {
    fd_kind kind;
    int connection; /* of FD_CONNECTION */
    int other_end;  /* of FD_NETLINK */
    int64_t due_ns; /* of FD_TIMER; NEVER: it is not armed */
    bool rung;      /* of FD_TIMER: it is readable */
    char path[64];  /* of FD_FILE, below WORLD_ROOT */
} seam_fd;

/* Return the data of a file descriptor of this life. */
seam_fd *seam_fd_of(int fd);
int seam_new_fd(int fd, fd_kind kind); /* returns fd */

/* Returns a path in the folder of the world for one below WORLD_ROOT, else the path itself. */
const char *seam_path(const char *path);

/* Returns the socket that was bound to a path in the folder of the world, or NULL. */
world_place *seam_place_of(const char *path);

/* Timers that are due become readable; returns when the next one is. */
int64_t seam_ring_timers(void);

/* Sets errno, notes that a call was refused, and returns true, in so many of 1000 calls. */
bool seam_refuses(unsigned permille, int number, const char *call);

/* Asks the disk, before a call for a path or a file. Returns false for a refusal, with errno
 * set. */
bool seam_disk_takes(const char *path, const char *call);

#endif
