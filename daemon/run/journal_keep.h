/* SPDX-License-Identifier: MIT
 *
 * journal_keep.h - the journals of before: which are kept when another one begins.
 *
 * FILE becomes FILE.1, that FILE.2, and so on. In a loop of crashes it is the first that tells why.
 * So when there are too many, the one that goes is the oldest that has its end; and when none has,
 * the oldest but one. The newest, which has just become FILE.1, never goes. What goes is told, and
 * each that has no end is told at each start as long as it is there.
 */
#ifndef CANWIRE_RUN_JOURNAL_KEEP_H
#define CANWIRE_RUN_JOURNAL_KEEP_H

#define JOURNAL_FILES_MIN 2u
#define JOURNAL_FILES_DEFAULT 5u
#define JOURNAL_FILES_MAX 1000u

/* Makes room for a journal of that name; so many are kept, the new one included, but never fewer
 * than the newest, the first without end, and the new one. Returns 0 or an errno, EBUSY as of
 * spool_open(); then nothing, or not all, has been moved. */
int journal_make_room(const char *file, unsigned files);

#endif
