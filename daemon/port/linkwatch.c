/* SPDX-License-Identifier: MIT
 *
 * linkwatch.c - reports changes of network interfaces, through rtnetlink.
 */
#include "port/linkwatch.h"

#include "base/log.h"

#include <errno.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <stdalign.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define MESSAGE_BYTES 32768u /* limit of the kernel for a piece of a list */
#define READS_MAX 64u        /* at one wake-up */
#define UP_FLAGS ((unsigned)IFF_UP | 0x10000u) /* IFF_LOWER_UP, which net/if.h does not have */

struct linkwatch {
    ev_io io;
    struct ev_loop *loop;
    const linkwatch_calls *calls;
    void *user;
    int fd;
    bool listing;    /* a list is being read */
    bool incomplete; /* ... and is incomplete, so that another one must follow */
    bool failing;    /* the last list failed, which has been logged */
    alignas(struct nlmsghdr) char buffer[MESSAGE_BYTES];
};

/* ---- Asking ---------------------------------------------------------------------------------- */

/* Gives a list up, whose owner asks for another one later. The log says it once, until a list
 * succeeds. */
static void linkwatch_fail(linkwatch *w, int number)
{
    if (!w->failing)
        log_warning("interfaces cannot be listed: %s; trying again", strerror(number));
    w->failing = true;
    w->listing = false;
    w->incomplete = false;
    w->calls->failed(w->user);
}

void linkwatch_list(linkwatch *w)
{
    struct {
        struct nlmsghdr header;
        struct ifinfomsg info;
    } request = {
        .header = {.nlmsg_len = sizeof request,
                   .nlmsg_type = RTM_GETLINK,
                   .nlmsg_flags = NLM_F_REQUEST | NLM_F_DUMP},
        .info = {.ifi_family = AF_UNSPEC},
    };
    ev_io_start(w->loop, &w->io); /* libev may have stopped it */
    w->incomplete = w->listing;
    if (w->listing) /* the kernel makes one list at a time */
        return;
    w->listing = send(w->fd, &request, sizeof request, 0) >= 0;
    if (w->listing)
        w->calls->listing(w->user);
    else
        linkwatch_fail(w, errno);
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Returns the first attribute of a type between two places, or NULL. */
static const struct rtattr *linkwatch_find(unsigned short type, const char *attribute,
                                           const char *end)
{
    while (end - attribute >= (ptrdiff_t)sizeof(struct rtattr)) {
        const struct rtattr *a = (const struct rtattr *)attribute;
        if (a->rta_len < sizeof *a || a->rta_len > end - attribute)
            return NULL;
        if ((a->rta_type & NLA_TYPE_MASK) == type)
            return a;
        attribute += RTA_ALIGN(a->rta_len);
    }
    return NULL;
}

static const struct rtattr *find_in(unsigned short type, const struct nlmsghdr *header)
{
    const struct ifinfomsg *info = NLMSG_DATA(header);
    return linkwatch_find(type, (const char *)info + NLMSG_ALIGN(sizeof *info),
                          (const char *)header + header->nlmsg_len);
}

/* Returns a text with its final 0, or "". */
static const char *linkwatch_text_of(const struct rtattr *a)
{
    bool text = a && RTA_PAYLOAD(a) > 0 && memchr(RTA_DATA(a), '\0', RTA_PAYLOAD(a));
    return text ? RTA_DATA(a) : "";
}

/* Returns the kind of an interface, "" for one that has none. */
static const char *kind_of(const struct nlmsghdr *header)
{
    const struct rtattr *info = find_in(IFLA_LINKINFO, header);
    if (!info)
        return "";
    return linkwatch_text_of(
        linkwatch_find(IFLA_INFO_KIND, RTA_DATA(info), (const char *)info + info->rta_len));
}

/* Passes an interface on that has come, changed or gone. */
static void take_link(linkwatch *w, const struct nlmsghdr *header)
{
    const struct ifinfomsg *info = NLMSG_DATA(header);
    if (info->ifi_family != AF_UNSPEC || info->ifi_index <= 0) /* bridges report ports, too */
        return;
    const char *name = linkwatch_text_of(find_in(IFLA_IFNAME, header));
    if (header->nlmsg_type == RTM_DELLINK)
        w->calls->gone(w->user, (unsigned)info->ifi_index);
    else if (*name)
        w->calls->seen(w->user, (unsigned)info->ifi_index, name, kind_of(header),
                       (info->ifi_flags & UP_FLAGS) == UP_FLAGS);
}

/* Returns the error of NLMSG_DONE or NLMSG_ERROR: 0, or a negative number. */
static int error_of(const struct nlmsghdr *header)
{
    int error = 0;
    if (header->nlmsg_len >= NLMSG_LENGTH(sizeof error))
        memcpy(&error, NLMSG_DATA(header), sizeof error);
    return error;
}

/* Takes the end of a list or the refusal of one. If links have changed meanwhile, the
 * list may lack some, and is asked for again. */
static void take_end(linkwatch *w, const struct nlmsghdr *header)
{
    int error = error_of(header);
    if (!w->listing) /* the list has failed before */
        return;
    if (error < 0) {
        linkwatch_fail(w, -error);
        return;
    }
    w->listing = false;
    w->failing = false;
    if (w->incomplete)
        linkwatch_list(w);
    else
        w->calls->listed(w->user);
}

/* Takes all messages of one read. The kernel never divides one. */
static void take_messages(linkwatch *w, size_t size)
{
    unsigned left = (unsigned)size;
    for (struct nlmsghdr *h = (struct nlmsghdr *)w->buffer; NLMSG_OK(h, left);
         h = NLMSG_NEXT(h, left)) {
        if (h->nlmsg_flags & NLM_F_DUMP_INTR) /* links have changed while the list was made */
            w->incomplete = true;
        if (h->nlmsg_type == NLMSG_DONE || h->nlmsg_type == NLMSG_ERROR)
            take_end(w, h);
        else if (h->nlmsg_type == RTM_NEWLINK || h->nlmsg_type == RTM_DELLINK)
            take_link(w, h);
    }
}

/* Reads what the kernel says of interfaces, a limited number of messages at a time. Other processes
 * can send to this socket; their messages are left out. */
static void on_message(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    linkwatch *w = io->data;
    if (events & EV_ERROR) { /* libev has stopped it, since the kernel does not accept it */
        linkwatch_fail(w, ENOMEM);
        return;
    }
    for (unsigned reads = 0; reads < READS_MAX; reads++) {
        struct sockaddr_nl from = {.nl_family = AF_NETLINK};
        struct iovec vector = {.iov_base = w->buffer, .iov_len = sizeof w->buffer};
        struct msghdr message = {.msg_name = &from, .msg_namelen = sizeof from,
                                 .msg_iov = &vector, .msg_iovlen = 1};
        ssize_t size = recvmsg(w->fd, &message, MSG_DONTWAIT);
        if (size < 0 && errno == ENOBUFS) { /* the kernel had no room for some messages */
            log_warning("messages about interfaces were lost, all are listed anew");
            linkwatch_list(w);
        } else if (size < 0 && errno != EINTR) {
            return;
        } else if (size > 0 && from.nl_pid == 0) { /* from the kernel */
            take_messages(w, (size_t)size);
        }
    }
}

/* ---- Start and stop -------------------------------------------------------------------------- */

linkwatch *linkwatch_start(struct ev_loop *loop, const linkwatch_calls *calls, void *user)
{
    struct sockaddr_nl address = {.nl_family = AF_NETLINK, .nl_groups = RTMGRP_LINK};
    linkwatch *w = calloc(1, sizeof *w);
    if (!w) {
        log_error("out of memory");
        return NULL;
    }
    w->loop = loop;
    w->calls = calls;
    w->user = user;
    w->fd = socket(AF_NETLINK, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (w->fd < 0 || bind(w->fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        log_error("interfaces cannot be watched: rtnetlink: %s", strerror(errno));
        linkwatch_stop(w);
        return NULL;
    }
    ev_io_init(&w->io, on_message, w->fd, EV_READ);
    w->io.data = w;
    linkwatch_list(w);
    return w;
}

void linkwatch_stop(linkwatch *w)
{
    if (!w)
        return;
    ev_io_stop(w->loop, &w->io);
    if (w->fd >= 0)
        (void)close(w->fd);
    free(w);
}
