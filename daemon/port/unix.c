/* SPDX-License-Identifier: MIT
 *
 * unix.c - a port on a Unix socket. It is for programs where there is no SocketCAN (emulators, test
 * rigs), and for kernels without CAN.
 *
 * There are two kinds of programs. A plain ECU has messages that are struct can_frame or struct
 * canfd_frame, and is alone. It gets CAN FD frames when it has sent one itself. One that was
 * written for 16 bytes would take the begin of 72 for a frame. Clients speak the protocol of
 * messages.h, and there may be many. A client binds its socket to an abstract address, so the two
 * can be told apart before their first message.
 *
 * Programs connect to a path, or a plain ECU has the other end of a socket that canwired inherited.
 * Without programs the node stays on the bus, as on a vcan interface without programs. The file
 * descriptor of the port is an epoll set, which stays the same when programs come and go.
 */
#include "port/kinds.h"

#include "base/number.h"
#include "base/pathsocket.h"
#include "port/door.h"
#include "port/member.h"
#include "port/underway.h"

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
#define CONTROLS_MAX 256u /* messages of one read that are no frames */
#define WAITING_MAX 8u

/* Marks of the epoll set: the place of a client, or one of these. */
#define PLAIN PORT_CLIENTS_MAX
#define LISTENER (PORT_CLIENTS_MAX + 1u)
#define WATCHED_MAX (PORT_CLIENTS_MAX + 2u)
#define PLAIN_BIT (UINT64_C(1) << PLAIN)

/* The kinds of sockets. */
typedef enum unix_use {
    FOR_PROGRAMS = 0, /* of a node, at a path or inherited */
    FOR_ONE,          /* of a guest, whose client is alone */
    FOR_GUESTS        /* a door */
} unix_use;

typedef struct port_unix {
    port base;
    unix_use use;
    pathsocket listener; /* its fd is -1 for a socket that was inherited */
    member programs[PORT_CLIENTS_MAX + 1]; /* at PLAIN the plain ECU, of which no state counts */
    unsigned client_count;
    int waiting[WAITING_MAX]; /* plain ECUs that have connected while one was there ... */
    unsigned waiting_count;   /* ... which may have gone, with frames to be read */
    bool takes_fd;            /* the plain ECU has sent a struct canfd_frame */
    bool deaf;     /* the listener is not watched: accept() failed without resources */
    bool crowded;  /* frames had to wait: programs take turns */
    unsigned turn; /* the one that was read last */
    uint32_t last_id;
    port_sharing sharing;
    char node[MESSAGE_NAME_BYTES];
    underway underway;
} port_unix;

static port_unix *own(port *p)
{
    return (port_unix *)p;
}

static const port_unix *own_const(const port *p)
{
    return (const port_unix *)p;
}

static int ecu_of(const port *p)
{
    return own_const(p)->programs[PLAIN].fd;
}

/* ---- Programs come and go -------------------------------------------------------------------- */

static bool watch(const port *p, int fd, unsigned what)
{
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = what};
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
        u->deaf = !watch(p, u->listener.fd, LISTENER);
}

/* Asks for room for frames that the program has not read yet, as far as the kernel allows, and for
 * time stamps of its frames. */
static bool prepare(int fd)
{
    const int room = SEND_BUFFER_BYTES, on = 1;
    if (setsockopt(fd, SOL_SOCKET, SO_SNDBUFFORCE, &room, sizeof room) != 0)
        (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) == 0;
}

static bool connect_ecu(port *p, int fd)
{
    if (!prepare(fd) || !watch(p, fd, PLAIN))
        return false;
    own(p)->programs[PLAIN] = (member){.fd = fd};
    own(p)->takes_fd = false;
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
    port_unix *u = own(p);
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
    port_unix *u = own(p);
    while (u->waiting_count > 0)
        refuse_plain(p, u->waiting[--u->waiting_count]);
}

/* Disconnects the plain ECU. The next one that waits has its place. */
static void disconnect_ecu(port *p)
{
    port_unix *u = own(p);
    (void)close(ecu_of(p)); /* this removes it from the epoll set */
    u->programs[PLAIN] = (member){.fd = -1};
    if (u->waiting_count == 0)
        return;
    const int next = u->waiting[0];
    u->waiting_count--;
    memmove(u->waiting, u->waiting + 1, u->waiting_count * sizeof *u->waiting);
    if (!connect_ecu(p, next))
        refuse_plain(p, next);
}

static const char too_many[] = "the port has as many clients as it takes (clients: max)";

/* Turns a client away, and says why. */
static void turn_away(port *p, int fd, int code, const char *why)
{
    member away;
    member_open(&away, fd, 0);
    member_refuse(&away, MESSAGE_HELLO, code, why);
    member_close(&away);
    p->stats.refused++;
}

static void take_client(port *p, int fd)
{
    port_unix *u = own(p);
    unsigned place = 0;
    while (place < PORT_CLIENTS_MAX && u->programs[place].state != MEMBER_NONE)
        place++;
    if (place == PORT_CLIENTS_MAX) {
        turn_away(p, fd, EBUSY, too_many);
        return;
    }
    if (!prepare(fd) || !watch(p, fd, place)) {
        turn_away(p, fd, errno, strerror(errno));
        return;
    }
    u->last_id += u->last_id == UINT32_MAX ? 2 : 1;
    member_open(&u->programs[place], fd, u->last_id);
    u->client_count++;
    p->shared = true;
    p->stats.connected++;
}

static void disconnect_client(port *p, member *c)
{
    port_unix *u = own(p);
    member_close(c);
    u->client_count--;
    p->shared = u->client_count > 0;
    if (!p->shared)
        underway_free(&u->underway);
}

/* Returns true for the socket of a client: bind() has given it an abstract address. */
static bool is_client(const struct sockaddr_un *address, socklen_t size)
{
    return size > sizeof address->sun_family && address->sun_path[0] == '\0';
}

/* Accepts waiting connections. Behind an ECU that has got the place it stops: that one may have
 * gone by now. The next read sees that, and accepts the next one. */
static void accept_waiting(port *p)
{
    port_unix *u = own(p);
    for (unsigned i = 0; u->listener.fd >= 0 && i < ACCEPTS_MAX; i++) {
        struct sockaddr_un address = {.sun_family = AF_UNIX};
        socklen_t size = sizeof address;
        int fd = accept4(u->listener.fd, (struct sockaddr *)&address, &size,
                         SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0) {
            set_deaf(p, errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS);
            return;
        }
        set_deaf(p, false);
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
    int received = port_receive(p, ecu_of(p), max);
    bool reported = received < 0 && errno == ECONNRESET;
    own(p)->programs[PLAIN].peeked = false;
    return reported ? port_receive(p, ecu_of(p), max) : received;
}

/* Reads up to max messages of the plain ECU. Returns the number of frames; *waits: more may be
 * there. */
static unsigned read_plain(port *p, port_frame *frames, unsigned max, bool *waits)
{
    const int received = receive(p, max);
    const bool nothing = received < 0 && (errno == EAGAIN || errno == EINTR);
    const int count = messages_before_end(p, received);
    note_size(p, count);
    const bool gone = !nothing && (count < received || received < 0);
    *waits = count == (int)max || gone; /* another ECU may wait for the place */
    if (nothing)
        refuse_waiting(p);
    else if (gone)
        disconnect_ecu(p);
    const unsigned taken = port_take(p, frames, count);
    own(p)->programs[PLAIN].read += gone ? 0 : taken;
    return taken;
}

/* Sends a frame. An ECU that has gone stays connected here, since its earlier frames are still
 * unread. */
static port_sent send_plain(port *p, const void *frame, size_t size)
{
    if (ecu_of(p) < 0 || (size == CANFD_MTU && !own(p)->takes_fd))
        return PORT_UNHEARD;
    if (send(ecu_of(p), frame, size, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)size) {
        own(p)->programs[PLAIN].written++;
        return PORT_SENT;
    }
    bool gone = errno == EPIPE || errno == ECONNRESET || errno == ENOTCONN;
    return gone ? PORT_UNHEARD : PORT_SEND_FAILED;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Finds what waits, a set of programs. Asking first is cheapest: accept4() makes a socket before it
 * finds no connection. */
static uint64_t look(port *p)
{
    struct epoll_event events[WATCHED_MAX];
    const port_unix *u = own(p);
    const int count = epoll_wait(p->fd, events, u->client_count > 0 ? WATCHED_MAX : 2, 0);
    bool connections = count < 0 || u->deaf;
    uint64_t ready = count < 0 ? PLAIN_BIT : 0;
    for (int i = 0; i < count; i++)
        if (events[i].data.u32 == LISTENER)
            connections = true;
        else
            ready |= UINT64_C(1) << events[i].data.u32;
    if (connections) {
        accept_waiting(p);
        ready |= PLAIN_BIT; /* perhaps a new one; if it is an old one, the next may be refused */
    }
    return ecu_of(p) >= 0 ? ready : ready & ~PLAIN_BIT;
}

/* Chooses a program of a set. In general it is the one whose message was sent first. While frames
 * have to wait it is the next one, so that one with many frames does not delay the others. */
static unsigned choose(port *p, uint64_t ready)
{
    port_unix *u = own(p);
    unsigned chosen = (unsigned)__builtin_ctzll(ready);
    int64_t first_ns = INT64_MAX;
    if ((ready & (ready - 1)) == 0)
        return chosen;
    const uint64_t behind = ready & (u->turn < PLAIN ? ~UINT64_C(0) << (u->turn + 1) : 0);
    if (u->crowded)
        return behind ? (unsigned)__builtin_ctzll(behind) : chosen;
    for (; ready; ready &= ready - 1) {
        const unsigned i = (unsigned)__builtin_ctzll(ready);
        const int64_t next_ns = member_next_ns(&u->programs[i]);
        if (next_ns >= first_ns)
            continue;
        first_ns = next_ns;
        chosen = i;
    }
    return chosen;
}

static unsigned count_there(const port_unix *u)
{
    unsigned count = 0;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        count += u->programs[i].state == MEMBER_THERE;
    return count;
}

/* Answers a hello. At a door the client waits, and is not read meanwhile. */
static void greet(port *p, member *c)
{
    if (own(p)->use == FOR_GUESTS) {
        (void)epoll_ctl(p->fd, EPOLL_CTL_DEL, c->fd, NULL);
        return;
    }
    if (count_there(own(p)) < own(p)->sharing.max) {
        member_welcome(c, own(p)->node, own(p)->sharing.fd);
        return;
    }
    member_refuse(c, MESSAGE_HELLO, EBUSY, too_many);
    p->stats.refused++;
    disconnect_client(p, c);
}

/* Reads a message of a client. Returns true when more may wait. */
static bool read_client(port *p, member *c, port_frame *frames, unsigned *count)
{
    const member_result result = member_read(c, p, frames);
    *count = result == MEMBER_FRAME;
    p->stats.read += *count;
    if (result == MEMBER_GREETS)
        greet(p, c);
    else if (result == MEMBER_GONE)
        disconnect_client(p, c);
    return (c->state == MEMBER_NEW || c->state == MEMBER_THERE) && result != MEMBER_NOTHING;
}

/* Reads messages of several programs. Returns the number of frames; *more: some may wait. */
static unsigned read_shared(port *p, port_frame *frames, unsigned max, bool *more, uint64_t ready)
{
    port_unix *u = own(p);
    unsigned count = 0;
    for (unsigned messages = 0; ready && count < max && messages < max + CONTROLS_MAX; messages++) {
        const unsigned i = choose(p, ready);
        unsigned some;
        bool waits;
        u->turn = i;
        if (i == PLAIN)
            some = read_plain(p, frames + count, 1, &waits);
        else
            waits = read_client(p, &u->programs[i], frames + count, &some);
        count += some;
        if (!waits || (i == PLAIN && ecu_of(p) < 0))
            ready &= ~(UINT64_C(1) << i);
    }
    *more = ready != 0;
    u->crowded = u->crowded && *more;
    if (count > 0)
        (void)look(p); /* a program that has connected before a frame was sent sees it */
    return count;
}

static unsigned read_frames(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    const uint64_t ready = look(p);
    *more = false;
    if (own(p)->client_count > 0)
        return read_shared(p, frames, max, more, ready);
    return ready ? read_plain(p, frames, max, more) : 0;
}

/* ---- Sending --------------------------------------------------------------------------------- */

static message_head head_of(const port *p, message_type type)
{
    return (message_head){.type = (uint8_t)type,
                          .realtime_ns = (uint64_t)p->now_realtime_ns,
                          .bus_ns = text_ticks_ns(p->now_tick)};
}

/* Sends a frame to a client, if it takes it. */
static port_sent send_client(port *p, member *c, const message_head *head, const void *frame,
                             size_t size)
{
    const uint32_t lost = c->lost;
    if (!member_takes(c, frame, size))
        return PORT_UNHEARD;
    const bool sent = member_send(c, head, frame, size);
    p->stats.clients_lost += c->lost != lost;
    return sent ? PORT_SENT : c->lost != lost ? PORT_SEND_FAILED : PORT_UNHEARD;
}

/* Sends a frame of the bus to all. It counts as written when one of them has got it, and as failed
 * when one has no room and none has got it. */
static port_sent send_frame(port *p, const void *frame, size_t size)
{
    port_unix *u = own(p);
    port_sent result = send_plain(p, frame, size);
    const message_head head = head_of(p, MESSAGE_FRAME);
    for (unsigned i = 0; u->client_count > 0 && i < PORT_CLIENTS_MAX; i++) {
        const port_sent one = send_client(p, &u->programs[i], &head, frame, size);
        if (one == PORT_SENT || (one == PORT_SEND_FAILED && result == PORT_UNHEARD))
            result = one;
    }
    return result;
}

/* Sends a frame of one program to the others. */
static void pass_on(port *p, const port_frame *frame)
{
    port_unix *u = own(p);
    struct canfd_frame out;
    const size_t size = port_make_frame(&out, &frame->frame);
    message_head head = head_of(p, MESSAGE_FRAME);
    head.flags = MESSAGE_LOCAL;
    if (frame->client != 0)
        p->stats.echoed += send_plain(p, &out, size) == PORT_SENT;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (u->programs[i].id != frame->client)
            p->stats.echoed += send_client(p, &u->programs[i], &head, &out, size) == PORT_SENT;
}

static member *find_client(port_unix *u, uint32_t id)
{
    for (unsigned i = 0; id != 0 && i < PORT_CLIENTS_MAX; i++)
        if (u->programs[i].id == id)
            return &u->programs[i];
    return NULL;
}

/* Sends a frame back to its sender. */
static void give_back(port *p, member *sender, const port_frame *frame)
{
    struct canfd_frame out;
    const size_t size = port_make_frame(&out, &frame->frame);
    message_head head = head_of(p, MESSAGE_FRAME);
    head.flags = MESSAGE_LOCAL | MESSAGE_OWN;
    head.number = frame->number;
    p->stats.echoed += send_client(p, sender, &head, &out, size) == PORT_SENT;
}

/* Tells the sender of a frame that it will not be sent. */
static void tell_dropped(member *sender, const port *p, const port_frame *frame, cw_drop why)
{
    message_head head = head_of(p, MESSAGE_DROPPED);
    head.number = frame->number;
    member_tell(sender, &head, why == CW_DROP_QUEUE_FULL ? ENOBUFS : ENETDOWN, cw_drop_name(why));
}

/* The plain ECU's frames loop back always, since it cannot choose. */
static bool loops_back(const port_frame *frame)
{
    return frame->client == 0 || (frame->options & MESSAGE_LOOPBACK);
}

static bool comes_back(const port_frame *frame)
{
    const uint32_t both = MESSAGE_LOOPBACK | MESSAGE_RECV_OWN;
    return frame->client != 0 && (frame->options & both) == both;
}

static void handed_in(port *p, const port_frame *frame)
{
    port_unix *u = own(p);
    const bool late = u->sharing.echo == PORT_ECHO_SENT && loops_back(frame);
    const bool told = frame->client != 0 && (frame->options & MESSAGE_TELL_DROPPED);
    if (late || told || comes_back(frame))
        p->stats.unconfirmed += !underway_add(&u->underway, frame, p->now_tick);
    if (!late && loops_back(frame))
        pass_on(p, frame);
}

static void ended(port *p, const cw_event *event)
{
    port_unix *u = own(p);
    port_frame frame;
    if (!underway_take(&u->underway, &frame, event))
        return;
    member *sender = find_client(u, frame.client);
    if (event->kind == CW_EVENT_TX) {
        if (u->sharing.echo == PORT_ECHO_SENT && loops_back(&frame))
            pass_on(p, &frame);
        if (sender && comes_back(&frame))
            give_back(p, sender, &frame);
    } else if (sender && (frame.options & MESSAGE_TELL_DROPPED)) {
        tell_dropped(sender, p, &frame, (cw_drop)event->why);
    }
}

/* ---- Sharing --------------------------------------------------------------------------------- */

static void share(port *p, const port_sharing *sharing)
{
    port_unix *u = own(p);
    u->sharing = *sharing;
    (void)snprintf(u->node, sizeof u->node, "%s", sharing->node);
    u->sharing.node = u->node;
}

static void crowd(port *p)
{
    own(p)->crowded = true;
}

/* Returns true when the client of a guest has gone. Messages that it has sent before may wait, when
 * the node's queue is full. */
static bool is_over(const port *p)
{
    const port_unix *u = own_const(p);
    struct pollfd only = {.fd = u->programs[0].fd};
    if (u->use != FOR_ONE)
        return false;
    return u->client_count == 0 || (poll(&only, 1, 0) == 1 && (only.revents & POLLHUP));
}

static bool describe(const port *p, unsigned n, port_client_info *out)
{
    const port_unix *u = own_const(p);
    for (unsigned k = 0; k <= PORT_CLIENTS_MAX; k++) {
        const unsigned i = (PLAIN + k) % (PORT_CLIENTS_MAX + 1); /* the plain ECU first */
        const member *c = &u->programs[i];
        if (i == PLAIN ? c->fd < 0 : c->state != MEMBER_THERE)
            continue;
        if (n-- > 0)
            continue;
        *out = (port_client_info){.name = i == PLAIN ? NULL : c->name,
                                  .read = c->read,
                                  .written = c->written,
                                  .lost = c->lost};
        return true;
    }
    return false;
}

/* ---- Opening and closing --------------------------------------------------------------------- */

static void close_port(port *p)
{
    port_unix *u = own(p);
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        member_close(&u->programs[i]);
    while (u->waiting_count > 0)
        (void)close(u->waiting[--u->waiting_count]);
    if (ecu_of(p) >= 0)
        (void)close(ecu_of(p));
    underway_free(&u->underway);
    pathsocket_close(&own(p)->listener);
    if (p->fd >= 0)
        (void)close(p->fd);
    free(p);
}

static const port_kind unix_kind = {.close = close_port,
                                    .read = read_frames,
                                    .send = send_frame,
                                    .share = share,
                                    .crowd = crowd,
                                    .handed_in = handed_in,
                                    .ended = ended,
                                    .client = describe,
                                    .is_over = is_over,
                                    .control_bytes = PORT_STAMP_BYTES};

static port *make_port(void)
{
    port *p = port_new(&unix_kind, sizeof(port_unix));
    if (!p)
        return NULL;
    own(p)->listener = (pathsocket)PATHSOCKET_NONE;
    own(p)->programs[PLAIN].fd = -1;
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
    if (good && watch(p, own(p)->listener.fd, LISTENER))
        return p;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "unix:%s: %s", path, *why ? why : strerror(errno));
    if (p)
        close_port(p);
    return NULL;
}

/* ---- Doors ----------------------------------------------------------------------------------- */

port *port_unix_open_door(const char *path, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = port_unix_open(path, error);
    if (p)
        own(p)->use = FOR_GUESTS;
    return p;
}

static member *first_waiting(port_unix *u)
{
    member *first = NULL;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (u->programs[i].state == MEMBER_WAITS && (!first || u->programs[i].id < first->id))
            first = &u->programs[i];
    return first;
}

const char *door_next(const port *door)
{
    const member *first = first_waiting((port_unix *)(uintptr_t)door);
    return first ? first->name : NULL;
}

port *door_admit(port *door)
{
    member *first = first_waiting(own(door));
    port *p = first ? make_port() : NULL;
    if (!p || !watch(p, first->fd, 0)) {
        port_close(p);
        return NULL;
    }
    port_unix *u = own(p);
    u->use = FOR_ONE;
    u->programs[0] = *first;
    u->client_count = 1;
    p->shared = true;
    p->stats.connected = 1;
    *first = (member){.state = MEMBER_NONE, .fd = -1};
    own(door)->client_count--;
    return p;
}

void door_welcome(port *admitted)
{
    port_unix *u = own(admitted);
    member_welcome(&u->programs[0], u->node, u->sharing.fd);
}

void door_refuse(port *door, int code, const char *text)
{
    member *first = first_waiting(own(door));
    if (!first)
        return;
    member_refuse(first, MESSAGE_HELLO, code, text);
    door->stats.refused++;
    disconnect_client(door, first);
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
