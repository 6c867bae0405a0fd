/* SPDX-License-Identifier: MIT
 *
 * pathsocket.h - a Unix socket that listens at a path: for the daemon's group, and removed at the
 * end.
 */
#ifndef CANWIRE_PATHSOCKET_H
#define CANWIRE_PATHSOCKET_H

#include <stdbool.h>
#include <sys/stat.h>

#define PATHSOCKET_ERROR_MAX 80

typedef struct pathsocket {
    int fd;           /* -1: none */
    char *path;       /* its own copy */
    struct stat made; /* of the path when it was made */
} pathsocket;

/* Listens at a path with mode 0660, for the group canwire where there is one, for sockets of a type
 * (SOCK_STREAM …); not blocking. A socket that nobody listens at is replaced. what: begins lines of
 * the log. False after writing why to error; the pathsocket is then to be closed all the same. */
bool pathsocket_open(pathsocket *s, const char *path, int type, int backlog, const char *what,
                     char error[PATHSOCKET_ERROR_MAX]);

/* Closes it, and removes the path unless it is another's by now. */
void pathsocket_close(pathsocket *s);

#endif
