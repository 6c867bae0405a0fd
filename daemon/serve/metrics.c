/* SPDX-License-Identifier: MIT
 *
 * metrics.c - a small server of HTTP/1 that gives programs a page of all counters.
 *
 * A connection is read up to the end of its request, waits for a page, and gets it. Then it is read
 * again until the program closes it: a socket that is closed before may lose the end of the page.
 * A page is made in turns, one before each wait of the loop, as server.c answers requests.
 */
#include "serve/metrics.h"

#include "base/file/pathsocket.h"
#include "base/log.h"
#include "base/text/jsonput.h"
#include "config/node/address.h"
#include "port/listen.h"
#include "serve/acceptor.h"
#include "serve/metrics_request.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define BACKLOG 64
#define TICK_S 1.0         /* between looks at the time of connections */
#define TURN_MAX_S 0.001   /* of a page, before the bus goes on */
#define SEND_BYTES 65536   /* of an answer, in the kernel */
#define REST_BYTES 16384u  /* of what nobody reads, in one wake-up ... */
#define REST_MAX (1u << 20) /* ... and in all */

/* A page that is finished, for all who have waited for it. */
typedef struct sheet {
    unsigned users;
    buffer text;
} sheet;

typedef enum phase {
    PHASE_FREE = 0,
    PHASE_ASKS,  /* its request is read */
    PHASE_WAITS, /* for the next page that is begun */
    PHASE_HAS,   /* ... for the one that is being made */
    PHASE_TAKES, /* its answer is written */
    PHASE_ENDS,  /* the answer is complete */
} phase;

typedef struct client {
    metrics *metrics;
    phase phase;
    int fd;
    ev_io io;
    ev_tstamp began;
    metrics_request request;
    char in[METRICS_REQUEST_MAX + 1];
    size_t used; /* bytes of `in`, later those that nobody reads */
    char head[METRICS_HEAD_BYTES];
    size_t head_length;
    sheet *sheet; /* or NULL */
    size_t sent;  /* bytes of both */
} client;

/* A place to listen at. */
typedef struct endpoint {
    pathsocket socket;
    char *name; /* as cfg_metrics has it; NULL: none */
    bool deaf;  /* has the address, and does not listen: the next place overlaps */
} endpoint;

#define ENDPOINT_NONE {.socket = PATHSOCKET_NONE}

/* The place of the next configuration of the bus. */
typedef struct plan {
    bool any;
    bool same; /* the present place stays, maybe with another spelling of its name */
    endpoint place;
} plan;

struct metrics {
    struct ev_loop *loop;
    metrics_fill *fill;
    void *user;
    endpoint place;
    plan next;
    plan earlier; /* the one that was prepared before it */
    bool moved;   /* ... whose place `next` has now */
    acceptor acceptor;
    ev_timer tick;
    ev_prepare turn;
    ev_idle busy;
    bool making;
    metrics_page page;
    metrics_own own;
    client clients[METRICS_CLIENTS_MAX];
};

/* ---- Connections ----------------------------------------------------------------------------- */

/* The last user of the page frees it. */
static void release_sheet(sheet *s)
{
    if (!s || --s->users > 0)
        return;
    buffer_free(&s->text);
    free(s);
}

/* Ends a connection; `dropped`: without a whole answer. */
static void end_client(client *c, bool dropped)
{
    metrics *m = c->metrics;
    ev_io_stop(m->loop, &c->io);
    (void)close(c->fd);
    release_sheet(c->sheet);
    m->own.dropped += dropped;
    m->own.clients--;
    *c = (client){.metrics = m, .fd = -1};
}

/* Watches a connection for other events; 0: for none, while it waits for a page. */
static void watch(client *c, int events)
{
    ev_io_stop(c->metrics->loop, &c->io);
    ev_io_set(&c->io, c->fd, events);
    if (events)
        ev_io_start(c->metrics->loop, &c->io);
}

/* Begins the answer to a request, with a page or without. */
static void begin_answer(client *c, sheet *s)
{
    const bool good = c->request.status == 200;
    c->head_length =
        metrics_request_answer(c->head, &c->request, s ? buffer_length(&s->text) : 0);
    c->phase = PHASE_TAKES;
    if (s && !c->request.head) {
        c->sheet = s;
        s->users++;
    }
    c->metrics->own.requests += good;
    c->metrics->own.refused += !good;
    watch(c, EV_WRITE);
}

/* Reads a request, as far as it has come. */
static void read_request(client *c)
{
    metrics *m = c->metrics;
    const ssize_t count = recv(c->fd, c->in + c->used, sizeof c->in - c->used, MSG_DONTWAIT);
    if (count < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (count <= 0) {
        end_client(c, c->used > 0);
        return;
    }
    c->used += (size_t)count;
    if (!metrics_request_is_whole(c->in, c->used))
        return;
    c->request = metrics_request_read(c->in, c->used);
    if (c->request.status != 200) {
        begin_answer(c, NULL);
        return;
    }
    c->phase = PHASE_WAITS;
    watch(c, 0);
    ev_prepare_start(m->loop, &m->turn);
    ev_idle_start(m->loop, &m->busy);
}

/* Writes as much of the answer as the socket takes. */
static void write_answer(client *c)
{
    const size_t page = c->sheet ? buffer_length(&c->sheet->text) : 0;
    while (c->sent < c->head_length + page) {
        const bool head = c->sent < c->head_length;
        const char *at = head ? c->head + c->sent
                              : buffer_first(&c->sheet->text) + (c->sent - c->head_length);
        const size_t left = (head ? 0 : page) + c->head_length - c->sent;
        const ssize_t count = send(c->fd, at, left, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (count < 0 && errno == EINTR)
            continue;
        if (count < 0 && errno != EAGAIN)
            end_client(c, true);
        if (count < 0)
            return;
        c->sent += (size_t)count;
    }
    (void)shutdown(c->fd, SHUT_WR);
    release_sheet(c->sheet);
    c->sheet = NULL;
    c->phase = PHASE_ENDS;
    c->used = 0;
    watch(c, EV_READ);
}

/* Throws away what a program sends behind its request, until it closes the connection. */
static void read_rest(client *c)
{
    char rest[REST_BYTES];
    const ssize_t count = recv(c->fd, rest, sizeof rest, MSG_DONTWAIT);
    if (count < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    c->used += count > 0 ? (size_t)count : 0;
    if (count <= 0 || c->used > REST_MAX)
        end_client(c, false);
}

/* A connection can be read or written, according to its phase. */
static void on_client(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    client *c = io->data;
    if (events & EV_ERROR)
        end_client(c, c->phase != PHASE_ENDS);
    else if (c->phase == PHASE_ASKS)
        read_request(c);
    else if (c->phase == PHASE_TAKES)
        write_answer(c);
    else
        read_rest(c);
}

/* Returns a free place, if need be that of the oldest connection. */
static client *find_place(metrics *m)
{
    client *oldest = &m->clients[0];
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++) {
        client *c = &m->clients[i];
        if (c->phase == PHASE_FREE)
            return c;
        if (c->began < oldest->began)
            oldest = c;
    }
    end_client(oldest, oldest->phase != PHASE_ENDS);
    return oldest;
}

/* Gives a place to a program. Its time begins now, so that one that says nothing goes. */
static void take_client(void *user, int fd)
{
    metrics *m = user;
    const int room = SEND_BYTES;
    client *c = find_place(m);
    (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    c->fd = fd;
    c->phase = PHASE_ASKS;
    c->began = ev_now(m->loop);
    m->own.clients++;
    ev_init(&c->io, on_client);
    c->io.data = c;
    watch(c, EV_READ);
    ev_timer_start(m->loop, &m->tick);
}

/* Accepts connections, if there is a place that listens. */
static void listen_again(metrics *m)
{
    if (m->place.name && !m->place.deaf)
        acceptor_listen(&m->acceptor, m->place.socket.fd, m->place.name);
}

/* Ends connections that last too long. */
static void on_tick(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)events;
    metrics *m = timer->data;
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++) {
        client *c = &m->clients[i];
        if (c->phase != PHASE_FREE && ev_now(loop) - c->began > METRICS_LIMIT_S)
            end_client(c, c->phase != PHASE_ENDS);
    }
    if (m->own.clients == 0)
        ev_timer_stop(loop, timer);
}

/* ---- Pages ----------------------------------------------------------------------------------- */

/* Returns the first program that waits, or has a page in the making; NULL: none. */
static client *find_phase(metrics *m, phase wanted)
{
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++)
        if (m->clients[i].phase == wanted)
            return &m->clients[i];
    return NULL;
}

/* Begins a page for all who wait for one in the same form. */
static void begin_page(metrics *m, const client *first)
{
    const bool openmetrics = first->request.openmetrics;
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++) {
        client *c = &m->clients[i];
        if (c->phase == PHASE_WAITS && c->request.openmetrics == openmetrics)
            c->phase = PHASE_HAS;
    }
    metrics_page_begin(&m->page, openmetrics);
    m->fill(m->user, &m->page);
    metrics_page_own(&m->page, &m->own);
    m->making = true;
}

/* Gives a page to those who have waited for it; without memory, an error. */
static void end_page(metrics *m)
{
    const bool good = metrics_page_is_good(&m->page);
    sheet *s = good ? calloc(1, sizeof *s) : NULL;
    if (s)
        *s = (sheet){.users = 1, .text = metrics_page_take(&m->page)};
    else
        metrics_page_free(&m->page);
    m->making = false;
    for (client *c = find_phase(m, PHASE_HAS); c; c = find_phase(m, PHASE_HAS)) {
        if (!s)
            c->request.status = 503;
        begin_answer(c, s);
    }
    release_sheet(s);
}

/* Makes a part of a page. The bus comes after some time. */
static void on_part(struct ev_loop *loop, ev_prepare *watcher, int events)
{
    (void)events;
    metrics *m = watcher->data;
    const ev_tstamp end = ev_time() + TURN_MAX_S;
    const client *first = m->making ? NULL : find_phase(m, PHASE_WAITS);
    if (first)
        begin_page(m, first);
    while (m->making && ev_time() < end)
        if (!metrics_page_write(&m->page))
            end_page(m);
    if (m->making || find_phase(m, PHASE_WAITS))
        return;
    ev_prepare_stop(loop, &m->turn);
    ev_idle_stop(loop, &m->busy);
}

/* Does nothing: the watcher only keeps the loop from waiting. */
static void on_idle(struct ev_loop *loop, ev_idle *watcher, int events)
{
    (void)loop;
    (void)watcher;
    (void)events;
}

/* ---- Places to listen at --------------------------------------------------------------------- */

static void close_place(endpoint *place)
{
    pathsocket_close(&place->socket);
    free(place->name);
    *place = (endpoint)ENDPOINT_NONE;
}

/* Returns true for the place that a configuration wants, however it spells the path. */
static bool is_at(const endpoint *place, const cfg_metrics *wanted)
{
    if (!place->name || !wanted->name)
        return !place->name && !wanted->name;
    return strcmp(place->name, wanted->name) == 0 ||
           (wanted->path && pathsocket_is_at(&place->socket, wanted->path));
}

/* Returns true for two addresses of one port of which one is that of the whole machine. A path has
 * no such pair. */
static bool overlap(const char *a, const char *b)
{
    net_address one, other;
    if (!a || !b || !address_parse(&one, a, strlen(a), 0) ||
        !address_parse(&other, b, strlen(b), 0))
        return false;
    return one.number == other.number && !strchr(one.host, ':') == !strchr(other.host, ':') &&
           (address_of_all(&one) || address_of_all(&other));
}

/* Lets a place listen no more. It keeps its address, which no other program gets. */
static bool deafen(endpoint *place, const char *wanted)
{
    if (place->deaf || !overlap(place->name, wanted) || shutdown(place->socket.fd, SHUT_RD) != 0)
        return false;
    place->deaf = true;
    return true;
}

/* Lets a place listen again. */
static void undeafen(endpoint *place)
{
    if (place->deaf && listen(place->socket.fd, BACKLOG) != 0)
        log_error("metrics %s: it does not listen any more: %s", place->name, strerror(errno));
    else
        place->deaf = false;
}

/* Lets those places listen again that no next one overlaps. */
static void hear_again(metrics *m)
{
    undeafen(&m->next.place);
    if (overlap(m->place.name, m->next.place.name))
        return;
    undeafen(&m->place);
    listen_again(m);
}

/* Listens at an address as port_listen_at() does. An own place that overlaps it is deaf then. */
static int listen_over(metrics *m, const net_address *address, const char *wanted)
{
    int fd = port_listen_at(address);
    if (fd >= 0 || errno != EADDRINUSE)
        return fd;
    const bool now = deafen(&m->place, wanted), next = deafen(&m->next.place, wanted);
    if (now)
        acceptor_stop(&m->acceptor);
    int error = EADDRINUSE;
    if (now || next) {
        fd = port_listen_at(address);
        error = errno;
    }
    if (fd < 0)
        hear_again(m);
    errno = error;
    return fd;
}

/* Opens a place. Returns false after writing the reason; the place must be closed even then. */
static bool open_place(metrics *m, endpoint *place, const cfg_metrics *wanted,
                       char error[PATHSOCKET_ERROR_MAX])
{
    net_address address;
    place->name = strdup(wanted->name);
    if (!place->name) {
        (void)snprintf(error, PATHSOCKET_ERROR_MAX, "out of memory");
        return false;
    }
    if (wanted->path)
        return pathsocket_open(&place->socket, wanted->path, SOCK_STREAM, BACKLOG, "metrics",
                               error);
    const bool known = address_parse(&address, wanted->name, strlen(wanted->name), 0);
    assert(known);
    place->socket.fd = known ? listen_over(m, &address, wanted->name) : -1;
    if (place->socket.fd < 0)
        (void)snprintf(error, PATHSOCKET_ERROR_MAX, "%s", strerror(errno));
    return place->socket.fd >= 0;
}

static void close_plan(plan *p)
{
    close_place(&p->place);
    *p = (plan){.place = ENDPOINT_NONE};
}

bool metrics_prepare(metrics *m, const cfg *config, FILE *errors)
{
    char error[PATHSOCKET_ERROR_MAX];
    const cfg_metrics *wanted = &config->metrics;
    plan next = {.any = true, .same = is_at(&m->place, wanted), .place = ENDPOINT_NONE};
    const bool moved =
        !next.same && m->next.any && !m->next.same && is_at(&m->next.place, wanted);
    if (!next.same && !moved && wanted->name && !open_place(m, &next.place, wanted, error)) {
        fprintf(errors, "%s:%d:%d: metrics %s: %s\n", config->file, wanted->place.line,
                wanted->place.column, wanted->name, error);
        close_plan(&next);
        return false;
    }
    if (next.same && wanted->name && strcmp(m->place.name, wanted->name) != 0)
        next.place.name = strdup(wanted->name); /* without memory it has the old spelling */
    m->moved = moved;
    m->earlier = m->next;
    if (moved)
        m->earlier = (plan){.place = ENDPOINT_NONE};
    else
        m->next = next;
    return true;
}

void metrics_settle(metrics *m, bool taken)
{
    if (taken) {
        close_plan(&m->earlier);
    } else if (!m->moved) {
        close_plan(&m->next);
        m->next = m->earlier;
        m->earlier = (plan){.place = ENDPOINT_NONE};
        hear_again(m);
    }
    m->moved = false;
}

/* Gives the present place the spelling that is wanted now, if that is another one. */
static void rename_place(metrics *m)
{
    if (!m->next.place.name)
        return;
    free(m->place.name);
    m->place.name = m->next.place.name;
    m->next.place.name = NULL;
}

void metrics_change(metrics *m)
{
    if (m->next.any && !m->next.same) {
        acceptor_stop(&m->acceptor);
        close_place(&m->place);
        m->place = m->next.place;
        m->next.place = (endpoint)ENDPOINT_NONE;
        listen_again(m);
    } else if (m->next.any) {
        rename_place(m);
        hear_again(m);
    }
    close_plan(&m->next);
}

/* ---- Start and end --------------------------------------------------------------------------- */

metrics *metrics_new(struct ev_loop *loop, metrics_fill *fill, void *user)
{
    metrics *m = calloc(1, sizeof *m);
    if (!m)
        return NULL;
    *m = (metrics){.loop = loop, .fill = fill, .user = user, .place = ENDPOINT_NONE,
                   .next.place = ENDPOINT_NONE, .earlier.place = ENDPOINT_NONE};
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++)
        m->clients[i] = (client){.metrics = m, .fd = -1};
    acceptor_init(&m->acceptor, loop, "metrics", take_client, m);
    ev_timer_init(&m->tick, on_tick, TICK_S, TICK_S);
    ev_prepare_init(&m->turn, on_part);
    ev_idle_init(&m->busy, on_idle);
    m->tick.data = m;
    m->turn.data = m;
    m->busy.data = m;
    return m;
}

json_t *metrics_json(const metrics *m)
{
    if (!m->place.name)
        return json_null();
    json_t *object = json_object();
    put_text(object, "address", m->place.name);
    put_count(object, "requests", m->own.requests);
    put_count(object, "refused", m->own.refused);
    put_count(object, "dropped", m->own.dropped);
    put_count(object, "clients", m->own.clients);
    return object;
}

void metrics_free(metrics *m)
{
    if (!m)
        return;
    for (size_t i = 0; i < METRICS_CLIENTS_MAX; i++)
        if (m->clients[i].phase != PHASE_FREE)
            end_client(&m->clients[i], false);
    acceptor_end(&m->acceptor);
    ev_timer_stop(m->loop, &m->tick);
    ev_prepare_stop(m->loop, &m->turn);
    ev_idle_stop(m->loop, &m->busy);
    metrics_page_free(&m->page);
    close_plan(&m->next);
    close_plan(&m->earlier);
    close_place(&m->place);
    free(m);
}
