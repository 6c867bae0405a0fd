/* SPDX-License-Identifier: MIT
 *
 * server.h - a Unix stream socket with many clients that write lines and get lines.
 *
 * It knows nothing of what the lines say. Whatever clients do, it never waits for one of them,
 * but for a moment at its end, and never works on them for longer than a few milliseconds before
 * the loop turns to the bus again.
 *
 * No user keeps the others out: one user has a part of the places at most, one is kept for root and
 * one for the daemon's own user, and who says nothing, or does not read what it is told, makes room
 * for who comes.
 */
#ifndef CANWIRE_SERVE_SERVER_H
#define CANWIRE_SERVE_SERVER_H

#include <ev.h>
#include <stdbool.h>
#include <stddef.h>

#define SERVER_CLIENTS_MAX 64        /* at a time; a further one gets an error line */
#define SERVER_USER_MAX 48           /* of these of one user */
#define SERVER_IDLE_S 60.0           /* without a line, or with something unread of which nothing is
                                        taken; then a client's place may go to another */
#define SERVER_LINE_MAX (1u << 18)   /* bytes of a line, without its end */
#define SERVER_OUTPUT_MAX (1u << 20) /* bytes that wait for a client; then it is disconnected */
#define SERVER_STREAM_MAX (1u << 18) /* bytes that wait, beyond which no news are added */

typedef struct server server;
typedef struct server_client server_client;

/* What the server tells; it must not be stopped from here. */
typedef struct server_calls {
    /* A line, without its end but with a 0 behind it, that may be written to. */
    void (*line)(void *user, server_client *client, char *line, size_t length);
    /* Nothing waits for this client any more. */
    void (*drained)(void *user, server_client *client);
    void (*closed)(void *user, unsigned client);
    /* What a client is told that is refused or disconnected: a line with its end. */
    const char *too_many;
    const char *too_quiet;
    const char *too_long;
} server_calls;

/* Listens at path, with mode 0660 and the group `canwire` where there is one. A socket that nobody
 * listens at is replaced. inherited: a socket that listens already, at this path or, with path
 * NULL, at any; -1: none. `calls` and `user` must live longer. NULL after logging why. */
server *server_start(struct ev_loop *loop, const char *path, int inherited,
                     const server_calls *calls, void *user);

/* Disconnects all and removes the socket, if it is still ours and was not inherited. Clients get
 * half a second, all together, to read what waits for them. NULL is fine. */
void server_stop(server *s);

/* What time it is, in seconds; ev_now() to begin with. For tests. */
typedef ev_tstamp server_clock(struct ev_loop *loop);
void server_set_clock(server *s, server_clock *now);

/* Whether the client keeps its place also when it says nothing, as one that listens does; it has to
 * read what it is told. */
void server_keep(server_client *client, bool stays);

/* 0 to SERVER_CLIENTS_MAX - 1, free again when the client is closed. */
unsigned server_client_number(const server_client *client);

/* The client of a number, or NULL. */
server_client *server_client_at(server *s, unsigned number);

/* Bytes that may be added before SERVER_STREAM_MAX wait for the client. */
size_t server_room(const server_client *client);

/* The client has to wait for a reply: its next line is not handled before server_go_on(). */
void server_hold(server_client *client);
void server_go_on(server_client *client);

/* Writes to the client, now or when it reads. A client for which too much waits already is
 * disconnected. */
void server_write(server_client *client, const char *text, size_t length);

#endif
