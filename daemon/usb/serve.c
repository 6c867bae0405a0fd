/* SPDX-License-Identifier: MIT
 *
 * serve.c - the loop of one adapter.
 *
 * The kernel's network configuration waits for some requests. So this loop waits for nothing but
 * the next event: neither for canwired, nor for the kernel to read an answer.
 */
#include "usb/serve.h"

#include "base/log.h"
#include "base/wall.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

#define READ_BYTES 65536u
#define NS_PER_MS INT64_C(1000000)

enum { KERNEL = 0, NODE, WATCHED };

static int64_t now_ms(void)
{
    return wall_ns() / NS_PER_MS;
}

/* Reads what the kernel has sent. Returns false at the end, *good false when it is wrong. */
static bool read_kernel(int kernel, usb_device *d, bool *good)
{
    static char bytes[READ_BYTES];
    const ssize_t size = recv(kernel, bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0)
        return errno == EAGAIN || errno == EINTR;
    *good = device_take(d, bytes, (size_t)size);
    return size > 0 && *good;
}

/* Sends as much as the kernel takes. */
static bool write_kernel(int kernel, usb_device *d)
{
    while (buffer_length(&d->out) > 0) {
        const ssize_t size = send(kernel, buffer_first(&d->out), buffer_length(&d->out),
                                  MSG_DONTWAIT | MSG_NOSIGNAL);
        if (size < 0)
            return errno == EAGAIN || errno == EINTR;
        buffer_take(&d->out, (size_t)size);
    }
    return true;
}

static bool write_sign(int beat, char sign)
{
    return write(beat, &sign, 1) == 1;
}

/* Tells that a driver has taken the adapter, before the driver gets its answer. So the sign comes
 * before the interface that the driver makes. A full pipe means that nobody looks. */
static void tell_claim(int beat, usb_device *d)
{
    if (d->claimed && write_sign(beat, SERVE_CLAIMED))
        d->claimed = false;
}

/* A full pipe is read soon, and the sign comes again then. */
static void tell_link(int beat, wire *w)
{
    if (w->news && write_sign(beat, SERVE_LINKED))
        w->news = false;
}

/* Gives a sign of life when it is time. */
static void give_signs(int beat, int64_t *next_ms, wire *w)
{
    const int64_t now = now_ms();
    if (now < *next_ms)
        return;
    *next_ms = now + SERVE_BEAT_MS;
    (void)write_sign(beat, SERVE_ALIVE);
    wire_connect(w);
}

/* Waits for the kernel and the node, and does what they want. Returns false at the end; *good: an
 * orderly one. */
static bool serve_go_on(int kernel, int beat, usb_device *d, wire *w, bool *good)
{
    struct pollfd watched[WATCHED] = {
        [KERNEL] = {.fd = kernel, .events = POLLIN},
        [NODE] = {.fd = w->fd, .events = POLLIN},
    };
    if (buffer_length(&d->out) > 0)
        watched[KERNEL].events |= POLLOUT;
    if (poll(watched, WATCHED, SERVE_BEAT_MS) < 0)
        return errno == EINTR;
    if ((watched[KERNEL].revents & (POLLIN | POLLHUP | POLLERR)) && !read_kernel(kernel, d, good))
        return false;
    if (watched[NODE].revents && watched[NODE].fd == w->fd)
        wire_read(w);
    tell_claim(beat, d);
    tell_link(beat, w);
    return write_kernel(kernel, d);
}

/* The kernel must not keep an interface that leads nowhere. */
static serve_end serve_judge(const wire *w, bool good)
{
    if (w->barred == EACCES)
        return SERVE_FORBIDDEN;
    if (w->barred)
        return w->barred == EUSERS ? SERVE_FULL : SERVE_TAKEN;
    return good ? SERVE_UNPLUGGED : SERVE_FAILED;
}

serve_end serve(int kernel, int beat, const usb_identity *who, const char *path)
{
    bool good = true;
    int64_t next_ms = 0;
    usb_device *d = calloc(1, sizeof *d);
    if (!d)
        return SERVE_FAILED;
    wire w = {.path = path, .name = who->serial, .device = d, .fd = -1};
    device_init(d, who, &wire_calls, &w);
    do
        give_signs(beat, &next_ms, &w);
    while (w.barred == 0 && serve_go_on(kernel, beat, d, &w, &good));
    if (!good)
        log_node_error(who->serial, "the kernel sends what no USB device understands");
    wire_close(&w);
    device_free(d);
    free(d);
    return serve_judge(&w, good);
}
