/* SPDX-License-Identifier: MIT
 *
 * background.h - canwired in the background: the process that was started ends when its child has
 * a bus that is ready.
 */
#ifndef CANWIRE_SERVE_BACKGROUND_H
#define CANWIRE_SERVE_BACKGROUND_H

/* Starts a child, before there are threads, and returns -1 in it; *ready is for
 * background_ready(). Returns the exit status in the first process, when the bus is ready or the
 * child has ended. Then it has printed the number of the child, or the reason. */
int background_start(int *ready);

/* Lets the first process end, and leaves its terminal; messages still go to standard error. Does
 * nothing for -1. */
void background_ready(int ready);

#endif
