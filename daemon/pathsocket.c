/* SPDX-License-Identifier: MIT
 *
 * pathsocket.c - a Unix socket that listens at a path: for the daemon's group, and removed at the
 * end.
 */
#include "pathsocket.h"

#include "log.h"

#include <errno.h>
#include <grp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define GROUP "canwire"

static bool is_socket(const char *path)
{
    struct stat found;
    return lstat(path, &found) == 0 && S_ISSOCK(found.st_mode);
}

/* Whether a socket is at the path that nobody listens at. One of another type is in use. */
static bool is_stale(const struct sockaddr_un *address, int type)
{
    if (!is_socket(address->sun_path))
        return false;
    int fd = socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    bool stale = fd >= 0 && connect(fd, (const struct sockaddr *)address, sizeof *address) != 0 &&
                 errno == ECONNREFUSED;
    if (fd >= 0)
        (void)close(fd);
    return stale;
}

/* Returns 0 or an errno. The mask makes the socket 0660 from its first moment on. */
static int bind_once(int fd, const struct sockaddr_un *address)
{
    mode_t mask = umask(S_IXUSR | S_IXGRP | S_IRWXO);
    int result = bind(fd, (const struct sockaddr *)address, sizeof *address);
    int number = result == 0 ? 0 : errno;
    (void)umask(mask);
    return number;
}

static const char *explain(const char *path, int number)
{
    if (number == EADDRINUSE)
        return is_socket(path) ? "in use; is another canwired running for this bus?"
                               : "there is something that is no socket";
    if (number == ENAMETOOLONG)
        return "the path is too long for a socket";
    return number == ENOENT ? "the directory does not exist" : strerror(number);
}

static int bind_path(pathsocket *s, int type, const char *what)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(s->path) >= sizeof address.sun_path)
        return ENAMETOOLONG;
    memcpy(address.sun_path, s->path, strlen(s->path));
    int number = bind_once(s->fd, &address);
    if (number == EADDRINUSE && is_stale(&address, type)) {
        log_info("%s %s: replacing the socket of a canwired that is gone", what, s->path);
        (void)unlink(s->path);
        number = bind_once(s->fd, &address);
    }
    if (number == 0 && lstat(s->path, &s->made) != 0)
        number = errno;
    return number;
}

/* Without the group the socket is for the daemon's own user and group. */
static void give_to_group(const pathsocket *s, const char *what)
{
    const struct group *group = getgrnam(GROUP);
    if (group && group->gr_gid != s->made.st_gid && chown(s->path, (uid_t)-1, group->gr_gid) != 0)
        log_warning("%s %s: cannot give it to the group " GROUP ": %s", what, s->path,
                    strerror(errno));
}

/* 0 or the number of what went wrong. */
static int open_path(pathsocket *s, int type, int backlog, const char *what)
{
    if (!s->path)
        return ENOMEM;
    s->fd = socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (s->fd < 0)
        return errno;
    int number = bind_path(s, type, what);
    if (number != 0)
        return number;
    give_to_group(s, what);
    return listen(s->fd, backlog) == 0 ? 0 : errno;
}

bool pathsocket_open(pathsocket *s, const char *path, int type, int backlog, const char *what,
                     char error[PATHSOCKET_ERROR_MAX])
{
    *s = (pathsocket){.fd = -1, .path = strdup(path)};
    int number = open_path(s, type, backlog, what);
    if (number != 0)
        (void)snprintf(error, PATHSOCKET_ERROR_MAX, "%s", explain(path, number));
    return number == 0;
}

/* Not the socket of a daemon that has taken the place. */
static void remove_path(const pathsocket *s)
{
    struct stat now;
    if (s->made.st_ino != 0 && lstat(s->path, &now) == 0 && now.st_ino == s->made.st_ino &&
        now.st_dev == s->made.st_dev)
        (void)unlink(s->path);
}

void pathsocket_close(pathsocket *s)
{
    if (s->path)
        remove_path(s);
    if (s->fd >= 0)
        (void)close(s->fd);
    free(s->path);
    *s = (pathsocket){.fd = -1};
}
