/* SPDX-License-Identifier: MIT
 *
 * relay.h - a CAN socket that has several connections, or one that may come back.
 *
 * The program's socket is one end of a pair then, and the pump writes into the other one what the
 * connections receive. A connection that is lost is tried again until its bus is there. All
 * functions need the lock of the table.
 */
#ifndef CANWIRE_PRELOAD_RELAY_H
#define CANWIRE_PRELOAD_RELAY_H

#include "preload/conn.h"
#include "preload/table.h"

/* A message in the pair has the index of the interface in `reserved` of its head. One of type
 * MESSAGE_ERROR is an error that the program gets. */

/* The use of a relay: it takes frames, and knows the wishes of connections, which wants_free()
 * releases. */
typedef struct relay_user {
    void (*frame)(cansock *s, int number, message *m, size_t size);
    conn_wants (*wants)(const cansock *s, int number);
} relay_user;

/* Makes the pair. Returns 0 or an errno. */
int relay_make(cansock *s, const relay_user *user);

/* Writes a message for the program. One that has no room is counted. */
void relay_put(cansock *s, message_head *head, const void *body, size_t size);

/* Gives it a connection, a hidden descriptor; -1: one that is tried until it is there. */
void relay_attach(cansock *s, int number, int fd);

/* Takes the loss of a connection: the program gets ENETDOWN. */
void relay_lose(cansock *s, int number);

/* Gives the program an error. */
void relay_fail(cansock *s, int error);

/* Stops reading. */
void relay_stop(cansock *s);

void relay_free(cansock *s);

#endif
