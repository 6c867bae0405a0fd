/* SPDX-License-Identifier: MIT
 *
 * privileges.h - gives up what root may do.
 */
#ifndef CANWIRE_USB_PRIVILEGES_H
#define CANWIRE_USB_PRIVILEGES_H

#include <stdbool.h>

/* Becomes another user, with the user's groups and the capability CAP_NET_ADMIN alone. Returns
 * false with errno set; ENOENT: there is no such user. */
bool privileges_become(const char *user);

/* Gives up that capability, too. Returns false with errno set. */
bool privileges_drop_all(void);

#endif
