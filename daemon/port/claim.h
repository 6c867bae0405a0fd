/* SPDX-License-Identifier: MIT
 *
 * claim.h - an interface belongs to one canwired at a time, and others can find out to which one.
 *
 * Two of them on one interface would each mistake the other's frames for frames of the ECU. A claim
 * is the name of a Unix socket in the abstract namespace. It ends with its process, also after a
 * crash. Each network namespace has its own names, as it has its own interfaces.
 */
#ifndef CANWIRE_PORT_CLAIM_H
#define CANWIRE_PORT_CLAIM_H

#include <stdbool.h>

typedef struct claim {
    int lock;  /* its name is the claimed interface, or -1 */
    int owner; /* its name is the owner, or -1 */
} claim;

#define CLAIM_NONE {.lock = -1, .owner = -1}

#define CLAIM_KEY_BYTES 48 /* of what is claimed, with its final 0 */
#define CLAIM_OWNER_BYTES 41

/* The process that has a claim. */
typedef struct claim_owner {
    char name[CLAIM_OWNER_BYTES]; /* of its bus, or whatever it has given */
    long pid;
} claim_owner;

/* Prints what claims of an interface are about. */
void claim_print_port(char key[CLAIM_KEY_BYTES], unsigned index);

/* Claims something under a name of one's own, which others find. Returns 0, EADDRINUSE when another
 * process has it, or another errno. */
int claim_take(claim *c, const char *key, const char *name);

/* Finds the owner of a claim. Returns false when there is none. */
bool claim_find(claim_owner *owner, const char *key);

/* Releases the claim. CLAIM_NONE is allowed. */
void claim_release(claim *c);

#endif
