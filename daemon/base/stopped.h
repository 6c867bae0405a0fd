/* SPDX-License-Identifier: MIT
 *
 * stopped.h - children that somebody has stopped.
 */
#ifndef CANWIRE_BASE_STOPPED_H
#define CANWIRE_BASE_STOPPED_H

#include <stdbool.h>
#include <sys/types.h>

/* Lets a child go on that SIGSTOP has stopped since the last call. Returns true when there was such
 * a signal. A child that a terminal has stopped stays so. */
bool stopped_go_on(pid_t child);

#endif
