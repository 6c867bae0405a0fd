/* SPDX-License-Identifier: MIT
 *
 * unix.c - a port on a Unix socket whose messages are struct can_frame or struct canfd_frame. It is
 * for ECUs that are no SocketCAN programs (emulators, test rigs), and for kernels without CAN.
 *
 * An ECU gets CAN FD frames when it has sent one itself. One that was written for 16 bytes would
 * take the begin of 72 for a frame.
 *
 * One ECU at a time connects to a path, or has the other end of a socket that canwired inherited.
 * Without an ECU the node stays on the bus, as on a vcan interface without programs. The file
 * descriptor of the port is an epoll set, which stays the same when ECUs come and go.
 */
#include "port/kinds.h"

#include "base/pathsocket.h"
#include "port/kind.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#define BACKLOG 8
#define ACCEPTS_MAX 16u /* in one read */
#define SEND_BUFFER_BYTES (8 << 20)

typedef struct port_unix {
    port base;
    pathsocket listener; /* its fd is -1 for a socket that was inherited */
    int ecu;             /* -1: none is connected */
    bool takes_fd;       /* the ECU has sent a struct canfd_frame */
    bool deaf;           /* the listener is not watched: accept() failed without resources */
} port_unix;

static port_unix *own(port *p)
{
    return (port_unix *)p;
}

/* ---- The ECU comes and goes ------------------------------------------------------------------ */

static bool watch(const port *p, int fd)
{
    struct epoll_event event = {.events = EPOLLIN, .data.fd = fd};
    return epoll_ctl(p->fd, EPOLL_CTL_ADD, fd, &event) == 0;
}

/* Stops or resumes watching the listener. A connection that cannot be accepted now would wake the
 * loop for ever; each read tries again. */
static void set_deaf(port *p, bool deaf)
{
    port_unix *u = own(p);
    if (deaf && !u->deaf)
        u->deaf = epoll_ctl(p->fd, EPOLL_CTL_DEL, u->listener.fd, NULL) == 0;
    else if (!deaf && u->deaf)
        u->deaf = !watch(p, u->listener.fd);
}

/* Asks for room for frames that the ECU has not read yet, as far as the kernel allows, and for time
 * stamps of its frames. */
static bool prepare(int fd)
{
    const int room = SEND_BUFFER_BYTES, on = 1;
    if (setsockopt(fd, SOL_SOCKET, SO_SNDBUFFORCE, &room, sizeof room) != 0)
        (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) == 0;
}

static bool connect_ecu(port *p, int fd)
{
    if (!prepare(fd) || !watch(p, fd))
        return false;
    own(p)->ecu = fd;
    own(p)->takes_fd = false;
    p->stats.connected++;
    return true;
}

/* Disconnects the ECU; closing its socket removes it from the epoll set. */
static void disconnect_ecu(port *p)
{
    (void)close(own(p)->ecu);
    own(p)->ecu = -1;
}

/* Accepts waiting connections. The first one becomes the ECU, if there is none. The others are
 * closed at once, since the place is taken. */
static void accept_waiting(port *p)
{
    port_unix *u = own(p);
    for (unsigned i = 0; u->listener.fd >= 0 && i < ACCEPTS_MAX; i++) {
        int fd = accept4(u->listener.fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0) {
            set_deaf(p, errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS);
            return;
        }
        if (u->ecu < 0 && connect_ecu(p, fd)) {
            set_deaf(p, false);
            return; /* it may have gone by now: the next read sees that and accepts the next one */
        }
        p->stats.refused++;
        (void)close(fd);
    }
}

/* ---- Frames ---------------------------------------------------------------------------------- */

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
    for (int i = 0; !own(p)->takes_fd && i < received; i++)
        own(p)->takes_fd =
            p->messages.headers[i].msg_len == CANFD_MTU && port_is_frame(p, (unsigned)i);
}

static int messages_before_end(const port *p, int received)
{
    int count = 0;
    while (count < received && !is_end(&p->messages.headers[count]))
        count++;
    return count;
}

/* Receives messages of the ECU. The kernel reports once that the ECU has gone with unread frames;
 * its own frames wait behind that report. */
static int receive(port *p, unsigned max)
{
    int received = port_receive(p, own(p)->ecu, max);
    bool reported = received < 0 && errno == ECONNRESET;
    return reported ? port_receive(p, own(p)->ecu, max) : received;
}

/* Pending input of a port. Asking first is cheapest: accept4() makes a socket before it finds no
 * connection. */
typedef struct waiting {
    bool frames; /* or the end of the ECU's connection */
    bool ecus;   /* that have connected */
} waiting;

static waiting look(const port *p)
{
    struct epoll_event events[2];
    const port_unix *u = (const port_unix *)p;
    int count = epoll_wait(p->fd, events, 2, 0);
    waiting found = {.frames = count < 0, .ecus = count < 0 || u->deaf};
    for (int i = 0; i < count; i++)
        if (events[i].data.fd == u->ecu)
            found.frames = true;
        else
            found.ecus = true;
    return found;
}

static unsigned read_frames(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    waiting found = look(p);
    *more = false;
    if (found.ecus && (own(p)->ecu < 0 || own(p)->deaf)) {
        accept_waiting(p);
        found.frames = true; /* perhaps of the new one */
    }
    if (own(p)->ecu < 0)
        return 0;
    int received = found.frames ? receive(p, max) : -1;
    bool nothing = !found.frames || (received < 0 && (errno == EAGAIN || errno == EINTR));
    int count = messages_before_end(p, received);
    note_size(p, count);
    if (nothing && found.ecus)
        accept_waiting(p);
    else if (!nothing && (count < received || received < 0))
        disconnect_ecu(p);
    *more = count == (int)max || own(p)->ecu < 0; /* another ECU may wait for the place */
    return port_take(p, frames, count);
}

/* Sends a frame. An ECU that has gone stays connected here, since its earlier frames are still
 * unread. */
static port_sent send_frame(port *p, const void *frame, size_t size)
{
    if (own(p)->ecu < 0 || (size == CANFD_MTU && !own(p)->takes_fd))
        return PORT_UNHEARD;
    if (send(own(p)->ecu, frame, size, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)size)
        return PORT_SENT;
    bool gone = errno == EPIPE || errno == ECONNRESET || errno == ENOTCONN;
    return gone ? PORT_UNHEARD : PORT_SEND_FAILED;
}

/* ---- Opening and closing --------------------------------------------------------------------- */

static void close_port(port *p)
{
    if (own(p)->ecu >= 0)
        (void)close(own(p)->ecu);
    pathsocket_close(&own(p)->listener);
    if (p->fd >= 0)
        (void)close(p->fd);
    free(p);
}

static const port_kind unix_kind = {.close = close_port,
                                    .read = read_frames,
                                    .send = send_frame,
                                    .control_bytes = PORT_STAMP_BYTES};

static port *make_port(void)
{
    port *p = port_new(&unix_kind, sizeof(port_unix));
    if (!p)
        return NULL;
    own(p)->listener = (pathsocket)PATHSOCKET_NONE;
    own(p)->ecu = -1;
    p->fd = epoll_create1(EPOLL_CLOEXEC);
    if (p->fd >= 0)
        return p;
    close_port(p);
    return NULL;
}

port *port_unix_open(const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    char why[PATHSOCKET_ERROR_MAX] = "";
    port *p = make_port();
    bool good = p && pathsocket_open(&own(p)->listener, path, SOCK_SEQPACKET, BACKLOG, "port", why);
    if (good && watch(p, own(p)->listener.fd))
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "unix:%s: %s", path, *why ? why : strerror(errno));
    if (p)
        close_port(p);
    return NULL;
}

/* Returns NULL for a usable inherited socket, else the reason. Descriptors that the daemon itself
 * opens are closed on exec. */
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
