/* SPDX-License-Identifier: MIT
 *
 * tcp.c - a port at a TCP address, for programs that speak as to socketcand.
 *
 * Several nodes may have the same address. They share its listener, and a program chooses the node
 * by `open`: it moves from the port that has accepted it to that one. A beacon tells the local
 * network of the address, if it is wanted.
 */
#include "port/kinds.h"

#include "base/moment.h"
#include "port/listen.h"
#include "port/shared.h"
#include "port/tunnel/socketcand.h"

#include <arpa/inet.h>
#include <errno.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#define ACCEPTS_MAX 16u             /* in one read */
#define SEND_BUFFER_BYTES (1 << 20) /* as far as net.core.wmem_max allows */
#define IDLE_S 60 /* until the kernel asks whether a silent program is still there */
#define BEACON_NS INT64_C(2000000000) /* at least every three seconds */

typedef struct port_tcp port_tcp;

/* A TCP address at which programs connect. */
typedef struct listener {
    struct listener *next;
    int fd;
    net_address address;
    port_tcp *ports; /* in the order in which they were opened; never none */
} listener;

struct port_tcp {
    port_shared shared;
    listener *at;
    port_tcp *next; /* at the same address */
    char bus[PORTNAME_BUS_MAX + 1];
    int64_t beacon_ns; /* time of its next beacon, CLOCK_MONOTONIC; 0: none */
};

/* All of this process; its ports are in one thread. */
static listener *listeners;

/* ---- Beacons --------------------------------------------------------------------------------- */

#define BEACON_BYTES 4096u

typedef struct beacon {
    char buses[BEACON_BYTES];
    size_t bytes;
} beacon;

#define BEACON_PORT 42000
#define MESSAGE_BYTES (BEACON_BYTES + 512u)
#define HOST_NAME_BYTES 65u

static void beacon_begin(beacon *b)
{
    b->bytes = 0;
    b->buses[0] = '\0';
}

/* Adds the name of a bus. */
static void beacon_add(beacon *b, const char *bus)
{
    const size_t room = sizeof b->buses - b->bytes;
    const int bytes = snprintf(b->buses + b->bytes, room, "<Bus name=\"%s\"/>", bus);
    if (bytes > 0 && (size_t)bytes < room)
        b->bytes += (size_t)bytes;
    else
        b->buses[b->bytes] = '\0';
}

/* Names of hosts have letters, digits and '-'. */
static void get_host_name(char out[HOST_NAME_BYTES])
{
    if (gethostname(out, HOST_NAME_BYTES - 1) != 0 || strpbrk(out, "\"<>&"))
        (void)snprintf(out, HOST_NAME_BYTES, "canwire");
    out[HOST_NAME_BYTES - 1] = '\0';
}

/* Sends a beacon to the broadcast address of one network, in the format of socketcand. It names the
 * address that this machine has there. */
static void send_to(int fd, const beacon *b, struct in_addr from, struct in_addr mask,
                    unsigned number)
{
    char beacon_text[MESSAGE_BYTES], host[HOST_NAME_BYTES], address[INET_ADDRSTRLEN];
    struct sockaddr_in to = {.sin_family = AF_INET,
                             .sin_port = htons(BEACON_PORT),
                             .sin_addr.s_addr = from.s_addr | ~mask.s_addr};
    get_host_name(host);
    if (!inet_ntop(AF_INET, &from, address, sizeof address))
        return;
    const int bytes = snprintf(beacon_text, sizeof beacon_text,
                               "<CANBeacon name=\"%s\" type=\"SocketCAN\" "
                               "description=\"canwire\">\n<URL>can://%s:%u</URL>%s</CANBeacon>",
                               host, address, number, b->buses);
    if (bytes > 0 && (size_t)bytes < sizeof beacon_text)
        (void)sendto(fd, beacon_text, (size_t)bytes, MSG_DONTWAIT | MSG_NOSIGNAL,
                     (const struct sockaddr *)&to, sizeof to);
}

/* Sends the beacon to the network of one address of the machine, if that is meant. */
static void tell_network(int fd, const beacon *b, const struct ifaddrs *network,
                         struct in_addr wanted, unsigned number)
{
    struct sockaddr_in address, mask;
    if (!network->ifa_addr || !network->ifa_netmask || network->ifa_addr->sa_family != AF_INET ||
        !(network->ifa_flags & IFF_UP))
        return;
    memcpy(&address, network->ifa_addr, sizeof address);
    memcpy(&mask, network->ifa_netmask, sizeof mask);
    if (wanted.s_addr == htonl(INADDR_ANY) || wanted.s_addr == address.sin_addr.s_addr)
        send_to(fd, b, address.sin_addr, mask.sin_addr, number);
}

/* Sends it from an IPv4 address, or from all of the machine for 0.0.0.0, to the broadcast address
 * of each network. Beacons that get lost come again. */
static void beacon_send(const beacon *b, const char *host, unsigned number)
{
    struct ifaddrs *all;
    struct in_addr wanted;
    const int on = 1;
    if (inet_pton(AF_INET, host, &wanted) != 1)
        return;
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return;
    (void)setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
    if (getifaddrs(&all) == 0) {
        for (const struct ifaddrs *network = all; network; network = network->ifa_next)
            tell_network(fd, b, network, wanted, number);
        freeifaddrs(all);
    }
    (void)close(fd);
}

static port_tcp *tcp_own(port *p)
{
    return (port_tcp *)p;
}

/* ---- Listening ------------------------------------------------------------------------------- */

/* Returns the listener of this process at an address; NULL: there is none. */
static listener *find_listener(const portname *name)
{
    listener *l = listeners;
    while (l && (l->address.number != name->address.number ||
                 strcmp(l->address.host, name->address.host) != 0))
        l = l->next;
    return l;
}

/* Returns the listener of an address; NULL with errno. */
static listener *use_listener(const portname *name)
{
    listener *l = find_listener(name);
    if (l)
        return l;
    l = calloc(1, sizeof *l);
    if (!l)
        return NULL;
    l->fd = port_listen_at(&name->address);
    if (l->fd < 0) {
        free(l);
        return NULL;
    }
    l->address = name->address;
    l->next = listeners;
    listeners = l;
    return l;
}

/* Closes an address at which no port is left. */
static void close_listener(listener *l)
{
    listener **link = &listeners;
    while (*link != l)
        link = &(*link)->next;
    *link = l->next;
    (void)close(l->fd);
    free(l);
}

/* Returns the port of that bus name at an address, or NULL. */
static port_tcp *find_port(const listener *l, const char *bus)
{
    port_tcp *t = l->ports;
    while (t && strcmp(t->bus, bus) != 0)
        t = t->next;
    return t;
}

/* Adds a port to those of an address, behind the others, whose order decides about the beacon. */
static void tcp_join(port_tcp *t, listener *l)
{
    port_tcp **link = &l->ports;
    while (*link)
        link = &(*link)->next;
    *link = t;
    t->at = l;
}

/* Takes a port out of an address. The last one closes it. */
static void tcp_leave(port_tcp *t)
{
    port_tcp **link = &t->at->ports;
    while (*link != t)
        link = &(*link)->next;
    *link = t->next;
    if (!t->at->ports)
        close_listener(t->at);
    t->at = NULL;
}

/* ---- Programs -------------------------------------------------------------------------------- */

/* A program whose machine has gone without a word is noticed by the kernel. */
static void tcp_prepare(int fd)
{
    const int on = 1, idle_s = IDLE_S;
    (void)shared_prepare(fd, SEND_BUFFER_BYTES);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    (void)setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
}

/* Accepts programs, a limited number at a time. Without descriptors or memory the listener is left
 * alone until the next read. */
static void accept_waiting(port *p)
{
    const int listening = tcp_own(p)->at->fd;
    for (unsigned i = 0; i < ACCEPTS_MAX; i++) {
        const int fd = accept4(listening, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0 && (errno == ECONNABORTED || errno == EINTR))
            continue;
        if (fd < 0) {
            shared_set_deaf(p, listening, errno == EMFILE || errno == ENFILE || errno == ENOMEM ||
                                              errno == ENOBUFS);
            return;
        }
        shared_set_deaf(p, listening, false);
        tcp_prepare(fd);
        shared_take_client(p, fd);
    }
}

static void turn_away(port *p, member *c, const char *why)
{
    member_refuse(c, 0, 0, why);
    p->stats.refused++;
    shared_disconnect(p, c);
}

/* Gives a program to the port that it has chosen. */
static void tcp_move(port *from, member *c, port *to)
{
    member *moved = shared_move(from, c, to);
    if (moved)
        shared_greet(to, moved);
    else
        turn_away(from, c, "too many programs");
}

/* Answers `open`: the program goes to the port that has this name at the same address. */
static void greet(port *p, member *c)
{
    port_tcp *chosen = find_port(tcp_own(p)->at, socketcand_bus(c));
    if (!chosen) {
        turn_away(p, c, "could not open bus");
    } else if (chosen == tcp_own(p)) {
        shared_greet(p, c);
    } else {
        tcp_move(p, c, &chosen->shared.base);
    }
}

/* ---- The beacon ------------------------------------------------------------------------------ */

/* The first of the ports of an address that want a beacon sends it, for all of them. */
static bool is_first(const port_tcp *t)
{
    const port_tcp *first = t->at->ports;
    while (!first->shared.sharing.beacon)
        first = first->next;
    return first == t;
}

/* Sends one beacon for all ports of an address that want one. */
static void send_beacon(port_tcp *t)
{
    beacon b;
    beacon_begin(&b);
    for (const port_tcp *other = t->at->ports; other; other = other->next)
        if (other->shared.sharing.beacon)
            beacon_add(&b, other->bus);
    beacon_send(&b, t->at->address.host, t->at->address.number);
}

/* Sends the beacon when it is time, and sees that the port wakes up for the next one. */
static void see_to_beacon(port *p)
{
    port_tcp *t = tcp_own(p);
    const int64_t now_ns = t->shared.sharing.beacon ? clock_ns(CLOCK_MONOTONIC) : 0;
    if (!t->shared.sharing.beacon)
        return;
    if (now_ns >= t->beacon_ns) {
        t->beacon_ns = now_ns + BEACON_NS;
        if (is_first(t))
            send_beacon(t);
    }
    shared_wake_at(p, t->beacon_ns);
}

static void share(port *p, const port_sharing *sharing)
{
    shared_share(p, sharing);
    see_to_beacon(p);
}

static unsigned read_port(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    const unsigned count = shared_read(p, frames, max, more);
    see_to_beacon(p);
    return count;
}

/* ---- Opening and closing --------------------------------------------------------------------- */

static void close_port(port *p)
{
    if (tcp_own(p)->at)
        tcp_leave(tcp_own(p));
    shared_close(p);
}

static const port_kind tcp_kind = {.close = close_port,
                                   .read = read_port,
                                   .send = shared_send,
                                   .share = share,
                                   .crowd = shared_crowd,
                                   .handed_in = shared_handed_in,
                                   .ended = shared_ended,
                                   .client = shared_client,
                                   .control_bytes = PORT_STAMP_BYTES};

static const shared_ways tcp_ways = {
    .member = &member_socketcand, .accept = accept_waiting, .greet = greet};

/* Joins the listener of an address. Returns the reason of a failure, else NULL. */
static const char *open_at(port *p, const portname *name)
{
    listener *l = use_listener(name);
    if (!l)
        return strerror(errno);
    if (find_port(l, name->bus))
        return "another node has this name at this address";
    tcp_join(tcp_own(p), l);
    (void)snprintf(tcp_own(p)->bus, sizeof tcp_own(p)->bus, "%s", name->bus);
    return shared_watch(p, l->fd, SHARED_LISTENER) ? NULL : strerror(errno);
}

port *port_tcp_open(const portname *name, const char *text, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = shared_new(&tcp_kind, &tcp_ways, sizeof(port_tcp));
    const char *why = p && p->fd >= 0 && shared_add_timer(p) ? open_at(p, name) : strerror(errno);
    if (!why)
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: %s", text, why);
    if (p)
        close_port(p);
    return NULL;
}
