/* SPDX-License-Identifier: MIT
 *
 * between_calls.c - to be preloaded into canwired: what others do between two of its calls, at
 * exactly that moment.
 *
 * HOLD_LISTEN=FILE   listen() makes FILE.held and waits until FILE is gone
 * SWAP_AT=CALL       behind bind() or in getgrnam(), the file SWAP_PATH gets another name and a
 *                    symbolic link to SWAP_TARGET takes its place, once
 * GROUP_ID=N         there is a group canwire, of this number
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/socket.h>
#include <unistd.h>

static void *next(const char *name)
{
    void *function = dlsym(RTLD_NEXT, name);
    if (!function)
        abort();
    return function;
}

static void swap_at(const char *call)
{
    static bool done;
    char stolen[4096];
    const char *wanted = getenv("SWAP_AT");
    const char *path = getenv("SWAP_PATH");
    const char *target = getenv("SWAP_TARGET");
    if (done || !wanted || !path || !target || strcmp(wanted, call) != 0)
        return;
    (void)snprintf(stolen, sizeof stolen, "%s.stolen", path);
    done = rename(path, stolen) == 0; /* else it was the call for another socket */
    if (done && symlink(target, path) != 0)
        abort();
}

int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    int (*real)(int, const struct sockaddr *, socklen_t);
    *(void **)&real = next("bind");
    int result = real(fd, address, size);
    if (result == 0)
        swap_at("bind");
    return result;
}

static void wait_until_gone(const char *file)
{
    char seen[4096];
    int watch = inotify_init1(IN_CLOEXEC);
    if (watch < 0)
        abort();
    (void)inotify_add_watch(watch, file, IN_ATTRIB | IN_DELETE_SELF | IN_MOVE_SELF);
    while (access(file, F_OK) == 0)
        if (read(watch, seen, sizeof seen) < 0 && errno != EINTR)
            abort();
    (void)close(watch);
}

int listen(int fd, int backlog)
{
    char held[4096];
    const char *file = getenv("HOLD_LISTEN");
    int (*real)(int, int);
    *(void **)&real = next("listen");
    if (file) {
        (void)snprintf(held, sizeof held, "%s.held", file);
        (void)close(open(held, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
        wait_until_gone(file);
    }
    return real(fd, backlog);
}

struct group *getgrnam(const char *name)
{
    static char *members[] = {NULL};
    static struct group made = {.gr_passwd = "", .gr_mem = members};
    const char *number = getenv("GROUP_ID");
    if (!number || strcmp(name, "canwire") != 0)
        return NULL;
    swap_at("getgrnam");
    made.gr_name = "canwire";
    made.gr_gid = (gid_t)strtoul(number, NULL, 10);
    return &made;
}
