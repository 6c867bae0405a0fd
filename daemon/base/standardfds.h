/* SPDX-License-Identifier: MIT
 *
 * standardfds.h - the descriptors 0 to 2, which a program may lack.
 */
#ifndef CANWIRE_BASE_STANDARDFDS_H
#define CANWIRE_BASE_STANDARDFDS_H

/* Opens those that are closed (`PROGRAM >&-`), so that no file and no socket gets their numbers,
 * and with them what is for standard output. Reading and writing fail as before, and programs that
 * are started have them closed. */
void standardfds_hold(void);

#endif
