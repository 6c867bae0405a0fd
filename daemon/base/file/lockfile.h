/* SPDX-License-Identifier: MIT
 *
 * lockfile.h - a file that exists to be locked; its lock belongs to one program as long as that
 * runs.
 */
#ifndef CANWIRE_BASE_LOCKFILE_H
#define CANWIRE_BASE_LOCKFILE_H

#include "base/file/folder.h"

/* Takes the lock file of a folder's NAME, NAME.lock, and makes a missing one. Returns 0 with the
 * descriptor to keep in *fd. Otherwise *fd is -1 and an errno is returned; EBUSY: another program
 * holds it. */
int lockfile_take(int *fd, const folder *in);

/* Removes and closes the lock file; -1: there is none. */
void lockfile_release(int fd, const folder *in);

#endif
