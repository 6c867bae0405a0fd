/* SPDX-License-Identifier: MIT
 *
 * serve.h - the loop of one adapter.
 */
#ifndef CANWIRE_USB_SERVE_H
#define CANWIRE_USB_SERVE_H

#include "usb/wire.h"

#define SERVE_BEAT_MS 200 /* between two signs of life */

/* Serves the kernel at one descriptor until it hangs up. A byte at `beat`, at least every
 * SERVE_BEAT_MS, is a sign of life. Returns false when a request could not be understood. */
bool serve(int kernel, int beat, const usb_identity *who, const char *path);

#endif
