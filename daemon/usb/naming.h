/* SPDX-License-Identifier: MIT
 *
 * naming.h - gives the interface that the kernel has made for an adapter its name and namespace.
 */
#ifndef CANWIRE_USB_NAMING_H
#define CANWIRE_USB_NAMING_H

#include <stdbool.h>

/* Returns the index of the interface of the device at a port of vhci-hcd. 0: there is none in the
 * network namespace of this process. */
unsigned naming_find(int port);

/* Returns false for a network namespace that is not there. */
bool naming_has_namespace(const char *netns);

/* Waits for the interface of the device at a port of vhci-hcd, some seconds at most. Then renames
 * it, and moves it to a namespace, NULL: none. Returns false after logging the reason. Needs
 * CAP_NET_ADMIN. It waits for the kernel's network configuration, so who answers the device must
 * not call it. */
bool name_interface(int port, const char *name, const char *netns);

#endif
