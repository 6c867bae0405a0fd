/* SPDX-License-Identifier: MIT
 *
 * unix.c - a port on a Unix socket. It is for programs where there is no SocketCAN (emulators, test
 * rigs), and for kernels without CAN.
 *
 * There are two kinds of programs. A plain ECU has messages that are struct can_frame or struct
 * canfd_frame, and is alone. It gets CAN FD frames when it has sent one itself. One that was
 * written for 16 bytes would take the start of 72 for a frame. Clients speak the protocol of
 * messages.h, and there may be many. A client binds its socket to an abstract address, so the two
 * can be told apart before their first message.
 *
 * Programs connect to a path, or a plain ECU has the other end of a socket that canwired inherited.
 * Without programs the node stays on the bus, as on a vcan interface without programs. The file
 * descriptor of the port is an epoll set, which stays the same when programs come and go.
 */
#include "port/kinds.h"

#include "base/file/pathsocket.h"
#include "port/door.h"
#include "port/gathered.h"
#include "port/shared.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/un.h>
#include <unistd.h>

#define BACKLOG 64
#define ACCEPTS_MAX 16u /* in one read */
#define SEND_BUFFER_BYTES (8 << 20)
#define WAITING_MAX 8u

#define PLAIN SHARED_PLAIN

/* The kinds of sockets. */
typedef enum unix_use {
    FOR_PROGRAMS = 0, /* of a node, at a path or inherited */
    FOR_CONTROLLER,   /* ... whose controller is one of them */
    FOR_ONE,          /* of a guest, whose client is alone */
    FOR_GUESTS        /* a door */
} unix_use;

typedef struct port_unix {
    port_shared shared;
    unix_use use;
    pathsocket listener; /* its fd is -1 for a socket that was inherited */
    int waiting[WAITING_MAX]; /* plain ECUs that have connected while one was there ... */
    unsigned waiting_count;   /* ... which may have gone, with frames to be read */
    bool takes_fd;            /* the plain ECU has sent a struct canfd_frame */
    bool had_frames;          /* the last read */
    gathered gathered;        /* frames for the plain ECU */
} port_unix;

static port_unix *unix_own(port *p)
{
    return (port_unix *)p;
}

static const port_unix *own_const(const port *p)
{
    return (const port_unix *)p;
}

static member *plain_of(port *p)
{
    return &unix_own(p)->shared.programs[PLAIN];
}

static int ecu_of(const port *p)
{
    return own_const(p)->shared.programs[PLAIN].fd;
}

/* ---- Programs come and go -------------------------------------------------------------------- */

/* Takes a program for the plain ECU, which sends plain frames without a hello. */
static bool connect_ecu(port *p, int fd)
{
    if (!shared_prepare(fd, SEND_BUFFER_BYTES) || !shared_watch(p, fd, PLAIN))
        return false;
    *plain_of(p) = (member){.fd = fd, .pid = port_peer_of(fd)};
    unix_own(p)->takes_fd = false;
    p->stats.connected++;
    return true;
}

static void refuse_plain(port *p, int fd)
{
    p->stats.refused++;
    (void)close(fd);
}

/* Takes a plain ECU. While one is there it waits: that one may have gone. */
static void take_plain(port *p, int fd)
{
    port_unix *u = unix_own(p);
    if (ecu_of(p) < 0 && u->use == FOR_PROGRAMS && connect_ecu(p, fd))
        return;
    if (ecu_of(p) >= 0 && u->waiting_count < WAITING_MAX)
        u->waiting[u->waiting_count++] = fd;
    else
        refuse_plain(p, fd);
}

/* Refuses the ones that wait: the ECU is still there. */
static void refuse_waiting(port *p)
{
    port_unix *u = unix_own(p);
    while (u->waiting_count > 0)
        refuse_plain(p, u->waiting[--u->waiting_count]);
}

static void unix_flush(port *p);

/* Disconnects the plain ECU. The next one that waits has its place. */
static void disconnect_ecu(port *p)
{
    port_unix *u = unix_own(p);
    unix_flush(p);
    (void)close(ecu_of(p)); /* this removes it from the epoll set */
    *plain_of(p) = (member){.fd = -1};
    if (u->waiting_count == 0)
        return;
    const int next = u->waiting[0];
    u->waiting_count--;
    memmove(u->waiting, u->waiting + 1, u->waiting_count * sizeof *u->waiting);
    if (!connect_ecu(p, next))
        refuse_plain(p, next);
}

static void take_client(port *p, int fd)
{
    (void)shared_prepare(fd, SEND_BUFFER_BYTES);
    shared_take_client(p, fd);
}

/* Returns true for the socket of a client: bind() has given it an abstract address. */
static bool is_client(const struct sockaddr_un *address, socklen_t size)
{
    return size > sizeof address->sun_family && address->sun_path[0] == '\0';
}

/* Accepts waiting connections. Behind an ECU that got the place it stops: that one may have
 * gone by now. The next read sees that, and accepts the next one. */
static void accept_waiting(port *p)
{
    port_unix *u = unix_own(p);
    for (unsigned i = 0; u->listener.fd >= 0 && i < ACCEPTS_MAX; i++) {
        struct sockaddr_un address = {.sun_family = AF_UNIX};
        socklen_t size = sizeof address;
        int fd = accept4(u->listener.fd, (struct sockaddr *)&address, &size,
                         SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0) {
            shared_set_deaf(p, u->listener.fd, errno == EMFILE || errno == ENFILE ||
                                                   errno == ENOMEM || errno == ENOBUFS);
            return;
        }
        shared_set_deaf(p, u->listener.fd, false);
        const bool alone = ecu_of(p) < 0;
        if (is_client(&address, size))
            take_client(p, fd);
        else
            take_plain(p, fd);
        if (alone && ecu_of(p) >= 0)
            return;
    }
}

/* ---- The plain ECU --------------------------------------------------------------------------- */

/* Returns true for the end behind the last message. It is empty, while a message has at least its
 * time stamp. */
static bool is_end(const struct mmsghdr *m)
{
    return m->msg_len == 0 && m->msg_hdr.msg_controllen == 0;
}

/* Notes whether the ECU uses struct canfd_frame: also an error frame, which never enters the bus,
 * counts as such a message. */
static void note_size(port *p, int received)
{
    for (int i = 0; !unix_own(p)->takes_fd && i < received; i++)
        unix_own(p)->takes_fd =
            p->messages.headers[i].msg_len == CANFD_MTU && port_is_frame(p, (unsigned)i);
}

/* Returns how many messages stand before the end of the connection. */
static int messages_before_end(const port *p, int received)
{
    int count = 0;
    while (count < received && !is_end(&p->messages.headers[count]))
        count++;
    return count;
}

/* Receives messages of the ECU. The kernel reports once that the ECU has gone with unread frames;
 * its own frames wait behind that report. */
static int unix_receive(port *p, unsigned max)
{
    int received = port_receive(p, ecu_of(p), max);
    bool reported = received < 0 && errno == ECONNRESET;
    plain_of(p)->peeked = false;
    return reported ? port_receive(p, ecu_of(p), max) : received;
}

/* Reads up to max messages of the plain ECU. Returns the number of frames; *waits: more may be
 * there. */
static unsigned read_plain(port *p, port_frame *frames, unsigned max, bool *waits)
{
    const int pid = plain_of(p)->pid;
    const int received = unix_receive(p, max);
    const bool nothing = received < 0 && (errno == EAGAIN || errno == EINTR);
    const int count = messages_before_end(p, received);
    note_size(p, count);
    const bool gone = !nothing && (count < received || received < 0);
    *waits = count == (int)max || gone; /* another ECU may wait for the place */
    if (nothing)
        refuse_waiting(p);
    else if (gone)
        disconnect_ecu(p);
    const uint64_t before = p->stats.read;
    const unsigned taken = port_take(p, frames, count);
    if (!nothing)
        port_note_told(p, pid, PORT_TOLD_ROOM);
    plain_of(p)->read += gone ? 0 : p->stats.read - before;
    return taken;
}

/* Reads the port. An inherited socket is all that it has, so while that has frames there is nothing
 * else to look at. */
static unsigned unix_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    port_unix *u = unix_own(p);
    const bool sure = u->had_frames && u->listener.fd < 0 && ecu_of(p) >= 0;
    const unsigned count =
        sure ? read_plain(p, frames, max, more) : shared_read(p, frames, max, more);
    u->had_frames = count > 0;
    return count;
}

/* Sends a frame at once. An ECU that has gone stays connected here, since its earlier frames are
 * still unread. */
static port_sent send_now(port *p, const void *frame, size_t size)
{
    if (send(ecu_of(p), frame, size, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)size) {
        plain_of(p)->written++;
        return PORT_SENT;
    }
    bool gone = errno == EPIPE || errno == ECONNRESET || errno == ENOTCONN;
    return gone ? PORT_UNHEARD : PORT_SEND_FAILED;
}

static void unix_flush(port *p)
{
    plain_of(p)->written += gathered_send(&unix_own(p)->gathered, p, ecu_of(p), send_now);
}

/* Clients get their frames at once, and a plain ECU beside them does, too. */
static port_sent send_plain(port *p, const void *frame, size_t size)
{
    if (ecu_of(p) < 0 || (size == CANFD_MTU && !unix_own(p)->takes_fd))
        return PORT_UNHEARD;
    if (!p->gathers || p->shared)
        return send_now(p, frame, size);
    return gathered_take(&unix_own(p)->gathered, p, frame, size);
}

/* ---- Guests ---------------------------------------------------------------------------------- */

/* Answers a hello. At a door the client waits, and is not read meanwhile. */
static void greet(port *p, member *c)
{
    if (unix_own(p)->use == FOR_GUESTS)
        (void)epoll_ctl(p->fd, EPOLL_CTL_DEL, c->fd, NULL);
    else
        shared_greet(p, c);
}

/* Returns true when the client of a guest has gone. Messages that it has sent before may wait, when
 * the node's queue is full. */
static bool unix_is_over(const port *p)
{
    const port_unix *u = own_const(p);
    struct pollfd only = {.fd = u->shared.programs[0].fd};
    if (u->use != FOR_ONE)
        return false;
    return u->shared.client_count == 0 || (poll(&only, 1, 0) == 1 && (only.revents & POLLHUP));
}

/* ---- Opening and closing --------------------------------------------------------------------- */

/* Frames that are gathered leave first. Plain ECUs that still wait for a place are closed. */
static void close_port(port *p)
{
    port_unix *u = unix_own(p);
    unix_flush(p);
    while (u->waiting_count > 0)
        (void)close(u->waiting[--u->waiting_count]);
    pathsocket_close(&u->listener);
    shared_close(p);
}

static const port_kind unix_kind = {.close = close_port,
                                    .read = unix_read,
                                    .send = shared_send,
                                    .flush = unix_flush,
                                    .share = shared_share,
                                    .crowd = shared_crowd,
                                    .handed_in = shared_handed_in,
                                    .ended = shared_ended,
                                    .client = shared_client,
                                    .is_over = unix_is_over,
                                    .obeyed = shared_obeyed,
                                    .tell_state = shared_tell_state,
                                    .settle = shared_settle,
                                    .control_bytes = PORT_STAMP_BYTES};

static const shared_ways unix_ways = {.member = &member_messages,
                                      .accept = accept_waiting,
                                      .greet = greet,
                                      .read_plain = read_plain,
                                      .send_plain = send_plain};

/* Makes a port without a listener or a program. NULL: without memory or descriptors. */
static port *make_port(void)
{
    port *p = shared_new(&unix_kind, &unix_ways, sizeof(port_unix));
    if (!p)
        return NULL;
    unix_own(p)->listener = (pathsocket)PATHSOCKET_NONE;
    if (p->fd >= 0)
        return p;
    close_port(p);
    return NULL;
}

/* Makes a socket at a path and listens there. Returns NULL, and a text that begins with the
 * port. */
static port *open_at(const char *kind, const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    char why[PATHSOCKET_ERROR_MAX] = "";
    port *p = make_port();
    bool good =
        p && pathsocket_open(&unix_own(p)->listener, path, SOCK_SEQPACKET, BACKLOG, "port", why);
    if (good && shared_watch(p, unix_own(p)->listener.fd, SHARED_LISTENER))
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s:%s: %s", kind, path,
                   *why ? why : strerror(errno));
    if (p)
        close_port(p);
    return NULL;
}

port *port_unix_open(const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    return open_at("unix", path, error);
}

port *port_unix_open_usb(const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = open_at("usb", path, error);
    if (!p)
        return NULL;
    unix_own(p)->use = FOR_CONTROLLER;
    p->commands = calloc(1, sizeof *p->commands);
    if (p->commands)
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "usb:%s: %s", path, strerror(ENOMEM));
    close_port(p);
    return NULL;
}

/* ---- Doors ----------------------------------------------------------------------------------- */

port *port_unix_open_door(const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = port_unix_open(path, error);
    if (p)
        unix_own(p)->use = FOR_GUESTS;
    return p;
}

/* Returns the guest that has come first, of those that wait for a node; NULL: none waits. */
static member *first_waiting(port_unix *u)
{
    member *first = NULL;
    member *all = u->shared.programs;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (all[i].state == MEMBER_WAITS && (!first || all[i].id < first->id))
            first = &all[i];
    return first;
}

const char *door_next(const port *door)
{
    const member *first = first_waiting((port_unix *)(uintptr_t)door);
    return first ? first->name : NULL;
}

port *door_admit(port *door)
{
    member *first = first_waiting(unix_own(door));
    port *p = first ? make_port() : NULL;
    if (!p || !shared_watch(p, first->fd, 0)) {
        port_close(p);
        return NULL;
    }
    port_unix *u = unix_own(p);
    u->use = FOR_ONE;
    u->shared.programs[0] = *first;
    u->shared.client_count = 1;
    p->shared = true;
    p->stats.connected = 1;
    *first = (member){.state = MEMBER_NONE, .fd = -1};
    unix_own(door)->shared.client_count--;
    return p;
}

void door_welcome(port *admitted)
{
    port_unix *u = unix_own(admitted);
    member_welcome(&u->shared.programs[0], u->shared.node, u->shared.sharing.fd);
    port_note_told(admitted, u->shared.programs[0].pid, PORT_TOLD_MESSAGE);
}

void door_refuse(port *door, int code, const char *text)
{
    member *first = first_waiting(unix_own(door));
    if (!first)
        return;
    member_refuse(first, MESSAGE_HELLO, code, text);
    door->stats.refused++;
    shared_disconnect(door, first);
}

/* Returns NULL for a usable inherited socket, otherwise the reason. Descriptors that the daemon
 * itself opens are closed on exec. */
static const char *explain_unfit(int fd)
{
    int domain = 0, type = 0;
    socklen_t size = sizeof domain;
    int flags = fcntl(fd, F_GETFD);
    if (flags < 0)
        return strerror(errno);
    if ((flags & FD_CLOEXEC) || getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) != 0 ||
        getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || domain != AF_UNIX ||
        type != SOCK_SEQPACKET)
        return "no inherited Unix socket of type SOCK_SEQPACKET";
    struct sockaddr_storage address;
    size = sizeof address;
    return getpeername(fd, (struct sockaddr *)&address, &size) == 0 ? NULL : strerror(errno);
}

port *port_unix_adopt(int fd, char error[PORT_ERROR_TEXT_MAX])
{
    const char *unfit = explain_unfit(fd);
    pathsocket_refuse_descriptors(fd);
    port *p = unfit ? NULL : make_port();
    if (p && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0 && connect_ecu(p, fd))
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "fd:%d: %s", fd, unfit ? unfit : strerror(errno));
    if (p)
        close_port(p);
    return NULL;
}
