/* SPDX-License-Identifier: MIT
 *
 * server.h - a Unix stream socket with many clients that write lines and get lines.
 *
 * It does not interpret the lines. Whatever clients do, it never waits for one of them, but for a
 * moment at its end. It works for a few milliseconds at most before the loop returns to the bus.
 *
 * No user can exclude the others. One user has a part of the places at most; one place is kept for
 * root and one for the daemon's own user. A client that sends nothing, or does not read, makes room
 * for new ones.
 */
#ifndef CANWIRE_SERVE_SERVER_H
#define CANWIRE_SERVE_SERVER_H

#include <ev.h>
#include <stdbool.h>
#include <stddef.h>

#define SERVER_CLIENTS_MAX 64        /* at a time; a further one gets an error line */
#define SERVER_USER_MAX 48           /* of these, for one user */
#define SERVER_IDLE_S 60.0           /* without a line, or without reading pending output; then a
                                        client's place may go to another */
#define SERVER_LINE_MAX (1u << 18)   /* bytes of a line, without its end */
#define SERVER_OUTPUT_MAX (1u << 20) /* pending bytes of a client; then it is disconnected */
#define SERVER_STREAM_MAX (1u << 18) /* pending bytes, beyond which no events are added */

typedef struct server server;
typedef struct server_client server_client;

/* The callbacks of the server; they must not stop it. */
typedef struct server_calls {
    /* Handles a line, without its end but with a 0 behind it; the line may be modified. */
    void (*line)(void *user, server_client *client, char *line, size_t length);
    /* Reports that a client has read all pending output. */
    void (*drained)(void *user, server_client *client);
    void (*closed)(void *user, unsigned client);
    /* The texts for clients that are refused or disconnected: a line with its end. */
    const char *too_many;
    const char *too_quiet;
    const char *too_long;
} server_calls;

/* Listens at path, with mode 0660 and the group `canwire` if it exists. A socket at which no
 * program listens is replaced. where: the FILE:LINE:COLUMN that asks for it. inherited: a socket
 * that listens already, at this path or, with path NULL, at any; -1: none. `calls` and `user` must
 * live longer. Returns NULL after logging the reason. */
server *server_start(struct ev_loop *loop, const char *path, const char *where, int inherited,
                     const server_calls *calls, void *user);

/* Disconnects all clients. Removes the socket, if it is still its own and was not inherited. All
 * clients together get half a second to read pending output. NULL is allowed. */
void server_stop(server *s);

/* Replaces the clock, in seconds, for tests; it is ev_now() at first. */
typedef ev_tstamp server_clock(struct ev_loop *loop);
void server_set_clock(server *s, server_clock *now);

/* Sets if the client keeps its place without sending lines, as a watcher does; it has to read its
 * output. */
void server_keep(server_client *client, bool stays);

/* Returns 0 to SERVER_CLIENTS_MAX - 1; the number is free again when the client is closed. */
unsigned server_client_number(const server_client *client);

/* Returns the client of a number, or NULL. */
server_client *server_client_at(server *s, unsigned number);

/* Returns the bytes that fit before SERVER_STREAM_MAX are pending for the client. */
size_t server_room(const server_client *client);

/* Makes the client wait for a reply: its next line is not handled before server_go_on(). */
void server_hold(server_client *client);
void server_go_on(server_client *client);

/* Writes to the client, now or when it reads. A client with too much pending output is
 * disconnected. */
void server_write(server_client *client, const char *text, size_t length);

#endif
