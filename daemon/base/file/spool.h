/* SPDX-License-Identifier: MIT
 *
 * spool.h - writes a file through a thread of its own, so that no disk ever delays the bus.
 *
 * Bytes are written in records (a line, a block ...). A record gets into the file as a whole or not
 * at all, also when the disk is full. It waits in a queue of SPOOL_QUEUE_BYTES until the thread
 * takes it to the disk. Files can be rotated as logrotate does: FILE is always the newest, FILE.1
 * the one before. An existing file is rotated, not overwritten.
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

/* Reports the end of the spool, by spool_end() or by an error, in the spool's thread. It must not
 * call the spool. */
typedef void spool_notify(void *user);

/* Makes the file, with mode 0640 less the umask, and rotates existing ones. At most `files` files
 * are kept, including FILE. `notify` may be NULL. Returns NULL with an errno in *error when that
 * fails. EINVAL: a file is not a regular file. EBUSY: another program writes the file, or one that
 * would be rotated. */
spool *spool_open(const char *file, unsigned files, spool_notify *notify, void *user, int *error);

/* Makes the file without waiting for a disk that hangs. The thread opens the file; records wait in
 * the queue meanwhile. The spool calls `notify` also when the file is open. A failure to open the
 * file is an error that ends the spool. */
spool *spool_open_later(const char *file, unsigned files, spool_notify *notify, void *user,
                        int *error);

/* Reserves room for the first records; spool_open_later() does it by itself. To be called before
 * any record is queued. Returns 0, also where room cannot be reserved, or the errno of a full
 * disk. */
int spool_reserve(const spool *s);

/* Says if spool_open() would fail, without making or moving a file that stays. A file that this
 * process writes already does not count. Returns 0 or the errno. */
int spool_probe(const char *file, unsigned files);

/* The same for one file with a few KiB, which it writes and takes back: not in the bus's thread. */
int spool_probe_room(const char *file);

/* Returns true for the errors of a full disk: another try may succeed without another
 * configuration. */
bool spool_may_wait(int error);

/* Writes into an open descriptor in place of a file, which may be a pipe, and closes it at the end.
 * Each record is written at once. A cut does nothing, and an error may leave a part of a record. */
spool *spool_stream(int fd, spool_notify *notify, void *user, int *error);

/* Packs what goes into the file. All functions but `free` run in the spool's thread. */
typedef struct spool_packer {
    void *user;
    /* Packs records so that all of them can be read without what comes later. Returns the bytes,
     * which are valid until the next call, or NULL with an errno. */
    const void *(*pack)(void *user, size_t *packed, const void *records, size_t size);
    /* Says that all that has been packed is in the file, or none of it since the last time. */
    void (*settle)(void *user, bool written);
    /* Returns what ends the file, in the same way. */
    const void *(*end)(void *user, size_t *packed);
    /* Says that somebody has shortened the file: what follows must not need what was there. */
    void (*begin)(void *user);
    void (*free)(void *user);
} spool_packer;

/* Packs all records. To be called before the first one; the spool frees the packer. There are no
 * cuts then, and after an error all records of a write are lost. */
void spool_pack(spool *s, const spool_packer *packer);

/* Returns true when the file has been opened. */
bool spool_is_open(spool *s);

/* Keeps the spool alive after errors. Queued records are lost then, and no record is taken before
 * spool_resume(). */
void spool_last(spool *s);
void spool_resume(spool *s);

/* Returns true when the first record queued since spool_resume() is in the file, without an
 * error. */
bool spool_has_resumed(spool *s);

/* Returns the number of records in the file, if it is never cut. */
uint64_t spool_kept(spool *s);

/* Returns the bytes that records take in its files, as packed. */
uint64_t spool_bytes(spool *s);

/* spool_stamp() sets the stamp of all later records; it is 0 before. spool_kept_stamp() returns the
 * stamp of the last record in the file. */
void spool_stamp(spool *s, uint64_t stamp);
uint64_t spool_kept_stamp(spool *s);

/* Returns the number of records lost by errors. */
uint64_t spool_lost(spool *s);

/* Returns the bytes of records that the queue has room for now; the room only grows with time. */
size_t spool_room(spool *s);

/* Queues a record of 1 to SPOOL_RECORD_MAX bytes. Writes nothing and returns false when there is no
 * room or the spool has ended. */
bool spool_write(spool *s, const void *record, size_t size);

/* Queues the beginning of a longer record in the same way. After an error the whole record is in
 * the file, or none of it. */
bool spool_write_part(spool *s, const void *part, size_t size);

/* Begins a new file for later records. Returns false when there is no room or the spool has
 * ended. */
bool spool_cut(spool *s);

/* Another program has done this to the file. */
typedef enum spool_found {
    SPOOL_AS_IT_WAS = 0,
    SPOOL_REMOVED,
    SPOOL_MOVED, /* renamed, or something else has its name; records still go there */
    SPOOL_SHORTENED
} spool_found;

/* Lets the thread look at the file. It calls `notify` when it finds something new;
 * spool_take_found() reports that once. A cut then begins the file anew, without a rotation. */
void spool_look(spool *s);
spool_found spool_take_found(spool *s);

/* Records need what comes first after a cut. So the records between the shortening of a file and
 * the next cut are left out. spool_left_out() counts them. */
void spool_has_head(spool *s);
uint64_t spool_left_out(spool *s);

/* Sets the number of files that are kept, from the next cut on. */
void spool_set_files(spool *s, unsigned files);

/* Explains one of these errors. */
const char *spool_explain(int error);

/* Returns the errno that has ended the spool, or 0. */
int spool_error(spool *s);

/* Ends the writing; does not wait for the records in the queue. */
void spool_end(spool *s);

/* Returns true when the thread has finished all its work. */
bool spool_has_ended(spool *s);

/* Ends the spool and waits up to that moment (thread.h). Returns true when it has ended. */
bool spool_wait(spool *s, const struct timespec *until);

/* Frees a spool, and waits for its end up to that time. Returns false when the disk hangs; the
 * spool is then left until the process ends. NULL is allowed. */
bool spool_close(spool *s, unsigned patience_s);

#endif
