/* SPDX-License-Identifier: MIT
 *
 * filelock.c - a file has one writing program at a time.
 */
#include "base/file/filelock.h"

#include "base/text/number.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

int filelock_take(int fd)
{
    return flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK ? EBUSY : 0;
}

int filelock_probe(int folder, const char *name)
{
    struct stat found;
    if (fstatat(folder, name, &found, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(found.st_mode))
        return 0;
    int fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (fd < 0)
        return 0;
    int error = filelock_take(fd);
    (void)close(fd);
    return error;
}

bool filelock_is_ours(const struct stat *file)
{
    DIR *all = opendir("/proc/self/fd");
    bool found = false;
    for (const struct dirent *one; all && !found && (one = readdir(all));) {
        struct stat open;
        uint64_t fd;
        found = !text_parse_uint(&fd, one->d_name) && fstat((int)fd, &open) == 0 &&
                open.st_dev == file->st_dev && open.st_ino == file->st_ino;
    }
    if (all)
        (void)closedir(all);
    return found;
}
