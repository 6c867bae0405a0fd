/* SPDX-License-Identifier: MIT
 *
 * lookout.h - looks now and then if a file could be written that is to be made later.
 *
 * A thread of its own looks, so that no disk delays the bus.
 */
#ifndef CANWIRE_BASE_LOOKOUT_H
#define CANWIRE_BASE_LOOKOUT_H

typedef struct lookout lookout;

/* Begins to look after a file; error: what is known of it, or 0. Returns NULL with an errno without
 * memory or a thread. */
lookout *lookout_start(const char *file, int error);

/* Returns 0 when the last look found that the file could be written, or the errno, for
 * spool_explain(). It is ETIMEDOUT while the disk does not answer. To be called about once a
 * second: some of the calls let the thread look again. NULL is allowed. */
int lookout_look(lookout *l);

/* Ends it, without waiting for the disk. NULL is allowed. */
void lookout_end(lookout *l);

#endif
