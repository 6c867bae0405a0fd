/* SPDX-License-Identifier: MIT
 *
 * activation.h - sockets that the service manager has opened for canwired (sd_listen_fds(3)).
 */
#ifndef CANWIRE_SERVE_ACTIVATION_H
#define CANWIRE_SERVE_ACTIVATION_H

#include <stdbool.h>

#define ACTIVATION_ERROR_MAX 200

/* Looks among the sockets that were passed ($LISTEN_FDS, $LISTEN_FDNAMES) for the one of this name,
 * which must be a Unix stream socket that listens; *fd is then the caller's, else -1. The others
 * stay as they are: they may be ports (fd:NUMBER). To be called once. False after writing to error
 * what is wrong. */
bool activation_take(int *fd, const char *name, char error[ACTIVATION_ERROR_MAX]);

#endif
