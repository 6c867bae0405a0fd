/* SPDX-License-Identifier: MIT
 *
 * filelock.h - a file that is written belongs to one program at a time.
 *
 * The lock is the kernel's (flock): it goes with the last descriptor, also in a crash, and holds
 * nobody off but those who ask for it. Where a file system knows no locks, every file is free.
 */
#ifndef CANWIRE_BASE_FILELOCK_H
#define CANWIRE_BASE_FILELOCK_H

/* Takes the lock of an open file. 0, or EBUSY: another has it. */
int filelock_take(int fd);

/* Whether the file of this name in a folder can be had: 0, also when there is none or it is no
 * regular file, or EBUSY. */
int filelock_probe(int folder, const char *name);

#endif
