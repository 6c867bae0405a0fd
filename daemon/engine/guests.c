/* SPDX-License-Identifier: MIT
 *
 * guests.c - puts the nodes of guests on the bus while their clients are connected.
 *
 * A client comes to the door and says its name. It gets a free node, which has that name until the
 * client goes.
 */
#include "engine/core.h"

#include "base/log.h"
#include "engine/share.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#define READS_MAX 64u /* of the door at one wake-up */

bool engine_open_door(engine *e)
{
    char error[PORT_ERROR_TEXT_MAX];
    const char *name = cfg_guest_port(e->config);
    if (!name)
        return true;
    e->now.door = door_open(name, error);
    if (!e->now.door)
        log_error("%s: guests: port %s",
                  cfg_place_text(e->config,
                                 e->config->nodes[e->config->node_count - 1].port_place).text,
                  error);
    return e->now.door != NULL;
}

/* ---- Coming ---------------------------------------------------------------------------------- */

/* The place of a new guest, or the reason why it has none. */
typedef struct place {
    unsigned node; /* CW_NO_NODE: none */
    int code;
    const char *why;
} place;

static bool is_free(const engine *e, unsigned node)
{
    return e->config->nodes[node].guest > 0 && !e->now.ports[node];
}

/* Returns the node of that name. A guest that has another name now will have its own one again. */
static unsigned find_name(const engine *e, const char *name)
{
    char own[CFG_GUEST_NAME_MAX];
    for (unsigned i = 0; i < e->config->node_count; i++) {
        cfg_guest_name(own, e->config->nodes[i].guest);
        if (e->config->nodes[i].guest > 0 && strcmp(name, own) == 0)
            return i;
    }
    return *name ? cfg_find_node(e->config, name) : CW_NO_NODE;
}

/* Finds a free node. The name of a free one asks for that one. */
static place guests_find_place(const engine *e, const char *name)
{
    const cfg *config = e->config;
    const unsigned named = find_name(e, name);
    if (named != CW_NO_NODE && is_free(e, named))
        return (place){.node = named};
    if (named != CW_NO_NODE)
        return (place){CW_NO_NODE, EEXIST, "there is a node of that name"};
    for (unsigned i = 0; i < config->node_count; i++)
        if (is_free(e, i))
            return (place){.node = i};
    return (place){CW_NO_NODE, EBUSY, "there are as many guests as the bus takes (guests: count)"};
}

/* Tells all who show names of nodes that one has changed. */
static void report_names(engine *e)
{
    uint8_t same[CW_NODES_MAX];
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        same[i] = (uint8_t)i;
    if (e->changed)
        e->changed(e->changed_user, same);
}

/* Gives a node to the client that has waited longest. The counts of its port begin with this
 * connection. */
static void seat(engine *e, unsigned node, const char *name)
{
    const bool renamed = *name && strcmp(name, e->config->nodes[node].name) != 0;
    port *p = door_admit(e->now.door);
    if (!p) {
        door_refuse(e->now.door, errno, strerror(errno));
        return;
    }
    e->now.ports[node] = p;
    inputs_attach_as(&e->inputs, node, renamed ? name : NULL);
    share_port(p, e->config, node);
    door_welcome(p);
    engine_watch_port(e, node);
    e->links.state[node] = REPORT_LINK_UP;
    log_node_info(e->config->nodes[node].name, "a guest has come");
    if (renamed)
        report_names(e);
}

/* Sees to those who wait, with the bus at the present. */
static void admit(engine *e)
{
    const char *said;
    while ((said = door_next(e->now.door))) {
        char name[CFG_NODE_NAME_MAX + 1];
        (void)snprintf(name, sizeof name, "%s", said);
        const place found = guests_find_place(e, name);
        if (found.node == CW_NO_NODE)
            door_refuse(e->now.door, found.code, found.why);
        else
            seat(e, found.node, name);
    }
}

void engine_look_at_door(engine *e)
{
    bool more = true;
    for (unsigned i = 0; e->now.door && more && i < READS_MAX; i++)
        (void)port_read(e->now.door, e->batch, PORT_BATCH, &more);
    if (e->now.door)
        admit(e);
}

/* Guests wait at the door. They are let in at the present tick. */
static void on_door(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    engine *e = io->data;
    if ((events & EV_ERROR) || e->stopping)
        return;
    if (engine_is_held(e)) {
        engine_unwatch_door(e);
        return;
    }
    e->wake(e); /* this may be a reload without guests */
    engine_look_at_door(e);
    e->wake(e);
}

void engine_watch_door(engine *e)
{
    if (!e->now.door || ev_is_active(&e->guests.io))
        return;
    ev_io_init(&e->guests.io, on_door, port_fd(e->now.door), EV_READ);
    e->guests.io.data = e;
    ev_io_start(e->loop, &e->guests.io);
}

void engine_unwatch_door(engine *e)
{
    ev_io_stop(e->loop, &e->guests.io);
}

/* ---- Going ----------------------------------------------------------------------------------- */

/* Takes a node off the bus. Its frames are dropped, and those that its client sent last are not
 * read. */
static void see_off(engine *e, unsigned node)
{
    char name[CFG_NODE_NAME_MAX + 1];
    (void)snprintf(name, sizeof name, "%s", e->config->nodes[node].name);
    inputs_attach(&e->inputs, node, false);
    conserve_closing(&e->books, node, e->now.ports[node]);
    engine_unwatch_port(e, node);
    port_close(e->now.ports[node]);
    e->now.ports[node] = NULL;
    e->pushed_back &= ~(UINT64_C(1) << node);
    e->links.state[node] = REPORT_LINK_DOWN;
    log_node_info(name, "the guest has gone");
    if (strcmp(name, e->config->nodes[node].name) != 0)
        report_names(e);
}

void engine_see_guests_off(engine *e)
{
    for (unsigned i = 0; e->guests.gone && i < e->config->node_count; i++)
        if ((e->guests.gone >> i & 1u) && e->now.ports[i])
            see_off(e, i);
    e->guests.gone = 0;
}
