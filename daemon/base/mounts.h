/* SPDX-License-Identifier: MIT
 *
 * mounts.h - what the next start of the service may write to.
 *
 * The unit makes all file systems read-only but its own folders. One that is mounted while it runs
 * is there as it is, up to the next start.
 */
#ifndef CANWIRE_BASE_MOUNTS_H
#define CANWIRE_BASE_MOUNTS_H

/* Notes what is mounted at the start. */
void mounts_remember(void);

/* Returns 0, or EROFS where a file can be written now, but not after the next start. Without
 * mounts_remember() it is 0. */
int mounts_forecast(const char *file);

#endif
