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

/* Serves the kernel at one descriptor until it hangs up. Bytes at `beat` are signs. Returns false
 * when a request could not be understood. */
bool serve(int kernel, int beat, const usb_identity *who, const char *path);

#endif
