/* SPDX-License-Identifier: MIT
 *
 * claim.h - an interface belongs to one canwired at a time.
 *
 * Two of them on one interface would each mistake the other's frames for frames of the ECU. A claim
 * is the name of a Unix socket in the abstract namespace. It ends with its process, also after a
 * crash. Each network namespace has its own names, as it has its own interfaces.
 */
#ifndef CANWIRE_PORT_CLAIM_H
#define CANWIRE_PORT_CLAIM_H

#include <stdbool.h>
#include <stddef.h>

typedef struct claim {
    int lock;  /* its name is the claimed interface, or -1 */
    int owner; /* its name is the owner, or -1 */
} claim;

#define CLAIM_NONE {.lock = -1, .owner = -1}

/* Claims the interface of an index for a bus. Returns false when another process has it or an error
 * occurs. `error` then has the reason ("in use by bus NAME of canwired, pid PID"). */
bool claim_take(claim *c, unsigned index, const char *bus, char *error, size_t error_size);

/* Releases the claim. CLAIM_NONE is allowed. */
void claim_release(claim *c);

#endif
