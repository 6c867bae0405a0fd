/* SPDX-License-Identifier: MIT
 *
 * spool.h - writes a file through a thread of its own, so that no disk ever holds up the bus.
 *
 * What is written goes in records (a line, a block ...): all of a record gets into the file or
 * nothing, also when the disk is full. It waits in a queue of SPOOL_QUEUE_BYTES until the thread
 * takes it to the disk. Files can be rotated as logrotate does: FILE is always the newest, FILE.1
 * the one before. A file that is there already is rotated, not overwritten.
 */
#ifndef CANWIRE_BASE_SPOOL_H
#define CANWIRE_BASE_SPOOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#define SPOOL_QUEUE_BYTES (8u * 1024u * 1024u)
#define SPOOL_RECORD_MAX (256u * 1024u) /* bytes */
#define SPOOL_FILES_MAX 1000u

typedef struct spool spool;

/* Is told, in the spool's thread, when it has ended, by spool_end() or by an error. It must not
 * call the spool. */
typedef void spool_news(void *user);

/* Makes the file, with mode 0640 less the umask, rotating what is there; at most `files` files are
 * kept, itself included. news may be NULL. NULL with *error, an errno, when that fails: EINVAL:
 * there is something that is no regular file; EBUSY: another program is writing it, or a file that
 * it would rotate. */
spool *spool_open(const char *file, unsigned files, spool_news *news, void *user, int *error);

/* The same at once, without waiting for a disk that hangs: the thread opens the file, and what is
 * written meanwhile waits in the queue. news is also told when it is open; what keeps it from that
 * is an error that ends it. */
spool *spool_open_later(const char *file, unsigned files, spool_news *news, void *user, int *error);

/* Whether the file has been opened. */
bool spool_is_open(spool *s);

/* From now on an error does not end it: what is queued then is lost, and nothing is taken before
 * spool_resume(). */
void spool_last(spool *s);
void spool_resume(spool *s);

/* Whether what was queued first since spool_resume() is in the file, and no error came then. */
bool spool_has_resumed(spool *s);

/* Records that the file has, of one that is never cut. */
uint64_t spool_kept(spool *s);

/* What all records have that come from now on, 0 before; and what the last one has that is in the
 * file. */
void spool_stamp(spool *s, uint64_t stamp);
uint64_t spool_kept_stamp(spool *s);

/* Records that were lost with errors. */
uint64_t spool_lost(spool *s);

/* Bytes of records that there is room for in the queue now; more only as time goes by. */
size_t spool_room(spool *s);

/* Queues a record of 1 to SPOOL_RECORD_MAX bytes. False, with nothing written, when there is no
 * room or the spool has ended. */
bool spool_write(spool *s, const void *record, size_t size);

/* The same with the beginning of a record that is longer than that: after an error all of it is in
 * the file or nothing. */
bool spool_write_part(spool *s, const void *part, size_t size);

/* What comes now goes into a new file. False when there is no room or the spool has ended. */
bool spool_cut(spool *s);

/* How many files are kept, from the next cut on. */
void spool_set_files(spool *s, unsigned files);

/* What one of these errors means. */
const char *spool_explain(int error);

/* The errno that has ended it, or 0. */
int spool_error(spool *s);

/* Nothing more is written; does not wait for what is in the queue. */
void spool_end(spool *s);

/* Whether the thread has done all it will do. */
bool spool_has_ended(spool *s);

/* As spool_end(), and waits up to that moment (thread.h). Whether it has ended. */
bool spool_wait(spool *s, const struct timespec *until);

/* Frees a spool that has ended or is to end; waits for it up to that time. False when it has not
 * ended by then, since the disk hangs: it is then left alone, for the process to end. NULL is
 * fine. */
bool spool_close(spool *s, unsigned patience_s);

#endif
