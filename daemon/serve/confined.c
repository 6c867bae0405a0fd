/* SPDX-License-Identifier: MIT
 *
 * confined.c - what a bus asks for that the unit of the service keeps from it, without an error.
 *
 * Files in a private /tmp are made and never found, and packets that IPAddressDeny= drops look like
 * a network that is slow. Packets tell if the unit allows a network.
 */
#include "serve/start.h"

#include "base/text/chars.h"
#include "base/log.h"
#include "base/unit.h"
#include "config/files.h"
#include "config/node/portname.h"
#include "config/node/tunnelname.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define DISCARD 9 /* the port of a packet to this host that nobody needs */
#define TCPQ "tcpq://"
#define PORTS_BYTES 240 /* of their names in a warning, which has room for 500 */
#define NETWORK_BYTES (INET_ADDRSTRLEN + 4)

/* ---- Files ----------------------------------------------------------------------------------- */

/* Warns of a file or socket in a folder that systemd gives the service for itself alone. */
static void warn_of_file(const fileuse *use)
{
    const char *folder = use->lock ? NULL : unit_private_folder(use->path);
    if (folder)
        log_warning("%s:%d:%d: %s: %s: the service has a %.*s of its own, where nobody else finds "
                    "it: use %s", use->file, use->line, use->column, use->what, use->path,
                    (int)strlen(folder) - 1, folder,
                    use->socket ? UNIT_RUN_FOLDER : "/var/lib/canwire");
}

/* Warns of all files and sockets that the configuration names and that others would look for in
 * vain. */
static void warn_of_files(const cfg *config)
{
    fileuses made = {.count = 0};
    cfg_add_files_written(&made, config);
    cfg_add_sockets(&made, config);
    for (size_t i = 0; i < made.count; i++)
        warn_of_file(&made.uses[i]);
    fileuses_free(&made);
}

/* ---- Hosts ----------------------------------------------------------------------------------- */

/* The networks that the unit keeps the service from, as far as that is known. */
typedef struct networks {
    bool shut; /* all of them */
    char own[NETWORK_BYTES]; /* one that this host is in and that is shut, or "" */
} networks;

/* Returns true when the unit drops packets to an address. This one goes to the loopback interface:
 * no network sees it, and none has to be there yet. Without that interface the unit is taken for
 * what it is by default. */
static bool is_dropped(struct in_addr address)
{
    static const char loopback[] = "lo";
    const struct sockaddr_in to = {
        .sin_family = AF_INET, .sin_port = htons(DISCARD), .sin_addr = address};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const bool passed =
        fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_BINDTODEVICE, loopback, sizeof loopback) == 0 &&
        sendto(fd, "", 0, MSG_NOSIGNAL, (const struct sockaddr *)&to, sizeof to) >= 0;
    if (fd >= 0)
        (void)close(fd);
    return !passed;
}

static struct in_addr address_of(const struct sockaddr *any)
{
    return ((const struct sockaddr_in *)(const void *)any)->sin_addr;
}

/* Returns true for an address of this host in a network. */
static bool is_in_network(const struct ifaddrs *one)
{
    return one->ifa_addr && one->ifa_netmask && one->ifa_addr->sa_family == AF_INET &&
           (one->ifa_flags & IFF_UP) &&
           ntohl(address_of(one->ifa_addr).s_addr) >> 24 != IN_LOOPBACKNET;
}

/* Prints the network of an address of this host, such as 192.168.1.0/24. */
static void print_network(char out[NETWORK_BYTES], const struct ifaddrs *one)
{
    char text[INET_ADDRSTRLEN];
    const in_addr_t mask = address_of(one->ifa_netmask).s_addr;
    const struct in_addr network = {.s_addr = address_of(one->ifa_addr).s_addr & mask};
    (void)inet_ntop(AF_INET, &network, text, sizeof text);
    (void)snprintf(out, NETWORK_BYTES, "%s/%d", text, __builtin_popcount(mask));
}

/* Looks at the networks of this host, or at usual ones when it is in none yet. */
static networks look_at_networks(void)
{
    static const char *const usual[] = {"192.168.0.1", "192.168.1.1", "10.0.0.1", "172.16.0.1"};
    networks found = {.shut = true};
    struct ifaddrs *all = NULL;
    bool any = false;
    (void)getifaddrs(&all);
    for (const struct ifaddrs *one = all; one; one = one->ifa_next) {
        if (!is_in_network(one))
            continue;
        any = true;
        if (!is_dropped(address_of(one->ifa_addr)))
            found.shut = false;
        else if (!*found.own)
            print_network(found.own, one);
    }
    freeifaddrs(all);
    for (size_t i = 0; i < sizeof usual / sizeof usual[0] && !any; i++)
        found.shut = found.shut && is_dropped((struct in_addr){.s_addr = inet_addr(usual[i])});
    return found;
}

/* Returns true for an address that other hosts reach or have. */
static bool is_elsewhere(const net_address *address)
{
    return strncmp(address->host, "127.", 4) != 0 && strcmp(address->host, "::1") != 0 &&
           !address_of_many(address);
}

/* Returns true when the unit keeps a port from other hosts: from that one, or from all. */
static bool is_kept(const networks *n, const net_address *address)
{
    struct in_addr four;
    if (!is_elsewhere(address))
        return false;
    if (address_of_all(address) || inet_pton(AF_INET, address->host, &four) != 1)
        return n->shut;
    return is_dropped(four);
}

/* Returns true for a port that needs a network from which the unit shuts the service off. */
static bool is_port_kept(const networks *n, const cfg_node *node)
{
    tunnelname tunnel;
    const portname name = portname_parse(node->port ? node->port : "");
    if (name.kind == PORTNAME_TCP)
        return is_kept(n, &name.address);
    return name.kind == PORTNAME_TUNNEL && tunnelname_parse(&tunnel, node->port) &&
           is_kept(n, tunnel.has_peer ? &tunnel.peer : &tunnel.listen);
}

/* The same for a server of LCM; one with a name may be anywhere. */
static bool is_server_kept(const networks *n, const cfg_lcm *lcm)
{
    net_address address;
    const char *host = lcm->url + strlen(TCPQ);
    if (!lcm->enabled || strncmp(lcm->url, TCPQ, strlen(TCPQ)) != 0)
        return false;
    return address_parse(&address, host, strlen(host), DISCARD) ? is_kept(n, &address) : n->shut;
}

/* The same for metrics that other hosts are to read. */
static bool are_metrics_kept(const networks *n, const cfg_metrics *metrics)
{
    net_address address;
    return metrics->name && !metrics->path &&
           address_parse(&address, metrics->name, strlen(metrics->name), 0) &&
           is_kept(n, &address);
}

/* One warning names all ports, with the command that allows their hosts. */
static void warn_of_ports(const networks *n, const char *all)
{
    log_warning("%s: the service drops packets from and to other hosts (IPAddressDeny=), unless "
                "you have allowed them: sudo systemctl set-property canwired@%s.service "
                "IPAddressAllow=%s or whatever their network is; see canwired(8)",
                all, unit_instance(), *n->own ? n->own : "192.168.0.0/16");
}

/* Adds a name to a list, after warning of those in it when it is full. */
static void name_port(const networks *n, char list[PORTS_BYTES], const char *name)
{
    if (*list && strlen(list) + strlen(name) + sizeof ", " > PORTS_BYTES) {
        warn_of_ports(n, list);
        *list = '\0';
    }
    (void)chars_print(list, PORTS_BYTES, strlen(list), "%s%s", *list ? ", " : "", name);
}

/* Warns of ports, of LCM and of metrics that need a network from which the unit shuts the service
 * off. */
static void warn_of_hosts(const cfg *config)
{
    char all[PORTS_BYTES] = "";
    const networks n = look_at_networks();
    for (size_t i = 0; i < config->node_count; i++)
        if (is_port_kept(&n, &config->nodes[i]))
            name_port(&n, all, config->nodes[i].port);
    if (is_server_kept(&n, &config->lcm))
        name_port(&n, all, config->lcm.url);
    if (are_metrics_kept(&n, &config->metrics))
        name_port(&n, all, config->metrics.name);
    if (*all)
        warn_of_ports(&n, all);
}

void confined_warn(const cfg *config)
{
    if (!unit_instance())
        return;
    warn_of_files(config);
    warn_of_hosts(config);
}
