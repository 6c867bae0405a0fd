/* SPDX-License-Identifier: MIT
 *
 * spool.c - writes a file through a thread of its own, so that no disk ever delays the bus.
 *
 * The queue is a ring of bytes: each record has its size before it; size 0 is a cut. The thread
 * lets bytes wait a little, so that many small records are one write().
 */
#include "base/file/spool.h"

#include "base/file/filelock.h"
#include "base/file/folder.h"
#include "base/thread.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#define HEAD (sizeof(uint32_t) + sizeof(uint64_t)) /* of a record: its size, and its stamp */
#define PART (UINT32_C(1) << 31)     /* in its head: the next one belongs to it */
#define BATCH (2 * SPOOL_RECORD_MAX) /* bytes that are written at once */
#define NAP_NS 20000000              /* between two writes, when there is little to write */
#define ROOM 4096 /* bytes that are reserved for the first records */
#define MODE 0640 /* less the umask: not everybody may read the traffic of a bus */

struct spool {
    char *file;
    folder folder; /* of the file: all calls stay there, whatever happens to the path */
    int fd;        /* locked, so that no other program rotates it */
    bool stream;   /* somebody else's descriptor, perhaps a pipe: no file is made or rotated */
    uint64_t written; /* bytes of this file */
    uint64_t whole;   /* ... of records that are whole with all their parts */
    bool divided;     /* the last record of a batch has more parts */
    bool headless;    /* shortened: records are left out until a cut */
    bool told;        /* somebody else's deed to this file has been reported */
    spool_packer packer; /* all NULL: records are written as they are */
    spool_notify *notify;
    void *user;
    unsigned char *batch;
    pthread_t thread;
    pthread_mutex_t lock; /* of all below */
    pthread_cond_t changed;
    unsigned files;
    size_t first; /* of the queue */
    size_t used;
    bool open; /* the file has been opened */
    bool look; /* at the file, to be done */
    bool has_head;
    spool_found found;
    uint64_t bytes;    /* written, into all files */
    uint64_t left_out; /* records of which the file lacked the head */
    bool ending;
    bool ended;
    bool lasting; /* errors do not end it */
    bool proven;  /* something has been written since spool_resume() */
    uint64_t stamp; /* of later records */
    uint64_t kept; /* records in the file; while there are no cuts */
    uint64_t kept_stamp; /* of the last one of them */
    uint64_t lost; /* records that an error found in the queue */
    int error;
    unsigned char *queue;
};

/* ---- Files ----------------------------------------------------------------------------------- */

/* Returns "FILE.3", to be freed; number 0 is FILE itself. */
static char *numbered(const char *file, unsigned number)
{
    char *name = NULL;
    int length = number == 0 ? asprintf(&name, "%s", file) : asprintf(&name, "%s.%u", file, number);
    return length < 0 ? NULL : name;
}

/* Moves a file. Returns 0 or an errno. A missing file is not an error. */
static int move_file(const folder *in, unsigned number)
{
    char *from = numbered(in->name, number);
    char *to = numbered(in->name, number + 1);
    int error = from && to ? 0 : ENOMEM;
    if (error == 0 && renameat(in->fd, from, in->fd, to) != 0 && errno != ENOENT)
        error = errno;
    free(from);
    free(to);
    return error;
}

/* Renames FILE to FILE.1 and so on; the oldest of `files` files is removed. Returns 0 or an
 * errno. */
static int rotate(const folder *in, unsigned files)
{
    int error = 0;
    if (files <= 1)
        return unlinkat(in->fd, in->name, 0) == 0 || errno == ENOENT ? 0 : errno;
    for (unsigned i = files - 1; i > 0 && error == 0; i--)
        error = move_file(in, i - 1);
    return error;
}

/* Returns true when it is the file that is being written. */
static bool is_own(const spool *s, const struct stat *there)
{
    struct stat own;
    return s->fd >= 0 && fstat(s->fd, &own) == 0 && own.st_dev == there->st_dev &&
           own.st_ino == there->st_ino;
}

/* Returns 0 or an errno. EINVAL: a socket, which a rotation would hide from its clients. EBUSY:
 * another program writes the file. */
static int check_other(const folder *in, const char *name)
{
    struct stat there;
    if (fstatat(in->fd, name, &there, AT_SYMLINK_NOFOLLOW) == 0 && S_ISSOCK(there.st_mode))
        return EINVAL;
    return filelock_probe(in->fd, name);
}

/* Checks the files that are moved or removed, now or by a rotation. */
static int check_others(const spool *s, unsigned files)
{
    struct stat there;
    int error = 0;
    for (unsigned i = 0; i < files && error == 0; i++) {
        char *name = numbered(s->folder.name, i);
        const bool own = name && fstatat(s->folder.fd, name, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
                         is_own(s, &there); /* also one that somebody has renamed */
        error = !name ? ENOMEM : own ? 0 : check_other(&s->folder, name);
        free(name);
    }
    return error;
}

/* Makes a file that is locked before it has a name, so that no other program can take its lock.
 * Returns -1 on a file system without such files. */
static int make_locked(const folder *in)
{
    char path[32];
    int fd = openat(in->fd, ".", O_WRONLY | O_APPEND | O_TMPFILE | O_CLOEXEC, MODE);
    if (fd < 0)
        return -1;
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (filelock_take(fd) == 0 &&
        linkat(AT_FDCWD, path, in->fd, in->name, AT_SYMLINK_FOLLOW) == 0)
        return fd;
    (void)close(fd);
    return -1;
}

/* Makes and locks a file. Another program may see it and take its lock first; the file is then that
 * program's. */
static int make_and_lock(int *fd, const folder *in)
{
    *fd = openat(in->fd, in->name,
                 O_WRONLY | O_APPEND | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, MODE);
    if (*fd < 0)
        return errno;
    int error = filelock_take(*fd);
    if (error != 0)
        (void)close(*fd);
    return error;
}

/* Makes the file, which must not exist. Returns 0 or an errno. */
static int make_file(spool *s)
{
    int fd = make_locked(&s->folder);
    int error = fd < 0 ? make_and_lock(&fd, &s->folder) : 0;
    if (error != 0)
        return error;
    s->fd = fd;
    s->written = 0;
    s->whole = 0;
    s->headless = false;
    s->told = false;
    return 0;
}

/* Rotates a file that is not empty, and begins a new one. Returns 0 or an errno. */
static int begin_file(spool *s, unsigned files)
{
    struct stat there;
    int error = check_others(s, files);
    if (error == 0 &&
        fstatat(s->folder.fd, s->folder.name, &there, AT_SYMLINK_NOFOLLOW) == 0)
        error = S_ISREG(there.st_mode) ? rotate(&s->folder, there.st_size > 0 ? files : 1) : EINVAL;
    return error == 0 ? make_file(s) : error;
}

/* Waits for room in a pipe that another program has set to non-blocking. */
static void wait_for_room(int fd)
{
    struct pollfd pipe = {.fd = fd, .events = POLLOUT};
    (void)poll(&pipe, 1, -1);
}

/* Writes all bytes. Returns 0 or an errno, with *done bytes written in either case. */
static int write_all(int fd, const unsigned char *bytes, size_t size, size_t *done)
{
    for (*done = 0; *done < size;) {
        ssize_t count = write(fd, bytes + *done, size - *done);
        if (count < 0 && errno == EAGAIN)
            wait_for_room(fd);
        else if (count < 0 && errno != EINTR)
            return errno;
        *done += count > 0 ? (size_t)count : 0;
    }
    return 0;
}

/* Ends the file, also that of a packer. Returns 0 or an errno. */
static int end_file(spool *s)
{
    size_t size = 0, done;
    const void *end = s->fd >= 0 && s->packer.end ? s->packer.end(s->packer.user, &size) : NULL;
    int error = end ? write_all(s->fd, end, size, &done) : 0;
    if (s->fd >= 0 && close(s->fd) != 0 && error == 0)
        error = errno;
    s->fd = -1;
    return error;
}

/* ---- Before a start -------------------------------------------------------------------------- */

/* Writes so many bytes into a file, and closes it. Returns 0 or an errno. */
static int fill_and_close(int fd, size_t size)
{
    static const unsigned char zeros[ROOM];
    size_t done;
    const int error = write_all(fd, zeros, size, &done);
    return close(fd) == 0 || error != 0 ? error : errno;
}

/* Makes a file of that size, which has no name and is gone at once. A file system without such
 * files tells if it may be written to. Returns 0 or an errno. */
static int try_to_make(const folder *in, size_t size)
{
    struct statvfs there;
    int fd = openat(in->fd, ".", O_WRONLY | O_TMPFILE | O_CLOEXEC, MODE);
    if (fd >= 0)
        return fill_and_close(fd, size);
    if (errno != EOPNOTSUPP && errno != EISDIR && errno != ENOENT)
        return errno;
    if (faccessat(in->fd, ".", W_OK | X_OK, AT_EACCESS) != 0)
        return errno;
    return size > 0 && fstatvfs(in->fd, &there) == 0 && there.f_bavail == 0 ? ENOSPC : 0;
}

/* Probes FILE, or one that it would be rotated to. */
static int probe_file(const folder *in, const char *name, bool older)
{
    struct stat there;
    if (fstatat(in->fd, name, &there, AT_SYMLINK_NOFOLLOW) != 0)
        return 0;
    if (!older && !S_ISREG(there.st_mode))
        return EINVAL;
    const int error = check_other(in, name);
    return error == EBUSY && filelock_is_ours(&there) ? 0 : error;
}

/* Probes all files, and room of that size. */
static int probe(const char *file, unsigned files, size_t size)
{
    folder in;
    int error = folder_open(&in, file);
    if (error == 0)
        error = try_to_make(&in, size);
    for (unsigned i = 0; i < files && error == 0; i++) {
        char *name = numbered(in.name, i);
        error = name ? probe_file(&in, name, i > 0) : ENOMEM;
        free(name);
    }
    folder_close(&in);
    return error;
}

int spool_probe(const char *file, unsigned files)
{
    return probe(file, files, 0);
}

int spool_probe_room(const char *file)
{
    return probe(file, 1, ROOM);
}

bool spool_may_wait(int error)
{
    return error == ENOSPC || error == EDQUOT;
}

/* ---- The queue ------------------------------------------------------------------------------- */

/* Appends to the ring. There must be room. */
static void copy_in(spool *s, const void *bytes, size_t size)
{
    size_t end = (s->first + s->used) % SPOOL_QUEUE_BYTES;
    size_t part = size < SPOOL_QUEUE_BYTES - end ? size : SPOOL_QUEUE_BYTES - end;
    memcpy(s->queue + end, bytes, part);
    memcpy(s->queue, (const unsigned char *)bytes + part, size - part);
    s->used += size;
}

/* Copies bytes that begin at an offset behind the first one. */
static void copy_out(const spool *s, void *bytes, size_t offset, size_t size)
{
    size_t begin = (s->first + offset) % SPOOL_QUEUE_BYTES;
    size_t part = size < SPOOL_QUEUE_BYTES - begin ? size : SPOOL_QUEUE_BYTES - begin;
    memcpy(bytes, s->queue + begin, part);
    memcpy((unsigned char *)bytes + part, s->queue, size - part);
}

static uint32_t record_size(const spool *s, size_t offset)
{
    uint32_t size;
    copy_out(s, &size, offset, sizeof size);
    return size;
}

static uint64_t record_stamp(const spool *s, size_t offset)
{
    uint64_t stamp;
    copy_out(s, &stamp, offset + sizeof(uint32_t), sizeof stamp);
    return stamp;
}

/* Collects records up to a cut, as many as fit into the batch. Each part of a longer record is by
 * itself: what is packed is in the file as a whole or not at all. Returns their bytes in the
 * queue. */
static size_t fill_batch(spool *s, size_t used, size_t *batch, bool *cut)
{
    size_t taken = 0;
    bool alone = false;
    *batch = 0;
    *cut = false;
    while (taken < used && !*cut && !alone) {
        const uint32_t head = record_size(s, taken);
        const uint32_t size = head & ~PART;
        alone = s->divided || head & PART;
        if (*batch + size > BATCH || (alone && taken > 0))
            break;
        *cut = size == 0;
        s->divided = head & PART;
        copy_out(s, s->batch + *batch, taken + HEAD, size);
        *batch += size;
        taken += HEAD + size;
    }
    return taken;
}

typedef struct extent {
    size_t bytes;
    uint64_t records;
    uint64_t stamp; /* of the last one */
} extent;

/* Returns the records that are whole, with all their parts, in that many bytes at the front of the
 * queue. */
static extent whole_records(const spool *s, size_t bytes)
{
    size_t offset = 0;
    extent whole = {.bytes = 0};
    for (size_t seen = 0; seen < bytes;) {
        uint32_t head = record_size(s, offset);
        uint32_t size = head & ~PART;
        if (size == 0 || seen + size > bytes)
            break;
        seen += size;
        if (!(head & PART))
            whole = (extent){.bytes = seen, .records = whole.records + 1,
                             .stamp = record_stamp(s, offset)};
        offset += HEAD + size;
    }
    return whole;
}

/* Counts records, each with all its parts, in that many bytes of the queue. */
static uint64_t count_records(const spool *s, size_t used)
{
    uint64_t count = 0;
    for (size_t offset = 0; offset < used;) {
        uint32_t head = record_size(s, offset);
        count += head != 0 && !(head & PART);
        offset += HEAD + (head & ~PART);
    }
    return count;
}

/* ---- The thread ------------------------------------------------------------------------------ */

/* Removes an incomplete record from the end of the file, which may have been shortened. */
static void remove_part(spool *s)
{
    struct stat own;
    const uint64_t part = s->written - s->whole;
    if (fstat(s->fd, &own) != 0)
        return;
    const uint64_t size = (uint64_t)own.st_size;
    (void)!ftruncate(s->fd, (off_t)(size > part ? size - part : 0));
    s->written = s->whole;
}

/* Packs a batch and writes it. Returns 0 or an errno, after removing what is behind the last record
 * in the file that is whole. */
static int write_packed(spool *s, extent *whole, size_t size)
{
    size_t packed, done = 0;
    const void *bytes = s->packer.pack(s->packer.user, &packed, s->batch, size);
    int error = bytes ? write_all(s->fd, bytes, packed, &done) : errno;
    s->written += done;
    if (error == 0)
        *whole = whole_records(s, size);
    else
        remove_part(s);
    if (whole->bytes > 0)
        s->whole = s->written;
    if (error != 0 || whole->bytes > 0)
        s->packer.settle(s->packer.user, error == 0);
    return error;
}

/* Writes the records that fill_batch() took; they are still in the queue. Returns 0 or an errno,
 * after removing an incomplete record from the file. */
static int write_batch(spool *s, extent *whole, size_t size)
{
    size_t done;
    if (s->packer.pack)
        return write_packed(s, whole, size);
    int error = write_all(s->fd, s->batch, size, &done);
    *whole = whole_records(s, done);
    if (whole->bytes > 0)
        s->whole = s->written + whole->bytes;
    s->written += done;
    if (error != 0 && !s->stream)
        remove_part(s);
    return error;
}

/* Finds out if somebody has moved, removed or shortened the file. A shortened one goes on at its
 * new end. */
static spool_found look_at_file(spool *s)
{
    struct stat own, there;
    if (s->stream || s->fd < 0 || fstat(s->fd, &own) != 0)
        return SPOOL_AS_IT_WAS;
    const bool found = fstatat(s->folder.fd, s->folder.name, &there, AT_SYMLINK_NOFOLLOW) == 0;
    if (!found && errno != ENOENT)
        return SPOOL_AS_IT_WAS;
    if (!found || there.st_dev != own.st_dev || there.st_ino != own.st_ino)
        return own.st_nlink > 0 ? SPOOL_MOVED : SPOOL_REMOVED;
    if ((uint64_t)own.st_size >= s->written)
        return SPOOL_AS_IT_WAS;
    s->written = s->whole = (uint64_t)own.st_size;
    if (s->packer.begin)
        s->packer.begin(s->packer.user);
    return SPOOL_SHORTENED;
}

/* Looks at the file. The lock is held, but not while it looks. */
static void base_spool_look(spool *s)
{
    const bool has_head = s->has_head;
    s->look = false;
    (void)pthread_mutex_unlock(&s->lock);
    const spool_found found = look_at_file(s);
    s->headless = s->headless || (found == SPOOL_SHORTENED && has_head);
    (void)pthread_mutex_lock(&s->lock);
    if (found == SPOOL_AS_IT_WAS || s->told)
        return;
    s->told = found != SPOOL_SHORTENED || has_head;
    s->found = found;
    if (s->notify)
        s->notify(s->user);
}

/* Begins a shortened file anew, in its place. */
static int begin_again(spool *s)
{
    s->headless = false;
    s->told = false;
    s->written = 0;
    s->whole = 0;
    return ftruncate(s->fd, 0) == 0 ? 0 : errno;
}

/* Goes on in a new file. One that lacks its head is begun anew in its place, since no reader can
 * use it. */
static int cut_here(spool *s, unsigned files)
{
    struct stat there;
    if (s->headless && fstatat(s->folder.fd, s->folder.name, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
        is_own(s, &there))
        return begin_again(s);
    const int before = s->fd; /* locked until the next file is */
    int error = begin_file(s, files);
    if (error != 0)
        s->fd = -1;
    return close(before) != 0 && error == 0 ? errno : error;
}

/* Waits for something to write, and then a little for more. The lock is held. */
static void wait_for_work(spool *s)
{
    while (s->used == 0 && !s->ending && !s->look)
        (void)pthread_cond_wait(&s->changed, &s->lock);
    const struct timespec until = thread_in_ns(NAP_NS);
    while (s->used < SPOOL_QUEUE_BYTES / 4 && !s->ending && !s->stream && !s->look)
        if (pthread_cond_timedwait(&s->changed, &s->lock, &until) != 0)
            break;
}

/* Discards the queue and waits for spool_resume(). The lock is held. */
static void wait_in_trouble(spool *s, int error)
{
    s->error = error;
    s->lost += count_records(s, s->used);
    s->used = 0;
    s->divided = false;
    while (s->error != 0 && !s->ending)
        (void)pthread_cond_wait(&s->changed, &s->lock);
}

/* Writes one batch; returns 0 or an errno. The lock is held, but not while it writes. */
static int work(spool *s)
{
    size_t used = s->used;
    unsigned files = s->files;
    size_t batch;
    bool cut;
    extent whole = {.bytes = 0};
    (void)pthread_mutex_unlock(&s->lock);
    size_t taken = fill_batch(s, used, &batch, &cut);
    const bool headless = s->headless;
    const uint64_t before = s->written;
    int error = headless ? 0 : write_batch(s, &whole, batch);
    const uint64_t more = s->written - before;
    if (error == 0 && cut && !s->stream)
        error = cut_here(s, files);
    (void)pthread_mutex_lock(&s->lock);
    s->kept += whole.records;
    s->bytes += more;
    if (whole.records > 0)
        s->kept_stamp = whole.stamp;
    if (error != 0)
        s->lost += count_records(s, taken) - whole.records;
    else if (headless)
        s->left_out += count_records(s, taken);
    s->first = (s->first + taken) % SPOOL_QUEUE_BYTES;
    s->used -= taken;
    s->proven = s->proven || error == 0;
    return error;
}

/* Opens the files. Returns 0 or an errno. */
static int open_files(spool *s, unsigned files)
{
    int error = folder_open(&s->folder, s->file);
    return error == 0 ? begin_file(s, files) : error;
}

int spool_reserve(const spool *s)
{
    if (fallocate(s->fd, FALLOC_FL_KEEP_SIZE, 0, ROOM) == 0)
        return 0;
    return spool_may_wait(errno) ? errno : 0;
}

/* Opens the files for spool_open_later(), and reserves room. Returns 0 or an errno. The lock is
 * held, but not while it opens. */
static int open_now(spool *s)
{
    const unsigned files = s->files;
    (void)pthread_mutex_unlock(&s->lock);
    int error = open_files(s, files);
    if (error == 0)
        error = spool_reserve(s);
    (void)pthread_mutex_lock(&s->lock);
    s->open = error == 0;
    if (s->open && s->notify)
        s->notify(s->user);
    return error;
}

/* The thread: opens, looks and writes until it is told to end. An error ends it, too, unless it is
 * to last. */
static void *spool_run(void *argument)
{
    spool *s = argument;
    (void)pthread_mutex_lock(&s->lock);
    int error = s->open ? 0 : open_now(s);
    while (error == 0 && (s->used > 0 || !s->ending)) {
        if (s->used < SPOOL_QUEUE_BYTES / 4)
            wait_for_work(s);
        if (s->look || s->has_head)
            base_spool_look(s);
        if (s->used > 0)
            error = work(s);
        if (error != 0 && s->lasting) {
            wait_in_trouble(s, error);
            error = s->error;
        }
    }
    (void)pthread_mutex_unlock(&s->lock);
    int end_error = end_file(s);
    (void)pthread_mutex_lock(&s->lock);
    s->error = error != 0 ? error : end_error;
    s->ended = true;
    (void)pthread_cond_broadcast(&s->changed);
    spool_notify *notify = s->notify;
    void *user = s->user;
    (void)pthread_mutex_unlock(&s->lock);
    if (notify)
        notify(user);
    return NULL;
}

/* ---- For other threads ----------------------------------------------------------------------- */

/* Frees all of it. The thread must have ended, or never have been started. */
static void free_spool(spool *s)
{
    if (s->fd >= 0)
        (void)close(s->fd);
    if (s->packer.free)
        s->packer.free(s->packer.user);
    folder_close(&s->folder);
    (void)pthread_cond_destroy(&s->changed);
    (void)pthread_mutex_destroy(&s->lock);
    free(s->file);
    free(s->batch);
    free(s->queue);
    free(s);
}

/* Makes a spool that is not open. NULL with *error: without memory. */
static spool *make_spool(const char *file, unsigned files, spool_notify *notify, void *user,
                         int *error)
{
    spool *s = calloc(1, sizeof *s);
    if (!s) {
        *error = ENOMEM;
        return NULL;
    }
    *s = (spool){.file = strdup(file), .folder = FOLDER_NONE, .fd = -1, .notify = notify,
                 .user = user,
                 .files = files, .batch = malloc(BATCH), .queue = malloc(SPOOL_QUEUE_BYTES)};
    (void)pthread_mutex_init(&s->lock, NULL);
    thread_init_condition(&s->changed);
    *error = s->file && s->batch && s->queue ? 0 : ENOMEM;
    if (*error == 0)
        return s;
    free_spool(s);
    return NULL;
}

/* Starts the thread. After an error, also one that *error has already, it frees the spool and
 * returns NULL. */
static spool *spool_start(spool *s, int *error)
{
    if (*error == 0)
        *error = thread_start(&s->thread, spool_run, s);
    if (*error == 0)
        return s;
    free_spool(s);
    return NULL;
}

spool *spool_open(const char *file, unsigned files, spool_notify *notify, void *user, int *error)
{
    spool *s = make_spool(file, files, notify, user, error);
    if (!s)
        return NULL;
    *error = open_files(s, files);
    s->open = *error == 0;
    return spool_start(s, error);
}

spool *spool_open_later(const char *file, unsigned files, spool_notify *notify, void *user,
                        int *error)
{
    spool *s = make_spool(file, files, notify, user, error);
    return s ? spool_start(s, error) : NULL;
}

spool *spool_stream(int fd, spool_notify *notify, void *user, int *error)
{
    spool *s = make_spool("", 1, notify, user, error);
    if (!s) {
        (void)close(fd);
        return NULL;
    }
    s->fd = fd;
    s->stream = true;
    s->open = true;
    return spool_start(s, error);
}

void spool_pack(spool *s, const spool_packer *packer)
{
    (void)pthread_mutex_lock(&s->lock);
    s->packer = *packer;
    (void)pthread_mutex_unlock(&s->lock);
}

bool spool_is_open(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    bool open = s->open;
    (void)pthread_mutex_unlock(&s->lock);
    return open;
}

void spool_last(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->lasting = true;
    (void)pthread_mutex_unlock(&s->lock);
}

void spool_resume(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->error = s->ended ? s->error : 0;
    s->proven = false;
    (void)pthread_cond_broadcast(&s->changed);
    (void)pthread_mutex_unlock(&s->lock);
}

bool spool_has_resumed(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    bool proven = s->proven && s->error == 0;
    (void)pthread_mutex_unlock(&s->lock);
    return proven;
}

uint64_t spool_bytes(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    const uint64_t bytes = s->bytes;
    (void)pthread_mutex_unlock(&s->lock);
    return bytes;
}

uint64_t spool_kept(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    uint64_t kept = s->kept;
    (void)pthread_mutex_unlock(&s->lock);
    return kept;
}

void spool_stamp(spool *s, uint64_t stamp)
{
    (void)pthread_mutex_lock(&s->lock);
    s->stamp = stamp;
    (void)pthread_mutex_unlock(&s->lock);
}

uint64_t spool_kept_stamp(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    uint64_t stamp = s->kept_stamp;
    (void)pthread_mutex_unlock(&s->lock);
    return stamp;
}

uint64_t spool_lost(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    uint64_t lost = s->lost;
    if (s->ended && s->error != 0)
        lost += count_records(s, s->used);
    (void)pthread_mutex_unlock(&s->lock);
    return lost;
}

static size_t room(const spool *s)
{
    size_t left = SPOOL_QUEUE_BYTES - s->used;
    return s->ending || s->ended || s->error != 0 || left < HEAD ? 0 : left - HEAD;
}

size_t spool_room(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    size_t bytes = room(s);
    (void)pthread_mutex_unlock(&s->lock);
    return bytes;
}

/* Queues a record, or a cut, which has no bytes. */
static bool spool_put(spool *s, const void *record, size_t size, uint32_t flags)
{
    uint32_t head = (uint32_t)size | flags;
    (void)pthread_mutex_lock(&s->lock);
    bool fits = size <= room(s) && room(s) > 0;
    if (fits) {
        const size_t before = s->used;
        copy_in(s, &head, sizeof head);
        copy_in(s, &s->stamp, sizeof s->stamp);
        copy_in(s, record, size);
        if (before == 0 || (before < SPOOL_QUEUE_BYTES / 4 && s->used >= SPOOL_QUEUE_BYTES / 4))
            (void)pthread_cond_signal(&s->changed);
    }
    (void)pthread_mutex_unlock(&s->lock);
    return fits;
}

bool spool_write(spool *s, const void *record, size_t size)
{
    assert(size > 0 && size <= SPOOL_RECORD_MAX);
    return spool_put(s, record, size, 0);
}

bool spool_write_part(spool *s, const void *part, size_t size)
{
    assert(size > 0 && size <= SPOOL_RECORD_MAX);
    return spool_put(s, part, size, PART);
}

bool spool_cut(spool *s)
{
    assert(!s->packer.pack);
    return spool_put(s, "", 0, 0);
}

void spool_look(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->look = !s->stream && s->open && !s->ended;
    (void)pthread_cond_broadcast(&s->changed);
    (void)pthread_mutex_unlock(&s->lock);
}

spool_found spool_take_found(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    const spool_found found = s->found;
    s->found = SPOOL_AS_IT_WAS;
    (void)pthread_mutex_unlock(&s->lock);
    return found;
}

void spool_has_head(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->has_head = true;
    (void)pthread_mutex_unlock(&s->lock);
}

uint64_t spool_left_out(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    const uint64_t count = s->left_out;
    (void)pthread_mutex_unlock(&s->lock);
    return count;
}

void spool_set_files(spool *s, unsigned files)
{
    (void)pthread_mutex_lock(&s->lock);
    s->files = files;
    (void)pthread_mutex_unlock(&s->lock);
}

const char *spool_explain(int error)
{
    if (error == EBUSY)
        return "another program is writing it, or a file that it would rotate";
    if (error == ETIMEDOUT)
        return "the disk does not answer";
    return error == EINVAL ? "there is something that is no regular file" : strerror(error);
}

int spool_error(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    int error = s->error;
    (void)pthread_mutex_unlock(&s->lock);
    return error;
}

void spool_end(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->ending = true;
    (void)pthread_cond_broadcast(&s->changed);
    (void)pthread_mutex_unlock(&s->lock);
}

bool spool_has_ended(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    bool ended = s->ended;
    (void)pthread_mutex_unlock(&s->lock);
    return ended;
}

bool spool_wait(spool *s, const struct timespec *until)
{
    spool_end(s);
    (void)pthread_mutex_lock(&s->lock);
    while (!s->ended && pthread_cond_timedwait(&s->changed, &s->lock, until) == 0)
        ;
    bool ended = s->ended;
    (void)pthread_mutex_unlock(&s->lock);
    return ended;
}

/* Removes the listener of the reports. Returns true when the spool has already ended. */
static bool spool_leave(spool *s)
{
    (void)pthread_mutex_lock(&s->lock);
    s->notify = NULL;
    bool ended = s->ended;
    (void)pthread_mutex_unlock(&s->lock);
    return ended;
}

bool spool_close(spool *s, unsigned patience_s)
{
    if (!s)
        return true;
    const struct timespec until = thread_in_seconds(patience_s);
    if (!spool_wait(s, &until) && !spool_leave(s))
        return false;
    (void)pthread_join(s->thread, NULL);
    free_spool(s);
    return true;
}
