/* SPDX-License-Identifier: MIT
 *
 * receive.c - what recvmsg() and its relatives do with CAN sockets.
 */
#include "preload/receive.h"

#include "base/moment.h"
#include "preload/conn.h"
#include "preload/raw.h"
#include "preload/hooks/real.h"
#include "preload/waiting.h"

#include <errno.h>
#include <linux/net_tstamp.h>
#include <stddef.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>

#define BODY_MAX 20000 /* bytes of the longest message of CAN_BCM, 257 CAN FD frames */
#define ADDRESS_TOLD (offsetof(struct sockaddr_can, can_ifindex) + sizeof(int))
#ifndef SO_TIMESTAMP_NEW
#define SO_TIMESTAMP_NEW 63
#define SO_TIMESTAMPNS_NEW 64
#define SO_TIMESTAMPING_NEW 65
#endif

/* A message as it comes, from a port or a relay. */
typedef struct incoming {
    message_head head;
    unsigned char body[BODY_MAX];
} incoming;

/* ---- Data beside a message ------------------------------------------------------------------- */

/* Adds data, as put_cmsg() of the kernel does. *used: bytes before. */
static void receive_put(struct msghdr *out, size_t *used, int type, const void *data, size_t size)
{
    struct cmsghdr head = {.cmsg_level = SOL_SOCKET, .cmsg_type = type};
    const size_t room = out->msg_control ? out->msg_controllen - *used : 0;
    if (room < sizeof head) {
        out->msg_flags |= MSG_CTRUNC;
        return;
    }
    unsigned char *to = (unsigned char *)out->msg_control + *used;
    head.cmsg_len = CMSG_LEN(size);
    if (head.cmsg_len > room) {
        out->msg_flags |= MSG_CTRUNC;
        head.cmsg_len = room;
    }
    memcpy(to, &head, sizeof head);
    memcpy(to + CMSG_LEN(0), data, head.cmsg_len - CMSG_LEN(0));
    *used += CMSG_SPACE(size) < room ? CMSG_SPACE(size) : room;
}

/* Adds the time stamps that the program has asked for, in the form of each option. */
static void put_stamp(struct msghdr *out, size_t *used, const cansock_stamps *stamps, int64_t ns)
{
    const struct timespec time = moment_of(ns);
    const struct timeval old = {.tv_sec = time.tv_sec, .tv_usec = time.tv_nsec / 1000};
    const struct timespec three[3] = {time};
    const bool micro = stamps->option == SO_TIMESTAMP || stamps->option == SO_TIMESTAMP_NEW;
    if (micro)
        receive_put(out, used, stamps->option, &old, sizeof old);
    else if (stamps->option)
        receive_put(out, used, stamps->option, &time, sizeof time);
    if (stamps->timestamping && (stamps->flags & SOF_TIMESTAMPING_SOFTWARE))
        receive_put(out, used, stamps->timestamping, three, sizeof three);
}

/* Adds time and lost frames. The time is kept for SIOCGSTAMP, too. */
static void put_control(cansock *s, struct msghdr *out, const message_head *head)
{
    size_t used = 0;
    s->stamp_ns = (int64_t)head->realtime_ns;
    put_stamp(out, &used, &s->stamps, s->stamp_ns);
    if (s->stamps.overflow && head->lost > 0)
        receive_put(out, &used, SO_RXQ_OVFL, &head->lost, sizeof head->lost);
    out->msg_controllen = used;
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Copies a body. Returns the bytes that had room. */
static size_t scatter(const struct msghdr *out, const unsigned char *body, size_t size)
{
    size_t done = 0;
    for (size_t i = 0; done < size && i < out->msg_iovlen; i++) {
        const size_t room = out->msg_iov[i].iov_len, left = size - done;
        const size_t part = room < left ? room : left;
        if (part > 0)
            memcpy(out->msg_iov[i].iov_base, body + done, part);
        done += part;
    }
    return done;
}

/* Writes the interface as the sender. Of a buffer that is too small a part is filled, as by the
 * kernel. */
static void put_name(const cansock *s, struct msghdr *out, const message_head *head)
{
    struct sockaddr_can name = {.can_family = AF_CAN};
    const socklen_t room = out->msg_namelen;
    if (!out->msg_name)
        return;
    name.can_ifindex = s->direct >= 0 ? ifmap_at(s->direct)->index : (int)head->reserved;
    memcpy(out->msg_name, &name, room < ADDRESS_TOLD ? room : ADDRESS_TOLD);
    out->msg_namelen = ADDRESS_TOLD;
}

/* Gives a message to the program in the form that recvmsg() has. Returns its bytes. */
static ssize_t hand_over(cansock *s, struct msghdr *out, const incoming *in, size_t size)
{
    const size_t body = size - sizeof in->head;
    const size_t done = scatter(out, in->body, body);
    out->msg_flags = done < body ? MSG_TRUNC : 0;
    out->msg_flags |= in->head.flags & MESSAGE_LOCAL ? MSG_DONTROUTE : 0;
    out->msg_flags |= in->head.flags & MESSAGE_OWN ? MSG_CONFIRM : 0;
    put_name(s, out, &in->head);
    put_control(s, out, &in->head);
    return (ssize_t)done; /* CAN sockets do not tell more with MSG_TRUNC */
}

/* Takes the end of a connection: reports it once, as the kernel does when an interface goes down.
 * From then on the socket waits for the bus. */
static void receive_end(cansock *s)
{
    raw_went_down(s, 0, false);
    errno = ENETDOWN;
}

/* Receives a message. Returns its size, or -1 with errno. The kernel reports once that the port has
 * gone with unread messages; its own ones wait behind that report. */
static ssize_t receive_take(cansock *s, int fd, incoming *in, int flags)
{
    const int known = flags & (MSG_PEEK | MSG_DONTWAIT);
    in->head = (message_head){.type = 0};
    ssize_t size = waiting_recv(fd, in, sizeof *in, known);
    if (size < 0 && errno == ECONNRESET)
        size = waiting_recv(fd, in, sizeof *in, known);
    if (size > 0)
        return size;
    if (size == 0 || errno == ECONNRESET)
        receive_end(s);
    else if (errno == ENOTCONN || errno == EINVAL)
        errno = EAGAIN; /* it has not been bound */
    return -1;
}

/* Removes a message that was only looked at. */
static void drop_peeked(int fd, int flags)
{
    message_head head;
    if (flags & MSG_PEEK)
        (void)!real()->recv(fd, &head, sizeof head, MSG_DONTWAIT);
}

static int error_of(const incoming *in)
{
    int code;
    memcpy(&code, in->body, sizeof code);
    return code;
}

ssize_t receive(cansock *s, int fd, struct msghdr *out, int flags)
{
    incoming in;
    if (flags & MSG_ERRQUEUE) {
        errno = EAGAIN; /* there are no time stamps of what was sent */
        return -1;
    }
    for (;;) {
        const ssize_t size = receive_take(s, fd, &in, flags);
        if (size < (ssize_t)sizeof in.head)
            return -1;
        if (in.head.type == MESSAGE_FRAME)
            return hand_over(s, out, &in, (size_t)size);
        drop_peeked(fd, flags);
        if (in.head.type == MESSAGE_FLUSH) /* another thread ends the socket, and waits for it */
            (void)__atomic_add_fetch(&s->flushed, 1, __ATOMIC_RELEASE);
        if (in.head.type == MESSAGE_ERROR && s->direct < 0) { /* of this library, not of a port */
            errno = error_of(&in);
            return -1;
        }
    }
}

ssize_t receive_into(cansock *s, int fd, void *to, size_t size, int flags)
{
    struct iovec part = {.iov_base = to, .iov_len = size};
    struct msghdr out = {.msg_iov = &part, .msg_iovlen = 1};
    return receive(s, fd, &out, flags);
}

int receive_next_size(int fd)
{
    incoming in;
    const ssize_t size = real()->recv(fd, &in, sizeof in, MSG_PEEK | MSG_DONTWAIT);
    return size > (ssize_t)sizeof in.head ? (int)((size_t)size - sizeof in.head) : 0;
}
