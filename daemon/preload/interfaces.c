/* SPDX-License-Identifier: MIT
 *
 * interfaces.c - what programs ask the kernel about interfaces.
 */
#include "preload/interfaces.h"

#include "base/moment.h"
#include "preload/receive.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/sockios.h>
#include <net/if_arp.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/time.h>
#include <time.h>

#define QUEUE_LENGTH 1000
#ifndef SIOCGSTAMP_NEW
#define SIOCGSTAMP_NEW _IOR(0x89, 0x06, long long[2])
#define SIOCGSTAMPNS_NEW _IOR(0x89, 0x07, long long[2])
#endif
#define STAMP_OLD 0x8906
#define STAMPNS_OLD 0x8907

/* Fills in the answer to a request by name. Returns false for a request that is none. */
static bool interfaces_answer(struct ifreq *r, unsigned long request, const iface *in)
{
    switch (request) {
    case SIOCGIFINDEX:
        r->ifr_ifindex = in->index;
        return true;
    case SIOCGIFMTU:
        r->ifr_mtu = in->mtu;
        return true;
    case SIOCGIFFLAGS:
        r->ifr_flags = IFF_UP | IFF_RUNNING | IFF_NOARP;
        return true;
    case SIOCGIFTXQLEN:
        r->ifr_qlen = QUEUE_LENGTH;
        return true;
    case SIOCGIFHWADDR:
        memset(&r->ifr_hwaddr, 0, sizeof r->ifr_hwaddr);
        r->ifr_hwaddr.sa_family = ARPHRD_CAN;
        return true;
    default:
        return false;
    }
}

bool interfaces_ioctl(unsigned long request, void *argument, int *result)
{
    struct ifreq *r = argument;
    const bool by_index = request == SIOCGIFNAME;
    const bool asks = by_index || request == SIOCGIFINDEX || request == SIOCGIFMTU ||
                      request == SIOCGIFFLAGS || request == SIOCGIFTXQLEN ||
                      request == SIOCGIFHWADDR;
    if (!asks || !r)
        return false;
    const iface *in = by_index ? ifmap_of_index(r->ifr_ifindex) : ifmap_of_name(r->ifr_name);
    if (!in)
        return false;
    *result = 0;
    if (!by_index)
        return interfaces_answer(r, request, in);
    memcpy(r->ifr_name, in->names[0], sizeof r->ifr_name);
    return true;
}

/* Tells when the last message was received. */
static int tell_stamp(const cansock *s, void *out, bool nano)
{
    const struct timespec time = moment_of(s->stamp_ns);
    const struct timeval old = {.tv_sec = time.tv_sec, .tv_usec = time.tv_nsec / 1000};
    if (s->stamp_ns == 0) {
        errno = ENOENT;
        return -1;
    }
    if (nano)
        memcpy(out, &time, sizeof time);
    else
        memcpy(out, &old, sizeof old);
    return 0;
}

bool interfaces_socket_ioctl(cansock *s, int fd, unsigned long request, void *argument,
                             int *result)
{
    *result = 0;
    if (request == STAMP_OLD || request == SIOCGSTAMP_NEW)
        *result = tell_stamp(s, argument, false);
    else if (request == STAMPNS_OLD || request == SIOCGSTAMPNS_NEW)
        *result = tell_stamp(s, argument, true);
    else if (request == FIONREAD)
        *(int *)argument = receive_next_size(fd);
    else
        return false;
    return true;
}
