/* SPDX-License-Identifier: MIT
 *
 * relay.c - a CAN socket that has several connections, or one that may come back.
 */
#include "preload/relay.h"

#include "preload/pump.h"
#include "preload/hooks/real.h"
#include "preload/wants.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define AGAIN_NS INT64_C(200000000) /* between two attempts to connect */
#define AT_ONCE 64                  /* messages of one connection, before those of others */

typedef struct relay_link {
    pump_item item;
    struct relay *relay;
    int number; /* of the interface */
} relay_link;

struct relay {
    cansock *socket;
    const relay_user *user;
    int inner;
    uint32_t lost; /* messages that the program had no room for */
    relay_link links[IFMAP_MAX];
};

/* ---- Messages -------------------------------------------------------------------------------- */

void relay_put(cansock *s, message_head *head, const void *body, size_t size)
{
    struct relay *r = s->relay;
    struct iovec parts[] = {{head, sizeof *head}, {(void *)(uintptr_t)body, size}};
    const struct msghdr whole = {.msg_iov = parts, .msg_iovlen = 2};
    head->size = (uint16_t)(sizeof *head + size);
    head->lost += r->lost;
    if (real()->sendmsg(r->inner, &whole, MSG_DONTWAIT | MSG_NOSIGNAL) < 0)
        r->lost += errno == EAGAIN || errno == ENOBUFS;
}

void relay_fail(cansock *s, int error)
{
    message m = {.head = {.type = MESSAGE_ERROR}};
    m.error.code = (uint32_t)error;
    (void)real()->send(s->relay->inner, &m, sizeof m.head + sizeof m.error.code,
                       MSG_DONTWAIT | MSG_NOSIGNAL);
}

/* Takes messages of one connection, up to a limit. Behind the limit the item is ready once more. */
static void read_link(relay_link *l)
{
    message m;
    for (int i = 0; i < AT_ONCE; i++) {
        const ssize_t size = real()->recv(l->item.fd, &m, sizeof m, MSG_DONTWAIT);
        if (size < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (size < 0 && errno == ECONNRESET)
            continue; /* its last messages wait behind that */
        if (size <= 0) {
            relay_lose(l->relay->socket, l->number);
            return;
        }
        if (m.head.type == MESSAGE_FRAME)
            l->relay->user->frame(l->relay->socket, l->number, &m, (size_t)size);
    }
    l->item.ready = true;
}

/* ---- Connections ----------------------------------------------------------------------------- */

/* Tries to connect, without the lock. The socket may have been closed meanwhile. */
static void revive(relay_link *l)
{
    cansock *s = l->relay->socket;
    const int number = l->number;
    conn_wants wants = l->relay->user->wants(s, number);
    wants.quiet = true;
    l->item.due_ns = PUMP_NEVER;
    s->uses++;
    table_unlock();
    const int fd = table_hide(conn_open(ifmap_at(number), &wants));
    wants_free(&wants);
    table_lock();
    if (s->descriptors > 0 && s->side[number] < 0)
        relay_attach(s, number, fd);
    else
        table_close_hidden(fd);
    table_give_locked(s);
}

/* A connection can be read, or it is time to try again to make it. */
static void relay_run(pump_item *self, bool readable)
{
    relay_link *l = self->user;
    if (readable && self->fd >= 0)
        read_link(l);
    else if (self->fd < 0)
        revive(l);
}

void relay_attach(cansock *s, int number, int fd)
{
    relay_link *l = &s->relay->links[number];
    s->side[number] = fd;
    l->item.fd = fd;
    l->item.due_ns = fd < 0 ? pump_now_ns() + AGAIN_NS : PUMP_NEVER;
    pump_put(&l->item);
}

void relay_lose(cansock *s, int number)
{
    table_close_hidden(s->side[number]);
    s->sent[number] = 0;
    relay_fail(s, ENETDOWN);
    relay_attach(s, number, -1);
}

int relay_make(cansock *s, const relay_user *user)
{
    int pair[2];
    struct relay *r = calloc(1, sizeof *r);
    if (!r || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0) {
        free(r);
        return r ? errno : ENOMEM;
    }
    r->socket = s;
    r->user = user;
    r->inner = table_hide(pair[1]);
    for (int i = 0; i < IFMAP_MAX; i++) {
        r->links[i] = (relay_link){.relay = r, .number = i};
        r->links[i].item = (pump_item){.fd = -1, .due_ns = PUMP_NEVER, .run = relay_run};
        r->links[i].item.user = &r->links[i];
    }
    table_replace(s, pair[0]);
    s->relay = r;
    s->direct = -1;
    return 0;
}

void relay_stop(cansock *s)
{
    for (int i = 0; s->relay && i < IFMAP_MAX; i++)
        pump_remove(&s->relay->links[i].item);
}

/* Its items leave the pump first, whose thread could run them. */
void relay_free(cansock *s)
{
    if (!s->relay)
        return;
    relay_stop(s);
    table_close_hidden(s->relay->inner);
    free(s->relay);
    s->relay = NULL;
}
