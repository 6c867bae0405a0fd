/* SPDX-License-Identifier: MIT
 *
 * options.h - getsockopt() and setsockopt() of CAN sockets.
 *
 * They return 0 or -1 with errno, and *passes: the call is the real socket's.
 */
#ifndef CANWIRE_PRELOAD_OPTIONS_H
#define CANWIRE_PRELOAD_OPTIONS_H

#include "preload/table.h"

#include <sys/socket.h>

int options_set(cansock *s, int fd, int level, int name, const void *value, socklen_t size,
                bool *passes);
int options_get(const cansock *s, int level, int name, void *value, socklen_t *size, bool *passes);

#endif
