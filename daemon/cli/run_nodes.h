/* SPDX-License-Identifier: MIT
 *
 * run_nodes.h - finds the port of a node, for canwire run.
 */
#ifndef CANWIRE_CLI_RUN_NODES_H
#define CANWIRE_CLI_RUN_NODES_H

#include <net/if.h>
#include <stdbool.h>
#include <sys/un.h>

#define RUN_NODES_MAX 16
#define RUN_PATH_BYTES sizeof((struct sockaddr_un *)0)->sun_path

typedef struct run_node {
    const char *bus; /* its name, the path of its socket, or its configuration */
    const char *name;
    const char *interface; /* NULL: the name */
    char path[RUN_PATH_BYTES];
    bool fd;    /* the node knows CAN FD */
    bool guest; /* the program becomes a guest */
    char time[RUN_PATH_BYTES]; /* the socket of virtual time; "": the bus has real time */
} run_node;

/* Finds path, fd, guest and time. Returns false after a message. */
bool run_find_node(run_node *n);

#endif
