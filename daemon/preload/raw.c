/* SPDX-License-Identifier: MIT
 *
 * raw.c - sockets of CAN_RAW: binding, sending, and their end.
 */
#include "preload/raw.h"

#include "preload/hooks/real.h"
#include "preload/relay.h"
#include "preload/wants.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <unistd.h>

#define ADDRESS_MIN (offsetof(struct sockaddr_can, can_ifindex) + sizeof(int))

int raw_index_of(int *index, const struct sockaddr *address, socklen_t size)
{
    const struct sockaddr_can *can = (const struct sockaddr_can *)address;
    if (size < ADDRESS_MIN || address->sa_family != AF_CAN)
        return EINVAL;
    *index = can->can_ifindex;
    return 0;
}

/* ---- Several connections --------------------------------------------------------------------- */

static void raw_pass_on(cansock *s, int number, message *m, size_t size)
{
    m->head.reserved = (uint32_t)ifmap_at(number)->index;
    relay_put(s, &m->head, &m->frame, size - sizeof m->head);
}

static conn_wants copy_wants(const cansock *s, int number)
{
    const conn_wants all = wants_all(s);
    (void)number;
    return wants_copy(&all);
}

static const relay_user relayed = {.frame = raw_pass_on, .wants = copy_wants};

/* ---- Binding --------------------------------------------------------------------------------- */

/* Puts a new socket without connection under the descriptors: a port has refused the old one. */
static void renew(cansock *s)
{
    const int fd = conn_socket(SOCK_CLOEXEC);
    table_lock();
    if (fd >= 0)
        table_replace(s, fd);
    table_unlock();
}

/* Connects the socket itself, so that what waits for it already goes on. A guest whose name is
 * taken needs another socket. */
static int bind_directly(cansock *s, int fd, const iface *in)
{
    const conn_wants wants = wants_all(s);
    int error = s->bound ? EEXIST : conn_start(fd, in, &wants, 1);
    if (error == EEXIST && (in->guest || s->bound)) {
        const int other = conn_open(in, &wants);
        error = other >= 0 ? 0 : errno;
        table_lock();
        if (other >= 0)
            table_replace(s, other);
        table_unlock();
    }
    if (error == 0)
        s->direct = ifmap_number(in);
    else if (!s->bound)
        renew(s);
    return error;
}

/* Connects to all interfaces. Those whose bus is not there are tried until it is; one must be. */
static int bind_to_all(cansock *s)
{
    const conn_wants wants = wants_all(s);
    int fds[IFMAP_MAX];
    int there = 0, error = ENODEV;
    for (int i = 0; i < ifmap_count(); i++) {
        fds[i] = table_hide(conn_open(ifmap_at(i), &wants));
        error = fds[i] < 0 ? errno : error;
        there += fds[i] >= 0;
    }
    if (there == 0)
        return error;
    table_lock();
    error = relay_make(s, &relayed);
    for (int i = 0; i < ifmap_count(); i++)
        if (error == 0)
            relay_attach(s, i, fds[i]);
        else
            table_close_hidden(fds[i]);
    table_unlock();
    return error;
}

/* Closes the connections of an earlier binding. */
static void unbind(cansock *s)
{
    table_lock();
    relay_free(s);
    for (int i = 0; i < IFMAP_MAX; i++) {
        table_close_hidden(s->side[i]);
        s->side[i] = -1;
        s->sent[i] = 0;
    }
    s->direct = -1;
    table_unlock();
}

int raw_bind(cansock *s, int fd, const struct sockaddr *address, socklen_t size)
{
    int index = 0;
    int error = raw_index_of(&index, address, size);
    if (error)
        return error;
    if (s->bound && s->index == index)
        return 0;
    const iface *in = ifmap_of_index(index);
    if (index != 0 && !in)
        return ENODEV;
    if (ifmap_count() == 0)
        return ENODEV;
    if (s->bound)
        unbind(s);
    const bool one = in || ifmap_count() == 1;
    error = one ? bind_directly(s, fd, in ? in : ifmap_at(0)) : bind_to_all(s);
    if (error)
        return error;
    s->index = index;
    s->bound = true;
    return 0;
}

/* ---- The bus goes ---------------------------------------------------------------------------- */

void raw_went_down(cansock *s, int index, bool fail)
{
    table_lock();
    if (s->direct >= 0 && (index == 0 || ifmap_number(ifmap_of_index(index)) == s->direct)) {
        const int number = s->direct;
        s->sent[number] = 0;
        if (relay_make(s, &relayed) == 0) {
            relay_attach(s, number, -1);
            if (fail)
                relay_fail(s, ENETDOWN);
        }
    }
    table_unlock();
}

/* ---- Sending --------------------------------------------------------------------------------- */

/* Returns a connection to another interface than the one whose connection the socket is, or -1 with
 * errno. The caller releases it: another thread may find its end and close it. */
static int side_of(cansock *s, const iface *in)
{
    const int number = ifmap_number(in);
    table_lock();
    const bool receives = s->relay && s->bound && (s->index == 0 || s->index == in->index);
    int fd = table_hold(s->side[number]);
    table_unlock();
    if (fd >= 0)
        return fd;
    if (receives) {
        errno = ENETDOWN; /* it will come back */
        return -1;
    }
    const conn_wants wants = wants_sending(s);
    fd = table_hide(conn_open(in, &wants));
    table_lock();
    if (s->side[number] >= 0) { /* another thread has made one */
        table_close_hidden(fd);
        fd = s->side[number];
    }
    s->side[number] = table_hold(fd);
    table_unlock();
    return fd;
}

/* Gives up a connection that has ended, unless another thread has done so. */
static void lose_side(cansock *s, const iface *in, int fd)
{
    const int number = ifmap_number(in);
    table_lock();
    if (s->side[number] != fd) {
        table_unlock();
        return;
    }
    if (s->relay && s->bound && (s->index == 0 || s->index == in->index)) {
        relay_lose(s, number);
    } else {
        table_close_hidden(s->side[number]);
        s->side[number] = -1;
    }
    table_unlock();
}

static void release(int fd)
{
    table_lock();
    table_release(fd);
    table_unlock();
}

/* Counts a frame that is about to be sent, so that whoever ends the socket meanwhile waits for it.
 * Returns true when the socket itself is the connection to that interface. */
static bool begin_frame(cansock *s, int number)
{
    table_lock();
    const bool direct = s->direct == number;
    s->sent[number]++;
    table_unlock();
    return direct;
}

/* Returns true while the socket is the connection that a frame has gone to. When another thread has
 * found its end, the frame may have gone to what replaces it, and is lost in any case. */
static bool is_still_direct(const cansock *s, int number)
{
    table_lock();
    const bool direct = s->direct == number;
    table_unlock();
    return direct;
}

/* Refuses what the kernel's raw_sendmsg() and can_send() refuse. */
static int check(const cansock *s, const iface *in, const struct canfd_frame *frame, size_t size)
{
    const bool fd = s->raw.fd_frames && in->mtu == CANFD_MTU && size == CANFD_MTU;
    if (size != CAN_MTU && !fd)
        return EINVAL;
    return frame->len > (fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN) ? EINVAL : 0;
}

int raw_send(cansock *s, int fd, const void *frame, size_t size, int index, int flags)
{
    const iface *in = ifmap_of_index(index);
    if (!in)
        return ENXIO;
    int error = check(s, in, frame, size);
    if (error)
        return error;
    const int number = ifmap_number(in);
    const bool direct = begin_frame(s, number);
    const int to = direct ? fd : side_of(s, in);
    if (to < 0)
        return errno;
    if (!direct && (real()->fcntl(fd, F_GETFL) & O_NONBLOCK))
        flags |= MSG_DONTWAIT;
    error = conn_send(to, frame, size, flags);
    if (error == 0 && direct && !is_still_direct(s, number))
        return ENETDOWN;
    if (error == ENETDOWN && direct)
        raw_went_down(s, index, true);
    else if (error == ENETDOWN)
        lose_side(s, in, to);
    if (!direct)
        release(to);
    return error;
}

/* ---- Options --------------------------------------------------------------------------------- */

/* Calls for each connection: the ones that receive, and those that only send. */
static void for_each(cansock *s, int fd, void (*call)(int fd, const conn_wants *wants),
                     bool sending, bool receiving)
{
    const conn_wants all = wants_all(s), only = wants_sending(s);
    if (!s->bound)
        return;
    if (s->direct >= 0 && receiving)
        call(fd, &all);
    for (int i = 0; i < ifmap_count(); i++) {
        const bool receives = s->relay && (s->index == 0 || s->index == ifmap_at(i)->index);
        table_lock();
        const int side = table_hold(s->side[i]);
        table_unlock();
        if (side >= 0 && (receives ? receiving : sending))
            call(side, receives ? &all : &only);
        release(side);
    }
}

void raw_options_changed(cansock *s, int fd)
{
    for_each(s, fd, conn_set_options, true, true);
}

void raw_filters_changed(cansock *s, int fd)
{
    for_each(s, fd, conn_set_filters, false, true);
}

/* ---- The end --------------------------------------------------------------------------------- */

/* Returns the connection of frames that may be lost, which the caller releases, or -1. */
static int hold_unsent(cansock *s, int fd, int number)
{
    int held = -1;
    table_lock();
    if (ifmap_at(number)->guest && s->sent[number] > 0)
        held = s->direct == number ? fd : table_hold(s->side[number]);
    s->sent[number] = 0;
    table_unlock();
    return held;
}

void raw_flush(cansock *s, int fd)
{
    if (s->shared)
        return;
    table_lock();
    relay_stop(s); /* it would read the answers */
    table_unlock();
    for (int i = 0; i < ifmap_count(); i++) {
        const int held = hold_unsent(s, fd, i);
        if (held < 0)
            continue;
        conn_flush(held, &s->flushed);
        if (held != fd)
            release(held);
    }
}
