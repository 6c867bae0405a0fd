/* SPDX-License-Identifier: MIT
 *
 * adapters.h - starts a process for each adapter, and unplugs those that do not answer.
 *
 * The kernel's network configuration waits for an adapter that does not answer. Each one gives
 * signs of life, and a silent one is unplugged and made anew.
 */
#ifndef CANWIRE_USB_ADAPTERS_H
#define CANWIRE_USB_ADAPTERS_H

#include "config/config.h"
#include "usb/vhci.h"

#define ADAPTERS_MAX 1024u /* 16 buses with 64 nodes */
#define ADAPTERS_TICK_MS 100

typedef struct adapters adapters;

/* Returns NULL without memory. */
adapters *adapters_new(const vhci *files);

/* Unplugs all and frees it. */
void adapters_free(adapters *a);

/* Takes the nodes with `port: { usb: … }` of all buses; those that are there stay, others go. */
void adapters_set(adapters *a, const cfg *const *buses, size_t count);

/* Looks after all; to be called every ADAPTERS_TICK_MS. */
void adapters_tick(adapters *a);

size_t adapters_count(const adapters *a);

/* Prints "1 of 2 plugged in: can0 of ecu waits for its namespace, can0 plugged in". Those in
 * trouble come first, as far as there is room. */
void adapters_print(char *out, size_t size, const adapters *a);

/* Returns true when each has its name, or could not have it. */
bool adapters_are_ready(const adapters *a);

#endif
