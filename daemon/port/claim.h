/* SPDX-License-Identifier: MIT
 *
 * claim.h - an interface belongs to one canwired at a time.
 *
 * Two of them on one interface would each take what the other writes for frames of the ECU. A claim
 * is the name of a Unix socket in the abstract namespace: it is gone when its process is, however
 * that ended, and each network namespace has its own, as it has its own interfaces.
 */
#ifndef CANWIRE_PORT_CLAIM_H
#define CANWIRE_PORT_CLAIM_H

#include <stdbool.h>
#include <stddef.h>

typedef struct claim {
    int lock;  /* whose name says what is claimed, or -1 */
    int owner; /* whose name says who does, or -1 */
} claim;

#define CLAIM_NONE {.lock = -1, .owner = -1}

/* Claims the interface of an index for a bus. False, with the reason in error ("in use by bus
 * NAME of canwired, pid PID"), when another process has it, or with errno's reason. */
bool claim_take(claim *c, unsigned index, const char *bus, char *error, size_t error_size);

/* CLAIM_NONE is fine. */
void claim_release(claim *c);

#endif
