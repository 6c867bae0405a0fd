/* SPDX-License-Identifier: MIT
 *
 * access.h - whether this process may open the socket of a node, and who may.
 */
#ifndef CANWIRE_USB_ACCESS_H
#define CANWIRE_USB_ACCESS_H

#include <stdbool.h>

#define ACCESS_WHY_BYTES 512u

/* Returns true for a path that this process may not write to, or not even look for. */
bool access_is_denied(const char *path);

/* Writes what may not be opened, whose it is, and who this process is. */
void access_explain(char why[ACCESS_WHY_BYTES], const char *path);

#endif
