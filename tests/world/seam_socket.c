/* SPDX-License-Identifier: MIT
 *
 * seam_socket.c - sockets: Unix ones are the kernel's own, with what the world adds: delays, short
 * reads, refusals, other users, time stamps of its clock. rtnetlink is one that knows no interface:
 * ports on interfaces are tested with a real kernel (tests/kernel).
 */
#include "seam.h"

#include <errno.h>
#include <linux/rtnetlink.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

/* ---- Addresses ------------------------------------------------------------------------------- */

typedef struct own_address {
    struct sockaddr_un un;
    const struct sockaddr *address;
    socklen_t size;
} own_address;

/* Converts an address. A path below WORLD_ROOT is one in the folder of the world. A name in the
 * abstract namespace, which all programs share, gets the folder as a prefix. */
static void to_own(own_address *own, const struct sockaddr *address, socklen_t size)
{
    const struct sockaddr_un *un = (const struct sockaddr_un *)address;
    *own = (own_address){.address = address, .size = size};
    if (!world_inside || address->sa_family != AF_UNIX || size <= sizeof(sa_family_t) ||
        un->sun_path[0] == '\0')
        return;
    own->un.sun_family = AF_UNIX;
    (void)snprintf(own->un.sun_path, sizeof own->un.sun_path, "%s", seam_path(un->sun_path));
    own->address = (const struct sockaddr *)&own->un;
    own->size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + strlen(own->un.sun_path) + 1);
}

/* ---- rtnetlink ------------------------------------------------------------------------------- */

static int open_netlink(void)
{
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) != 0)
        abort();
    (void)seam_new_fd(ends[0], FD_NETLINK);
    seam_fd_of(ends[0])->other_end = ends[1];
    return ends[0];
}

/* Answers any request with the end of a list. */
static void answer_netlink(const seam_fd *f)
{
    struct {
        struct nlmsghdr header;
        int error;
    } done = {.header = {.nlmsg_len = NLMSG_LENGTH(sizeof(int)), .nlmsg_type = NLMSG_DONE}};
    (void)send(f->other_end, &done, sizeof done, MSG_NOSIGNAL);
    world_wake(world_me()->life, WAIT_FD, NULL, false);
}

/* ---- Making and connecting ------------------------------------------------------------------- */

SEAM(int, socket, int domain, int type, int protocol)
{
    if (!world_inside)
        return socket(domain, type, protocol);
    world_enter("socket");
    if (seam_refuses(world->refuse_permille / 4, EMFILE, "socket"))
        return -1;
    if (domain == AF_NETLINK)
        return open_netlink();
    int fd = seam_new_fd(socket(domain, type, protocol), FD_OTHER);
    world_trace("socket(%d, %#x) = %d", domain, (unsigned)type, fd);
    return fd;
}

static void note_place(const char *path)
{
    world_place *p = seam_place_of(path);
    if (!p && world->place_count < PLACES_MAX)
        p = &world->places[world->place_count++];
    if (!p)
        return;
    (void)snprintf(p->path, sizeof p->path, "%s", path);
    p->life = world_me()->life;
}

SEAM(int, bind, int fd, const struct sockaddr *address, socklen_t size)
{
    own_address own;
    to_own(&own, address, size);
    if (!world_inside)
        return bind(fd, address, size);
    world_enter("bind");
    if (seam_fd_of(fd)->kind == FD_NETLINK)
        return 0;
    int result = bind(fd, own.address, own.size);
    int number = errno;
    if (result == 0)
        note_place(own.un.sun_path);
    world_trace("bind(%d, %s) = %d %s", fd, own.un.sun_path, result,
                result ? strerrorname_np(number) : "");
    errno = number;
    return result;
}

SEAM(int, connect, int fd, const struct sockaddr *address, socklen_t size)
{
    own_address own;
    to_own(&own, address, size);
    if (!world_inside)
        return connect(fd, address, size);
    world_enter("connect");
    int result = connect(fd, own.address, own.size);
    int number = errno;
    world_trace("connect(%d, %s) = %d %s", fd, own.un.sun_path, result,
                result ? strerrorname_np(number) : "");
    errno = number;
    return result;
}

SEAM(int, listen, int fd, int backlog)
{
    if (!world_inside)
        return listen(fd, backlog);
    world_enter("listen");
    int result = listen(fd, backlog);
    world_trace("listen(%d) = %d", fd, result);
    return result;
}

/* Clients of the world have a socket with a name, c/NUMBER. */
static int connection_of(const struct sockaddr_un *peer, socklen_t size)
{
    int number = -1;
    if (size > offsetof(struct sockaddr_un, sun_path) + 2 && peer->sun_path[0] == 'c' &&
        peer->sun_path[1] == '/')
        number = atoi(peer->sun_path + 2);
    return number >= 0 && number < (int)CONNECTIONS_MAX ? number : -1;
}

SEAM(int, accept4, int fd, struct sockaddr *address, socklen_t *size, int flags)
{
    struct sockaddr_un peer = {.sun_family = AF_UNIX};
    socklen_t peer_size = sizeof peer;
    if (!world_inside)
        return accept4(fd, address, size, flags);
    world_enter("accept4");
    if (seam_refuses(world->refuse_permille, world_chance(500) ? EMFILE : ENOBUFS, "accept4") ||
        seam_refuses(world->interrupt_permille, EINTR, "accept4"))
        return -1;
    int client = accept4(fd, (struct sockaddr *)&peer, &peer_size, flags);
    int number = errno;
    if (client >= 0) {
        (void)seam_new_fd(client, FD_CONNECTION);
        seam_fd_of(client)->connection = connection_of(&peer, peer_size);
        world_trace("accept4(%d) = %d, connection %d", fd, client, seam_fd_of(client)->connection);
    }
    if (address && size) { /* the name is this world's own: the program has none */
        memset(address, 0, *size);
        address->sa_family = AF_UNIX;
        *size = sizeof address->sa_family;
    }
    errno = number;
    return client;
}

/* ---- Sending --------------------------------------------------------------------------------- */

static ssize_t count_sent(int fd, const void *bytes, size_t size, ssize_t count)
{
    int number = errno;
    world_trace("send(%d, %zu bytes %08llx) = %zd %s", fd, size,
                (unsigned long long)(world_hash(bytes, size) & 0xffffffff), count,
                count < 0 ? strerrorname_np(number) : "");
    errno = number;
    return count;
}

static bool is_stream(int fd)
{
    int type = 0;
    socklen_t size = sizeof type;
    return getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_STREAM;
}

SEAM(ssize_t, send, int fd, const void *bytes, size_t size, int flags)
{
    const seam_fd *f = seam_fd_of(fd);
    if (!world_inside)
        return send(fd, bytes, size, flags);
    world_enter("send");
    if (f->kind == FD_NETLINK) {
        answer_netlink(f);
        return (ssize_t)size;
    }
    if (seam_refuses(world->refuse_permille, ENOBUFS, "send") ||
        seam_refuses(world->interrupt_permille, EINTR, "send"))
        return -1;
    if (size > 1 && world_chance(world->interrupt_permille) && is_stream(fd))
        size = 1 + world_draw(size - 1);
    return count_sent(fd, bytes, size, send(fd, bytes, size, flags));
}

SEAM(int, sendmmsg, int fd, struct mmsghdr *messages, unsigned count, int flags)
{
    if (!world_inside)
        return sendmmsg(fd, messages, count, flags);
    world_enter("sendmmsg");
    if (seam_refuses(world->refuse_permille, ENOBUFS, "sendmmsg") ||
        seam_refuses(world->interrupt_permille, EINTR, "sendmmsg"))
        return -1;
    if (world_chance(world->interrupt_permille * 4))
        count = 1 + (unsigned)world_draw(count);
    int sent = sendmmsg(fd, messages, count, flags);
    int number = errno;
    for (int i = 0; i < sent; i++)
        (void)count_sent(fd, messages[i].msg_hdr.msg_iov->iov_base, messages[i].msg_len,
                         messages[i].msg_len);
    world_trace("sendmmsg(%d, %u) = %d", fd, count, sent);
    errno = number;
    return sent;
}

/* Notes messages to the service manager, which count from now on. */
static void note_state(const char *text, size_t size)
{
    static const char ready[] = "READY=1", stopping[] = "STOPPING=1";
    world_life *life = world_my_life();
    if (size == strlen(ready) && memcmp(text, ready, size) == 0)
        life->started_up = true;
    if (size == strlen(stopping) && memcmp(text, stopping, size) == 0)
        life->stopping = true;
}

SEAM(ssize_t, sendto, int fd, const void *bytes, size_t size, int flags,
     const struct sockaddr *address, socklen_t address_size)
{
    own_address own;
    if (!world_inside || !address)
        return sendto(fd, bytes, size, flags, address, address_size);
    world_enter("sendto");
    if (seam_refuses(world->refuse_permille, EAGAIN, "sendto"))
        return -1;
    to_own(&own, address, address_size);
    ssize_t sent = sendto(fd, bytes, size, flags, own.address, own.size);
    if (sent >= 0)
        note_state(bytes, size);
    return count_sent(fd, bytes, size, sent);
}

/* ---- Receiving ------------------------------------------------------------------------------- */

SEAM(ssize_t, recv, int fd, void *out, size_t size, int flags)
{
    if (!world_inside)
        return recv(fd, out, size, flags);
    world_enter("recv");
    if (seam_refuses(world->interrupt_permille, world_chance(500) ? EAGAIN : EINTR, "recv"))
        return -1;
    if (size > 1 && world_chance(world->interrupt_permille * 4) && is_stream(fd))
        size = 1 + world_draw(size < 200 ? size : 200);
    ssize_t count = recv(fd, out, size, flags);
    int number = errno;
    world_trace("recv(%d) = %zd", fd, count);
    errno = number;
    return count;
}

SEAM(ssize_t, recvmsg, int fd, struct msghdr *message, int flags)
{
    if (!world_inside)
        return recvmsg(fd, message, flags);
    world_enter("recvmsg");
    struct sockaddr_nl *from = message->msg_name;
    ssize_t count = recvmsg(fd, message, flags);
    if (seam_fd_of(fd)->kind == FD_NETLINK && from && count >= 0) {
        *from = (struct sockaddr_nl){.nl_family = AF_NETLINK};
        message->msg_namelen = sizeof *from;
    }
    return count;
}

/* Stamps a message with the world's time of sending, in place of the kernel's real time. */
static void stamp(world_connection *c, struct msghdr *header)
{
    int64_t sent_ns = c->stamps[c->received++ % STAMPS_MAX];
    if (sent_ns < c->stamps_from_ns)
        sent_ns = world->now_ns;
    int64_t ns = sent_ns + world->realtime_ns;
    const struct timespec time = {.tv_sec = (time_t)(ns / S), .tv_nsec = (long)(ns % S)};
    for (struct cmsghdr *m = CMSG_FIRSTHDR(header); m; m = CMSG_NXTHDR(header, m))
        if (m->cmsg_level == SOL_SOCKET && m->cmsg_type == SCM_TIMESTAMPNS)
            memcpy(CMSG_DATA(m), &time, sizeof time);
}

SEAM(int, recvmmsg, int fd, struct mmsghdr *messages, unsigned count, int flags,
     struct timespec *timeout)
{
    if (!world_inside)
        return recvmmsg(fd, messages, count, flags, timeout);
    world_enter("recvmmsg");
    if (seam_refuses(world->interrupt_permille, world_chance(500) ? EAGAIN : EINTR, "recvmmsg"))
        return -1;
    if (world_chance(world->interrupt_permille * 4))
        count = 1 + (unsigned)world_draw(count);
    int received = recvmmsg(fd, messages, count, flags, timeout);
    int number = errno;
    int connection = seam_fd_of(fd)->connection;
    for (int i = 0; connection >= 0 && i < received; i++)
        if (messages[i].msg_len > 0 || messages[i].msg_hdr.msg_controllen > 0)
            stamp(&world->connections[connection], &messages[i].msg_hdr);
    world_trace("recvmmsg(%d) = %d", fd, received);
    errno = number;
    return received;
}

/* ---- Options --------------------------------------------------------------------------------- */

SEAM(int, setsockopt, int fd, int level, int option, const void *value, socklen_t size)
{
    int connection = seam_fd_of(fd)->connection;
    if (!world_inside)
        return setsockopt(fd, level, option, value, size);
    world_enter("setsockopt");
    if (level == SOL_SOCKET && option == SO_TIMESTAMPNS && connection >= 0)
        world->connections[connection].stamps_from_ns = world->now_ns;
    return setsockopt(fd, level, option, value, size);
}

#define FIRST_CLIENT_PID 9000

SEAM(int, getsockopt, int fd, int level, int option, void *value, socklen_t *size)
{
    int connection = seam_fd_of(fd)->connection;
    if (!world_inside)
        return getsockopt(fd, level, option, value, size);
    world_enter("getsockopt");
    int result = getsockopt(fd, level, option, value, size);
    if (result == 0 && level == SOL_SOCKET && option == SO_PEERCRED &&
        *size == sizeof(struct ucred)) {
        struct ucred *peer = value;
        peer->pid = FIRST_CLIENT_PID + connection;
        if (connection >= 0)
            peer->uid = world->connections[connection].uid;
    }
    return result;
}
