/* SPDX-License-Identifier: MIT
 *
 * confined.c - what a bus asks for that the unit of the service keeps from it, without an error.
 *
 * Files in a private /tmp are made and never found, and packets that IPAddressDeny= drops look like
 * a network that is slow.
 */
#include "serve/start.h"

#include "base/text/chars.h"
#include "base/log.h"
#include "base/unit.h"
#include "config/files.h"
#include "config/node/portname.h"
#include "config/node/tunnelname.h"

#include <arpa/inet.h>
#include <errno.h>
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

/* Returns the errno of a packet to an address of this host, which no network sees. */
static int try_address(const struct sockaddr_in *own)
{
    struct sockaddr_in to = *own;
    to.sin_port = htons(DISCARD);
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return errno;
    ssize_t sent = sendto(fd, "", 0, MSG_NOSIGNAL, (const struct sockaddr *)&to, sizeof to);
    int number = sent < 0 ? errno : 0;
    (void)close(fd);
    return number;
}

static bool is_loopback(const struct sockaddr_in *address)
{
    return ntohl(address->sin_addr.s_addr) >> 24 == IN_LOOPBACKNET;
}

/* Returns true when the addresses of this host in its networks are out of reach. Without any, the
 * unit is taken for what it is by default. */
static bool is_shut_in(void)
{
    struct ifaddrs *all;
    bool open = false;
    if (getifaddrs(&all) != 0)
        return true;
    for (const struct ifaddrs *one = all; one && !open; one = one->ifa_next) {
        const struct sockaddr_in *address = (const void *)one->ifa_addr;
        open = address && address->sin_family == AF_INET && (one->ifa_flags & IFF_UP) &&
               !is_loopback(address) && try_address(address) != EPERM;
    }
    freeifaddrs(all);
    return !open;
}

/* Returns true for an address that other hosts reach or have. */
static bool is_elsewhere(const net_address *address)
{
    return strncmp(address->host, "127.", 4) != 0 && strcmp(address->host, "::1") != 0 &&
           !address_of_many(address);
}

/* Returns true for a port that needs a network beyond this machine. */
static bool wants_hosts(const cfg_node *node)
{
    tunnelname tunnel;
    const portname name = portname_parse(node->port ? node->port : "");
    if (name.kind == PORTNAME_TCP)
        return is_elsewhere(&name.address);
    return name.kind == PORTNAME_TUNNEL && tunnelname_parse(&tunnel, node->port) &&
           is_elsewhere(tunnel.has_peer ? &tunnel.peer : &tunnel.listen);
}

static bool wants_server(const cfg_lcm *lcm)
{
    const char *host = lcm->url + strlen(TCPQ);
    return lcm->enabled && strncmp(lcm->url, TCPQ, strlen(TCPQ)) == 0 &&
           strncmp(host, "127.", 4) != 0 && strncmp(host, "localhost", strlen("localhost")) != 0;
}

/* Returns true for metrics that other hosts are to read. */
static bool serves_hosts(const cfg_metrics *metrics)
{
    net_address address;
    return metrics->name && !metrics->path &&
           address_parse(&address, metrics->name, strlen(metrics->name), 0) &&
           is_elsewhere(&address);
}

/* One warning names all ports, with the command that allows their hosts. */
static void warn_of_ports(const char *all)
{
    log_warning("%s: the service drops packets from and to other hosts (IPAddressDeny=), unless "
                "you have allowed them: sudo systemctl set-property canwired@%s.service "
                "IPAddressAllow=192.168.0.0/16 or whatever their network is; see canwired(8)",
                all, unit_instance());
}

/* Adds a name to a list, after warning of those in it when it is full. */
static void name_port(char list[PORTS_BYTES], const char *name)
{
    if (*list && strlen(list) + strlen(name) + sizeof ", " > PORTS_BYTES) {
        warn_of_ports(list);
        *list = '\0';
    }
    (void)chars_print(list, PORTS_BYTES, strlen(list), "%s%s", *list ? ", " : "", name);
}

/* Warns of ports, and of LCM, that need a network from which the unit shuts the service off. */
static void warn_of_hosts(const cfg *config)
{
    char all[PORTS_BYTES] = "";
    const bool server = config->lcm.enabled && wants_server(&config->lcm);
    const bool metrics = serves_hosts(&config->metrics);
    bool any = server || metrics;
    for (size_t i = 0; i < config->node_count; i++)
        any = any || wants_hosts(&config->nodes[i]);
    if (!any || !is_shut_in())
        return;
    for (size_t i = 0; i < config->node_count; i++)
        if (wants_hosts(&config->nodes[i]))
            name_port(all, config->nodes[i].port);
    if (server)
        name_port(all, config->lcm.url);
    if (metrics)
        name_port(all, config->metrics.name);
    warn_of_ports(all);
}

void confined_warn(const cfg *config)
{
    if (!unit_instance())
        return;
    warn_of_files(config);
    warn_of_hosts(config);
}
