/* SPDX-License-Identifier: MIT
 *
 * client.h - asks a running canwired at its control socket.
 */
#ifndef CANWIRE_CLI_CLIENT_H
#define CANWIRE_CLI_CLIENT_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

typedef struct client {
    const char *bus; /* as the user named it */
    int fd;
    FILE *in;
    char *line; /* the last one that was read */
    size_t line_size;
    int error; /* the errno that client_next() has ended with, 0: the bus has ended */
} client;

/* Where sockets of buses are: /run/canwire, or $CANWIRE_RUN. */
const char *client_folder(void);

/* Connects to a bus: its name, or the path of its socket, which has a '/'. False after a message.
 * The name must live longer. */
bool client_open(client *c, const char *bus);

/* Sends a request, which it takes, and waits for the reply. NULL after a message when it is
 * refused or does not come; else to be released by the caller. */
json_t *client_ask(client *c, json_t *request);

/* The next line that the bus sends, however long that takes. NULL at the end, which is not always
 * that of the bus. */
const char *client_next(client *c);

/* Says that it has ended, or what has. False: it was not the bus. */
bool client_tell_end(const client *c);

void client_close(client *c);

/* All of it for a single request. */
json_t *client_ask_once(const char *bus, json_t *request);

/* The same where the reply says nothing more: returns the exit status. */
int client_tell(const char *bus, json_t *request);

/* A request of that name. */
json_t *client_request(const char *name);

#endif
