/* SPDX-License-Identifier: MIT
 *
 * options.h - getsockopt(), setsockopt() and ioctl() of CAN sockets.
 */
#ifndef CANWIRE_PRELOAD_OPTIONS_H
#define CANWIRE_PRELOAD_OPTIONS_H

#include "preload/table.h"

#include <sys/socket.h>

/* Return 0 or -1 with errno, and *passes: the call is the real socket's. */
int options_set(cansock *s, int fd, int level, int name, const void *value, socklen_t size,
                bool *passes);
int options_get(const cansock *s, int level, int name, void *value, socklen_t *size, bool *passes);

/* Answers an ioctl() about one of our interfaces. Returns false when it is about others; otherwise
 * *result is what the call returns, with errno. */
bool interfaces_ioctl(unsigned long request, void *argument, int *result);

/* The same about a CAN socket itself. */
bool interfaces_socket_ioctl(cansock *s, int fd, unsigned long request, void *argument,
                             int *result);

#endif
