/* SPDX-License-Identifier: MIT
 *
 * client.h - asks a running canwired at its control socket.
 */
#ifndef CANWIRE_CLI_CLIENT_H
#define CANWIRE_CLI_CLIENT_H

#include "cli/lines.h"

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

typedef struct client {
    const char *bus; /* as given by the user */
    int fd;
    lines_reader in;
    bool exact; /* texts of replies stay as they are */
    bool order; /* the last request is to do something */
    int error; /* the errno that ended client_next(), 0: the bus has ended */
} client;

/* Passes the messages of all clients to a function, in place of standard error. */
void client_set_teller(void (*tell)(const char *text));

/* Takes the reply of a bus over, NULL after a message. */
typedef void client_take(void *user, const char *path, json_t *reply);

/* Asks several buses at once, so that those which hang share one limit. Those that
 * cannot be asked are taken first. Sockets of another type are left out. Without memory it returns
 * false after a message. */
bool client_ask_all(char *const *paths, size_t count, json_t *request, client_take *take,
                    void *user);

/* Lets clients wait that long for a connection, and for a request and all of its reply. */
void client_set_patience(int seconds);

/* Lets the program wait that long, in all its calls together, for buses that are just starting. By
 * default it does not. */
void client_set_wait(uint64_t ns);

/* Pauses for a moment after a bus was not there, and returns true to look again. Returns false
 * after a failure of another kind, and when that time is over. */
bool client_wait(int error);

/* Lets clients take the one bus that says to have a name, though others that say nothing may have
 * it, too. This is for those who only look. By default they are refused. */
void client_allow_doubt(void);

/* Returns true for a bus that has a socket; it need not run. */
bool client_has_socket(const char *bus);

/* Returns true for a socket at which a bus listens, and not a port. */
bool client_has_listener(const char *bus);

/* Returns true for the own name of a bus that runs, which has another socket. It says nothing. */
bool client_is_named(const char *bus);

/* Connects to a bus. That is the path of a socket, which contains a '/' or is a file in the current
 * folder, or the name of a socket. Without one it is the name of the bus itself. The name must live
 * longer. Returns false after a message. */
bool client_open(client *c, const char *bus);

/* Sends a request, takes it over, and waits for the reply, which the caller releases. Returns NULL
 * after a message when it is refused or does not come. */
json_t *client_ask(client *c, json_t *request);

/* Returns the next line of the bus, without its end, however long that takes. Returns NULL at the
 * end, of the bus or of the connection. Like all lines and replies it can be shown as it is: the
 * client makes what comes from a socket plain (base/plain.h). */
const char *client_next(client *c);

/* Parses a line of the bus; its texts are plain. Returns NULL for a line that is not JSON. */
json_t *client_parse(const char *line, json_error_t *error);

/* Reports that the bus has ended, or the error. Returns false when the bus has not ended. */
bool client_report_end(const client *c);

void client_close(client *c);

/* Connects, asks and closes for a single request. */
json_t *client_ask_once(const char *bus, json_t *request);

/* Does the same, and leaves paths in the reply as they are: they are for use and not for show. */
json_t *client_ask_exact(const char *bus, json_t *request);

/* Does the same for a reply without content: returns the exit status. */
int client_report(const char *bus, json_t *request);

/* Makes a request of that name. */
json_t *client_request(const char *name);

/* Returns the path of a file that a folder may be in front of, to be freed, or NULL. */
char *client_path_in(const char *folder, const char *file);

/* Returns the path of a file, `file` or `rig`, that a status names, to be freed; NULL for none. */
char *client_file_of(const json_t *status, const char *key);

#endif
