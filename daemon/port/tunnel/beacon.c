/* SPDX-License-Identifier: MIT
 *
 * beacon.c - tells a local network of a port for programs that speak as to socketcand.
 */
#include "port/tunnel/beacon.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define BEACON_PORT 42000
#define MESSAGE_BYTES (BEACON_BYTES + 512u)
#define HOST_NAME_BYTES 65u

void beacon_begin(beacon *b)
{
    b->bytes = 0;
    b->buses[0] = '\0';
}

void beacon_add(beacon *b, const char *bus)
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

static void send_to(int fd, const beacon *b, struct in_addr from, struct in_addr mask,
                    unsigned number)
{
    char message[MESSAGE_BYTES], host[HOST_NAME_BYTES], address[INET_ADDRSTRLEN];
    struct sockaddr_in to = {.sin_family = AF_INET,
                             .sin_port = htons(BEACON_PORT),
                             .sin_addr.s_addr = from.s_addr | ~mask.s_addr};
    get_host_name(host);
    if (!inet_ntop(AF_INET, &from, address, sizeof address))
        return;
    const int bytes = snprintf(message, sizeof message,
                               "<CANBeacon name=\"%s\" type=\"SocketCAN\" "
                               "description=\"canwire\">\n<URL>can://%s:%u</URL>%s</CANBeacon>",
                               host, address, number, b->buses);
    if (bytes > 0 && (size_t)bytes < sizeof message)
        (void)sendto(fd, message, (size_t)bytes, MSG_DONTWAIT | MSG_NOSIGNAL,
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

void beacon_send(const beacon *b, const char *host, unsigned number)
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
