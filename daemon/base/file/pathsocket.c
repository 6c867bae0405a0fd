/* SPDX-License-Identifier: MIT
 *
 * pathsocket.c - a Unix socket that listens at a path: it is for the daemon's group, and is removed
 * at the end.
 */
#include "base/file/pathsocket.h"

#include "base/file/filelock.h"
#include "base/file/folder.h"
#include "base/log.h"
#include "base/unit.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#ifndef SO_PASSRIGHTS /* of Linux 6.16 */
#define SO_PASSRIGHTS 83
#endif

#define GROUP "canwire"

/* ---- A lock file ----------------------------------------------------------------------------- */

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

/* Takes the lock file of a folder's NAME, NAME.lock, and makes a missing one. Returns 0 with the
 * descriptor to keep in *fd. Otherwise *fd is -1 and an errno is returned; EBUSY: another program
 * holds it. */
static int lockfile_take(int *fd, const folder *in)
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

/* Removes and closes the lock file; -1: there is none. */
static void lockfile_release(int fd, const folder *in)
{
    lockname name;
    if (fd < 0)
        return;
    if (make_name(name, in) == 0)
        (void)unlinkat(in->fd, name, 0);
    (void)close(fd);
}

static bool is_socket(const folder *in)
{
    struct stat found;
    return fstatat(in->fd, in->name, &found, AT_SYMLINK_NOFOLLOW) == 0 && S_ISSOCK(found.st_mode);
}

/* Returns true when no program listens at the socket of the path. A socket of another type is in
 * use. */
static bool is_stale(const pathsocket *s, const struct sockaddr_un *address, int type)
{
    if (!is_socket(&s->folder))
        return false;
    int fd = socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    bool stale = fd >= 0 && connect(fd, (const struct sockaddr *)address, sizeof *address) != 0 &&
                 errno == ECONNREFUSED;
    if (fd >= 0)
        (void)close(fd);
    return stale;
}

/* Binds the socket. Returns 0 or an errno. The mask makes the socket 0660 from its first moment
 * on. */
static int bind_once(int fd, const struct sockaddr_un *address)
{
    mode_t mask = umask(S_IXUSR | S_IXGRP | S_IRWXO);
    int result = bind(fd, (const struct sockaddr *)address, sizeof *address);
    int number = result == 0 ? 0 : errno;
    (void)umask(mask);
    return number;
}

/* Says why there can be no socket, in words that help more than the error of the kernel. */
static const char *explain(const pathsocket *s, int number)
{
    if (number == EBUSY || (number == EADDRINUSE && is_socket(&s->folder)))
        return "in use; is another canwired running for this bus?";
    if (number == EADDRINUSE)
        return "there is something that is no socket";
    if (number == ENAMETOOLONG)
        return "the path is too long for a socket";
    if (number == ELOOP || number == EINVAL)
        return "its lock, the path with .lock behind it, is no regular file";
    if (number == ENXIO || number == EOPNOTSUPP)
        return "this file system takes no sockets; /run does";
    if (number == ESTALE)
        return "somebody else has changed the directory meanwhile";
    return number == ENOENT ? "the directory does not exist" : strerror(number);
}

/* Gives the socket to the group; without that group it stays with the daemon's user and group. So
 * it does, without a word, where somebody outside of the group has started a bus by hand. */
static void give_to_group(const pathsocket *s, int made, gid_t now, const char *what)
{
    const struct group *group = getgrnam(GROUP);
    if (group && group->gr_gid != now &&
        fchownat(made, "", (uid_t)-1, group->gr_gid, AT_EMPTY_PATH) != 0 &&
        (errno != EPERM || unit_instance()))
        log_warning("%s %s: cannot give it to the group " GROUP ": %s", what, s->path,
                    strerror(errno));
}

/* Remembers the socket, to remove it at the end. Returns false when bind() has not made it. */
static bool remember_made(pathsocket *s, const struct stat *found)
{
    if (!S_ISSOCK(found->st_mode) || found->st_uid != geteuid() || found->st_nlink != 1)
        return false;
    s->made = true;
    s->device = found->st_dev;
    s->inode = found->st_ino;
    return true;
}

/* Checks and gives away the new socket through a descriptor: others who may write to the directory
 * can replace the path at any moment. Returns 0 or an errno. */
static int take_made(pathsocket *s, const char *what)
{
    struct stat found;
    int made = openat(s->folder.fd, s->folder.name, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    int error = errno;
    if (made < 0 && fstatat(s->folder.fd, s->folder.name, &found, AT_SYMLINK_NOFOLLOW) == 0)
        return remember_made(s, &found) ? error : ESTALE;
    if (made < 0)
        return ESTALE;
    bool own = fstat(made, &found) == 0 && remember_made(s, &found);
    if (own)
        give_to_group(s, made, found.st_gid, what);
    (void)close(made);
    return own ? 0 : ESTALE;
}

/* Binds the path while holding the lock. A program that has a socket here and does not listen has
 * ended. */
static int bind_path(const pathsocket *s, int type, const char *what)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    memcpy(address.sun_path, s->path, strlen(s->path));
    int number = bind_once(s->fd, &address);
    if (number == EADDRINUSE && is_stale(s, &address, type)) {
        log_info("%s %s: replacing the socket of a canwired that is gone", what, s->path);
        (void)unlinkat(s->folder.fd, s->folder.name, 0);
        number = bind_once(s->fd, &address);
    }
    return number;
}

/* Opens the path. Returns 0 or the number of the error. It listens at once: a client that finds the
 * path may come in between. */
static int open_path(pathsocket *s, int type, int backlog, const char *what)
{
    struct sockaddr_un address;
    if (!s->path)
        return ENOMEM;
    if (strlen(s->path) >= sizeof address.sun_path)
        return ENAMETOOLONG;
    int number = folder_open(&s->folder, s->path);
    if (number == 0)
        number = lockfile_take(&s->lock, &s->folder);
    if (number != 0)
        return number;
    s->fd = socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (s->fd < 0)
        return errno;
    pathsocket_refuse_descriptors(s->fd);
    number = bind_path(s, type, what);
    if (number != 0)
        return number;
    const int deaf = listen(s->fd, backlog) == 0 ? 0 : errno;
    number = take_made(s, what); /* then it is removed at the end, also when nobody listens */
    return deaf != 0 ? deaf : number;
}

void pathsocket_refuse_descriptors(int fd)
{
    const int off = 0;
    (void)setsockopt(fd, SOL_SOCKET, SO_PASSRIGHTS, &off, sizeof off);
}

/* Reports a path where no socket can be. Returns whether it can. */
static bool pathsocket_judge(const pathsocket *s, int number, char error[PATHSOCKET_ERROR_MAX])
{
    if (number != 0)
        (void)snprintf(error, PATHSOCKET_ERROR_MAX, "%s%s", explain(s, number),
                       unit_hint(s->path, number));
    return number == 0;
}

/* Returns 0, or the errno that making a socket there would end with. */
static int probe_path(pathsocket *s)
{
    struct sockaddr_un address;
    if (!s->path)
        return ENOMEM;
    if (strlen(s->path) >= sizeof address.sun_path)
        return ENAMETOOLONG;
    const int number = folder_open(&s->folder, s->path);
    if (number != 0)
        return number;
    return faccessat(s->folder.fd, ".", W_OK | X_OK, AT_EACCESS) == 0 ? 0 : errno;
}

bool pathsocket_probe(const char *path, char error[PATHSOCKET_ERROR_MAX])
{
    pathsocket s = PATHSOCKET_NONE;
    s.path = strdup(path);
    const bool good = pathsocket_judge(&s, probe_path(&s), error);
    pathsocket_close(&s);
    return good;
}

/* Returns true where no start will make a socket: something else is there, or the file system takes
 * none. */
static bool takes_no_socket(const pathsocket *s, int number)
{
    return number == ENXIO || number == EOPNOTSUPP ||
           (number == EADDRINUSE && !is_socket(&s->folder));
}

bool pathsocket_open(pathsocket *s, const char *path, int type, int backlog, const char *what,
                     char error[PATHSOCKET_ERROR_MAX])
{
    *s = (pathsocket)PATHSOCKET_NONE;
    s->path = strdup(path);
    const int number = open_path(s, type, backlog, what);
    unit_blame(takes_no_socket(s, number) ? ENOTSOCK : number);
    return pathsocket_judge(s, number, error);
}

bool pathsocket_is_at(const pathsocket *s, const char *path)
{
    folder other = FOLDER_NONE;
    struct stat here;
    struct stat there;
    const bool same = s->folder.fd >= 0 && folder_open(&other, path) == 0 &&
                      strcmp(other.name, s->folder.name) == 0 &&
                      fstat(s->folder.fd, &here) == 0 && fstat(other.fd, &there) == 0 &&
                      here.st_dev == there.st_dev && here.st_ino == there.st_ino;
    folder_close(&other);
    return same;
}

/* ---- Sockets of the service manager ---------------------------------------------------------- */

/* Returns true for one folder or file by two paths. */
static bool is_same_place(const char *a, const char *b)
{
    struct stat in_a;
    struct stat in_b;
    return strcmp(a, b) == 0 ||
           (stat(a, &in_a) == 0 && stat(b, &in_b) == 0 && in_a.st_dev == in_b.st_dev &&
            in_a.st_ino == in_b.st_ino);
}

/* Returns the path of the socket, to be freed; it is empty for a socket without path. Returns NULL
 * with errno set. */
static char *path_of(int fd)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    socklen_t size = sizeof address - 1; /* leaves a 0 at the end */
    return getsockname(fd, (struct sockaddr *)&address, &size) == 0 ? strdup(address.sun_path)
                                                                   : NULL;
}

/* Takes the lock of a socket that somebody else has made. A user who may not make a lock relies on
 * the maker of the socket to use only one daemon. */
static bool lock_adopted(pathsocket *s)
{
    if (*s->path == '\0' || folder_open(&s->folder, s->path) != 0)
        return true;
    return lockfile_take(&s->lock, &s->folder) != EBUSY;
}

/* Prepares a socket that listens already. Listening once more makes this process the peer that
 * clients see (SO_PEERCRED); `canwire reload --pid` looks for it. Before that they see the maker of
 * the socket. */
static bool pathsocket_prepare(int fd, int backlog)
{
    int flags = fcntl(fd, F_GETFL);
    return flags >= 0 && fcntl(fd, F_SETFL, flags | O_NONBLOCK) == 0 &&
           fcntl(fd, F_SETFD, FD_CLOEXEC) == 0 && listen(fd, backlog) == 0;
}

static bool pathsocket_refuse(char error[PATHSOCKET_ERROR_MAX], const char *why)
{
    (void)snprintf(error, PATHSOCKET_ERROR_MAX, "%s", why);
    return false;
}

bool pathsocket_adopt(pathsocket *s, int fd, const char *path, int backlog,
                      char error[PATHSOCKET_ERROR_MAX])
{
    *s = (pathsocket)PATHSOCKET_NONE;
    s->fd = fd;
    pathsocket_refuse_descriptors(fd);
    s->path = path_of(fd);
    if (!s->path)
        return pathsocket_refuse(error, strerror(errno));
    if (path && !is_same_place(path, s->path)) {
        (void)snprintf(error, PATHSOCKET_ERROR_MAX, "the service manager listens at %s instead",
                       *s->path ? s->path : "a place without a path");
        return false;
    }
    if (!lock_adopted(s))
        return pathsocket_refuse(error, explain(s, EBUSY));
    return pathsocket_prepare(fd, backlog) || pathsocket_refuse(error, strerror(errno));
}

/* ---- The end --------------------------------------------------------------------------------- */

/* Removes the path, but not the socket of a daemon that has replaced this one. */
static void remove_path(const pathsocket *s)
{
    struct stat now;
    if (s->made && fstatat(s->folder.fd, s->folder.name, &now, AT_SYMLINK_NOFOLLOW) == 0 &&
        now.st_ino == s->inode && now.st_dev == s->device)
        (void)unlinkat(s->folder.fd, s->folder.name, 0);
}

/* Removes the lock last. */
void pathsocket_close(pathsocket *s)
{
    remove_path(s);
    if (s->fd >= 0)
        (void)close(s->fd);
    lockfile_release(s->lock, &s->folder);
    folder_close(&s->folder);
    free(s->path);
    *s = (pathsocket)PATHSOCKET_NONE;
}
