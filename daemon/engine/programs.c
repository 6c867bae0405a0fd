/* SPDX-License-Identifier: MIT
 *
 * programs.c - the connections of programs that have joined virtual time.
 *
 * A connection ends with its program, or when that becomes another program (exec). The end of the
 * process tells one from the other. Until then, or until the process has connected again, its place
 * is kept and time holds.
 */
#include "engine/programs.h"

#include "base/log.h"
#include "base/file/pathsocket.h"
#include "canwire.h"
#include "port/kind.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#define BACKLOG 64
#define ACCEPTS_MAX 16u
#define MESSAGES_MAX 16u /* of one program at one wake-up */
#define CONNECTIONS_MAX (TURNS_MAX + 16u)

typedef struct connection {
    ev_io io; /* first: the callback gets a pointer to it */
    ev_io end; /* of the process, while its place is kept */
    programs *owner;
    int fd;         /* -1: none */
    int pidfd;      /* -1: none */
    int pid;        /* of the process that has connected */
    unsigned place; /* of its turns; TURNS_NONE before it has joined */
} connection;

struct programs {
    struct ev_loop *loop;
    const programs_calls *calls;
    void *user;
    pathsocket listener;
    ev_io coming;
    turns turns;
    connection all[CONNECTIONS_MAX];
};

/* ---- Ends ------------------------------------------------------------------------------------ */

/* Closes the connection. The place of the program is kept or forgotten apart from that. */
static void hang_up(connection *c)
{
    if (c->fd >= 0) {
        ev_io_stop(c->owner->loop, &c->io);
        (void)close(c->fd);
    }
    c->fd = -1;
}

/* Forgets a program, for which virtual time then waits no more. */
static void programs_forget(connection *c)
{
    hang_up(c);
    if (c->pidfd >= 0) {
        ev_io_stop(c->owner->loop, &c->end);
        (void)close(c->pidfd);
    }
    if (c->place != TURNS_NONE)
        turns_remove(&c->owner->turns, c->place);
    c->pidfd = -1;
    c->place = TURNS_NONE;
}

/* The process of a kept place has ended: virtual time goes on without it. */
static void on_process_end(struct ev_loop *loop, ev_io *io, int events)
{
    connection *c = io->data;
    (void)loop;
    (void)events;
    programs_forget(c);
    c->owner->calls->changed(c->owner->user);
}

/* Returns a descriptor that is readable when the process has ended. glibc 2.35 has no function for
 * it. */
static int open_process(int pid)
{
    return (int)syscall(SYS_pidfd_open, pid, 0);
}

/* Keeps the place of a program whose connection has ended until its process has. */
static void keep_place(connection *c)
{
    turn *one = &c->owner->turns.all[c->place];
    const int pidfd = open_process(one->pid);
    hang_up(c);
    if (pidfd < 0) {
        programs_forget(c);
        return;
    }
    one->state = TURN_ENDS;
    c->pidfd = pidfd;
    ev_io_init(&c->end, on_process_end, pidfd, EV_READ);
    c->end.data = c;
    ev_io_start(c->owner->loop, &c->end);
}

/* A connection has ended. One that has not joined has no place to keep. */
static void programs_lose(connection *c)
{
    if (c->place == TURNS_NONE)
        programs_forget(c);
    else
        keep_place(c);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Tells a program why it cannot join virtual time. */
static void programs_refuse(connection *c, int code, const char *why)
{
    timing_message m = {.head = {.type = TIMING_ERROR, .number = TIMING_JOIN}};
    m.error.code = (uint32_t)code;
    (void)snprintf(m.error.text, sizeof m.error.text, "%s", why);
    m.head.size = (uint16_t)(sizeof m.head + sizeof m.error);
    (void)send(c->fd, &m, m.head.size, MSG_DONTWAIT | MSG_NOSIGNAL);
    log_warning("virtual time: a program is refused: %s", why);
    programs_forget(c);
}

/* Forgets the place of the program that the process was before. */
static void take_place_of(programs *p, int pid)
{
    for (unsigned i = 0; i < CONNECTIONS_MAX; i++) {
        connection *c = &p->all[i];
        if (c->pidfd >= 0 && p->turns.all[c->place].pid == pid)
            programs_forget(c);
    }
}

/* The words are for people, and order programs: what is not ASCII does not matter. */
static void clean(char *words)
{
    for (; *words; words++)
        if (*words < ' ' || *words > '~')
            *words = '?';
}

/* A program joins virtual time. The one that its process was before loses its place. */
static void programs_join(connection *c, timing_join *said, size_t size)
{
    programs *p = c->owner;
    if (size < sizeof *said || memcmp(said->magic, MESSAGE_MAGIC, sizeof said->magic) != 0 ||
        said->version != TIMING_VERSION) {
        programs_refuse(c, EPROTO, "expected a message JOIN of version 1");
        return;
    }
    said->node[sizeof said->node - 1] = '\0';
    said->program[sizeof said->program - 1] = '\0';
    clean(said->program);
    if (said->pid == 0)
        said->pid = c->pid;
    const unsigned node = p->calls->find_node(p->user, said->node);
    take_place_of(p, said->pid);
    c->place = turns_add(&p->turns, node, said);
    if (c->place == TURNS_NONE)
        programs_refuse(c, EBUSY, "there are 64 programs, which is the most");
}

/* Does what a message says. */
static void programs_obey(connection *c, timing_message *m, size_t size)
{
    turns *t = &c->owner->turns;
    if (c->place == TURNS_NONE) {
        if (m->head.type == TIMING_JOIN)
            programs_join(c, &m->join, size - sizeof m->head);
        else
            programs_refuse(c, EPROTO, "the first message must be JOIN");
    } else if (m->head.type == TIMING_CANCEL) {
        turns_cancel(t, c->place);
    } else if (m->head.type == TIMING_WAIT && t->all[c->place].state == TURN_RUNS) {
        const uint64_t until_ns = m->head.bus_ns;
        turns_wait(t, c->place, until_ns < INT64_MAX ? (int64_t)until_ns : TIMING_NEVER,
                   m->head.flags);
    } else if (m->head.type == TIMING_CHILDREN && t->all[c->place].state == TURN_RUNS) {
        turns_wait_for_children(t, c->place);
    } else {
        programs_refuse(c, EPROTO, "a message that does not fit its turn");
    }
}

/* Reads what a program has said. Returns true when there was something. */
static bool read_messages(connection *c)
{
    bool any = false;
    for (unsigned i = 0; c->fd >= 0 && i < MESSAGES_MAX; i++) {
        timing_message m = {.head = {.type = 0}};
        const ssize_t size = recv(c->fd, &m, sizeof m, MSG_DONTWAIT);
        if (size < 0 && (errno == EAGAIN || errno == EINTR))
            return any;
        any = true;
        if (size >= (ssize_t)sizeof m.head)
            programs_obey(c, &m, (size_t)size);
        else
            programs_lose(c);
    }
    return any;
}

/* A message may end a turn, so that time may go on. */
static void on_message(struct ev_loop *loop, ev_io *io, int events)
{
    connection *c = (connection *)io;
    (void)loop;
    (void)events;
    if (read_messages(c))
        c->owner->calls->changed(c->owner->user);
}

void programs_tell_now(programs *p, unsigned place, int64_t bus_ns, int64_t realtime_ns)
{
    const message_head head = {.type = TIMING_NOW,
                               .size = sizeof head,
                               .bus_ns = (uint64_t)bus_ns,
                               .realtime_ns = (uint64_t)realtime_ns};
    for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
        if (p->all[i].place == place && p->all[i].fd >= 0)
            (void)send(p->all[i].fd, &head, sizeof head, MSG_DONTWAIT | MSG_NOSIGNAL);
}

/* ---- Coming ---------------------------------------------------------------------------------- */

/* Returns a connection that is free: closed, and without a place that is kept. NULL: there is
 * none. */
static connection *find_room(programs *p)
{
    for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
        if (p->all[i].fd < 0 && p->all[i].place == TURNS_NONE)
            return &p->all[i];
    return NULL;
}

/* Takes a connection. Its first message may be there already. */
static void programs_take(programs *p, int fd)
{
    connection *c = find_room(p);
    if (!c) {
        (void)close(fd);
        return;
    }
    c->fd = fd;
    c->pid = port_peer_of(fd);
    ev_io_init(&c->io, on_message, fd, EV_READ);
    ev_io_start(p->loop, &c->io);
    (void)read_messages(c);
}

void programs_let_in(programs *p)
{
    for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
        if (p->all[i].fd >= 0 && p->all[i].place == TURNS_NONE)
            (void)read_messages(&p->all[i]); /* it came before its JOIN did */
    for (unsigned i = 0; i < ACCEPTS_MAX; i++) {
        const int fd = accept4(p->listener.fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd < 0)
            break;
        programs_take(p, fd);
    }
}

static void on_coming(struct ev_loop *loop, ev_io *io, int events)
{
    programs *p = io->data;
    (void)loop;
    (void)events;
    programs_let_in(p);
    p->calls->changed(p->user);
}

/* ---- Begin and end --------------------------------------------------------------------------- */

programs *programs_open(struct ev_loop *loop, const char *path, const char *where,
                        const programs_calls *calls, void *user)
{
    char error[PATHSOCKET_ERROR_MAX] = "out of memory";
    programs *p = calloc(1, sizeof *p);
    if (p) {
        *p = (programs){.loop = loop, .calls = calls, .user = user};
        p->listener = (pathsocket)PATHSOCKET_NONE;
        for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
            p->all[i] = (connection){.owner = p, .fd = -1, .pidfd = -1, .place = TURNS_NONE};
        if (pathsocket_open(&p->listener, path, SOCK_SEQPACKET, BACKLOG, "virtual", error))
            return p;
    }
    log_error("%s: virtual: %s: %s", where, path, error);
    programs_close(p);
    return NULL;
}

void programs_begin(programs *p)
{
    ev_io_init(&p->coming, on_coming, p->listener.fd, EV_READ);
    p->coming.data = p;
    ev_io_start(p->loop, &p->coming);
}

void programs_close(programs *p)
{
    if (!p)
        return;
    for (unsigned i = 0; i < CONNECTIONS_MAX; i++)
        programs_forget(&p->all[i]);
    ev_io_stop(p->loop, &p->coming);
    pathsocket_close(&p->listener);
    free(p);
}

turns *programs_turns(programs *p)
{
    return &p->turns;
}
