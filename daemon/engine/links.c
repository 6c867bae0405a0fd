/* SPDX-License-Identifier: MIT
 *
 * links.c - detaches nodes from the bus and attaches them again with their interfaces.
 *
 * A configuration names interfaces, so names count: a renamed interface is gone. Another one that
 * gets its name replaces it, as at the next start. A new interface of the same name needs another
 * socket. Ports that are not interfaces stay as they are.
 */
#include "engine/core.h"

#include "base/log.h"
#include "config/node/fdnodes.h"
#include "config/node/portname.h"
#include "engine/share.h"
#include "port/loopless.h"
#include "port/open.h"

#include <errno.h>
#include <linux/can.h>
#include <net/if.h>
#include <string.h>

#define RETRY_S 1.0 /* of interfaces that exist but cannot be opened, and of lists */

static uint64_t bit_of(unsigned node)
{
    return UINT64_C(1) << node;
}

static const char *const link_words[] = {
    [REPORT_NO_LINK] = "",
    [REPORT_LINK_UP] = "is up",
    [REPORT_LINK_DOWN] = "is down",
    [REPORT_LINK_MISSING] = "is missing, waiting for it",
};

/* ---- Nodes and the bus ----------------------------------------------------------------------- */

/* Returns how the MTU of an interface fits the frames of its node. 0: it is not known. */
static mtu_told judge_mtu(const engine *e, unsigned node, unsigned mtu)
{
    const bool fd = cfg_fd_nodes(e->config) & bit_of(node);
    if (mtu == 0 || (mtu >= CANFD_MTU) == fd)
        return MTU_FITS;
    return fd ? MTU_SMALL : MTU_LARGE;
}

/* Warns of an MTU that does not fit, once. It changes only while the interface is down, so it is
 * looked at when that comes up. */
static void report_mtu(engine *e, unsigned node)
{
    const cfg_node *config = &e->config->nodes[node];
    const unsigned mtu = e->now.ports[node] ? port_mtu(e->now.ports[node]) : 0;
    const mtu_told verdict = judge_mtu(e, node, mtu);
    if (verdict == e->links.mtu[node])
        return;
    e->links.mtu[node] = verdict;
    if (verdict == MTU_LARGE)
        log_node_warning(config->name,
                         "port %s: its MTU is %u: programs can write CAN FD frames, which are "
                         "dropped (bad-frame), since the node knows none; with an MTU of 16 they "
                         "get an error",
                         config->port, mtu);
    else if (verdict == MTU_SMALL)
        log_node_warning(config->name,
                         "port %s: its MTU is %u: CAN FD frames do not pass, neither way (ip link "
                         "set %s down; ip link set %s mtu %u up; or make it by canwire vcan up)",
                         config->port, mtu, config->port, config->port, (unsigned)CANFD_MTU);
}

void engine_set_link(engine *e, unsigned node, report_link state)
{
    const cfg_node *config = &e->config->nodes[node];
    if (e->links.state[node] == state)
        return;
    e->links.state[node] = state;
    if (state == REPORT_LINK_UP)
        log_node_info(config->name, "%s %s", config->port, link_words[state]);
    else
        log_node_warning(config->name, "%s %s", config->port, link_words[state]);
    if (state == REPORT_LINK_UP)
        report_mtu(e, node);
    inputs_attach(&e->inputs, node, state == REPORT_LINK_UP);
}

/* Closes the port of a node after reading its last frames, which still count. */
static void lose_port(engine *e, unsigned node)
{
    if (e->now.ports[node]) {
        engine_read_rest(e, node);
        conserve_closing(&e->books, node, e->now.ports[node]);
        engine_unwatch_port(e, node);
        port_close(e->now.ports[node]);
        e->now.ports[node] = NULL;
        e->pushed_back &= ~bit_of(node);
    }
    e->links.refused &= ~bit_of(node);
    e->links.mtu[node] = MTU_FITS; /* as far as the log has told of the next one */
    engine_set_link(e, node, REPORT_LINK_MISSING);
}

/* Tries again later to open an interface that is there. That is told once, not at each try. */
static void start_retrying(engine *e, unsigned node, const char *error)
{
    if (!(e->links.refused & bit_of(node)))
        log_node_warning(e->config->nodes[node].name, "port %s; trying again every %.0f s", error,
                         RETRY_S);
    e->links.refused |= bit_of(node);
    ev_timer_again(e->loop, &e->links.retry);
}

/* Logs a small buffer once: the limit is the machine's. */
static void report_small_buffer(engine *e, unsigned node)
{
    const port *p = e->now.ports[node];
    if (!p || e->links.reported_small || port_buffer_bytes(p) >= PORT_BUFFER_BYTES)
        return;
    e->links.reported_small = true;
    log_detail("an interface may have %u KiB of frames waiting, not %d, before the kernel drops "
               "more: sysctl net.core.rmem_max=%d",
               port_buffer_bytes(p) / 1024u, PORT_BUFFER_BYTES / 1024, PORT_BUFFER_BYTES);
}

/* Opens the port of an interface that has appeared. Without success it is tried again later. */
static void gain_port(engine *e, unsigned node)
{
    char error[PORT_ERROR_TEXT_MAX];
    port *p = port_open(e->config->nodes[node].port, e->config->bus_name, error);
    if (!p) {
        start_retrying(e, node, error);
        return;
    }
    e->links.refused &= ~bit_of(node);
    e->now.ports[node] = p;
    share_port(p, e->config, node);
    conserve_opened(&e->books, node, p);
    engine_count_loopless(e);
    engine_watch_port(e, node);
    report_small_buffer(e, node);
}

/* ---- Reports of rtnetlink -------------------------------------------------------------------- */

static bool has_index(const engine *e, unsigned node, unsigned index)
{
    return e->now.ports[node] && port_index(e->now.ports[node]) == index;
}

static bool links_has_name(const engine *e, unsigned node, const char *name)
{
    const char *own = e->config->nodes[node].port;
    return own && strcmp(own, name) == 0;
}

static bool has_changed(const engine *e, unsigned node, unsigned index, const char *name,
                    report_link state)
{
    if (links_has_name(e, node, name))
        return !has_index(e, node, index) || e->links.state[node] != state;
    return has_index(e, node, index);
}

/* Closes ports of nodes that had this interface under another name: it can be opened only once. */
static void lose_other_names(engine *e, unsigned index, const char *name)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (has_index(e, i, index) && !links_has_name(e, i, name))
            lose_port(e, i);
}

/* An interface is there: its node gets it, or another one of the same name if it has been made
 * anew. */
static void take_interface(engine *e, unsigned node, unsigned index, report_link state)
{
    if (e->now.ports[node] && !has_index(e, node, index))
        lose_port(e, node);
    if (!e->now.ports[node])
        gain_port(e, node);
    if (has_index(e, node, index))
        engine_set_link(e, node, state);
}

/* Notes the kind of an interface: only the counters of a vcan show frames sent without loopback. */
static void note_kind(engine *e, const char *name, bool vcan)
{
    for (unsigned i = 0; i < e->config->node_count; i++) {
        if (!links_has_name(e, i, name))
            continue;
        e->links.vcans &= ~bit_of(i);
        e->links.vcans |= vcan ? bit_of(i) : 0;
    }
}

/* The kernel tells of an interface, or of a change. Nodes with that name get it, and lose one
 * renamed. */
static void on_seen(void *user, unsigned index, const char *name, const char *kind, bool up)
{
    engine *e = user;
    report_link state = up ? REPORT_LINK_UP : REPORT_LINK_DOWN;
    bool changed = false;
    (void)log_enter(e->name);
    note_kind(e, name, strcmp(kind, "vcan") == 0);
    for (unsigned i = 0; i < e->config->node_count; i++) {
        changed = changed || has_changed(e, i, index, name, state);
        e->links.mentioned |= links_has_name(e, i, name) ? bit_of(i) : 0;
    }
    if (!changed || e->stopping)
        return;
    e->wake(e); /* this may move nodes to other places */
    lose_other_names(e, index, name);
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (links_has_name(e, i, name))
            take_interface(e, i, index, state);
    e->wake(e);
}

/* An interface is gone, and nodes that have it lose their port. */
static void on_gone(void *user, unsigned index)
{
    engine *e = user;
    (void)log_enter(e->name);
    if (e->stopping)
        return;
    e->wake(e);
    for (unsigned i = 0; i < e->config->node_count; i++) {
        if (!has_index(e, i, index))
            continue;
        e->links.mentioned &= ~bit_of(i);
        lose_port(e, i);
    }
    e->wake(e);
}

/* A list begins, so no retry is needed. Interfaces that it does not name are gone at its end. */
static void on_listing(void *user)
{
    engine *e = user;
    e->links.awaited = true;
    e->links.mentioned = 0;
    ev_timer_stop(e->loop, &e->links.retry);
}

/* The kernel has told of all interfaces. Nodes whose interface was not among them have lost it. */
static void on_listed(void *user)
{
    engine *e = user;
    (void)log_enter(e->name);
    e->links.awaited = false;
    if (e->stopping)
        return;
    e->wake(e);
    if (e->links.awaited) /* the update was a reload: nodes have other places, another list comes */
        return;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (portname_is_interface(e->config->nodes[i].port) && !(e->links.mentioned & bit_of(i)))
            lose_port(e, i);
    e->wake(e);
}

/* Keeps the nodes unchanged until the next list. */
static void on_failed(void *user)
{
    engine *e = user;
    e->links.awaited = true;
    ev_timer_again(e->loop, &e->links.retry);
}

/* Asks for a list: the interfaces in it are opened as new ones are. */
static void on_retry(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    engine *e = timer->data;
    linkwatch_list(e->links.watch);
}

/* ---- Start, stop, reload --------------------------------------------------------------------- */

/* Opens the port of a node at the start. One that may be missing need not be there. */
static bool open_port(engine *e, unsigned node)
{
    char error[PORT_ERROR_TEXT_MAX];
    const cfg_node *config = &e->config->nodes[node];
    if (cfg_waits_for_port(e->config, config) && !port_exists(config->port))
        return true;
    e->now.ports[node] = port_open(config->port, e->config->bus_name, error);
    if (!e->now.ports[node])
        log_node_error_at(cfg_place_text(e->config, config->port_place).text, config->name,
                          "port %s", error);
    share_port(e->now.ports[node], e->config, node);
    report_small_buffer(e, node);
    report_mtu(e, node);
    return e->now.ports[node] != NULL;
}

/* A node whose controller is in a program is off until that says otherwise. */
static report_link link_of_opened(const cfg *config, unsigned node)
{
    return cfg_is_usb(&config->nodes[node]) ? REPORT_LINK_DOWN : REPORT_LINK_UP;
}

/* Opens the port of a node, or names a missing one. Of several canwired that start at once, the one
 * with the first port gets all others. The refused ones open no more ports. */
static bool open_or_name_port(engine *e, unsigned node, bool good)
{
    const cfg_node *config = &e->config->nodes[node];
    e->links.state[node] = link_of_opened(e->config, node);
    if (good || !port_exists(config->port))
        return open_port(e, node) && good;
    return false;
}

/* Opens all ports. All interfaces count as up until the first list reports them. */
bool engine_open_ports(engine *e)
{
    bool good = true;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (e->config->nodes[i].guest > 0)
            e->links.state[i] = REPORT_LINK_DOWN;
        else if (e->config->nodes[i].port)
            good = open_or_name_port(e, i, good);
    engine_count_loopless(e);
    return good;
}

void engine_count_loopless(engine *e)
{
    if (loopless_look(e->config, e->now.ports, e->links.vcans) || e->links.reported_uncounted)
        return;
    e->links.reported_uncounted = true;
    log_warning("frames that are sent without loopback cannot be counted: %s", strerror(errno));
}

bool engine_watch_links(engine *e)
{
    static const linkwatch_calls calls = {.seen = on_seen,
                                          .gone = on_gone,
                                          .listing = on_listing,
                                          .listed = on_listed,
                                          .failed = on_failed};
    ev_init(&e->links.retry, on_retry);
    e->links.retry.repeat = RETRY_S;
    e->links.retry.data = e;
    e->links.watch = linkwatch_start(e->loop, &calls, e);
    return e->links.watch != NULL;
}

/* Ends reports of interfaces. It may be called again, and without a watch. */
void engine_unwatch_links(engine *e)
{
    if (!e->links.watch)
        return;
    ev_timer_stop(e->loop, &e->links.retry);
    linkwatch_stop(e->links.watch);
    e->links.watch = NULL;
}

/* Returns the link of a node after a reload. Ports that are kept have it as before. */
static report_link link_after(const engine *e, const reload *r, const report_link *before,
                              unsigned node)
{
    if (!e->config->nodes[node].port)
        return REPORT_NO_LINK;
    if (e->config->nodes[node].guest > 0)
        return e->now.ports[node] ? REPORT_LINK_UP : REPORT_LINK_DOWN;
    if (r->port_from[node] != CW_NO_NODE)
        return before[r->port_from[node]];
    return e->now.ports[node] ? link_of_opened(e->config, node) : REPORT_LINK_MISSING;
}

void engine_carry_links_over(engine *e, const reload *r)
{
    report_link before[CW_NODES_MAX];
    mtu_told told[CW_NODES_MAX];
    memcpy(before, e->links.state, sizeof before);
    memcpy(told, e->links.mtu, sizeof told);
    e->links.refused = 0;
    e->links.vcans = 0; /* the list that is asked for below sets it again */
    for (unsigned i = 0; i < e->config->node_count; i++) {
        report_link state = link_after(e, r, before, i);
        e->links.state[i] = state;
        engine_keep_settings(e, i);
        inputs_attach(&e->inputs, i, state == REPORT_NO_LINK || state == REPORT_LINK_UP);
        report_small_buffer(e, i);
        e->links.mtu[i] = r->port_from[i] != CW_NO_NODE ? told[r->port_from[i]] : MTU_FITS;
        report_mtu(e, i);
    }
    linkwatch_list(e->links.watch);
}
