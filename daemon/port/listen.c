/* SPDX-License-Identifier: MIT
 *
 * listen.c - a socket that listens at an address of TCP.
 */
#include "port/listen.h"

#include "port/kind.h"

#include <errno.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#define BACKLOG 64

/* Returns true for the broadcast address of a network of this machine: a connection never comes
 * there, although a socket may listen. Only such an address needs SO_BROADCAST. A rule of a
 * firewall gives EACCES with it, too. */
static bool is_broadcast(const struct sockaddr_storage *address, socklen_t size)
{
    const int on = 1;
    const int fd = socket(address->ss_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const bool refused = fd >= 0 && connect(fd, (const struct sockaddr *)address, size) != 0 &&
                         errno == EACCES &&
                         setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &on, sizeof on) == 0 &&
                         connect(fd, (const struct sockaddr *)address, size) == 0;
    if (fd >= 0)
        (void)close(fd);
    return refused;
}

int port_listen_at(const net_address *at)
{
    struct sockaddr_storage address;
    const socklen_t size = address_for_socket(&address, at);
    const int on = 1;
    if (is_broadcast(&address, size)) {
        errno = EADDRNOTAVAIL;
        return -1;
    }
    const int fd = socket(address.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return -1;
    (void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    port_bound_tcp(fd);
    if (address.ss_family == AF_INET6)
        (void)setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on);
    if (bind(fd, (const struct sockaddr *)&address, size) == 0 && listen(fd, BACKLOG) == 0)
        return fd;
    const int error = errno;
    (void)close(fd);
    errno = error;
    return -1;
}
