/* SPDX-License-Identifier: MIT
 *
 * activation.h - sockets that the service manager has opened for canwired (sd_listen_fds(3)).
 */
#ifndef CANWIRE_SERVE_ACTIVATION_H
#define CANWIRE_SERVE_ACTIVATION_H

#include <stdbool.h>

#define ACTIVATION_ERROR_MAX 200

/* Finds the passed socket ($LISTEN_FDS, $LISTEN_FDNAMES) of this name, which must be a listening
 * Unix stream socket. The caller then owns *fd, which is -1 otherwise. Other sockets stay
 * unchanged: they may be ports (fd:NUMBER). Call it once. Returns false after writing the problem
 * to error. */
bool activation_take(int *fd, const char *name, char error[ACTIVATION_ERROR_MAX]);

/* Answers the clients that wait at that socket with an error, and ends their connections. */
void activation_refuse(const char *name, const char *why);

/* Does that at a socket that has been found; -1: there is none. */
void activation_answer(int listening, const char *why);

#endif
