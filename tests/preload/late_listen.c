/* SPDX-License-Identifier: MIT
 *
 * late_listen.c - to be preloaded into canwired and a program. canwired listens at the port
 * engine.sock only after a program has been refused there, and the program goes on only afterwards.
 * Each opens the pipe $LATE_LISTEN twice, and waits for the other one.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

typedef int listen_function(int, int);
typedef int connect_function(int, const struct sockaddr *, socklen_t);

static void meet(int first)
{
    const char *pipe = getenv("LATE_LISTEN");
    if (pipe)
        (void)close(open(pipe, first | O_CLOEXEC));
}

static bool is_the_port(int fd)
{
    struct sockaddr_un own = {.sun_family = 0};
    socklen_t size = sizeof own;
    return getsockname(fd, (struct sockaddr *)&own, &size) == 0 && own.sun_family == AF_UNIX &&
           strstr(own.sun_path, "engine.sock");
}

int listen(int fd, int backlog)
{
    listen_function *real = (listen_function *)dlsym(RTLD_NEXT, "listen");
    const bool late = is_the_port(fd);
    if (late)
        meet(O_RDONLY);
    const int result = real(fd, backlog);
    if (late)
        meet(O_WRONLY);
    return result;
}

int connect(int fd, const struct sockaddr *to, socklen_t size)
{
    connect_function *real = (connect_function *)dlsym(RTLD_NEXT, "connect");
    const int result = real(fd, to, size);
    const int error = errno;
    if (result != 0 && error == ECONNREFUSED) {
        meet(O_WRONLY);
        meet(O_RDONLY);
        (void)unsetenv("LATE_LISTEN");
    }
    errno = error;
    return result;
}
