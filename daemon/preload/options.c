/* SPDX-License-Identifier: MIT
 *
 * options.c - getsockopt(), setsockopt() and ioctl() of CAN sockets.
 */
#include "preload/options.h"

#include "base/moment.h"
#include "preload/raw.h"
#include "preload/receive.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/sockios.h>
#include <net/if_arp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/time.h>
#include <time.h>

#ifndef SO_TIMESTAMP_NEW
#define SO_TIMESTAMP_NEW 63
#define SO_TIMESTAMPNS_NEW 64
#define SO_TIMESTAMPING_NEW 65
#endif

static int options_fail(int error)
{
    errno = error;
    return -1;
}

/* ---- SOL_SOCKET ------------------------------------------------------------------------------ */

static bool is_stamp(int name)
{
    return name == SO_TIMESTAMP || name == SO_TIMESTAMPNS || name == SO_TIMESTAMP_NEW ||
           name == SO_TIMESTAMPNS_NEW;
}

static bool is_timestamping(int name)
{
    return name == SO_TIMESTAMPING || name == SO_TIMESTAMPING_NEW;
}

/* Options of time stamps and counters are the library's; others pass to the real socket. */
static int set_of_socket(cansock *s, int name, const void *value, socklen_t size, bool *passes)
{
    int number;
    *passes = !is_stamp(name) && !is_timestamping(name) && name != SO_RXQ_OVFL;
    if (*passes)
        return 0;
    if (size < sizeof number)
        return options_fail(EINVAL);
    memcpy(&number, value, sizeof number);
    if (is_stamp(name))
        s->stamps.option = number ? name : 0;
    else if (name == SO_RXQ_OVFL)
        s->stamps.overflow = number != 0;
    else
        s->stamps.timestamping = number ? name : 0;
    if (is_timestamping(name))
        s->stamps.flags = (unsigned)number;
    return 0;
}

/* Gives an int, or as much of it as there is room for, as the kernel does. */
static int give(void *value, socklen_t *size, int number)
{
    if (*size > sizeof number)
        *size = sizeof number;
    memcpy(value, &number, *size);
    return 0;
}

/* Answers what would show that the socket is not one of CAN. All else passes to the real one. */
static int get_of_socket(const cansock *s, int name, void *value, socklen_t *size, bool *passes)
{
    const bool raw = s->kind == CANSOCK_RAW;
    *passes = false;
    if (name == SO_DOMAIN)
        return give(value, size, AF_CAN);
    if (name == SO_TYPE)
        return give(value, size, raw ? SOCK_RAW : SOCK_DGRAM);
    if (name == SO_PROTOCOL)
        return give(value, size, 0); /* the kernel does not keep it */
    if (name == SO_RXQ_OVFL)
        return give(value, size, s->stamps.overflow);
    if (is_stamp(name))
        return give(value, size, s->stamps.option == name);
    if (is_timestamping(name))
        return give(value, size, s->stamps.timestamping == name ? (int)s->stamps.flags : 0);
    *passes = true;
    return 0;
}

/* ---- SOL_CAN_RAW ----------------------------------------------------------------------------- */

/* Replaces all filters. An empty list lets nothing through, as with the kernel. */
static int set_filters(cansock *s, int fd, const void *value, socklen_t size)
{
    struct can_filter *filters;
    if (size % sizeof *filters != 0 || size > CAN_RAW_FILTER_MAX * sizeof *filters)
        return options_fail(EINVAL);
    filters = malloc(size + 1);
    if (!filters)
        return options_fail(ENOMEM);
    if (size > 0)
        memcpy(filters, value, size);
    table_lock();
    free(s->raw.filters);
    s->raw.filters = filters;
    s->raw.filter_count = (unsigned)(size / sizeof *filters);
    s->raw.filters_set = true;
    table_unlock();
    raw_filters_changed(s, fd);
    return 0;
}

/* Returns the variable of an option that is an int. */
static int *options_number_of(cansock_raw *raw, int name)
{
    switch (name) {
    case CAN_RAW_LOOPBACK:
        return &raw->loopback;
    case CAN_RAW_RECV_OWN_MSGS:
        return &raw->recv_own;
    case CAN_RAW_FD_FRAMES:
        return &raw->fd_frames;
    case CAN_RAW_JOIN_FILTERS:
        return &raw->join;
    default:
        return NULL;
    }
}

/* Sets an option of raw sockets, which the port must then know of. */
static int set_of_raw(cansock *s, int fd, int name, const void *value, socklen_t size)
{
    int *number = options_number_of(&s->raw, name);
    if (name == CAN_RAW_FILTER)
        return set_filters(s, fd, value, size);
    if (!number && name != CAN_RAW_ERR_FILTER)
        return options_fail(ENOPROTOOPT);
    if (size != sizeof *number)
        return options_fail(EINVAL);
    if (number)
        memcpy(number, value, sizeof *number);
    else
        memcpy(&s->raw.error_mask, value, sizeof s->raw.error_mask);
    s->raw.error_mask &= CAN_ERR_MASK;
    raw_options_changed(s, fd);
    return 0;
}

/* Without room it says how much is needed (ERANGE). By default one filter takes all frames. */
static int get_filters(const cansock *s, void *value, socklen_t *size)
{
    static const struct can_filter all = {.can_id = 0};
    const socklen_t needs =
        s->raw.filters_set ? (socklen_t)(s->raw.filter_count * sizeof all) : sizeof all;
    const socklen_t room = *size;
    *size = needs;
    if (room < needs)
        return options_fail(ERANGE);
    if (needs > 0)
        memcpy(value, s->raw.filters_set ? s->raw.filters : &all, needs);
    return 0;
}

/* Returns -1 with ENOPROTOOPT for an option that the kernel does not have. */
static int get_of_raw(const cansock *s, int name, void *value, socklen_t *size)
{
    const int *number = options_number_of((cansock_raw *)(uintptr_t)&s->raw, name);
    if (name == CAN_RAW_FILTER)
        return get_filters(s, value, size);
    if (name == CAN_RAW_ERR_FILTER)
        return give(value, size, (int)s->raw.error_mask);
    return number ? give(value, size, *number) : options_fail(ENOPROTOOPT);
}

/* ---- Both ------------------------------------------------------------------------------------ */

int options_set(cansock *s, int fd, int level, int name, const void *value, socklen_t size,
                bool *passes)
{
    *passes = false;
    if (level == SOL_SOCKET)
        return set_of_socket(s, name, value, size, passes);
    if (level == SOL_CAN_RAW && s->kind == CANSOCK_RAW)
        return set_of_raw(s, fd, name, value, size);
    return options_fail(s->kind == CANSOCK_RAW ? EINVAL : ENOPROTOOPT); /* as raw_setsockopt() */
}

int options_get(const cansock *s, int level, int name, void *value, socklen_t *size, bool *passes)
{
    *passes = false;
    if (level == SOL_SOCKET)
        return get_of_socket(s, name, value, size, passes);
    if (level == SOL_CAN_RAW && s->kind == CANSOCK_RAW)
        return get_of_raw(s, name, value, size);
    return options_fail(s->kind == CANSOCK_RAW ? EINVAL : ENOPROTOOPT);
}

/* ---- What programs ask about interfaces ------------------------------------------------------ */

#define QUEUE_LENGTH 1000
#ifndef SIOCGSTAMP_NEW
#define SIOCGSTAMP_NEW _IOR(0x89, 0x06, long long[2])
#define SIOCGSTAMPNS_NEW _IOR(0x89, 0x07, long long[2])
#endif
#define STAMP_OLD 0x8906
#define STAMPNS_OLD 0x8907

/* Fills in the answer to a request by name. Returns false for another request. */
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
