/* SPDX-License-Identifier: MIT
 *
 * seam_file.c - files: the kernel's own in the folder of the world, on a disk that may be full,
 * slow, broken or hanging.
 */
#include "seam.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#define POLL_NS (100 * MS) /* of a disk that hangs: whether it still does */

static seam_fd fds[FDS_MAX];

/* ---- File descriptors and paths -------------------------------------------------------------- */

seam_fd *seam_fd_of(int fd)
{
    static seam_fd none;
    if (fd >= 0 && fd < FDS_MAX)
        return &fds[fd];
    none = (seam_fd){.kind = FD_OTHER};
    return &none;
}

int seam_new_fd(int fd, fd_kind kind)
{
    *seam_fd_of(fd) = (seam_fd){.kind = kind, .connection = -1, .other_end = -1, .due_ns = NEVER};
    return fd;
}

const char *seam_path(const char *path)
{
    size_t root = strlen(WORLD_ROOT);
    if (strncmp(path, WORLD_ROOT, root) == 0)
        return path[root] ? path + root : ".";
    return strcmp(path, "/world") == 0 ? "." : path;
}

static bool is_ours(const char *path)
{
    return seam_path(path) != path;
}

/* ---- The disk -------------------------------------------------------------------------------- */

bool seam_refuses(unsigned permille, int number, const char *call)
{
    if (!world_chance(permille))
        return false;
    world_trace("%s is refused: %s", call, strerrorname_np(number));
    world_my_life()->faulted = true;
    errno = number;
    return true;
}

static bool hangs(const char *path)
{
    const world_disk *d = &world->disk;
    return world->now_ns < d->hung_until_ns &&
           (d->hung_path[0] == '\0' || strcmp(d->hung_path, path) == 0);
}

/* Complains about a wait in the thread of the bus: a file may block only a thread of its own. */
static void complain_of_wait(const char *path, const char *call)
{
    const world_life *life = world_my_life();
    if (world_me()->is_main && life->started_up && !life->stopping)
        world_complain("the thread of the bus waits in %s(%s)", call, path);
}

/* Waits for a disk. A reader of a FIFO waits for a writer, even across signals whose actions say
 * SA_RESTART. So does a call on a mount that does not answer. */
static void wait_for_disk(const char *path, const char *call)
{
    world_my_life()->disk_failed = true;
    world_trace("%s(%s) does not return", call, path);
    complain_of_wait(path, call);
    while (hangs(path))
        (void)world_block(WAIT_DISK, path, world->now_ns + POLL_NS, call, NULL);
}

bool seam_disk_takes(const char *path, const char *call)
{
    const world_disk *d = &world->disk;
    world_enter(call);
    if (hangs(path))
        wait_for_disk(path, call);
    if (d->slow_ns > 0) {
        world_my_life()->disk_failed = true;
        (void)world_block(WAIT_DISK, path,
                          world->now_ns + (int64_t)world_draw((uint64_t)d->slow_ns), call, NULL);
    }
    if (!world_chance(d->errors_permille))
        return true;
    world_my_life()->disk_failed = true;
    world_trace("%s(%s) = EIO", call, path);
    errno = EIO;
    return false;
}

/* Returns the bytes of so many that the disk has room for; -1: refused. */
static ssize_t room_for(const seam_fd *f, size_t size)
{
    world_disk *d = &world->disk;
    if (d->room != NEVER && (int64_t)size > d->room) {
        world_my_life()->disk_failed = true;
        size = (size_t)d->room;
    }
    if (size == 0) {
        world_trace("write(%s) = ENOSPC", f->path);
        errno = ENOSPC;
        return -1;
    }
    if (size > 1 && world_chance(d->short_permille))
        size = 1 + world_draw(size - 1);
    return (ssize_t)size;
}

static void use_room(int64_t bytes)
{
    if (world->disk.room != NEVER)
        world->disk.room -= bytes;
}

static void note_synced(int fd)
{
    struct stat s;
    if (fstat(fd, &s) == 0)
        world->files[file_number(file_identity_at(fd, "", AT_EMPTY_PATH))].synced = s.st_size;
}

/* ---- Opening --------------------------------------------------------------------------------- */

/* Waits for ever in a call that opens a FIFO to read without O_NONBLOCK: nothing here writes into
 * one. */
static void wait_at_fifo(const char *path, int flags)
{
    struct stat s;
    if ((flags & (O_ACCMODE | O_NONBLOCK | O_PATH)) != O_RDONLY || stat(path, &s) != 0 ||
        !S_ISFIFO(s.st_mode))
        return;
    world_my_life()->disk_failed = true;
    world_trace("open(%s), a FIFO, does not return", path);
    complain_of_wait(path, "open");
    for (;;)
        (void)world_block(WAIT_DISK, path, NEVER, "open of a FIFO", NULL);
}

static int opened(int fd, const char *path, int flags)
{
    if (fd < 0)
        return fd;
    (void)seam_new_fd(fd, FD_FILE);
    (void)snprintf(fds[fd].path, sizeof fds[fd].path, "%s", path);
    world_trace("open(%s, %#x) = %d", path, (unsigned)flags, fd);
    return fd;
}

static int open_at(int folder, const char *path, int flags, mode_t mode)
{
    if (!world_inside)
        return openat(folder, seam_path(path), flags, mode);
    if (!is_ours(path) && path[0] == '/')
        return seam_new_fd(openat(folder, path, flags, mode), FD_OTHER);
    path = seam_path(path);
    if (!seam_disk_takes(path, "open"))
        return -1;
    if ((flags & O_CREAT) && world->disk.room == 0 && faccessat(folder, path, F_OK, 0) != 0) {
        world_my_life()->disk_failed = true;
        errno = ENOSPC;
        return -1;
    }
    wait_at_fifo(path, flags);
    if (seam_refuses(world->refuse_permille / 4, EMFILE, "open"))
        return -1;
    return opened(openat(folder, path, flags, mode), path, flags);
}

SEAM(int, open, const char *path, int flags, ...)
{
    va_list args;
    va_start(args, flags);
    mode_t mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(args, mode_t) : 0;
    va_end(args);
    return open_at(AT_FDCWD, path, flags, mode);
}

SEAM(int, openat, int folder, const char *path, int flags, ...)
{
    va_list args;
    va_start(args, flags);
    mode_t mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(args, mode_t) : 0;
    va_end(args);
    return open_at(folder, path, flags, mode);
}

SEAM(FILE *, fopen, const char *path, const char *mode)
{
    if (!world_inside || !is_ours(path))
        return fopen(seam_path(path), mode);
    int flags =
        mode[0] == 'r' ? O_RDONLY : O_WRONLY | O_CREAT | (mode[0] == 'a' ? O_APPEND : O_TRUNC);
    int fd = open_at(AT_FDCWD, path, flags | O_CLOEXEC, 0666);
    return fd < 0 ? NULL : fdopen(fd, mode);
}

/* ---- Reading and writing --------------------------------------------------------------------- */

static bool file_takes(FILE *file, const char *call)
{
    const seam_fd *f = seam_fd_of(fileno(file));
    return !world_inside || fileno(file) < 0 || f->kind != FD_FILE ||
           seam_disk_takes(f->path, call);
}

/* An error of the disk is an end of the file here: a stream of the C library cannot get an
 * error. */
SEAM(size_t, fread, void *out, size_t size, size_t count, FILE *file)
{
    return file_takes(file, "fread") ? fread(out, size, count, file) : 0;
}

SEAM(char *, fgets, char *out, int size, FILE *file)
{
    return file_takes(file, "fgets") ? fgets(out, size, file) : NULL;
}

SEAM(ssize_t, read, int fd, void *out, size_t size)
{
    seam_fd *f = seam_fd_of(fd);
    if (!world_inside)
        return read(fd, out, size);
    if (f->kind == FD_FILE) {
        if (!seam_disk_takes(f->path, "read"))
            return -1;
        if (size > 1 && world_chance(world->disk.short_permille))
            size = 1 + world_draw(size - 1);
    } else {
        world_enter("read");
    }
    ssize_t count = read(fd, out, size);
    if (f->kind == FD_TIMER)
        f->rung = false;
    world_trace("read(%d) = %zd", fd, count);
    return count;
}

SEAM(ssize_t, pread, int fd, void *out, size_t size, off_t offset)
{
    const seam_fd *f = seam_fd_of(fd);
    if (world_inside && f->kind == FD_FILE && !seam_disk_takes(f->path, "pread"))
        return -1;
    return pread(fd, out, size, offset);
}

SEAM(ssize_t, write, int fd, const void *bytes, size_t size)
{
    const seam_fd *f = seam_fd_of(fd);
    if (!world_inside)
        return write(fd, bytes, size);
    if (f->kind != FD_FILE) {
        world_enter("write");
        ssize_t count = write(fd, bytes, size);
        world_wake(world_me()->life, WAIT_FD, NULL, false);
        return count;
    }
    if (!seam_disk_takes(f->path, "write"))
        return -1;
    ssize_t room = room_for(f, size);
    if (room < 0)
        return -1;
    ssize_t count = write(fd, bytes, (size_t)room);
    use_room(count);
    world_trace("write(%s, %zu bytes %08llx) = %zd", f->path, size,
                (unsigned long long)(world_hash(bytes, size) & 0xffffffff), count);
    return count;
}

SEAM(int, close, int fd)
{
    seam_fd *f = seam_fd_of(fd);
    if (!world_inside)
        return close(fd);
    world_enter("close");
    if (f->other_end > 0)
        (void)close(f->other_end);
    (void)seam_new_fd(fd, FD_OTHER);
    int result = close(fd);
    world_trace("close(%d) = %d", fd, result);
    return result;
}

/* ---- The rest -------------------------------------------------------------------------------- */

/* A call for the path or the descriptor of a file that only passes the disk. */
#define ON_PATH(name, path, call)                                                                  \
    do {                                                                                           \
        if (world_inside && is_ours(path) && !seam_disk_takes(seam_path(path), #name))             \
            return -1;                                                                             \
        int result = call;                                                                         \
        int number = errno;                                                                        \
        if (world_inside && is_ours(path))                                                         \
            world_trace(#name "(%s) = %d", seam_path(path), result);                               \
        errno = number;                                                                            \
        return result;                                                                             \
    } while (0)

/* Numbers inodes in the order of their first use. The kernel's numbers differ from run to run, and
 * so would the work of a program that sorts by them. */
static void number_inode(int result, int folder, const char *path, struct stat *s, int flags)
{
    if (world_inside && result == 0)
        s->st_ino = 1 + file_number(file_identity_at(folder, path, flags));
}

static int stat_at(int folder, const char *path, struct stat *s, int flags)
{
    int result = fstatat(folder, path, s, flags);
    number_inode(result, folder, path, s, flags);
    return result;
}

SEAM(int, stat, const char *path, struct stat *s)
{
    ON_PATH(stat, path, stat_at(AT_FDCWD, seam_path(path), s, 0));
}

SEAM(int, lstat, const char *path, struct stat *s)
{
    ON_PATH(lstat, path, stat_at(AT_FDCWD, seam_path(path), s, AT_SYMLINK_NOFOLLOW));
}

SEAM(int, fstatat, int folder, const char *path, struct stat *s, int flags)
{
    ON_PATH(fstatat, path, stat_at(folder, seam_path(path), s, flags));
}

SEAM(ssize_t, readlink, const char *path, char *out, size_t size)
{
    return readlink(seam_path(path), out, size);
}

SEAM(int, access, const char *path, int mode)
{
    ON_PATH(access, path, access(seam_path(path), mode));
}

/* Returns the last part of a path. No two sockets have the same name. */
static const char *last_part(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

world_place *seam_place_of(const char *path)
{
    for (unsigned i = 0; i < world->place_count; i++)
        if (strcmp(last_part(world->places[i].path), last_part(path)) == 0)
            return &world->places[i];
    return NULL;
}

/* Checks that a daemon removes only its own socket, or that of a daemon that has ended. */
static void check_owner(const char *path)
{
    const world_place *p = world_inside ? seam_place_of(seam_path(path)) : NULL;
    if (p && p->life != world_me()->life && world->lives[p->life].alive &&
        !world->lives[p->life].exiting && access(p->path, F_OK) == 0)
        world_complain("removes %s, which is the socket of life %d", p->path, p->life);
}

SEAM(int, unlink, const char *path)
{
    check_owner(path);
    ON_PATH(unlink, path, unlink(seam_path(path)));
}

SEAM(int, unlinkat, int folder, const char *path, int flags)
{
    check_owner(path);
    ON_PATH(unlinkat, path, unlinkat(folder, seam_path(path), flags));
}

SEAM(int, rename, const char *from, const char *to)
{
    ON_PATH(rename, from, rename(seam_path(from), seam_path(to)));
}

SEAM(int, renameat, int from_folder, const char *from, int to_folder, const char *to)
{
    ON_PATH(renameat, from, renameat(from_folder, seam_path(from), to_folder, seam_path(to)));
}

SEAM(int, renameat2, int from_folder, const char *from, int to_folder, const char *to,
     unsigned flags)
{
    ON_PATH(renameat2, from,
            renameat2(from_folder, seam_path(from), to_folder, seam_path(to), flags));
}

SEAM(int, link, const char *from, const char *to)
{
    ON_PATH(link, to, link(seam_path(from), seam_path(to)));
}

SEAM(int, linkat, int from_folder, const char *from, int to_folder, const char *to, int flags)
{
    ON_PATH(linkat, to, linkat(from_folder, seam_path(from), to_folder, seam_path(to), flags));
}

SEAM(int, chown, const char *path, uid_t owner, gid_t group)
{
    ON_PATH(chown, path, chown(seam_path(path), owner, group));
}

SEAM(int, lchown, const char *path, uid_t owner, gid_t group)
{
    ON_PATH(lchown, path, lchown(seam_path(path), owner, group));
}

SEAM(int, fchownat, int folder, const char *path, uid_t owner, gid_t group, int flags)
{
    ON_PATH(fchownat, path, fchownat(folder, seam_path(path), owner, group, flags));
}

#define ON_FD(name, call)                                                                          \
    do {                                                                                           \
        const seam_fd *f = seam_fd_of(fd);                                                         \
        if (world_inside && f->kind == FD_FILE && !seam_disk_takes(f->path, #name))                \
            return -1;                                                                             \
        int result = call;                                                                         \
        int number = errno;                                                                        \
        if (world_inside && f->kind == FD_FILE)                                                    \
            world_trace(#name "(%s) = %d", f->path, result);                                       \
        errno = number;                                                                            \
        return result;                                                                             \
    } while (0)

SEAM(int, fstat, int fd, struct stat *s)
{
    ON_FD(fstat, stat_at(fd, "", s, AT_EMPTY_PATH));
}

SEAM(int, fchown, int fd, uid_t owner, gid_t group)
{
    ON_FD(fchown, fchown(fd, owner, group));
}

SEAM(int, fchmod, int fd, mode_t mode)
{
    ON_FD(fchmod, fchmod(fd, mode));
}

SEAM(int, fallocate, int fd, int mode, off_t offset, off_t size)
{
    ON_FD(fallocate, fallocate(fd, mode, offset, size));
}

SEAM(int, ftruncate, int fd, off_t size)
{
    ON_FD(ftruncate, ftruncate(fd, size));
}

SEAM(int, flock, int fd, int operation)
{
    ON_FD(flock, flock(fd, operation));
}

SEAM(off_t, lseek, int fd, off_t offset, int whence)
{
    if (world_inside)
        world_enter("lseek");
    return lseek(fd, offset, whence);
}

static int sync_file(int fd, const char *call)
{
    const seam_fd *f = seam_fd_of(fd);
    if (world_inside && f->kind == FD_FILE) {
        if (!seam_disk_takes(f->path, call))
            return -1;
        note_synced(fd);
        world_trace("%s(%s) = 0", call, f->path);
    }
    return 0;
}

/* A real one would only cost time. */
SEAM(int, fsync, int fd)
{
    return sync_file(fd, "fsync");
}

SEAM(int, fdatasync, int fd)
{
    return sync_file(fd, "fdatasync");
}

SEAM(int, ioctl, int fd, unsigned long request, ...)
{
    va_list args;
    va_start(args, request);
    void *argument = va_arg(args, void *);
    va_end(args);
    if (world_inside)
        world_enter("ioctl");
    return ioctl(fd, request, argument);
}

SEAM(int, fcntl, int fd, int command, ...)
{
    va_list args;
    va_start(args, command);
    void *argument = va_arg(args, void *);
    va_end(args);
    if (world_inside)
        world_enter("fcntl");
    return fcntl(fd, command, argument);
}
