/* SPDX-License-Identifier: MIT
 *
 * run_nodes.c - finds the port of a node, for canwire run: in the status of the bus, or in its
 * configuration.
 */
#include "cli/run_nodes.h"

#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/client.h"
#include "config/config.h"
#include "config/node/portname.h"
#include "config/rig.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define NAMES_MAX 512

/* A node as status or configuration tell of it. */
typedef struct told_node {
    const char *name;
    const char *port; /* NULL: none */
    bool fd;
    bool guest;
} told_node;

/* The one that is looked for. */
typedef struct search {
    run_node *node;
    const char *directory; /* of relative paths */
    const char *time;      /* the socket of virtual time, or NULL */
    told_node found;       /* the node itself, or a place for a guest */
    bool there;
    char names[NAMES_MAX]; /* of all nodes */
} search;

/* Considers a node. The named one is taken; failing that, the first place for a guest. */
static void consider(search *s, const told_node *told)
{
    const size_t used = strlen(s->names);
    const bool named = strcmp(told->name, s->node->name) == 0;
    if (!told->guest)
        (void)snprintf(s->names + used, sizeof s->names - used, "%s%s", used ? ", " : "",
                       told->name);
    if (!named && (!told->guest || s->there))
        return;
    s->found = *told;
    s->there = true;
}

static bool run_nodes_refuse(const search *s, const char *why)
{
    plain_print(stderr, "canwire run: node '%s' of bus %s: %s\n", s->node->name, s->node->bus, why);
    return false;
}

/* Writes a path as it is from here; without links, where it is too long with them. Returns false
 * when it is too long. */
static bool resolve(const search *s, char out[RUN_PATH_BYTES], const char *path)
{
    char whole[PATH_MAX];
    char real[PATH_MAX];
    const bool relative = path[0] != '/' && s->directory;
    const int length = snprintf(whole, sizeof whole, "%s%s%s", relative ? s->directory : "",
                                relative ? "/" : "", path);
    if (length <= 0 || (size_t)length >= sizeof whole)
        return false;
    const bool too_long = (size_t)length >= RUN_PATH_BYTES;
    const char *shown = too_long && realpath(whole, real) ? real : whole;
    const size_t size = strlen(shown) + 1;
    if (size <= RUN_PATH_BYTES)
        memcpy(out, shown, size);
    return size <= RUN_PATH_BYTES;
}

/* Looks for the listener of a port, which is not a client: a socket of another type is refused with
 * EPROTOTYPE. Returns 0 or an errno. */
static int find_listener(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return errno;
    const int error = connect(fd, (const struct sockaddr *)&address, sizeof address) ? errno : 0;
    (void)close(fd);
    return error == EPROTOTYPE ? 0 : error;
}

/* Waits for the port of a bus that is just starting. */
static bool await_port(const search *s)
{
    char why[NAMES_MAX + 64];
    int error;
    do
        error = find_listener(s->node->path);
    while (client_wait(error));
    (void)snprintf(why, sizeof why, "%.120s: %s%s", s->node->path, strerror(error),
                   error == ENOENT || error == ECONNREFUSED ? " (does canwired run?)" : "");
    return error == 0 || run_nodes_refuse(s, why);
}

/* Takes the path of the port of the node that was found. */
static bool run_nodes_take(search *s)
{
    char why[NAMES_MAX + 64];
    run_node *n = s->node;
    (void)snprintf(why, sizeof why, "there is no such node, and there are no guests; it has: %s",
                   s->names);
    if (!s->there)
        return run_nodes_refuse(s, why);
    if (!s->found.port)
        return run_nodes_refuse(s, "it has no port: it needs 'port: unix:PATH' (canwire-ports(7))");
    const portname port = portname_parse(s->found.port);
    (void)snprintf(why, sizeof why, "its port is %.64s: it needs 'port: unix:PATH', or the program "
                   "needs no canwire run", s->found.port);
    if (port.kind != PORTNAME_UNIX)
        return run_nodes_refuse(s, why);
    n->fd = s->found.fd;
    n->guest = s->found.guest;
    if (!resolve(s, n->path, port.path) || (s->time && !resolve(s, n->time, s->time)))
        return run_nodes_refuse(s, "the path of its port is too long from here");
    return await_port(s);
}

/* ---- The status ------------------------------------------------------------------------------ */

static bool is_fd(const json_t *node)
{
    const char *kind = get_text(node, "kind");
    return kind && strcmp(kind, "fd") == 0;
}

/* Looks for the node in the status of a bus that runs. */
static bool find_in_status(search *s)
{
    json_t *reply = client_ask_exact(s->node->bus, client_request("status"));
    const json_t *status = json_object_get(reply, "status");
    const json_t *nodes = json_object_get(status, "nodes");
    s->directory = get_text(status, "directory");
    s->time = get_text(json_object_get(status, "virtual"), "socket");
    for (size_t i = 0; i < json_array_size(nodes); i++) {
        const json_t *node = json_array_get(nodes, i);
        const told_node told = {.name = get_text(node, "name"),
                                .port = get_text(node, "port"),
                                .fd = is_fd(node),
                                .guest = json_object_get(node, "guest") != NULL};
        if (told.name)
            consider(s, &told);
    }
    const bool good = reply && run_nodes_take(s);
    json_decref(reply);
    return good;
}

/* ---- The configuration ----------------------------------------------------------------------- */

/* Looks for the node in a configuration: its bus need not have a control socket. */
static bool find_in_file(search *s)
{
    char directory[PATH_MAX];
    if (rig_is_rig(s->node->bus)) {
        plain_print(stderr, "canwire run: %s is a rig: --bus names one of its buses\n",
                    s->node->bus);
        return false;
    }
    cfg *config = cfg_load(s->node->bus, stderr);
    if (!config)
        return false;
    s->directory = getcwd(directory, sizeof directory);
    s->time = config->virtual_time.socket;
    for (size_t i = 0; i < config->node_count; i++) {
        const told_node told = {.name = config->nodes[i].name,
                                .port = config->nodes[i].port,
                                .fd = cfg_knows_fd(config, &config->nodes[i]),
                                .guest = config->nodes[i].guest > 0};
        consider(s, &told);
    }
    const bool good = run_nodes_take(s);
    cfg_free(config);
    return good;
}

bool run_find_node(run_node *n)
{
    struct stat found;
    search s = {.node = n};
    const bool file = strpbrk(n->bus, "/.") && stat(n->bus, &found) == 0 && S_ISREG(found.st_mode);
    return file ? find_in_file(&s) : find_in_status(&s);
}
