/* SPDX-License-Identifier: MIT
 *
 * buses.c - the buses that run on this machine, by their control sockets.
 */
#include "cli/buses.h"

#include "base/unit.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define SUFFIX ".sock" /* of the socket of a bus */

static int error_of_folder; /* errno of the last look into it */
static bool with_closed;    /* sockets of other users count in that look */

const char *buses_folder(void)
{
    return unit_run_folder();
}

bool buses_are_of_service(void)
{
    return strcmp(buses_folder(), UNIT_RUN_FOLDER) == 0;
}

char *buses_path(const char *name)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s" SUFFIX, buses_folder(), name) < 0 ? NULL : path;
}

/* Returns true for a name that needs no quoting, also for Wireshark. */
static bool is_plain(const char *name, size_t length)
{
    for (size_t i = 0; i < length; i++)
        if (name[i] <= ' ' || name[i] == '{' || name[i] == '}' || name[i] == 0x7F)
            return false;
    return length > 0;
}

pid_t buses_listener(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    struct ucred peer = {.pid = BUSES_NOBODY};
    socklen_t size = sizeof peer;
    if (strlen(path) >= sizeof address.sun_path)
        return BUSES_NOBODY;
    memcpy(address.sun_path, path, strlen(path));
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof address) == 0)
        (void)getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size);
    else if (fd >= 0 && errno == EAGAIN) /* it has many clients, and hangs */
        peer.pid = 0;
    else if (fd >= 0 && errno == EACCES)
        peer.pid = BUSES_CLOSED;
    if (fd >= 0)
        (void)close(fd);
    return peer.pid;
}

/* Returns true when a canwired listens there, and not a port, nor nobody. For a socket of other
 * users that is not known. */
static bool is_running(const char *name)
{
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/%s", buses_folder(), name);
    const pid_t listener = buses_listener(path);
    return listener != BUSES_NOBODY && (listener != BUSES_CLOSED || with_closed);
}

/* Returns true for the socket of a bus that has a listener: others have been left behind. */
static int is_bus(const struct dirent *file)
{
    const char *name = file->d_name;
    const size_t length = strlen(name), end = strlen(SUFFIX);
    return length > end && strcmp(name + length - end, SUFFIX) == 0 &&
           is_plain(name, length - end) && is_running(name);
}

size_t buses_find(char *names[], size_t most, bool closed)
{
    struct dirent **files;
    size_t count = 0;
    with_closed = closed;
    const int found = scandir(buses_folder(), &files, is_bus, alphasort);
    error_of_folder = found < 0 && errno != ENOENT ? errno : 0;
    for (int i = 0; i < found; i++) {
        const char *name = files[i]->d_name;
        char *copy = count < most ? strndup(name, strlen(name) - strlen(SUFFIX)) : NULL;
        if (copy)
            names[count++] = copy;
        free(files[i]);
    }
    if (found >= 0)
        free(files);
    return count;
}

int buses_error(void)
{
    return error_of_folder;
}
