/* SPDX-License-Identifier: MIT
 *
 * buses.h - the buses that run on this machine, by their control sockets.
 */
#ifndef CANWIRE_CLI_BUSES_H
#define CANWIRE_CLI_BUSES_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#define BUSES_MAX 64u
#define BUSES_NOBODY ((pid_t)-1)
#define BUSES_CLOSED ((pid_t)-2) /* to this user: nobody knows */

/* Returns the folder of their sockets: /run/canwire, or $CANWIRE_RUN. */
const char *buses_folder(void);

/* Returns true when that is where the service has its buses. */
bool buses_are_of_service(void);

/* Finds up to `most` buses whose sockets are in buses_folder() and have a listener; closed: or are
 * closed to this user. Returns their number, with the names in order, to be freed. Names with
 * characters that need quoting are left out. */
size_t buses_find(char *names[], size_t most, bool closed);

/* Returns the errno with which that could not read the folder, or 0; without a folder there is no
 * bus. */
int buses_error(void);

/* Returns the path of the socket of a bus, to be freed, or NULL. */
char *buses_path(const char *name);

/* Returns the process whose control socket is at a path, 0 for one that cannot be seen from here,
 * BUSES_NOBODY or BUSES_CLOSED. */
pid_t buses_listener(const char *path);

#endif
