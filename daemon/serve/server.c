/* SPDX-License-Identifier: MIT
 *
 * server.c - a Unix stream socket with many clients that write lines and get lines.
 *
 * Lines are not handled where they are read but in turns, one turn before each wait of the loop. A
 * turn handles a line of each client, for TURN_MAX_S at most. While lines wait, an idle watcher
 * keeps the loop from waiting. So neither many lines nor many clients delay the bus, and all get
 * their share.
 */
#include "serve/server.h"

#include "base/text/buffer.h"
#include "base/log.h"
#include "base/file/pathsocket.h"
#include "serve/acceptor.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define BACKLOG 64
#define READ_BYTES 65536u /* in one wake-up */
#define TURN_MAX_S 0.002
#define LOG_LINES_PER_S 10 /* about clients, which must not fill the log */
#define FAREWELL_MS 500    /* for all clients to read pending output, at the end */

struct server_client {
    server *server;
    int fd; /* -1: the place is free */
    ev_io reader;
    ev_io writer;
    buffer in;
    buffer out;
    size_t searched; /* bytes of `in` that hold no end of a line */
    bool line_waits; /* the end of the first line is at `searched` */
    bool held;       /* no line is handled before server_go_on() */
    bool end;        /* the client will write no more */
    bool doomed;     /* to be disconnected */
    bool stays;      /* keeps its place without sending lines */
    uid_t user;
    ev_tstamp heard; /* time of its last line, or of its connection */
    ev_tstamp took;  /* while output is pending: last time that the client took some, or when it
                        began */
};

struct server {
    struct ev_loop *loop;
    const server_calls *calls;
    void *user;
    pathsocket socket;
    acceptor acceptor;
    ev_prepare turn;
    ev_idle busy;
    unsigned first; /* client whose turn comes first */
    ev_tstamp log_second;
    unsigned log_lines;
    server_clock *now;
    server_client clients[SERVER_CLIENTS_MAX];
};

/* ---- Log ------------------------------------------------------------------------------------- */

/* Tells how many messages about clients the log has been spared in the last second. */
static void log_left_out(server *s)
{
    if (s->log_lines > LOG_LINES_PER_S)
        log_info("control: %u more messages about clients left out",
                 s->log_lines - LOG_LINES_PER_S);
    s->log_lines = 0;
}

/* Returns true when a line about a client may be logged. */
static bool may_log(server *s)
{
    ev_tstamp now = ev_now(s->loop);
    if (now < s->log_second || now >= s->log_second + 1.0) {
        log_left_out(s);
        s->log_second = now;
    }
    return ++s->log_lines <= LOG_LINES_PER_S;
}

/* ---- Output ---------------------------------------------------------------------------------- */

/* Forgets a client, whose place may then have another. */
static void close_client(server_client *c)
{
    server *s = c->server;
    ev_io_stop(s->loop, &c->reader);
    ev_io_stop(s->loop, &c->writer);
    (void)close(c->fd);
    buffer_free(&c->in);
    buffer_free(&c->out);
    *c = (server_client){.server = s, .fd = -1};
    s->calls->closed(s->user, server_client_number(c));
}

static void report_dismissed(server *s, const char *whom)
{
    if (may_log(s))
        log_warning("control: %s is disconnected", whom);
}

/* Marks a client for disconnecting: it has gone, or an error prevents writing. */
static void doom(server_client *c, int error)
{
    if (!c->doomed && error != EPIPE && error != ECONNRESET)
        report_dismissed(c->server, "a client whose socket fails");
    c->doomed = true;
}

/* Writes as much as the socket takes. */
static void server_flush(server_client *c)
{
    while (buffer_length(&c->out) > 0) {
        ssize_t count =
            send(c->fd, buffer_first(&c->out), buffer_length(&c->out), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (count > 0) {
            buffer_take(&c->out, (size_t)count);
            c->took = c->server->now(c->server->loop);
        } else if (errno != EINTR) {
            if (errno != EAGAIN)
                doom(c, errno);
            return;
        }
    }
}

/* Returns true when the client will write no more and got all replies. */
static bool is_done_with(const server_client *c)
{
    return c->end && !c->line_waits && !c->held && buffer_length(&c->out) == 0;
}

/* Handles a socket that the kernel cannot watch: libev stops the watcher and calls once more. */
static bool is_watched(server_client *c, int events)
{
    if (!(events & EV_ERROR))
        return true;
    report_dismissed(c->server, "a client that cannot be watched");
    close_client(c);
    return false;
}

/* Writes on to a client that has read something, or closes it when it is done. */
static void on_writable(struct ev_loop *loop, ev_io *io, int events)
{
    server_client *c = io->data;
    if (!is_watched(c, events))
        return;
    server_flush(c);
    if (c->doomed || is_done_with(c)) {
        close_client(c);
    } else if (buffer_length(&c->out) == 0) {
        ev_io_stop(loop, &c->writer);
        c->server->calls->drained(c->server->user, c);
    }
}

void server_write(server_client *client, const char *text, size_t length)
{
    if (client->doomed)
        return;
    if (buffer_length(&client->out) == 0)
        client->took = client->server->now(client->server->loop);
    bool full = buffer_length(&client->out) + length > SERVER_OUTPUT_MAX;
    if (full || !buffer_append(&client->out, text, length)) {
        report_dismissed(client->server, full ? "a client that does not read its replies"
                                            : "out of memory, a client");
        client->doomed = true;
    }
    ev_io_start(client->server->loop, &client->writer); /* the writer also disconnects doomed
                                                           clients */
}

size_t server_room(const server_client *client)
{
    size_t waiting = buffer_length(&client->out);
    return waiting < SERVER_STREAM_MAX ? SERVER_STREAM_MAX - waiting : 0;
}

/* ---- Input ----------------------------------------------------------------------------------- */

/* Reports to a client why it is disconnected, if it has room for that. */
static void dismiss(server_client *c, const char *why)
{
    server_write(c, why, strlen(why));
    server_flush(c);
    close_client(c);
}

/* Searches new bytes for the end of a line. */
static void find_line(server_client *c)
{
    size_t length = buffer_length(&c->in);
    if (c->line_waits || length == c->searched)
        return;
    const char *start = buffer_first(&c->in);
    const char *end = memchr(start + c->searched, '\n', length - c->searched);
    c->line_waits = end != NULL;
    c->searched = end ? (size_t)(end - start) : length;
}

/* Updates the client after bytes have come or gone. While a line waits no more is read: the client
 * has to wait. */
static void look_at_input(server_client *c)
{
    server *s = c->server;
    find_line(c);
    if (c->searched > SERVER_LINE_MAX) {
        dismiss(c, s->calls->too_long);
    } else if (c->line_waits) {
        ev_io_stop(s->loop, &c->reader);
        ev_prepare_start(s->loop, &s->turn);
        ev_idle_start(s->loop, &s->busy);
    } else if (!c->end) {
        ev_io_start(s->loop, &c->reader);
    } else if (buffer_length(&c->out) == 0) {
        close_client(c);
    } else {
        ev_io_stop(s->loop, &c->reader);
    }
}

/* Reads from a client. Its lines are answered in turn with those of others. */
static void on_readable(struct ev_loop *loop, ev_io *io, int events)
{
    (void)loop;
    server_client *c = io->data;
    if (!is_watched(c, events))
        return;
    if (!buffer_reserve(&c->in, READ_BYTES)) {
        report_dismissed(c->server, "out of memory, a client");
        close_client(c);
        return;
    }
    ssize_t count = recv(c->fd, c->in.data + c->in.end, READ_BYTES, MSG_DONTWAIT);
    if (count < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (count < 0) {
        close_client(c);
        return;
    }
    c->in.end += (size_t)count;
    c->end = count == 0;
    look_at_input(c);
}

/* Hands the next line of a client to its reader. A client whose answer waits is not read on. */
static void handle_line(server_client *c)
{
    server *s = c->server;
    char *line = buffer_first(&c->in);
    size_t length = c->searched;
    line[length] = '\0';
    c->heard = s->now(s->loop);
    s->calls->line(s->user, c, line, length);
    buffer_take(&c->in, length + 1);
    c->searched = 0;
    c->line_waits = false;
    server_flush(c);
    if (c->doomed)
        close_client(c);
    else if (c->held)
        ev_io_stop(s->loop, &c->reader);
    else
        look_at_input(c);
}

void server_hold(server_client *client)
{
    client->held = true;
}

void server_go_on(server_client *client)
{
    client->held = false;
    server_flush(client);
    if (client->doomed)
        close_client(client);
    else
        look_at_input(client);
}

/* Answers a line of each client that has one, beginning with another one each time. The bus comes
 * after some time. */
static void on_turn(struct ev_loop *loop, ev_prepare *watcher, int events)
{
    (void)events;
    server *s = watcher->data;
    ev_tstamp end = ev_time() + TURN_MAX_S;
    unsigned i;
    for (i = 0; i < SERVER_CLIENTS_MAX; i++) {
        server_client *c = &s->clients[(s->first + i) % SERVER_CLIENTS_MAX];
        if (c->fd < 0 || !c->line_waits)
            continue;
        handle_line(c);
        if (ev_time() >= end)
            break;
    }
    s->first = (s->first + i + 1) % SERVER_CLIENTS_MAX;
    for (i = 0; i < SERVER_CLIENTS_MAX; i++)
        if (s->clients[i].line_waits)
            return;
    ev_prepare_stop(loop, &s->turn);
    ev_idle_stop(loop, &s->busy);
}

/* Does nothing: the watcher only has to exist. */
static void on_busy(struct ev_loop *loop, ev_idle *watcher, int events)
{
    (void)loop;
    (void)watcher;
    (void)events;
}

/* ---- Places ---------------------------------------------------------------------------------- */

/* Counts the connections of a user, whom the kernel names. */
static unsigned count_clients(const server *s, uid_t user)
{
    unsigned count = 0;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        count += s->clients[i].fd >= 0 && s->clients[i].user == user;
    return count;
}

/* Counts the places that nobody has. */
static unsigned count_free(const server *s)
{
    unsigned count = 0;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        count += s->clients[i].fd < 0;
    return count;
}

/* Counts places that are kept for other users: one for root and one for the daemon's own user,
 * until they have one. */
static unsigned count_kept(const server *s, uid_t user)
{
    const uid_t own = geteuid();
    unsigned kept = user != 0 && count_clients(s, 0) == 0;
    if (own != 0 && own != user && count_clients(s, own) == 0)
        kept++;
    return kept;
}

static bool has_quota(const server *s, uid_t user)
{
    return count_clients(s, user) < SERVER_USER_MAX;
}

static bool may_come(const server *s, uid_t user)
{
    return has_quota(s, user) && count_free(s) > count_kept(s, user);
}

/* Returns the time since which the client is idle. A client has to read its pending output
 * first. */
static ev_tstamp idle_since(const server_client *c)
{
    return buffer_length(&c->out) > 0 ? c->took : c->heard;
}

/* Returns true for a client that may have to give its place away. `stays` does not save one that
 * does not read. */
static bool is_idle(const server_client *c)
{
    bool reads_all = buffer_length(&c->out) == 0;
    if (c->fd < 0 || (reads_all && (c->stays || c->line_waits || c->held)))
        return false;
    return c->server->now(c->server->loop) - idle_since(c) >= SERVER_IDLE_S;
}

/* Returns the client that has been idle for longest, if that is too long; NULL: none. */
static server_client *find_idle(server *s, bool of_user, uid_t user)
{
    server_client *found = NULL;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++) {
        server_client *c = &s->clients[i];
        if (is_idle(c) && (!of_user || c->user == user) &&
            (!found || idle_since(c) < idle_since(found)))
            found = c;
    }
    return found;
}

/* Disconnects an idle client when its place is needed, and not before. */
static void server_make_room(server *s, uid_t user)
{
    server_client *idle = find_idle(s, !has_quota(s, user), user);
    if (idle)
        dismiss(idle, s->calls->too_quiet);
}

/* ---- New clients ----------------------------------------------------------------------------- */

/* Gives a place to a client, and watches it. */
static void take_in(server *s, server_client *c, int fd, uid_t user)
{
    c->fd = fd;
    c->user = user;
    c->heard = s->now(s->loop);
    ev_io_init(&c->reader, on_readable, fd, EV_READ);
    ev_io_init(&c->writer, on_writable, fd, EV_WRITE);
    c->reader.data = c;
    c->writer.data = c;
    ev_io_start(s->loop, &c->reader);
}

static void server_refuse(server *s, int fd)
{
    (void)send(fd, s->calls->too_many, strlen(s->calls->too_many), MSG_NOSIGNAL | MSG_DONTWAIT);
    (void)close(fd);
}

/* Returns the process that connected, which need not be the present owner of the descriptor. */
static bool get_peer(struct ucred *peer, int fd)
{
    socklen_t size = sizeof *peer;
    return getsockopt(fd, SOL_SOCKET, SO_PEERCRED, peer, &size) == 0;
}

/* Admits a client when there is a place for its user; one of the same user may have to go. Others
 * are told. */
static void admit(void *user, int fd)
{
    server *s = user;
    struct ucred peer;
    bool known = get_peer(&peer, fd);
    if (known && !may_come(s, peer.uid))
        server_make_room(s, peer.uid);
    for (unsigned i = 0; known && i < SERVER_CLIENTS_MAX && may_come(s, peer.uid); i++) {
        if (s->clients[i].fd >= 0)
            continue;
        take_in(s, &s->clients[i], fd, peer.uid);
        log_detail("control: client: uid %jd, pid %jd", (intmax_t)peer.uid, (intmax_t)peer.pid);
        return;
    }
    if (known && may_log(s))
        log_info("control: too many clients, one is refused: uid %jd, pid %jd",
                 (intmax_t)peer.uid, (intmax_t)peer.pid);
    else if (!known && may_log(s))
        log_warning("control: a client is refused, who it is cannot be told: %s", strerror(errno));
    server_refuse(s, fd);
}

/* ---- Start and stop -------------------------------------------------------------------------- */

/* Prepares the watchers of the server's own socket and of its turns. */
static void prepare_watchers(server *s)
{
    acceptor_init(&s->acceptor, s->loop, "control", admit, s);
    ev_prepare_init(&s->turn, on_turn);
    ev_idle_init(&s->busy, on_busy);
    s->turn.data = s;
}

/* Opens the socket. Returns false after logging the reason. */
static bool open_socket(server *s, const char *path, const char *where, int inherited)
{
    char error[PATHSOCKET_ERROR_MAX];
    bool good = inherited >= 0
                    ? pathsocket_adopt(&s->socket, inherited, path, BACKLOG, error)
                    : pathsocket_open(&s->socket, path, SOCK_STREAM, BACKLOG, "control", error);
    if (!good)
        log_error("%s: control %s: %s", where, inherited >= 0 ? "that was passed" : path, error);
    else if (inherited >= 0)
        log_info("control %s: a socket of the service manager", s->socket.path);
    return good;
}

server *server_start(struct ev_loop *loop, const char *path, const char *where, int inherited,
                     const server_calls *calls, void *user)
{
    server *s = calloc(1, sizeof *s);
    if (!s) {
        log_error("out of memory");
        return NULL;
    }
    *s = (server){.loop = loop, .calls = calls, .user = user, .socket = PATHSOCKET_NONE,
                  .now = ev_now};
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        s->clients[i] = (server_client){.server = s, .fd = -1};
    bool good = open_socket(s, path, where, inherited);
    prepare_watchers(s);
    if (!good) {
        server_stop(s);
        return NULL;
    }
    acceptor_listen(&s->acceptor, s->socket.fd, s->socket.path);
    return s;
}

static int64_t monotonic_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* Finds the clients with pending output. */
static nfds_t find_writable(const server *s, struct pollfd sockets[SERVER_CLIENTS_MAX],
                            unsigned clients[SERVER_CLIENTS_MAX])
{
    nfds_t count = 0;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++) {
        const server_client *c = &s->clients[i];
        if (c->fd < 0 || c->doomed || buffer_length(&c->out) == 0)
            continue;
        sockets[count] = (struct pollfd){.fd = c->fd, .events = POLLOUT};
        clients[count++] = i;
    }
    return count;
}

/* Writes pending output to clients that read, for FAREWELL_MS at most. */
static void write_last_changes(server *s)
{
    struct pollfd sockets[SERVER_CLIENTS_MAX];
    unsigned clients[SERVER_CLIENTS_MAX];
    const int64_t end = monotonic_ms() + FAREWELL_MS;
    nfds_t count = find_writable(s, sockets, clients);
    while (count > 0 && monotonic_ms() < end) {
        if (poll(sockets, count, (int)(end - monotonic_ms())) < 0 && errno != EINTR)
            return;
        for (nfds_t i = 0; i < count; i++) {
            server_client *c = &s->clients[clients[i]];
            server_flush(c);
            if (!c->doomed && buffer_length(&c->out) == 0)
                s->calls->drained(s->user, c);
        }
        count = find_writable(s, sockets, clients);
    }
}

void server_stop(server *s)
{
    if (!s)
        return;
    write_last_changes(s);
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        if (s->clients[i].fd >= 0)
            close_client(&s->clients[i]);
    acceptor_end(&s->acceptor);
    ev_prepare_stop(s->loop, &s->turn);
    ev_idle_stop(s->loop, &s->busy);
    pathsocket_close(&s->socket);
    log_left_out(s);
    free(s);
}

void server_set_clock(server *s, server_clock *now)
{
    s->now = now;
}

void server_keep(server_client *client, bool stays)
{
    client->stays = stays;
}

unsigned server_client_number(const server_client *client)
{
    return (unsigned)(client - client->server->clients);
}

server_client *server_client_at(server *s, unsigned number)
{
    return s->clients[number].fd >= 0 ? &s->clients[number] : NULL;
}
