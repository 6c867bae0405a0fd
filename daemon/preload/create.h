/* SPDX-License-Identifier: MIT
 *
 * create.h - the start and the end of CAN sockets, and of the library.
 */
#ifndef CANWIRE_PRELOAD_CREATE_H
#define CANWIRE_PRELOAD_CREATE_H

#include "preload/table.h"

/* Makes a socket of the family PF_CAN. Returns the descriptor, or -1 with errno. */
int create_socket(int type, int protocol);

/* Prepares the close of a descriptor: waits for the last frames, where they would be lost, and
 * forgets it. */
void create_close(int fd);

/* Waits for the last frames of all sockets: the process ends. */
void create_exit(void);

#endif
