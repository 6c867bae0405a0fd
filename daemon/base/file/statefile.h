/* SPDX-License-Identifier: MIT
 *
 * statefile.h - a small file with the present state of something, replaced as a whole.
 *
 * A thread of its own writes it, so that no disk delays the bus. A crash leaves either the old or
 * the new file. States that come while the thread writes are merged: the last one counts.
 */
#ifndef CANWIRE_BASE_STATEFILE_H
#define CANWIRE_BASE_STATEFILE_H

#include <ev.h>
#include <stdint.h>

typedef struct statefile statefile;

/* Reports in the loop that the file has the state with this number, or a later one. error: the
 * errno why not, ETIMEDOUT when the disk does not answer. It is about all states up to that one. */
typedef void statefile_written(void *user, uint64_t number, int error);

/* The file has this name in a folder that is open; it becomes it from `next`. The names must live
 * longer. Returns NULL without memory. */
statefile *statefile_new(struct ev_loop *loop, int folder, const char *name, const char *next,
                         statefile_written *written, void *user);

/* Sets the state, and takes its text; NULL: no file. Returns its number, from 1; 0 with an errno
 * when there is no thread for it. */
uint64_t statefile_put(statefile *s, char *text);

/* Says in the time of the file that the process lives, unless the disk hangs. */
void statefile_touch(statefile *s);

/* Waits a moment for the last state, and ends; `written` is no longer called. Returns 0 or the
 * error of the last state. After ETIMEDOUT a thread still uses the names and the folder, which then
 * have to stay. */
int statefile_close(statefile *s);

#endif
