/* SPDX-License-Identifier: MIT
 *
 * wire.h - the adapter's connection to canwired, as the controller of a node (port/messages.h).
 *
 * Neither of the two waits for the other. While canwired is away, or stopped, frames stay held.
 */
#ifndef CANWIRE_USB_WIRE_H
#define CANWIRE_USB_WIRE_H

#include "usb/device.h"

typedef struct wire {
    const char *path; /* of the socket of the port */
    const char *name; /* as the status of canwired shows it */
    usb_device *device;
    int fd;           /* -1: not connected */
    bool there;       /* the hello was answered */
    bool news;        /* it has been answered, and nobody was told yet */
    int told;         /* the errno that the log has */
    unsigned busy;    /* attempts in a row at which its place, or the port, was taken */
    unsigned denied;  /* attempts in a row at which the socket was not to be opened */
    int barred;       /* EACCES, EBUSY, EUSERS: it will not be let in; 0: it may be */
} wire;

extern const device_calls wire_calls; /* of the device; their user is a wire */

/* Tries to connect, unless it is connected. It does not wait. */
void wire_connect(wire *w);

/* Reads all messages that wait. */
void wire_read(wire *w);

void wire_close(wire *w);

#endif
