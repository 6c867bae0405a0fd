/* SPDX-License-Identifier: MIT
 *
 * conn.c - a connection to a port of a bus, by the protocol of port/messages.h.
 */
#include "preload/conn.h"

#include "preload/hooks/real.h"
#include "preload/waiting.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define WELCOME_MS 30000 /* for the answer to a hello */
#define STARTING_MS 50     /* for a bus that has made the path, and does not listen yet */
#define FLUSH_MS 10000   /* for the bus to send what is left; a bus-off node never does */
#define LOOK_MS 10       /* between two looks for an answer that another thread may read */
#define GUESTS_MAX 64u

/* The room of a socket in bytes; the kernel doubles it, and takes no more without privileges. By
 * default poll() sees no room behind 80 frames that canwired has not read, because it waits for a
 * processor. Programs that do not wait would fail there, as no interface lets them. */
#define ROOM_BYTES 212992

bool conn_is_over(int error)
{
    return error == EPIPE || error == ECONNRESET || error == ENOTCONN || error == ECONNREFUSED ||
           error == ENOENT;
}

/* ---- Messages -------------------------------------------------------------------------------- */

static message_head head_of(message_type type, size_t body)
{
    return (message_head){.type = (uint8_t)type, .size = (uint16_t)(sizeof(message_head) + body)};
}

/* Sends a message about the connection. It waits for room, also on a socket that does not block. */
static int send_control(int fd, message_type type, const void *body, size_t size)
{
    message_head head = head_of(type, size);
    struct iovec parts[] = {{&head, sizeof head}, {(void *)(uintptr_t)body, size}};
    const struct msghdr whole = {.msg_iov = parts, .msg_iovlen = 2};
    while (real()->sendmsg(fd, &whole, MSG_NOSIGNAL | MSG_DONTWAIT) < 0) {
        struct pollfd room = {.fd = fd, .events = POLLOUT};
        if (errno != EAGAIN && errno != EINTR)
            return errno;
        if (errno == EAGAIN && poll(&room, 1, WELCOME_MS) == 0)
            return ETIMEDOUT;
    }
    return 0;
}

static int64_t now_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000) + now.tv_nsec / 1000000;
}

/* Returns true when another thread has read the answer that this one waits for. */
static bool is_answered(const unsigned *elsewhere, unsigned before)
{
    return elsewhere && __atomic_load_n(elsewhere, __ATOMIC_ACQUIRE) != before;
}

/* Receives a message of one of two types; others are lost. elsewhere: see conn_flush(), before: its
 * value before the question. Returns 0 or an errno. */
static int await_here_or_there(int fd, message *m, message_type one, message_type other,
                               int limit_ms, const unsigned *elsewhere, unsigned before)
{
    const int64_t end = now_ms() + limit_ms;
    for (int64_t left = limit_ms; left > 0; left = end - now_ms()) {
        struct pollfd in = {.fd = fd, .events = POLLIN};
        const int ready = poll(&in, 1, elsewhere && left > LOOK_MS ? LOOK_MS : (int)left);
        if (is_answered(elsewhere, before))
            return 0;
        if (ready <= 0)
            continue;
        m->head = (message_head){.type = 0};
        const ssize_t size = real()->recv(fd, m, sizeof *m, MSG_DONTWAIT);
        if (size == 0)
            return ENETDOWN;
        if (size > 0 && (m->head.type == one || m->head.type == other))
            return 0;
        if (size < 0 && errno != EAGAIN && errno != EINTR && errno != ECONNRESET)
            return errno;
    }
    return ETIMEDOUT;
}

static int conn_await(int fd, message *m, message_type one, message_type other, int limit_ms)
{
    return await_here_or_there(fd, m, one, other, limit_ms, NULL, 0);
}

/* ---- Connecting ------------------------------------------------------------------------------ */

int conn_socket(int flags)
{
    const int room = ROOM_BYTES;
    const int fd = real()->socket(AF_UNIX, SOCK_SEQPACKET | flags, 0);
    if (fd >= 0)
        (void)real()->setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return fd;
}

/* Connects to a port; returns 0 or an errno. A port that has gone is, to programs, an interface
 * that is down. */
static int conn_connect_to(int fd, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const struct sockaddr *any = (const struct sockaddr *)&address;
    /* without a path the kernel gives an address, which makes it a client */
    if (real()->bind(fd, any, sizeof address.sun_family) != 0)
        return errno;
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    for (int refused = 0; real()->connect(fd, any, sizeof address) != 0;) {
        struct pollfd later = {.fd = -1};
        /* a bus that starts has the path a moment before it listens */
        const bool starts = errno == ECONNREFUSED && refused++ < STARTING_MS;
        if (errno != EAGAIN && errno != EINTR && !starts)
            return conn_is_over(errno) ? ENETDOWN : errno;
        (void)poll(&later, 1, 1); /* or the port has too many connections to accept */
    }
    return 0;
}

/* A guest brings its name. Each further socket of the program is a guest with a number. */
static int say_hello(int fd, const iface *in, const conn_wants *wants, unsigned number)
{
    message_hello hello = {.magic = MESSAGE_MAGIC,
                           .version = MESSAGE_VERSION,
                           .options = wants->options,
                           .error_mask = wants->error_mask};
    if (in->guest && number > 1)
        (void)snprintf(hello.name, sizeof hello.name, "%.28s-%u", in->node, number % 100);
    else if (in->guest)
        (void)snprintf(hello.name, sizeof hello.name, "%.32s", in->node);
    return send_control(fd, MESSAGE_HELLO, &hello, sizeof hello);
}

static void conn_complain(const iface *in, const char *why)
{
    (void)fprintf(stderr, "libcanwire-socketcan: %s: %.*s\n", in->names[0],
                  (int)MESSAGE_TEXT_BYTES, why);
}

/* Filters come behind the hello. The frames of the time between have not passed them, and are lost:
 * the program gets those that come when its call has returned. */
static void begin_filtered(int fd, const conn_wants *wants)
{
    conn_set_filters(fd, wants);
    conn_flush(fd, NULL);
}

int conn_start(int fd, const iface *in, const conn_wants *wants, unsigned number)
{
    message answer;
    int error = conn_connect_to(fd, in->path);
    error = error ? error : say_hello(fd, in, wants, number);
    error = error ? error : conn_await(fd, &answer, MESSAGE_HELLO, MESSAGE_ERROR, WELCOME_MS);
    if (error)
        return conn_is_over(error) ? ENETDOWN : error;
    if (answer.head.type == MESSAGE_HELLO) {
        if (wants->filtered)
            begin_filtered(fd, wants);
        return 0;
    }
    if (!wants->quiet && (answer.error.code != EEXIST || !in->guest))
        conn_complain(in, answer.error.text);
    return answer.error.code > 0 ? (int)answer.error.code : EPROTO;
}

int conn_open(const iface *in, const conn_wants *wants)
{
    for (unsigned number = 1; number <= GUESTS_MAX; number++) {
        const int fd = conn_socket(SOCK_CLOEXEC);
        if (fd < 0)
            return -1;
        const int error = conn_start(fd, in, wants, number);
        if (error == 0)
            return fd;
        (void)real()->close(fd);
        errno = error;
        if (error != EEXIST || !in->guest)
            return -1;
    }
    return -1;
}

void conn_set_options(int fd, const conn_wants *wants)
{
    const message_options options = {.options = wants->options, .error_mask = wants->error_mask};
    (void)send_control(fd, MESSAGE_OPTIONS, &options, sizeof options);
}

void conn_set_filters(int fd, const conn_wants *wants)
{
    (void)send_control(fd, MESSAGE_FILTERS, wants->filters,
                       wants->filter_count * sizeof *wants->filters);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

int conn_send(int fd, const void *frame, size_t size, int flags)
{
    message_head head = head_of(MESSAGE_FRAME, size);
    struct iovec parts[] = {{&head, sizeof head}, {(void *)(uintptr_t)frame, size}};
    const struct msghdr whole = {.msg_iov = parts, .msg_iovlen = 2};
    if (waiting_send(fd, &whole, (flags & MSG_DONTWAIT) | MSG_NOSIGNAL) >= 0)
        return 0;
    return conn_is_over(errno) ? ENETDOWN : errno;
}

void conn_flush(int fd, const unsigned *elsewhere)
{
    message answer;
    const unsigned before = elsewhere ? __atomic_load_n(elsewhere, __ATOMIC_ACQUIRE) : 0;
    if (send_control(fd, MESSAGE_FLUSH, NULL, 0) == 0)
        (void)await_here_or_there(fd, &answer, MESSAGE_FLUSH, MESSAGE_FLUSH, FLUSH_MS, elsewhere,
                                  before);
}
