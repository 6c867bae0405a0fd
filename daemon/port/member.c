/* SPDX-License-Identifier: MIT
 *
 * member.c - one of several programs at a port: what its protocols have in common.
 */
#include "port/member.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

bool member_open(member *c, const member_kind *kind, int fd, uint32_t id)
{
    *c = (member){.state = MEMBER_NEW, .kind = kind, .fd = fd, .id = id};
    c->pid = port_peer_of(fd);
    if (!kind->open || kind->open(c))
        return true;
    *c = (member){.state = MEMBER_NONE, .fd = -1};
    return false;
}

void member_close(member *c)
{
    if (c->state == MEMBER_NONE)
        return;
    if (c->kind->close)
        c->kind->close(c);
    (void)close(c->fd);
    free(c->filters);
    *c = (member){.state = MEMBER_NONE, .fd = -1};
}

/* ---- To the client --------------------------------------------------------------------------- */

bool member_send(member *c, const message_head *head, const void *frame, size_t size)
{
    const bool sent = c->kind->send(c, head, frame, size);
    c->written += sent;
    return sent;
}

void member_welcome(member *c, const char *node, bool fd)
{
    c->state = MEMBER_THERE;
    c->kind->welcome(c, node, fd);
}

void member_tell(member *c, const message_head *head, int code, const char *text)
{
    c->kind->tell(c, head, code, text);
}

void member_flushed(member *c, const message_head *head)
{
    c->flushing = false;
    c->kind->flushed(c, head);
}

void member_tell_state(member *c, const message_head *head, const message_state *state)
{
    c->kind->tell_state(c, head, state);
}

void member_refuse(member *c, unsigned type, int code, const char *text)
{
    const message_head head = {.type = MESSAGE_ERROR, .number = type};
    member_tell(c, &head, code, text);
}

bool member_takes(const member *c, const void *frame, size_t size)
{
    return c->state == MEMBER_THERE && c->kind->takes(c, frame, size);
}

/* ---- From the client ------------------------------------------------------------------------- */

/* Returns the time stamp beside a message, 0 without. */
static int64_t stamp_of(struct msghdr *header)
{
    struct timespec time;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(header); c; c = CMSG_NXTHDR(header, c)) {
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS)
            continue;
        memcpy(&time, CMSG_DATA(c), sizeof time);
        return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
    }
    return 0;
}

/* The kernel reports once that the client has gone with unread messages. Its own ones wait behind
 * that report. */
ssize_t member_receive(const member *c, void *bytes, size_t room, int flags, int64_t *stamp_ns,
                       bool *cut)
{
    _Alignas(struct cmsghdr) unsigned char control[PORT_STAMP_BYTES];
    struct iovec part = {.iov_base = bytes, .iov_len = room};
    struct msghdr header = {.msg_iov = &part,
                            .msg_iovlen = 1,
                            .msg_control = control,
                            .msg_controllen = sizeof control};
    ssize_t size = recvmsg(c->fd, &header, flags | MSG_DONTWAIT);
    if (size < 0 && errno == ECONNRESET)
        size = recvmsg(c->fd, &header, flags | MSG_DONTWAIT);
    *stamp_ns = size >= 0 ? stamp_of(&header) : 0;
    *cut = size >= 0 && (header.msg_flags & MSG_TRUNC);
    return size;
}

bool member_has_gone(const member *c)
{
    struct pollfd one = {.fd = c->fd, .events = POLLRDHUP};
    return poll(&one, 1, 0) == 1;
}

bool member_waits(const member *c)
{
    char first;
    return recv(c->fd, &first, sizeof first, MSG_PEEK | MSG_DONTWAIT) > 0;
}

int64_t member_next_ns(member *c)
{
    bool cut;
    char first;
    if (!c->peeked) {
        ssize_t size = member_receive(c, &first, sizeof first, MSG_PEEK, &c->next_ns, &cut);
        if (size < 0)
            return INT64_MAX;
        c->peeked = true;
    }
    return c->next_ns;
}

member_result member_read(member *c, port *p, port_frame *out)
{
    c->peeked = false;
    return c->kind->read(c, p, out);
}
