/* SPDX-License-Identifier: MIT
 *
 * interfaces.h - what programs ask the kernel about interfaces.
 */
#ifndef CANWIRE_PRELOAD_INTERFACES_H
#define CANWIRE_PRELOAD_INTERFACES_H

#include "preload/table.h"

/* Answers an ioctl() about one of our interfaces. Returns false when it is about others; otherwise
 * *result is what the call returns, with errno. */
bool interfaces_ioctl(unsigned long request, void *argument, int *result);

/* The same about a CAN socket itself. */
bool interfaces_socket_ioctl(cansock *s, int fd, unsigned long request, void *argument,
                             int *result);

#endif
