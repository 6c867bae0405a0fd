/* SPDX-License-Identifier: MIT
 *
 * notify.c - reports the daemon's state to the service manager (sd_notify(3)) without waiting.
 */
#include "serve/notify.h"

#include "base/log.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define STATES_MAX 8u
#define STATE_BYTES 64u
#define STATUS_BYTES 1024u
#define RETRY_S 0.05

struct notifier {
    struct ev_loop *loop;
    ev_timer retry; /* runs while messages are pending */
    int fd;
    bool failed; /* the failure has been logged */
    struct sockaddr_un address;
    socklen_t address_length;
    /* pending messages */
    char states[STATES_MAX][STATE_BYTES];
    unsigned state_count;
    bool alive;
    char status[STATUS_BYTES]; /* or empty */
};

static void on_retry(struct ev_loop *loop, ev_timer *timer, int events);

/* Sets the address: a path, or with '@' a name in the abstract namespace. */
static bool set_address(notifier *n, const char *path)
{
    size_t length = strlen(path);
    if ((path[0] != '/' && path[0] != '@') || length >= sizeof n->address.sun_path) {
        log_warning("NOTIFY_SOCKET=%s: no path of a Unix socket, the service manager is not told",
                    path);
        return false;
    }
    n->address.sun_family = AF_UNIX;
    memcpy(n->address.sun_path, path, length);
    if (path[0] == '@')
        n->address.sun_path[0] = '\0';
    n->address_length = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length);
    return true;
}

notifier *notify_open(struct ev_loop *loop)
{
    const char *path = getenv("NOTIFY_SOCKET");
    if (!path || !*path)
        return NULL;
    notifier *n = calloc(1, sizeof *n);
    if (!n || !set_address(n, path)) {
        free(n);
        return NULL;
    }
    n->loop = loop;
    n->fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (n->fd < 0) {
        log_warning("the service manager is not told: %s", strerror(errno));
        free(n);
        return NULL;
    }
    ev_timer_init(&n->retry, on_retry, RETRY_S, RETRY_S);
    n->retry.data = n;
    return n;
}

/* Sends a text. Returns false when there is no room now. A text that can never be sent is
 * dropped. */
static bool send_text(notifier *n, const char *text)
{
    if (sendto(n->fd, text, strlen(text), MSG_DONTWAIT | MSG_NOSIGNAL,
               (const struct sockaddr *)&n->address, n->address_length) >= 0)
        return true;
    if (errno == EAGAIN || errno == ENOBUFS || errno == EINTR)
        return false;
    if (!n->failed)
        log_warning("the service manager cannot be told: %s", strerror(errno));
    n->failed = true;
    return true;
}

static void drop_first_state(notifier *n)
{
    n->state_count--;
    memmove(n->states[0], n->states[1], n->state_count * sizeof n->states[0]);
}

/* Returns true when no message is pending any more. */
static bool send_all(notifier *n)
{
    while (n->state_count > 0) {
        if (!send_text(n, n->states[0]))
            return false;
        drop_first_state(n);
    }
    if (n->alive && !send_text(n, "WATCHDOG=1"))
        return false;
    n->alive = false;
    if (n->status[0] && !send_text(n, n->status))
        return false;
    n->status[0] = '\0';
    return true;
}

/* Sends as much as there is room for, and tries the rest again soon. */
static void notify_flush(notifier *n)
{
    if (send_all(n))
        ev_timer_stop(n->loop, &n->retry);
    else if (!ev_is_active(&n->retry))
        ev_timer_again(n->loop, &n->retry);
}

static void on_retry(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)loop;
    (void)events;
    notify_flush(timer->data);
}

void notify_close(notifier *n)
{
    if (!n)
        return;
    (void)send_all(n);
    ev_timer_stop(n->loop, &n->retry);
    (void)close(n->fd);
    free(n);
}

/* Adds a state. When there are too many, the first one is dropped: only the last one is the present
 * state. */
static void add_state(notifier *n, const char *state)
{
    if (!n)
        return;
    if (n->state_count == STATES_MAX)
        drop_first_state(n);
    (void)snprintf(n->states[n->state_count++], STATE_BYTES, "%s", state);
    notify_flush(n);
}

void notify_ready(notifier *n)
{
    add_state(n, "READY=1");
}

void notify_reloading(notifier *n)
{
    char state[STATE_BYTES];
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    (void)snprintf(state, sizeof state, "RELOADING=1\nMONOTONIC_USEC=%" PRIu64,
                   (uint64_t)t.tv_sec * 1000000 + (uint64_t)t.tv_nsec / 1000);
    add_state(n, state);
}

void notify_stopping(notifier *n)
{
    add_state(n, "STOPPING=1");
}

void notify_alive(notifier *n)
{
    if (!n)
        return;
    n->alive = true;
    notify_flush(n);
}

void notify_status(notifier *n, const char *format, ...)
{
    static const char key[] = "STATUS=";
    va_list args;
    if (!n)
        return;
    memcpy(n->status, key, sizeof key);
    va_start(args, format);
    (void)vsnprintf(n->status + strlen(key), STATUS_BYTES - strlen(key), format, args);
    va_end(args);
    notify_flush(n);
}
