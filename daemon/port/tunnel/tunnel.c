/* SPDX-License-Identifier: MIT
 *
 * tunnel.c - a port that is the end of a tunnel of cannelloni: its ECU is on another machine.
 *
 * Frames of the bus are collected until a packet is full, or the first of them has waited for the
 * timeout. Frames of the peer are handed in with the kernel's time stamp of their packet. A timer
 * in the epoll set wakes the port when it has something to do by itself.
 */
#include "port/kinds.h"

#include "base/alarm.h"
#include "base/log.h"
#include "base/moment.h"
#include "config/node/tunnelname.h"
#include "port/tunnel/cannelloni.h"
#include "port/kind.h"

#include <errno.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#define BYTES_MAX 65536u    /* of a packet, and of what waits for a connection */
#define STREAM_BYTES 2048u  /* of one read of a connection */
#define PACKETS_MAX 256u    /* in one read of the port */
#define SEND_BUFFER_BYTES (1 << 17) /* of a connection; more would be old when it is read */
#define RETRY_NS INT64_C(1000000000)
#define GREETING_NS INT64_C(1000000000) /* for which a connection may keep the place silently */
#define LEFT_NS INT64_C(1000000000) /* for which a peer that has gone may keep it from others */
#define BACKLOG 16
#define IDLE_S 10           /* after which the kernel asks whether the peer is still there ... */
#define ASK_S 5             /* ... again after this time ... */
#define ASKS 3              /* ... and so often */

/* Marks of the epoll set. */
enum { LINK, LISTENER, TIMER, WATCHED };

typedef enum tunnel_state {
    WAITING = 0, /* for a peer that connects, or for the next attempt */
    CONNECTING,
    GREETING,    /* the peer's greeting has not come */
    UP,
    LEFT         /* the peer has gone, and frames that it has sent wait */
} tunnel_state;

typedef struct tunnel {
    port base;
    tunnelname name;
    char text[TUNNELNAME_BYTES];
    tunnel_state state;
    int link;     /* the UDP socket, or the connection; -1: none */
    int listener; /* -1: none */
    wake_alarm timer;
    int64_t retry_ns; /* when it connects again; 0: it does not */
    int64_t greeted_ns; /* when this end has greeted its peer */
    int64_t left_ns;    /* when it was known that the peer has gone */
    int next;           /* a connection that waits for its place; -1: none */
    bool readable;     /* something may wait at the link */
    bool room_watched; /* the loop is woken when the connection takes more */
    uint8_t number;    /* of the next packet */
    cannelloni_sequence sequence; /* of the peer */
    port_tunnel_info info;
    uint8_t out[BYTES_MAX];
    size_t out_bytes;
    unsigned out_frames;
    int64_t out_ns; /* time of the first of them, CLOCK_MONOTONIC; 0: none waits */
    uint8_t in[BYTES_MAX];
    size_t in_begin;
    size_t in_end;
    unsigned in_frames; /* left in a packet */
    int64_t in_realtime_ns;
} tunnel;

static tunnel *tunnel_own(port *p)
{
    return (tunnel *)p;
}

/* ---- Time and the epoll set ------------------------------------------------------------------ */

static bool tunnel_watch(const tunnel *t, int fd, unsigned what, uint32_t events)
{
    struct epoll_event event = {.events = events, .data.u32 = what};
    return epoll_ctl(t->base.fd, EPOLL_CTL_ADD, fd, &event) == 0;
}

/* Watches the connection for room, but only while something waits for it: epoll would wake the loop
 * all the time. */
static void watch_room(tunnel *t, bool wanted)
{
    struct epoll_event event = {.events = EPOLLIN | (wanted ? EPOLLOUT : 0), .data.u32 = LINK};
    if (t->link >= 0 && wanted != t->room_watched &&
        epoll_ctl(t->base.fd, EPOLL_CTL_MOD, t->link, &event) == 0)
        t->room_watched = wanted;
}

static void wake_at(tunnel *t, int64_t ns)
{
    if (ns != 0)
        (void)alarm_set_earlier(&t->timer, ns);
}

/* ---- To the peer ----------------------------------------------------------------------------- */

static size_t head_bytes(const tunnel *t)
{
    return t->name.tcp ? 0 : CANNELLONI_HEAD_BYTES;
}

static void forget_out(tunnel *t)
{
    t->out_bytes = head_bytes(t);
    t->out_frames = 0;
    t->out_ns = 0;
}

/* Counts frames that have been taken as not sent after all. */
static void lose_out(tunnel *t)
{
    t->base.stats.written -= t->out_frames;
    t->base.stats.write_failed += t->out_frames;
    forget_out(t);
}

/* Keeps how long the oldest frame of a packet has waited for it to be sent. */
static void note_held(tunnel *t)
{
    const uint64_t held_ns = (uint64_t)(clock_ns(CLOCK_MONOTONIC) - t->out_ns);
    t->info.held_last_ns = held_ns;
    if (held_ns > t->info.held_max_ns)
        t->info.held_max_ns = held_ns;
    t->info.packets_written++;
}

/* A packet that the kernel does not take leaves a gap, from which the peer knows of it. */
static void send_packet(tunnel *t)
{
    struct sockaddr_storage peer;
    const socklen_t size = address_for_socket(&peer, &t->name.peer);
    cannelloni_put_head(t->out, t->number++, t->out_frames);
    if (sendto(t->link, t->out, t->out_bytes, MSG_DONTWAIT | MSG_NOSIGNAL,
               (const struct sockaddr *)&peer, size) < 0) {
        lose_out(t);
        return;
    }
    note_held(t);
    forget_out(t);
}

static bool peer_has_gone(const tunnel *t)
{
    struct pollfd link = {.fd = t->link, .events = POLLRDHUP};
    return poll(&link, 1, 0) == 1;
}

/* Notes that the peer has gone. Frames for it are lost; those that it has sent are still read. */
static void note_left(tunnel *t)
{
    t->state = LEFT;
    t->left_ns = clock_ns(CLOCK_MONOTONIC);
    lose_out(t);
    watch_room(t, false);
    log_info("port %s: the peer has gone", t->text);
}

/* A connection that takes a part gets the rest when it has room again. The kernel would take
 * frames for a peer that has gone, so that is asked first. */
static void send_stream(tunnel *t)
{
    if (peer_has_gone(t)) {
        note_left(t);
        return;
    }
    const ssize_t sent = send(t->link, t->out, t->out_bytes, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent < 0 && errno != EAGAIN && errno != EINTR) {
        note_left(t);
        return;
    }
    if (sent == (ssize_t)t->out_bytes) {
        if (t->out_frames > 0)
            note_held(t);
        forget_out(t);
    } else if (sent > 0) {
        t->out_bytes -= (size_t)sent;
        memmove(t->out, t->out + sent, t->out_bytes);
    }
    watch_room(t, t->out_bytes > 0);
}

/* Sends what has been gathered, if anything. */
static void tunnel_flush(tunnel *t)
{
    if (t->link < 0 || t->out_bytes == head_bytes(t))
        return;
    if (t->name.tcp)
        send_stream(t);
    else
        send_packet(t);
}

/* Returns true when that many bytes fit behind those that wait; else sends those. A stream keeps
 * what does not go at once. */
static bool tunnel_make_room(tunnel *t, size_t bytes)
{
    if (t->out_bytes + bytes <= t->name.mtu)
        return true;
    if (!t->name.tcp || !t->room_watched)
        tunnel_flush(t);
    return t->out_bytes + bytes <= (t->name.tcp ? BYTES_MAX : t->name.mtu);
}

static int64_t due_ns(const tunnel *t)
{
    return t->out_ns == 0 || t->room_watched ? 0 : t->out_ns + (int64_t)t->name.timeout_ns;
}

/* Error frames are of this end: an interface at the other one would put them on its bus. */
static port_sent tunnel_send_frame(port *p, const void *frame, size_t size)
{
    tunnel *t = tunnel_own(p);
    uint8_t bytes[CANNELLONI_FRAME_MAX];
    canid_t id;
    memcpy(&id, frame, sizeof id);
    if (t->state != UP || (id & CAN_ERR_FLAG))
        return PORT_UNHEARD;
    const size_t count = cannelloni_put_frame(bytes, frame, size);
    if (!tunnel_make_room(t, count))
        return PORT_SEND_FAILED;
    if (t->state != UP) /* to make room, it has found that the peer has gone */
        return PORT_UNHEARD;
    memcpy(t->out + t->out_bytes, bytes, count);
    t->out_bytes += count;
    t->out_frames++;
    if (t->out_ns == 0)
        t->out_ns = clock_ns(CLOCK_MONOTONIC);
    if (t->name.timeout_ns == 0 && !t->room_watched)
        tunnel_flush(t);
    wake_at(t, due_ns(t));
    return PORT_SENT;
}

/* ---- Connections ----------------------------------------------------------------------------- */

/* Ends the connection. Gathered frames are lost, and counted so. A port that connects tries again
 * later. */
static void disconnect(tunnel *t)
{
    if (t->state == UP)
        log_info("port %s: the peer has gone", t->text);
    if (t->link >= 0)
        (void)close(t->link);
    t->link = -1;
    t->state = WAITING;
    t->room_watched = false;
    t->in_begin = t->in_end = 0;
    lose_out(t);
    t->retry_ns = t->name.connects ? clock_ns(CLOCK_MONOTONIC) + RETRY_NS : 0;
    wake_at(t, t->retry_ns);
}

/* Sets a connection so that frames leave at once, and that a peer whose machine is gone is noticed
 * within a known time. */
static void prepare_connection(int fd)
{
    const int on = 1, room = SEND_BUFFER_BYTES, idle_s = IDLE_S, ask_s = ASK_S, asks = ASKS;
    const unsigned gone_ms = 1000 * (IDLE_S + ASK_S * ASKS);
    (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    (void)setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    (void)setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &ask_s, sizeof ask_s);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &asks, sizeof asks);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &gone_ms, sizeof gone_ms);
}

/* Sends the greeting of cannelloni. No frame is sent before that of the peer has come. */
static void greet(tunnel *t)
{
    t->state = GREETING;
    t->greeted_ns = clock_ns(CLOCK_MONOTONIC);
    watch_room(t, false);
    if (send(t->link, CANNELLONI_GREETING, CANNELLONI_GREETING_BYTES,
             MSG_DONTWAIT | MSG_NOSIGNAL) != (ssize_t)CANNELLONI_GREETING_BYTES)
        disconnect(t);
}

/* Returns true for a sender that has the address of the peer, whatever its port. Without a peer in
 * the configuration all are. */
static bool is_peer(const tunnel *t, const struct sockaddr_storage *from)
{
    struct sockaddr_storage peer;
    if (!t->name.has_peer)
        return true;
    (void)address_for_socket(&peer, &t->name.peer);
    if (from->ss_family != peer.ss_family)
        return false;
    if (peer.ss_family == AF_INET)
        return ((const struct sockaddr_in *)from)->sin_addr.s_addr ==
               ((const struct sockaddr_in *)&peer)->sin_addr.s_addr;
    return memcmp(&((const struct sockaddr_in6 *)from)->sin6_addr,
                  &((const struct sockaddr_in6 *)&peer)->sin6_addr, sizeof(struct in6_addr)) == 0;
}

/* Returns whether bytes of the peer wait in the kernel. */
static bool bytes_wait(const tunnel *t)
{
    char byte;
    return recv(t->link, &byte, sizeof byte, MSG_PEEK | MSG_DONTWAIT) > 0;
}

/* Returns whether the peer has gone before its greeting was read. It may wait with frames. */
static bool has_gone_early(const tunnel *t)
{
    return t->state == GREETING && peer_has_gone(t);
}

/* Returns whether the connection that is there leaves its place to the next one. It does when its
 * peer has not greeted for some time, like a program that looks for open ports. It also does when
 * its peer has gone, and what that has sent has waited for some time. */
static bool gives_way(const tunnel *t)
{
    const int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    if (t->state == GREETING)
        return now_ns - t->greeted_ns >= GREETING_NS && !bytes_wait(t);
    return t->state == LEFT && now_ns - t->left_ns >= LEFT_NS;
}

/* Begins with the greeting. A connection that cannot be watched would never be read. */
static void begin_connection(tunnel *t, int fd)
{
    prepare_connection(fd);
    t->link = fd;
    if (tunnel_watch(t, fd, LINK, EPOLLIN))
        greet(t);
    else
        disconnect(t);
}

static void tunnel_refuse(tunnel *t, int fd)
{
    t->base.stats.refused++;
    (void)close(fd);
}

/* Lets a connection wait for its place. The last one to come is the one that is alive. */
static void hold(tunnel *t, int fd)
{
    if (t->next >= 0)
        tunnel_refuse(t, t->next);
    t->next = fd;
}

/* Takes a connection. There is one at a time. */
static void take_connection(tunnel *t, int fd, const struct sockaddr_storage *from)
{
    if (!is_peer(t, from)) {
        t->base.stats.strangers++;
        (void)close(fd);
        return;
    }
    if (t->state == UP && peer_has_gone(t))
        note_left(t);
    if (has_gone_early(t) && !bytes_wait(t))
        disconnect(t);
    if (t->link < 0 && t->next < 0)
        begin_connection(t, fd);
    else if (t->link < 0 || t->state == LEFT || has_gone_early(t) || gives_way(t))
        hold(t, fd);
    else
        tunnel_refuse(t, fd);
}

/* Accepts peers, a limited number at a time: the loop comes again for others. */
static void accept_waiting(tunnel *t)
{
    for (unsigned i = 0; i < PACKETS_MAX; i++) {
        struct sockaddr_storage from = {.ss_family = AF_UNSPEC};
        socklen_t size = sizeof from;
        const int fd = accept4(t->listener, (struct sockaddr *)&from, &size,
                               SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0)
            return;
        take_connection(t, fd, &from);
    }
}

/* Begins a connection. It waits for nothing: complete_connection() takes the result. */
static void connect_to_peer(tunnel *t)
{
    struct sockaddr_storage peer;
    const socklen_t size = address_for_socket(&peer, &t->name.peer);
    t->retry_ns = 0;
    t->link = socket(peer.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    t->state = CONNECTING;
    if (t->link >= 0) {
        prepare_connection(t->link);
        port_bound_tcp(t->link);
        const int result = connect(t->link, (const struct sockaddr *)&peer, size);
        t->room_watched = true;
        if ((result == 0 || errno == EINPROGRESS) &&
            tunnel_watch(t, t->link, LINK, EPOLLIN | EPOLLOUT))
            return;
    }
    disconnect(t);
}

/* Takes the result of an attempt to connect. */
static void complete_connection(tunnel *t)
{
    int error = 0;
    socklen_t size = sizeof error;
    if (getsockopt(t->link, SOL_SOCKET, SO_ERROR, &error, &size) == 0 && error == 0)
        greet(t);
    else
        disconnect(t);
}

/* ---- From the peer --------------------------------------------------------------------------- */

/* Receives bytes behind those that are there, and the address of their sender. */
static ssize_t tunnel_receive(tunnel *t, size_t room, struct sockaddr_storage *from)
{
    _Alignas(struct cmsghdr) unsigned char control[PORT_CONTROL_BYTES];
    struct iovec part = {.iov_base = t->in + t->in_end, .iov_len = room};
    struct msghdr header = {.msg_name = from,
                            .msg_namelen = sizeof *from,
                            .msg_iov = &part,
                            .msg_iovlen = 1,
                            .msg_control = control,
                            .msg_controllen = sizeof control};
    const ssize_t size = recvmsg(t->link, &header, MSG_DONTWAIT);
    if (size < 0)
        return size;
    t->in_realtime_ns = port_take_control(&t->base, &header);
    const int64_t waited_ns = clock_ns(CLOCK_REALTIME) - t->in_realtime_ns;
    t->info.waited_last_ns = t->in_realtime_ns > 0 && waited_ns > 0 ? (uint64_t)waited_ns : 0;
    if (t->info.waited_last_ns > t->info.waited_max_ns)
        t->info.waited_max_ns = t->info.waited_last_ns;
    return size;
}

/* Looks at a packet. Its frames are left in t->in. */
static void take_packet(tunnel *t, size_t bytes, const struct sockaddr_storage *from)
{
    if (!is_peer(t, from)) {
        t->base.stats.strangers++;
        return;
    }
    const int frames = cannelloni_check(t->in, bytes);
    if (frames < 0) {
        t->base.stats.malformed++;
        t->info.malformed++;
        return;
    }
    unsigned missing;
    const cannelloni_place place =
        cannelloni_follow(&t->sequence, t->in, bytes, clock_ns(CLOCK_MONOTONIC), &missing);
    t->info.packets_read++;
    t->base.stats.missing += missing;
    t->info.late += place == CANNELLONI_LATE;
    t->info.duplicate += place == CANNELLONI_DUPLICATE;
    t->info.restarts += place == CANNELLONI_RESTART;
    if (place == CANNELLONI_DUPLICATE)
        return;
    t->in_frames = (unsigned)frames;
    t->in_begin = CANNELLONI_HEAD_BYTES;
    t->in_end = bytes;
}

/* Reads the next packet. Returns false when none waits. */
static bool read_packet(tunnel *t)
{
    struct sockaddr_storage from = {.ss_family = AF_UNSPEC};
    t->in_begin = t->in_end = 0;
    const ssize_t size = tunnel_receive(t, sizeof t->in, &from);
    if (size >= 0)
        take_packet(t, (size_t)size, &from);
    else
        t->base.stats.read_failed += errno != EAGAIN && errno != EINTR;
    return size >= 0;
}

/* Reads more of the stream. Returns false when nothing waits, or the peer has gone. */
static bool read_stream(tunnel *t)
{
    struct sockaddr_storage from;
    if (t->link < 0 || t->state == CONNECTING)
        return false;
    memmove(t->in, t->in + t->in_begin, t->in_end - t->in_begin);
    t->in_end -= t->in_begin;
    t->in_begin = 0;
    const ssize_t size = tunnel_receive(t, STREAM_BYTES, &from);
    if (size < 0 && (errno == EAGAIN || errno == EINTR))
        return false;
    if (size <= 0) {
        disconnect(t);
        return false;
    }
    t->in_end += (size_t)size;
    t->info.packets_read += t->state == UP || t->state == LEFT;
    return true;
}

static void tunnel_complain(tunnel *t)
{
    t->base.stats.malformed++;
    t->info.malformed++;
    disconnect(t);
}

/* Takes the greeting of the peer, of which a part may be yet to come. */
static void take_greeting(tunnel *t)
{
    const size_t there = t->in_end - t->in_begin;
    const size_t bytes = there < CANNELLONI_GREETING_BYTES ? there : CANNELLONI_GREETING_BYTES;
    if (memcmp(t->in + t->in_begin, CANNELLONI_GREETING, bytes) != 0) {
        tunnel_complain(t);
        return;
    }
    if (bytes < CANNELLONI_GREETING_BYTES)
        return;
    t->in_begin += bytes;
    t->state = UP;
    t->base.stats.connected++;
    log_info("port %s: the peer is connected", t->text);
}

/* Takes the next frame of those that have been read. Returns false without a whole one. */
static bool tunnel_take_frame(tunnel *t, port_frame *out, bool *good)
{
    struct canfd_frame frame;
    size_t size;
    if (t->name.tcp ? t->state != UP && t->state != LEFT : t->in_frames == 0)
        return false;
    const int taken =
        cannelloni_take_frame(&frame, &size, t->in + t->in_begin, t->in_end - t->in_begin);
    if (taken < 0)
        tunnel_complain(t);
    if (taken <= 0)
        return false;
    t->in_begin += (size_t)taken;
    t->in_frames -= !t->name.tcp;
    *out = (port_frame){.realtime_ns = t->in_realtime_ns};
    *good = port_take_frame(&t->base, out, &frame, size);
    t->base.stats.read += *good;
    return true;
}

/* Reads what there is. Returns false when nothing is left, or the peer has gone. */
static bool read_more(tunnel *t)
{
    if (t->readable)
        t->readable = t->name.tcp ? read_stream(t) : read_packet(t);
    if (t->readable && t->state == GREETING)
        take_greeting(t);
    return t->readable;
}

/* Takes up to max frames. *more: some may be left. */
static unsigned take_frames(tunnel *t, port_frame *frames, unsigned max, bool *more)
{
    unsigned count = 0;
    bool good;
    *more = true;
    for (unsigned reads = 0; count < max && reads < PACKETS_MAX;) {
        if (tunnel_take_frame(t, &frames[count], &good)) {
            count += good;
            continue;
        }
        reads++;
        if (!read_more(t)) {
            *more = false;
            break;
        }
    }
    return count;
}

/* Counts the frames that a peer has left behind, and that nobody will read. */
static void lose_in(tunnel *t)
{
    struct canfd_frame frame;
    size_t size;
    for (;;) {
        const int taken =
            cannelloni_take_frame(&frame, &size, t->in + t->in_begin, t->in_end - t->in_begin);
        if (taken > 0) {
            t->in_begin += (size_t)taken;
            t->base.stats.kernel_dropped++;
        } else if (taken < 0 || !read_stream(t)) {
            return;
        }
    }
}

/* Gives the connection that waits the place of the one before. That one has left, and all that it
 * has sent has been read, or it gives way. If it has greeted after all, it stays. */
static void admit_next(tunnel *t)
{
    if (t->next < 0)
        return;
    if (t->state == UP && peer_has_gone(t))
        note_left(t);
    if (t->link >= 0 && !gives_way(t)) {
        if (t->state != LEFT && !has_gone_early(t)) {
            tunnel_refuse(t, t->next);
            t->next = -1;
        }
        return;
    }
    if (t->state == LEFT)
        lose_in(t);
    if (t->link >= 0)
        disconnect(t);
    const int fd = t->next;
    t->next = -1;
    begin_connection(t, fd);
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Notes that there may be something to read, and goes on with what waited for room. */
static void on_link(tunnel *t, uint32_t events)
{
    t->readable = true;
    if (t->state == CONNECTING && (events & (EPOLLOUT | EPOLLERR | EPOLLHUP)))
        complete_connection(t);
    else if (events & EPOLLOUT)
        tunnel_flush(t);
}

/* Looks once what has happened to the listener, the connection and the timer. */
static void tunnel_look(tunnel *t)
{
    struct epoll_event events[WATCHED];
    const int count = epoll_wait(t->base.fd, events, WATCHED, 0);
    for (int i = 0; i < count; i++)
        if (events[i].data.u32 == TIMER)
            (void)alarm_take(&t->timer);
        else if (events[i].data.u32 == LISTENER)
            accept_waiting(t);
        else
            on_link(t, events[i].events);
}

/* Frames that have been read, but not taken, wake the loop again: nothing in the kernel does. */
static void see_to_time(tunnel *t, bool more)
{
    const int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    if (due_ns(t) != 0 && due_ns(t) <= now_ns)
        tunnel_flush(t);
    if (t->retry_ns != 0 && t->retry_ns <= now_ns)
        connect_to_peer(t);
    wake_at(t, due_ns(t));
    wake_at(t, t->retry_ns);
    wake_at(t, t->next >= 0 && t->state == LEFT ? t->left_ns + LEFT_NS : 0);
    wake_at(t, more ? now_ns : 0);
}

/* Takes frames of the peer. A peer that waits is let in when all of the former one have been
 * taken. */
static unsigned read_port(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    tunnel *t = tunnel_own(p);
    tunnel_look(t);
    const unsigned count = take_frames(t, frames, max, more);
    admit_next(t);
    see_to_time(t, *more);
    return count;
}

/* A state is told in the words of users: a greeting is a part of connecting. */
static bool tunnel_describe(const port *p, port_tunnel_info *out)
{
    static const char *const states[] = {
        [WAITING] = "waiting", [CONNECTING] = "connecting", [GREETING] = "connecting", [UP] = "up",
        [LEFT] = "waiting"};
    const tunnel *t = (const tunnel *)p;
    *out = t->info;
    out->state = states[t->state];
    out->missing = p->stats.missing;
    out->strangers = p->stats.strangers;
    return true;
}

/* ---- Opening and closing --------------------------------------------------------------------- */

static void close_fd(int fd)
{
    if (fd >= 0)
        (void)close(fd);
}

/* Frames that wait for their packet to be full leave first. */
static void close_port(port *p)
{
    tunnel *t = tunnel_own(p);
    tunnel_flush(t);
    close_fd(t->link);
    close_fd(t->listener);
    close_fd(t->next);
    alarm_close(&t->timer);
    close_fd(p->fd);
    free(t);
}

static const port_kind tunnel_kind = {
    .close = close_port,
    .read = read_port,
    .send = tunnel_send_frame,
    .tunnel = tunnel_describe,
    .control_bytes = PORT_CONTROL_BYTES,
};

/* Returns a bound socket; -1 with errno. */
static int bind_socket(const tunnel *t, int type)
{
    struct sockaddr_storage address;
    const socklen_t size = address_for_socket(&address, &t->name.listen);
    const int on = 1, room = PORT_BUFFER_BYTES;
    const int fd = socket(address.ss_family, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return -1;
    if (type == SOCK_STREAM) {
        (void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
        port_bound_tcp(fd);
    } else if (setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &room, sizeof room) != 0) {
        (void)setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    }
    (void)setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
    (void)setsockopt(fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    if (bind(fd, (const struct sockaddr *)&address, size) == 0)
        return fd;
    const int error = errno;
    (void)close(fd);
    errno = error;
    return -1;
}

static bool open_udp(tunnel *t)
{
    t->link = bind_socket(t, SOCK_DGRAM);
    t->state = UP;
    return t->link >= 0 && tunnel_watch(t, t->link, LINK, EPOLLIN);
}

/* A port that connects is good without its peer, which may come later. */
static bool open_tcp(tunnel *t)
{
    if (t->name.connects) {
        connect_to_peer(t);
        return true;
    }
    t->listener = bind_socket(t, SOCK_STREAM);
    return t->listener >= 0 && listen(t->listener, BACKLOG) == 0 &&
           tunnel_watch(t, t->listener, LISTENER, EPOLLIN);
}

/* Opens the sockets of the tunnel, and one set of descriptors for the loop to watch. False with
 * errno. */
static bool open_tunnel(tunnel *t)
{
    t->base.fd = epoll_create1(EPOLL_CLOEXEC);
    if (t->base.fd < 0 || !alarm_open(&t->timer) || !tunnel_watch(t, t->timer.fd, TIMER, EPOLLIN))
        return false;
    forget_out(t);
    return t->name.tcp ? open_tcp(t) : open_udp(t);
}

port *port_tunnel_open(const char *text, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = port_new(&tunnel_kind, sizeof(tunnel));
    if (p) {
        tunnel_own(p)->link = tunnel_own(p)->listener = tunnel_own(p)->next = -1;
        tunnel_own(p)->timer = ALARM_CLOSED;
        (void)tunnelname_parse(&tunnel_own(p)->name, text);
        tunnelname_print(tunnel_own(p)->text, &tunnel_own(p)->name);
        if (open_tunnel(tunnel_own(p)))
            return p;
    }
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: %s", text, strerror(errno));
    if (p)
        close_port(p);
    return NULL;
}
