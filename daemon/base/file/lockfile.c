/* SPDX-License-Identifier: MIT
 *
 * lockfile.c - a file that exists to be locked.
 *
 * The holder of the lock removes the file. Another program may have opened the file before that,
 * and then gets the lock of a removed file. So a program that gets a lock checks that the name
 * still belongs to that file.
 */
#include "base/file/lockfile.h"

#include "base/file/filelock.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#define MODE 0600
#define TRIES_MAX 100 /* one for each program that has just ended */

typedef char lockname[NAME_MAX + 1];

static int make_name(lockname out, const folder *in)
{
    int length = snprintf(out, sizeof(lockname), "%s.lock", in->name);
    return length < 0 || (size_t)length >= sizeof(lockname) ? ENAMETOOLONG : 0;
}

/* Opens the lock file, never the target of a link. The first try is without O_CREAT: in a folder
 * like /tmp the kernel refuses O_CREAT for another user's file. Returns -1 with errno set. */
static int lockfile_open_file(const folder *in, const char *name)
{
    const int flags = O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
    int fd = openat(in->fd, name, flags);
    if (fd < 0 && errno == ENOENT)
        fd = openat(in->fd, name, flags | O_CREAT | O_EXCL, MODE);
    return fd;
}

static bool is_still(const folder *in, const char *name, const struct stat *own)
{
    struct stat now;
    return fstatat(in->fd, name, &now, AT_SYMLINK_NOFOLLOW) == 0 && now.st_dev == own->st_dev &&
           now.st_ino == own->st_ino;
}

/* Locks the file. Returns 0 or an errno; EAGAIN: the name belongs to another file by now. */
static int lock_file(int fd, const folder *in, const char *name)
{
    struct stat own;
    if (fstat(fd, &own) != 0)
        return errno;
    if (!S_ISREG(own.st_mode))
        return EINVAL;
    int error = filelock_take(fd);
    return error != 0 ? error : is_still(in, name, &own) ? 0 : EAGAIN;
}

int lockfile_take(int *fd, const folder *in)
{
    lockname name;
    int error = make_name(name, in);
    *fd = -1;
    for (unsigned i = 0; error == 0 && i < TRIES_MAX; i++) {
        *fd = lockfile_open_file(in, name);
        int result = *fd < 0 ? errno : lock_file(*fd, in, name);
        if (result == 0)
            return 0;
        if (*fd >= 0)
            (void)close(*fd);
        *fd = -1;
        if (result != EAGAIN && result != EEXIST && result != ENOENT)
            error = result;
    }
    return error != 0 ? error : EBUSY;
}

void lockfile_release(int fd, const folder *in)
{
    lockname name;
    if (fd < 0)
        return;
    if (make_name(name, in) == 0)
        (void)unlinkat(in->fd, name, 0);
    (void)close(fd);
}
