/* SPDX-License-Identifier: MIT
 *
 * journal_keep.h - chooses the older journals that are kept when a new one begins.
 *
 * FILE becomes FILE.1, that FILE.2, and so on. In a loop of crashes the first journal explains the
 * cause. So when there are too many, the oldest one with an end is removed or, if none has an end,
 * the second oldest. The newest, which has just become FILE.1, stays. A message reports each
 * removed journal. Another one reports, at each start, each journal without an end.
 */
#ifndef CANWIRE_RUN_JOURNAL_KEEP_H
#define CANWIRE_RUN_JOURNAL_KEEP_H

#define JOURNAL_FILES_MIN 2u
#define JOURNAL_FILES_DEFAULT 5u
#define JOURNAL_FILES_MAX 1000u

/* Makes room for a journal of that name; so many are kept, the new one included. The newest, the
 * first without end, and the new one are always kept. Returns 0 or an errno, EBUSY as for
 * spool_open(); after an error some files may not have been moved. */
int journal_make_room(const char *file, unsigned files);

#endif
