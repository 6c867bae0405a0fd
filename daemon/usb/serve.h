/* SPDX-License-Identifier: MIT
 *
 * serve.h - the loop of one adapter.
 */
#ifndef CANWIRE_USB_SERVE_H
#define CANWIRE_USB_SERVE_H

#include "usb/wire.h"

#define SERVE_BEAT_MS 200 /* between two signs of life */

/* Signs at `beat`. */
#define SERVE_ALIVE '.'   /* at least every SERVE_BEAT_MS */
#define SERVE_CLAIMED 'c' /* a driver has taken the adapter, and makes an interface */
#define SERVE_LINKED 'l'  /* canwired has answered: it is the controller of its node */

/* Why a server has ended; the exit status of its process. */
typedef enum serve_end {
    SERVE_UNPLUGGED = 0,
    SERVE_FAILED,    /* a request could not be understood, or memory is short */
    SERVE_FORBIDDEN, /* the socket of the node may not be opened */
    SERVE_TAKEN,     /* the node has another controller, which stays */
    SERVE_FULL       /* the port has as many programs as it takes, which stay */
} serve_end;

/* Serves the kernel at one descriptor until it hangs up. Bytes at `beat` are signs. */
serve_end serve(int kernel, int beat, const usb_identity *who, const char *path);

#endif
