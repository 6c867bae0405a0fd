/* SPDX-License-Identifier: MIT
 *
 * filelock.h - a file has one writing program at a time.
 *
 * The kernel's lock (flock) ends with the last descriptor, also in a crash. It stops only programs
 * that ask for it. Every file is free on a file system without locks.
 */
#ifndef CANWIRE_BASE_FILELOCK_H
#define CANWIRE_BASE_FILELOCK_H

#include <stdbool.h>
#include <sys/stat.h>

/* Takes the lock of an open file. Returns 0, or EBUSY when another program holds it. */
int filelock_take(int fd);

/* Returns EBUSY when another program holds the file of this name in a folder. Returns 0 when the
 * lock is free, and when there is no regular file. */
int filelock_probe(int folder, const char *name);

/* Returns true when this process has the file open. */
bool filelock_is_ours(const struct stat *file);

#endif
