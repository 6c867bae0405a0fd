/* SPDX-License-Identifier: MIT
 *
 * pathsocket.h - a Unix socket that listens at a path: for the daemon's group, and removed at the
 * end.
 *
 * A lock, PATH.lock, is held as long as it is there. So a canwired that has the path, but does not
 * listen yet, is not taken for one that is gone.
 */
#ifndef CANWIRE_BASE_PATHSOCKET_H
#define CANWIRE_BASE_PATHSOCKET_H

#include "base/folder.h"

#include <stdbool.h>
#include <sys/stat.h>

#define PATHSOCKET_ERROR_MAX 160

typedef struct pathsocket {
    int fd;        /* -1: none */
    char *path;    /* its own copy */
    folder folder; /* of the path: whatever becomes of it, all happens there */
    int lock;      /* -1: none */
    bool made;     /* the path is to be removed, if it still is this one: */
    dev_t device;
    ino_t inode;
} pathsocket;

#define PATHSOCKET_NONE {.fd = -1, .folder = FOLDER_NONE, .lock = -1}

/* Listens at a path with mode 0660, for the group canwire where there is one, for sockets of a type
 * (SOCK_STREAM …); not blocking. A socket that nobody listens at is replaced. what: begins lines of
 * the log. False after writing why to error; the pathsocket is then to be closed all the same. */
bool pathsocket_open(pathsocket *s, const char *path, int type, int backlog, const char *what,
                     char error[PATHSOCKET_ERROR_MAX]);

/* Takes over a socket that listens already, at this path or, with path NULL, at any. The path stays
 * at the end: it is of whoever made it. False after writing why to error; the pathsocket, which
 * then has the descriptor, is to be closed all the same. */
bool pathsocket_adopt(pathsocket *s, int fd, const char *path, int backlog,
                      char error[PATHSOCKET_ERROR_MAX]);

/* Closes it, and removes the path unless it is another's by now. */
void pathsocket_close(pathsocket *s);

/* Nobody can send descriptors along to this socket, or to one that comes of it. A descriptor whose
 * last owner is this process is closed here, and that may take as long as its sender has chosen
 * (SO_LINGER). Kernels before 6.16 cannot refuse them. */
void pathsocket_refuse_descriptors(int fd);

#endif
