/* SPDX-License-Identifier: MIT
 *
 * ecu_network.c - a network of its own for a row.
 */
#include "campaign/ecu/ecu_network.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <net/if.h>
#include <net/route.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define MULTICAST 0xE0000000u /* 224.0.0.0/4 */
#define MULTICAST_MASK 0xF0000000u

/* ---- The user -------------------------------------------------------------------------------- */

/* The kernel takes a map only in one write. errno is that of the write. */
static bool ecu_network_write_text(const char *path, const char *text)
{
    const int fd = open(path, O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0)
        return false;
    const bool good = write(fd, text, strlen(text)) == (ssize_t)strlen(text);
    const int error = errno;
    (void)close(fd);
    errno = error;
    return good;
}

/* Keeps user and group what they are. */
static bool map_user(unsigned user, unsigned group)
{
    char users[32], groups[32];
    (void)snprintf(users, sizeof users, "%u %u 1", user, user);
    (void)snprintf(groups, sizeof groups, "%u %u 1", group, group);
    return ecu_network_write_text("/proc/self/setgroups", "deny") &&
           ecu_network_write_text("/proc/self/uid_map", users) &&
           ecu_network_write_text("/proc/self/gid_map", groups);
}

/* ---- The loopback interface ------------------------------------------------------------------ */

static struct sockaddr_in address_of(unsigned address)
{
    return (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(address)};
}

/* Lets multicast, which LCM uses, stay in this network. */
static bool add_multicast(int fd)
{
    static char name[] = "lo";
    const struct sockaddr_in target = address_of(MULTICAST), mask = address_of(MULTICAST_MASK);
    struct rtentry route = {.rt_flags = RTF_UP, .rt_dev = name};
    memcpy(&route.rt_dst, &target, sizeof target);
    memcpy(&route.rt_genmask, &mask, sizeof mask);
    return ioctl(fd, SIOCADDRT, &route) == 0;
}

/* Brings up the loopback of a new network, with multicast, which LCM needs. */
static bool bring_up(void)
{
    struct ifreq lo = {.ifr_name = "lo"};
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return false;
    bool good = ioctl(fd, SIOCGIFFLAGS, &lo) == 0;
    lo.ifr_flags = (short)(lo.ifr_flags | IFF_UP | IFF_MULTICAST);
    good = good && ioctl(fd, SIOCSIFFLAGS, &lo) == 0 && add_multicast(fd);
    const int error = errno;
    (void)close(fd);
    errno = error;
    return good;
}

/* ---- The network ----------------------------------------------------------------------------- */

bool ecu_network_enter(void)
{
    const unsigned user = geteuid(), group = getegid();
    if (unshare(CLONE_NEWNET) == 0)
        return bring_up();
    if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
        return false;
    return map_user(user, group) && bring_up();
}

bool ecu_network_is_possible(void)
{
    int status = 0;
    const pid_t pid = fork();
    if (pid == 0)
        _exit(ecu_network_enter() ? 0 : errno);
    if (pid < 0)
        return false;
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    errno = WIFEXITED(status) ? WEXITSTATUS(status) : EPERM;
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}
