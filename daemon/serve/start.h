/* SPDX-License-Identifier: MIT
 *
 * start.h - how canwired is started: with sockets that the service manager has opened for it, in
 *           the background, and by a unit that keeps something from it.
 */
#ifndef CANWIRE_SERVE_START_H
#define CANWIRE_SERVE_START_H

#include "config/config.h"

#include <stdbool.h>

/* ---- activation.c: sockets from the service manager (sd_listen_fds(3)) ----------------------- */

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

/* ---- background.c: the first process ends when its child has a bus that is ready ------------- */

/* Starts a child, before there are threads, and returns -1 in it; *ready is for
 * background_ready(). Returns the exit status in the first process, when the bus is ready or the
 * child has ended. Then it has printed the number of the child, or the reason. */
int background_start(int *ready);

/* Lets the first process end, and leaves its terminal; messages still go to standard error. Does
 * nothing for -1. */
void background_ready(int ready);

/* ---- confined.c: what the unit keeps from a bus without an error ----------------------------- */

/* Warns of files and sockets that nobody else sees, and of other hosts that do not get through.
 * Does nothing outside of the service. */
void confined_warn(const cfg *config);

#endif
