/* SPDX-License-Identifier: MIT
 *
 * vhci.h - the ports of the kernel's virtual USB host controllers (module vhci-hcd), by sysfs.
 */
#ifndef CANWIRE_USB_VHCI_H
#define CANWIRE_USB_VHCI_H

#include <stdbool.h>
#include <stddef.h>

#define VHCI_BUS_ID_MAX 32u

/* Files that only root may open; whoever has them open may write. */
typedef struct vhci {
    int attach;
    int detach;
} vhci;

/* Opens the files. Returns false with errno set; ENOENT: the module is not loaded, or not yet. */
bool vhci_open(vhci *v);

/* Returns false when the module has been removed since then, also when it is there again. */
bool vhci_is_there(const vhci *v);

/* Finds a free high-speed port that is not among the used ones. Returns -1 with errno set; EBUSY:
 * all are taken. */
int vhci_find_port(const int *used, size_t count);

/* Gives a connected socket to a port; the kernel keeps it. Returns false with errno set. */
bool vhci_attach(const vhci *v, int port, int socket);

/* Unplugs a port. */
void vhci_detach(const vhci *v, int port);

/* Returns true when the kernel knows the device at a port, with the name of its USB device. */
bool vhci_bus_id(char out[VHCI_BUS_ID_MAX], int port);

/* ---- naming.c: the interface that the kernel has made for the device at a port --------------- */

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
