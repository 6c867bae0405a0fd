/* SPDX-License-Identifier: MIT
 *
 * hanging_disk.c - to be preloaded. While a file $HANG exists, a call that opens or reads a file
 * waits if the path contains the text in $HANG. So a network file system behaves that does not
 * answer. A file $HANG.waits exists during the wait. Behind "second:" in $HANG, the first open, the
 * third and so on of such paths pass. Such a disk answers the look at it, and then no more.
 */
#define _GNU_SOURCE // RTLD_NEXT
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <unistd.h>

typedef int open_function(const char *, int, ...);
typedef int openat_function(int, const char *, int, ...);
typedef ssize_t read_function(int, void *, size_t);

static open_function *real_open;
static openat_function *real_openat;
static read_function *real_read;

static __attribute__((constructor)) void find(void)
{
    real_open = (open_function *)dlsym(RTLD_NEXT, "open");
    real_openat = (openat_function *)dlsym(RTLD_NEXT, "openat");
    real_read = (read_function *)dlsym(RTLD_NEXT, "read");
}

/* Returns true when $HANG selects a path. count: of its opens, NULL for one that waits already. */
static bool hangs(const char *flag, const char *path, atomic_uint *count)
{
    static const char second[] = "second:";
    char text[PATH_MAX] = "";
    int fd = real_open(flag, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return false;
    ssize_t length = real_read(fd, text, sizeof text - 1);
    (void)close(fd);
    const size_t skipped = strncmp(text, second, strlen(second)) == 0 ? strlen(second) : 0;
    return length > 0 && strstr(path, text + skipped) &&
           (skipped == 0 || !count || (*count)++ % 2 == 1);
}

/* Waits while $HANG says so. Each time it has changed, there may be another file of that name. */
static void wait_while_it_hangs(const char *flag, const char *path)
{
    static const uint32_t changes = IN_ATTRIB | IN_CLOSE_WRITE | IN_DELETE_SELF | IN_MOVE_SELF;
    for (bool goes_on = true; goes_on;) {
        char seen[4096];
        int watch = inotify_init1(IN_CLOEXEC);
        if (watch < 0)
            abort();
        goes_on = inotify_add_watch(watch, flag, changes) >= 0 && hangs(flag, path, NULL);
        if (goes_on)
            (void)!real_read(watch, seen, sizeof seen);
        (void)close(watch);
    }
}

static void wait_for(const char *path)
{
    char note[PATH_MAX];
    const char *flag = getenv("HANG");
    static atomic_uint count;
    if (!flag || !hangs(flag, path, &count))
        return;
    (void)snprintf(note, sizeof note, "%s.waits", flag);
    (void)close(real_open(note, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    wait_while_it_hangs(flag, path);
}

int open(const char *path, int flags, ...)
{
    va_list more;
    if (!real_open)
        find();
    va_start(more, flags);
    mode_t mode = flags & O_CREAT ? va_arg(more, mode_t) : 0;
    va_end(more);
    wait_for(path);
    return real_open(path, flags, mode);
}

int openat(int folder, const char *path, int flags, ...)
{
    va_list more;
    if (!real_openat)
        find();
    va_start(more, flags);
    mode_t mode = flags & O_CREAT ? va_arg(more, mode_t) : 0;
    va_end(more);
    wait_for(path);
    return real_openat(folder, path, flags, mode);
}

/* The functions that hardened programs call. */
int __openat_2(int folder, const char *path, int flags);
int __openat_2(int folder, const char *path, int flags)
{
    return openat(folder, path, flags);
}

int __open_2(const char *path, int flags);
int __open_2(const char *path, int flags)
{
    return open(path, flags);
}

ssize_t __read_chk(int fd, void *bytes, size_t size, size_t room);
ssize_t __read_chk(int fd, void *bytes, size_t size, size_t room)
{
    return size <= room ? read(fd, bytes, size) : (abort(), -1);
}

ssize_t read(int fd, void *bytes, size_t size)
{
    char link[64];
    char path[PATH_MAX];
    if (!real_read)
        find();
    (void)snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length > 0 && path[0] == '/') {
        path[length] = '\0';
        wait_for(path);
    }
    return real_read(fd, bytes, size);
}
