/* SPDX-License-Identifier: MIT
 *
 * acceptor.c - accepts the connections of a socket that listens, some at a time.
 */
#include "serve/acceptor.h"

#include "base/log.h"
#include "base/text/counted.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

#define ACCEPTS_MAX 16u /* in one wake-up: a flood of clients does not stop the bus */
#define TICK_S 1.0      /* of a pause */
#define CALM_S 10.0     /* without one, until a lack is over */

/* Accepts no more before the next tick. */
static void pause_accepting(acceptor *a, const char *why)
{
    if (a->pauses++ == 0)
        log_warning("%s %s: no connection can be accepted: %s", a->kind, a->name, why);
    a->paused = ev_now(a->loop);
    ev_io_stop(a->loop, &a->io);
    ev_timer_start(a->loop, &a->tick);
}

static void on_connection(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    acceptor *a = io->data;
    if (events & EV_ERROR) {
        pause_accepting(a, "the socket cannot be watched");
        return;
    }
    for (unsigned i = 0; i < ACCEPTS_MAX; i++) {
        const int fd = accept4(io->fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0) {
            a->take(a->user, fd);
        } else if (errno == EAGAIN) {
            return;
        } else if (errno != EINTR && errno != ECONNABORTED) {
            pause_accepting(a, strerror(errno));
            return;
        }
    }
}

/* Accepts again. While a lack lasts, connections that wait bring on a pause each tick. */
static void on_tick(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)events;
    acceptor *a = timer->data;
    if (a->listens)
        ev_io_start(loop, &a->io);
    if (ev_now(loop) - a->paused < CALM_S)
        return;
    log_info("%s: connections are accepted again, after %s", a->kind,
             counted(a->pauses, "pause").text);
    a->pauses = 0;
    ev_timer_stop(loop, timer);
}

void acceptor_init(acceptor *a, struct ev_loop *loop, const char *kind, acceptor_take *take,
                   void *user)
{
    *a = (acceptor){.loop = loop, .take = take, .user = user, .kind = kind};
    ev_init(&a->io, on_connection);
    ev_timer_init(&a->tick, on_tick, TICK_S, TICK_S);
    a->io.data = a;
    a->tick.data = a;
}

void acceptor_listen(acceptor *a, int fd, const char *name)
{
    a->name = name;
    a->listens = true;
    if (a->io.fd != fd)
        ev_io_stop(a->loop, &a->io);
    if (!ev_is_active(&a->io))
        ev_io_set(&a->io, fd, EV_READ);
    ev_io_start(a->loop, &a->io);
}

void acceptor_stop(acceptor *a)
{
    a->listens = false;
    ev_io_stop(a->loop, &a->io);
}

void acceptor_end(acceptor *a)
{
    acceptor_stop(a);
    ev_timer_stop(a->loop, &a->tick);
}
