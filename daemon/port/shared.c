/* SPDX-License-Identifier: MIT
 *
 * shared.c - the programs at a port, which take turns and see each other's frames.
 */
#include "port/shared.h"

#include "base/moment.h"
#include "base/text/number.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#define PLAIN SHARED_PLAIN
#define PLAIN_BIT (UINT64_C(1) << PLAIN)
#define CONTROLS_MAX 256u /* messages of one read that are not frames */

static port_shared *shared_own(port *p)
{
    return (port_shared *)p;
}

static int ecu_of(const port *p)
{
    return ((const port_shared *)p)->programs[PLAIN].fd;
}

/* ---- Programs come and go -------------------------------------------------------------------- */

bool shared_watch(const port *p, int fd, unsigned what)
{
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = what};
    return epoll_ctl(p->fd, EPOLL_CTL_ADD, fd, &event) == 0;
}

void shared_set_deaf(port *p, int listener, bool deaf)
{
    port_shared *s = shared_own(p);
    if (deaf && !s->deaf)
        s->deaf = epoll_ctl(p->fd, EPOLL_CTL_DEL, listener, NULL) == 0;
    else if (!deaf && s->deaf)
        s->deaf = !shared_watch(p, listener, SHARED_LISTENER);
}

/* Asks for room for frames that the program has not read yet, as far as the kernel allows. */
bool shared_prepare(int fd, int room)
{
    const int on = 1;
    if (setsockopt(fd, SOL_SOCKET, SO_SNDBUFFORCE, &room, sizeof room) != 0)
        (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) == 0;
}

static const char too_many[] = "the port has as many clients as it takes (clients: max)";

/* Turns a client away, and says why. */
static void turn_away(port *p, int fd, int code, const char *why)
{
    member away;
    p->stats.refused++;
    if (!member_open(&away, shared_own(p)->ways->member, fd, 0)) {
        (void)close(fd);
        return;
    }
    member_refuse(&away, MESSAGE_HELLO, code, why);
    port_note_told(p, away.pid, PORT_TOLD_MESSAGE);
    member_close(&away);
}

/* Returns the first free place for a client, PORT_CLIENTS_MAX when all are taken. */
static unsigned free_place(const port_shared *s)
{
    unsigned place = 0;
    while (place < PORT_CLIENTS_MAX && s->programs[place].state != MEMBER_NONE)
        place++;
    return place;
}

/* Returns true for a connection whose hello has not come, and does not wait to be read. */
static bool is_silent(const member *c)
{
    return c->state == MEMBER_NEW && !member_waits(c);
}

/* Returns true for a program that has gone while what it has sent waits. A controller decides
 * whether its node is on the bus, so its end is for the node to see first. */
static bool has_left(const member *c)
{
    return c->state == MEMBER_THERE && !(c->options & MESSAGE_CONTROLLER) && member_has_gone(c);
}

/* Returns the one that has come first of those that something is true of; NULL: of none. */
static member *find_oldest(port_shared *s, bool (*is_true)(const member *c))
{
    member *oldest = NULL;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++) {
        member *c = &s->programs[i];
        if ((!oldest || (int32_t)(c->id - oldest->id) < 0) && is_true(c))
            oldest = c;
    }
    return oldest;
}

/* Returns a place for a client, PORT_CLIENTS_MAX without one. When all are taken, a connection
 * that has said nothing gives way, or a program that has gone and has left frames. Otherwise those
 * could keep others out. */
static unsigned make_place(port *p)
{
    static const char why[] = "nothing was said here, and another program has come";
    port_shared *s = shared_own(p);
    const unsigned place = free_place(s);
    if (place < PORT_CLIENTS_MAX)
        return place;
    member *silent = find_oldest(s, is_silent);
    member *left = silent ? NULL : find_oldest(s, has_left);
    if (silent) {
        p->stats.gave_way++;
        member_refuse(silent, MESSAGE_HELLO, ETIMEDOUT, why);
        shared_disconnect(p, silent);
    } else if (left) {
        p->stats.kernel_dropped += left->kind->lose(left);
        shared_disconnect(p, left);
    }
    return free_place(s);
}

/* Counts a client that has a place now. */
static void count_in(port *p, member *c)
{
    port_shared *s = shared_own(p);
    s->last_id += s->last_id == UINT32_MAX ? 2 : 1;
    c->id = s->last_id;
    s->client_count++;
    p->shared = true;
    p->stats.connected++;
}

void shared_take_client(port *p, int fd)
{
    port_shared *s = shared_own(p);
    const unsigned place = make_place(p);
    if (place == PORT_CLIENTS_MAX) {
        turn_away(p, fd, EUSERS, too_many);
        return;
    }
    if (!shared_watch(p, fd, place) || !member_open(&s->programs[place], s->ways->member, fd, 0)) {
        turn_away(p, fd, errno, strerror(errno));
        return;
    }
    count_in(p, &s->programs[place]);
}

/* Forgets a client that has no place here any more. */
static void count_out(port *p)
{
    port_shared *s = shared_own(p);
    s->client_count--;
    p->shared = s->client_count > 0;
    if (!p->shared)
        underway_free(&s->underway);
}

/* A node without its controller leaves the bus. */
static void lose_controller(port *p)
{
    p->commands->next = (port_command){.order = MESSAGE_OFF};
    p->commands->waits = true;
    p->commands->told_any = false;
    p->commands->told = (message_state){.state = 0};
}

/* Closes a client. In virtual time its program may wait for messages, and gets the end instead. */
void shared_disconnect(port *p, member *c)
{
    if (p->commands && c->state == MEMBER_THERE && (c->options & MESSAGE_CONTROLLER))
        lose_controller(p);
    port_note_told(p, c->pid, PORT_TOLD_MESSAGE);
    member_close(c);
    count_out(p);
}

member *shared_move(port *from, member *c, port *to)
{
    const unsigned place = make_place(to);
    if (place == PORT_CLIENTS_MAX || !shared_watch(to, c->fd, place))
        return NULL;
    (void)epoll_ctl(from->fd, EPOLL_CTL_DEL, c->fd, NULL);
    member *moved = &shared_own(to)->programs[place];
    *moved = *c;
    *c = (member){.state = MEMBER_NONE, .fd = -1};
    from->stats.connected--;
    count_out(from);
    count_in(to, moved);
    return moved;
}

/* ---- Time ------------------------------------------------------------------------------------ */

bool shared_add_timer(port *p)
{
    wake_alarm *timer = &shared_own(p)->timer;
    return alarm_open(timer) && shared_watch(p, timer->fd, SHARED_TIMER);
}

void shared_wake_at(port *p, int64_t ns)
{
    if (ns != 0)
        (void)alarm_set_earlier(&shared_own(p)->timer, ns);
}

/* Sets the timer for all programs. */
static void wake_for_all(port *p)
{
    port_shared *s = shared_own(p);
    if (s->timer.fd < 0)
        return;
    for (unsigned i = 0; s->client_count > 0 && i < PORT_CLIENTS_MAX; i++)
        if (s->programs[i].state != MEMBER_NONE)
            shared_wake_at(p, s->programs[i].wake_ns);
}

/* Returns the programs that have wanted to be looked at by now. */
static uint64_t on_time(port *p)
{
    port_shared *s = shared_own(p);
    uint64_t ready = 0;
    const int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    (void)alarm_take(&s->timer);
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (s->programs[i].state != MEMBER_NONE && s->programs[i].wake_ns != 0 &&
            s->programs[i].wake_ns <= now_ns)
            ready |= UINT64_C(1) << i;
    return ready;
}

/* Watches for room in the socket of a client while it has half a message. */
static void watch_room(const port *p, member *c, unsigned place)
{
    struct epoll_event event = {.events = EPOLLIN | (c->stuck ? EPOLLOUT : 0),
                                .data.u32 = place};
    if (c->stuck != c->room_watched && epoll_ctl(p->fd, EPOLL_CTL_MOD, c->fd, &event) == 0)
        c->room_watched = c->stuck;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Finds what waits, a set of programs. Asking first is cheapest: accept4() makes a socket before it
 * finds no connection. */
static uint64_t shared_look(port *p)
{
    struct epoll_event events[SHARED_WATCHED_MAX];
    port_shared *s = shared_own(p);
    const int count = epoll_wait(p->fd, events, s->client_count > 0 ? SHARED_WATCHED_MAX : 2, 0);
    bool connections = count < 0 || s->deaf;
    uint64_t ready = count < 0 ? PLAIN_BIT : 0;
    for (int i = 0; i < count; i++)
        if (events[i].data.u32 == SHARED_LISTENER)
            connections = true;
        else if (events[i].data.u32 == SHARED_TIMER)
            ready |= on_time(p);
        else
            ready |= UINT64_C(1) << events[i].data.u32;
    if (connections) {
        s->ways->accept(p);
        ready |= PLAIN_BIT; /* perhaps a new one; if it is an old one, the next may be refused */
    }
    return ecu_of(p) >= 0 ? ready : ready & ~PLAIN_BIT;
}

/* Chooses a program of a set. In general it is the one whose message was sent first. While frames
 * have to wait it is the next one, so that one with many frames does not delay the others. */
static unsigned shared_choose(port *p, uint64_t ready)
{
    port_shared *s = shared_own(p);
    unsigned chosen = (unsigned)__builtin_ctzll(ready);
    int64_t first_ns = INT64_MAX;
    if ((ready & (ready - 1)) == 0)
        return chosen;
    const uint64_t behind = ready & (s->turn < PLAIN ? ~UINT64_C(0) << (s->turn + 1) : 0);
    if (s->crowded)
        return behind ? (unsigned)__builtin_ctzll(behind) : chosen;
    for (; ready; ready &= ready - 1) {
        const unsigned i = (unsigned)__builtin_ctzll(ready);
        const int64_t next_ns = member_next_ns(&s->programs[i]);
        if (next_ns >= first_ns)
            continue;
        first_ns = next_ns;
        chosen = i;
    }
    return chosen;
}

/* Counts programs. One that has gone keeps no other out while its last frames wait. */
static unsigned count_there(const port_shared *s)
{
    unsigned count = 0;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        count += s->programs[i].state == MEMBER_THERE && !member_has_gone(&s->programs[i]);
    return count;
}

static member *find_controller(port_shared *s)
{
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (s->programs[i].state == MEMBER_THERE && (s->programs[i].options & MESSAGE_CONTROLLER))
            return &s->programs[i];
    return NULL;
}

/* Refuses a hello. */
static void send_off(port *p, member *c, int code, const char *why)
{
    member_refuse(c, MESSAGE_HELLO, code, why);
    p->stats.refused++;
    shared_disconnect(p, c);
}

void shared_greet(port *p, member *c)
{
    const bool controls = c->options & MESSAGE_CONTROLLER;
    if (controls && !p->commands)
        send_off(p, c, EOPNOTSUPP, "the node has its own controller; one of a port usb has not");
    else if (controls && find_controller(shared_own(p)))
        send_off(p, c, EBUSY, "the node has a controller already");
    else if (!controls && count_there(shared_own(p)) >= shared_own(p)->sharing.max)
        send_off(p, c, EUSERS, too_many);
    else
        member_welcome(c, shared_own(p)->node, shared_own(p)->sharing.fd);
    port_note_told(p, c->pid, PORT_TOLD_MESSAGE);
}

static void answer_flush(port *p, member *c);

/* Reads a message of a client. Returns true when more may wait. */
static bool read_client(port *p, member *c, port_frame *frames, unsigned *count)
{
    *count = 0;
    if (c->state == MEMBER_NONE) /* it has given way since it was found */
        return false;
    const int pid = c->pid;
    const member_result result = member_read(c, p, frames);
    *count = result == MEMBER_FRAME;
    if (*count && !frames->is_error) {
        p->stats.read++;
        shared_own(p)->traffic.frames_in++;
        shared_own(p)->traffic.bytes_in += cw_frame_length(&frames->frame);
    }
    if (result == MEMBER_GREETS)
        shared_own(p)->ways->greet(p, c);
    else if (result == MEMBER_GONE)
        shared_disconnect(p, c);
    else
        watch_room(p, c, (unsigned)(c - shared_own(p)->programs));
    if (result == MEMBER_CONTROL)
        answer_flush(p, c);
    if (result != MEMBER_NOTHING)
        port_note_told(p, pid, PORT_TOLD_ROOM);
    return (c->state == MEMBER_NEW || c->state == MEMBER_THERE) && result != MEMBER_NOTHING;
}

static bool is_alone(port *p)
{
    return shared_own(p)->client_count + (ecu_of(p) >= 0) < 2;
}

/* Reads messages of several programs. Returns the number of frames; *more: some may wait. */
static unsigned read_programs(port *p, port_frame *frames, unsigned max, bool *more,
                              uint64_t ready)
{
    port_shared *s = shared_own(p);
    unsigned count = 0;
    for (unsigned messages = 0; ready && count < max && messages < max + CONTROLS_MAX &&
                                !port_next_command(p);
         messages++) {
        const unsigned i = shared_choose(p, ready);
        unsigned some;
        bool waits;
        s->turn = i;
        if (i == PLAIN)
            some = s->ways->read_plain(p, frames + count, 1, &waits);
        else
            waits = read_client(p, &s->programs[i], frames + count, &some);
        count += some;
        if (!waits || (i == PLAIN && ecu_of(p) < 0))
            ready &= ~(UINT64_C(1) << i);
        if (!is_alone(p))
            ready |=
                shared_look(p); /* a filter that another one has sent meanwhile may come first */
    }
    *more = ready != 0 && !port_next_command(p);
    s->crowded = s->crowded && *more;
    if (count > 0)
        (void)shared_look(p); /* a program that has connected before a frame was sent sees it */
    return count;
}

unsigned shared_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    unsigned count = 0;
    *more = false;
    if (port_next_command(p))
        return 0;
    const uint64_t ready = shared_look(p);
    if (shared_own(p)->client_count > 0)
        count = read_programs(p, frames, max, more, ready);
    else if (ready)
        count = shared_own(p)->ways->read_plain(p, frames, max, more);
    wake_for_all(p);
    return count;
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
    watch_room(p, c, (unsigned)(c - shared_own(p)->programs));
    shared_wake_at(p, c->wake_ns);
    p->stats.clients_lost += c->lost != lost;
    if (sent)
        port_note_told(p, c->pid, PORT_TOLD_MESSAGE);
    return sent ? PORT_SENT : c->lost != lost ? PORT_SEND_FAILED : PORT_UNHEARD;
}

/* Sends a frame to the plain ECU, if there is one. */
static port_sent send_plain(port *p, const void *frame, size_t size)
{
    if (ecu_of(p) < 0)
        return PORT_UNHEARD;
    port_note_told(p, shared_own(p)->programs[PLAIN].pid, PORT_TOLD_MESSAGE);
    return shared_own(p)->ways->send_plain(p, frame, size);
}

/* Counts a frame of the bus; struct can_frame and struct canfd_frame have their length in one
 * place. */
static void count_sent(port_shared *s, const void *frame)
{
    struct can_frame begin;
    memcpy(&begin, frame, sizeof begin);
    if (begin.can_id & CAN_ERR_FLAG)
        return;
    s->traffic.frames_out++;
    s->traffic.bytes_out += begin.can_id & CAN_RTR_FLAG ? 0 : begin.len;
}

/* Sends a frame of the bus to all. It counts as written when one of them got it, and as failed
 * when one has no room and none got it. */
port_sent shared_send(port *p, const void *frame, size_t size)
{
    port_shared *s = shared_own(p);
    port_sent result = send_plain(p, frame, size);
    count_sent(s, frame);
    const message_head head = head_of(p, MESSAGE_FRAME);
    for (unsigned i = 0; s->client_count > 0 && i < PORT_CLIENTS_MAX; i++) {
        const port_sent one = send_client(p, &s->programs[i], &head, frame, size);
        if (one == PORT_SENT || (one == PORT_SEND_FAILED && result == PORT_UNHEARD))
            result = one;
    }
    return result;
}

/* Makes a frame of linux/can.h of what a program has sent. */
static size_t make_frame(struct canfd_frame *out, const port_frame *frame)
{
    return frame->is_error ? port_make_error(out, &frame->frame)
                           : port_make_frame(out, &frame->frame);
}

/* Sends a frame of one program to the others. */
static void shared_pass_on(port *p, const port_frame *frame)
{
    port_shared *s = shared_own(p);
    struct canfd_frame out;
    const size_t size = make_frame(&out, frame);
    message_head head = head_of(p, MESSAGE_FRAME);
    head.flags = MESSAGE_LOCAL;
    if (frame->client != 0)
        p->stats.echoed += send_plain(p, &out, size) == PORT_SENT;
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        if (s->programs[i].id != frame->client)
            p->stats.echoed += send_client(p, &s->programs[i], &head, &out, size) == PORT_SENT;
}

/* Returns the client that has sent a frame; NULL: it has gone, or the plain ECU has sent it (0). */
static member *find_client(port_shared *s, uint32_t id)
{
    for (unsigned i = 0; id != 0 && i < PORT_CLIENTS_MAX; i++)
        if (s->programs[i].id == id)
            return &s->programs[i];
    return NULL;
}

/* Sends a frame back to its sender. */
static void give_back(port *p, member *sender, const port_frame *frame)
{
    struct canfd_frame out;
    const size_t size = make_frame(&out, frame);
    message_head head = head_of(p, MESSAGE_FRAME);
    head.flags = MESSAGE_LOCAL | MESSAGE_OWN;
    head.number = frame->number;
    p->stats.echoed += send_client(p, sender, &head, &out, size) == PORT_SENT;
}

/* Tells the sender of a frame that it will not be sent. */
static void tell_dropped(member *sender, port *p, const port_frame *frame, cw_drop why)
{
    message_head head = head_of(p, MESSAGE_DROPPED);
    head.number = frame->number;
    member_tell(sender, &head, why == CW_DROP_QUEUE_FULL ? ENOBUFS : ENETDOWN, cw_drop_name(why));
    port_note_told(p, sender->pid, PORT_TOLD_MESSAGE);
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

static bool flushes(const port_frame *frame)
{
    return frame->client != 0 && (frame->options & MESSAGE_FLUSHES);
}

/* Answers a flush when no frame of the client is under way. */
static void answer_flush(port *p, member *c)
{
    const message_head head = head_of(p, MESSAGE_FLUSH);
    if (!c || !c->flushing || c->handed_in < c->flush_at ||
        underway_has(&shared_own(p)->underway, c->id))
        return;
    member_flushed(c, &head);
    port_note_told(p, c->pid, PORT_TOLD_MESSAGE);
}

/* Counts a frame of a client that may ask for a flush: those that were read before the question may
 * be handed in behind it. */
static void count_handed_in(port *p, const port_frame *frame)
{
    member *c = find_client(shared_own(p), frame->client);
    if (!c)
        return;
    c->handed_in++;
    answer_flush(p, c);
}

/* As on a vcan, the programs of an interface see an error frame that one of them writes. */
static void share_error(port *p, const port_frame *frame)
{
    member *sender = find_client(shared_own(p), frame->client);
    if (loops_back(frame))
        shared_pass_on(p, frame);
    if (sender && comes_back(frame))
        give_back(p, sender, frame);
}

void shared_handed_in(port *p, const port_frame *frame)
{
    port_shared *s = shared_own(p);
    if (frame->is_error) {
        share_error(p, frame);
        return;
    }
    const bool late = s->sharing.echo == PORT_ECHO_SENT && loops_back(frame);
    const bool told = frame->client != 0 && (frame->options & MESSAGE_TELL_DROPPED);
    if (late || told || comes_back(frame) || flushes(frame))
        p->stats.unconfirmed += !underway_add(&s->underway, frame, p->now_tick);
    if (flushes(frame))
        count_handed_in(p, frame);
    if (!late && loops_back(frame))
        shared_pass_on(p, frame);
}

void shared_ended(port *p, const cw_event *event)
{
    port_shared *s = shared_own(p);
    port_frame frame;
    if (!underway_take(&s->underway, &frame, event))
        return;
    member *sender = find_client(s, frame.client);
    if (event->kind == CW_EVENT_TX) {
        if (s->sharing.echo == PORT_ECHO_SENT && loops_back(&frame))
            shared_pass_on(p, &frame);
        if (sender && comes_back(&frame))
            give_back(p, sender, &frame);
    } else if (sender && (frame.options & MESSAGE_TELL_DROPPED)) {
        tell_dropped(sender, p, &frame, (cw_drop)event->why);
    }
    answer_flush(p, sender);
}

/* ---- The controller -------------------------------------------------------------------------- */

void shared_obeyed(port *p, const char *problem)
{
    member *controller = find_controller(shared_own(p));
    if (controller && problem)
        member_refuse(controller, MESSAGE_CONTROL, EINVAL, problem);
}

void shared_tell_state(port *p, const message_state *state)
{
    const message_head head = head_of(p, MESSAGE_STATE);
    member *controller = find_controller(shared_own(p));
    if (controller)
        member_tell_state(controller, &head, state);
}

void shared_settle(port *p)
{
    port_shared *s = shared_own(p);
    for (size_t i = 0; i < s->underway.count; i++) {
        const port_frame *frame = &s->underway.frames[i].frame;
        member *sender = find_client(s, frame->client);
        if (sender && comes_back(frame))
            give_back(p, sender, frame);
    }
    underway_free(&s->underway);
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        answer_flush(p, &s->programs[i]);
}

/* ---- Sharing --------------------------------------------------------------------------------- */

void shared_share(port *p, const port_sharing *sharing)
{
    port_shared *s = shared_own(p);
    s->sharing = *sharing;
    (void)snprintf(s->node, sizeof s->node, "%s", sharing->node);
    s->sharing.node = s->node;
}

void shared_crowd(port *p)
{
    shared_own(p)->crowded = true;
}

bool shared_client(const port *p, unsigned n, port_client_info *out)
{
    const port_shared *s = (const port_shared *)p;
    for (unsigned k = 0; k <= PORT_CLIENTS_MAX; k++) {
        const unsigned i = (PLAIN + k) % (PORT_CLIENTS_MAX + 1); /* the plain ECU first */
        const member *c = &s->programs[i];
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

void shared_close(port *p)
{
    port_shared *s = shared_own(p);
    for (unsigned i = 0; i < PORT_CLIENTS_MAX; i++)
        member_close(&s->programs[i]);
    if (ecu_of(p) >= 0)
        (void)close(ecu_of(p));
    underway_free(&s->underway);
    free(p->commands);
    alarm_close(&s->timer);
    if (p->fd >= 0)
        (void)close(p->fd);
    free(p);
}

port *shared_new(const port_kind *kind, const shared_ways *ways, size_t size)
{
    port *p = port_new(kind, size);
    if (!p)
        return NULL;
    shared_own(p)->ways = ways;
    shared_own(p)->timer = ALARM_CLOSED;
    shared_own(p)->programs[PLAIN].fd = -1;
    p->fd = epoll_create1(EPOLL_CLOEXEC);
    return p;
}
