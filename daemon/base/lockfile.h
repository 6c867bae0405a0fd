/* SPDX-License-Identifier: MIT
 *
 * lockfile.h - a file that is there to be locked: what belongs to one program at a time, as long as
 * that runs.
 */
#ifndef CANWIRE_BASE_LOCKFILE_H
#define CANWIRE_BASE_LOCKFILE_H

#include "base/folder.h"

/* Takes NAME.lock in the folder, for the NAME of that folder, and makes it where it is not there. 0
 * with the descriptor to keep in *fd, or an errno with -1; EBUSY: another has it. */
int lockfile_take(int *fd, const folder *in);

/* Removes and closes it; -1: nothing. */
void lockfile_release(int fd, const folder *in);

#endif
