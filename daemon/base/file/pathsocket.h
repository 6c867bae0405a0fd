/* SPDX-License-Identifier: MIT
 *
 * pathsocket.h - a Unix socket that listens at a path: it is for the daemon's group, and is removed
 * at the end.
 *
 * A lock, PATH.lock, is held as long as the socket exists. So a canwired that has the path, but
 * does not listen yet, is not mistaken for one that has ended.
 */
#ifndef CANWIRE_BASE_PATHSOCKET_H
#define CANWIRE_BASE_PATHSOCKET_H

#include "base/file/folder.h"

#include <stdbool.h>
#include <sys/stat.h>

#define PATHSOCKET_ERROR_MAX 160

typedef struct pathsocket {
    int fd;        /* -1: none */
    char *path;    /* its own copy */
    folder folder; /* of the path: all calls stay there, whatever happens to the path */
    int lock;      /* -1: none */
    bool made;     /* the path is to be removed, if it is still this socket: */
    dev_t device;
    ino_t inode;
} pathsocket;

#define PATHSOCKET_NONE {.fd = -1, .folder = FOLDER_NONE, .lock = -1}

/* Listens at a path with mode 0660, for the group canwire if it exists. type is SOCK_STREAM or the
 * like; the socket does not block. A socket at which no program listens is replaced. `what` begins
 * lines of the log. Returns false after writing the reason to error; the pathsocket must be closed
 * even then. */
bool pathsocket_open(pathsocket *s, const char *path, int type, int backlog, const char *what,
                     char error[PATHSOCKET_ERROR_MAX]);

/* Checks that a socket could be made at a path, whose folder must take one. Returns false after
 * writing the reason to error. */
bool pathsocket_probe(const char *path, char error[PATHSOCKET_ERROR_MAX]);

/* Returns true when a path, however it is spelled, is that of this socket. */
bool pathsocket_is_at(const pathsocket *s, const char *path);

/* Takes over a socket that listens already, at this path or, with path NULL, at any. The path stays
 * at the end: it belongs to the maker of the socket. Returns false after writing the reason to
 * error; the pathsocket has the descriptor and must be closed even then. */
bool pathsocket_adopt(pathsocket *s, int fd, const char *path, int backlog,
                      char error[PATHSOCKET_ERROR_MAX]);

/* Closes the socket, and removes the path unless it belongs to another socket by now. */
void pathsocket_close(pathsocket *s);

/* Refuses descriptors that are sent to this socket, and to those accepted from it. Closing a
 * descriptor as its last owner can take as long as its sender has chosen (SO_LINGER). Kernels
 * before 6.16 cannot refuse them. */
void pathsocket_refuse_descriptors(int fd);

#endif
