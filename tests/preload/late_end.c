/* SPDX-License-Identifier: MIT
 *
 * late_end.c - to be preloaded into canwired. It ends connections to the port engine.sock late: it
 * opens the pipe $LATE_END for writing before it closes the first one, and then for reading. Each
 * waits for the other end.
 */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>

typedef int close_function(int);

static bool is_of_the_port(int fd)
{
    static const char port[] = "engine.sock";
    struct sockaddr_un own = {.sun_family = 0}, peer;
    socklen_t size = sizeof own, peer_size = sizeof peer;
    if (getsockname(fd, (struct sockaddr *)&own, &size) != 0 ||
        getpeername(fd, (struct sockaddr *)&peer, &peer_size) != 0 || own.sun_family != AF_UNIX)
        return false;
    const size_t length = strnlen(own.sun_path, sizeof own.sun_path);
    return length >= strlen(port) &&
           strncmp(own.sun_path + length - strlen(port), port, strlen(port)) == 0;
}

int close(int fd)
{
    close_function *real_close = (close_function *)dlsym(RTLD_NEXT, "close");
    const char *pipe = getenv("LATE_END");
    if (pipe && is_of_the_port(fd)) {
        (void)unsetenv("LATE_END");
        (void)real_close(open(pipe, O_WRONLY | O_CLOEXEC));
        (void)real_close(open(pipe, O_RDONLY | O_CLOEXEC));
    }
    return real_close(fd);
}
