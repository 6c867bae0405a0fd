/* SPDX-License-Identifier: MIT
 *
 * wire.c - the adapter's connection to canwired, as the controller of a node (port/messages.h).
 */
#include "usb/wire.h"

#include "base/log.h"
#include "port/messages.h"

#include <errno.h>
#include <linux/can/error.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define NS_PER_US 1000u
/* Attempts, SERVE_BEAT_MS apart. */
#define BUSY_MAX 10u
#define DENIED_MAX 5u
/* Classes that the driver does not make of its own state. */
#define ERROR_MASK (CAN_ERR_LOSTARB | CAN_ERR_PROT | CAN_ERR_TRX | CAN_ERR_ACK | CAN_ERR_BUSERROR)

void wire_close(wire *w)
{
    if (w->fd >= 0)
        (void)close(w->fd);
    w->fd = -1;
    w->there = false;
}

/* ---- To canwired ----------------------------------------------------------------------------- */

/* Sends a message. canwired may be stopped, without room: all is said again when it is back. */
static bool send_message(wire *w, message_type type, uint32_t number, const void *body, size_t size)
{
    unsigned char bytes[sizeof(message_head) + sizeof(message_control)];
    const message_head head = {
        .type = (uint8_t)type, .size = (uint16_t)(sizeof head + size), .number = number};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, body, size);
    if (w->fd >= 0 && send(w->fd, bytes, head.size, MSG_DONTWAIT | MSG_NOSIGNAL) == head.size)
        return true;
    wire_close(w);
    return false;
}

static void wire_send_frame(void *user, uint32_t number, const peak_frame *frame)
{
    wire *w = user;
    if (w->there)
        (void)send_message(w, MESSAGE_FRAME, number, &frame->fd, frame->size);
}

/* Sends an order with settings. Without a connection it is left out: device_begin() repeats it when
 * there is one. */
static void send_order(void *user, message_order order, const char *settings)
{
    wire *w = user;
    message_control body = {.order = order};
    const size_t length = strlen(settings);
    if (!w->there || length >= sizeof body.settings)
        return;
    memcpy(body.settings, settings, length);
    (void)send_message(w, MESSAGE_CONTROL, 0, &body, sizeof body.order + length);
}

const device_calls wire_calls = {.send = wire_send_frame, .order = send_order};

/* ---- From canwired --------------------------------------------------------------------------- */

/* Takes a frame of the bus. One of our own says that it has been sent. */
static void wire_take_frame(const wire *w, const message *m, size_t size)
{
    if (m->head.flags & MESSAGE_OWN)
        device_was_sent(w->device, m->head.number);
    else if (size == CAN_MTU || size == CANFD_MTU)
        device_received(w->device, &m->frame, size, m->head.bus_ns / NS_PER_US);
}

/* Takes a refusal. A node that is taken may be free in a moment, so it is tried some times before
 * it counts. */
static void take_error(wire *w, message *m, size_t size)
{
    m->error.text[size < sizeof m->error ? size - sizeof m->error.code : MESSAGE_TEXT_BYTES - 1] =
        '\0';
    const int code = (int)m->error.code;
    if (!w->there && (code == EBUSY || code == EUSERS)) {
        w->busy++; /* the one before may have gone a moment ago */
        w->barred = w->busy < BUSY_MAX ? 0 : code;
        return;
    }
    if (!w->there && w->told == code)
        return;
    log_node_warning(w->name, "canwired refuses: %s", m->error.text);
    w->told = w->there ? w->told : code;
}

/* Takes a message of canwired. Types that are of no use here are left out. */
static void wire_take(wire *w, message *m, size_t whole)
{
    const size_t size = whole - sizeof m->head;
    switch (m->head.type) {
    case MESSAGE_HELLO:
        w->there = w->news = true;
        w->told = 0;
        w->busy = w->denied = 0;
        log_node_info(w->name, "connected to %s", w->path);
        device_begin(w->device, m->hello.mtu == CANFD_MTU);
        break;
    case MESSAGE_FRAME:
        wire_take_frame(w, m, size);
        break;
    case MESSAGE_DROPPED:
        device_was_dropped(w->device, m->head.number);
        break;
    case MESSAGE_STATE:
        if (size == sizeof m->state)
            device_state(w->device, &m->state, m->head.bus_ns / NS_PER_US);
        break;
    case MESSAGE_ERROR:
        if (size > sizeof m->error.code)
            take_error(w, m, size);
        break;
    default:
        break;
    }
}

/* The kernel reports once that canwired has gone without reading the hello. Its answer waits behind
 * that report. */
static void wire_read_all(wire *w)
{
    message m;
    bool reported = false;
    while (w->fd >= 0) {
        const ssize_t size = recv(w->fd, &m, sizeof m, MSG_DONTWAIT);
        if (size < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (size < 0 && errno == ECONNRESET && !reported) {
            reported = true;
            continue;
        }
        if (size < (ssize_t)sizeof m.head) {
            if (w->there)
                log_node_warning(w->name, "canwired has gone from %s; frames wait", w->path);
            wire_close(w);
            return;
        }
        wire_take(w, &m, (size_t)size);
    }
}

void wire_read(wire *w)
{
    wire_read_all(w);
    device_flush(w->device);
}

/* ---- The start ------------------------------------------------------------------------------- */

/* Connects as a client, by an abstract address. False with errno; the socket is for the caller to
 * close. */
static bool wire_connect_to(wire *w)
{
    const sa_family_t none = AF_UNIX; /* an abstract address: a client, no plain ECU */
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", w->path);
    w->fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    return w->fd >= 0 && bind(w->fd, (const struct sockaddr *)&none, sizeof none) == 0 &&
           connect(w->fd, (const struct sockaddr *)&address, sizeof address) == 0;
}

/* The adapter is the controller of its node, and asks to be told of frames that are dropped. */
static void say_hello(wire *w)
{
    message_hello hello = {
        .magic = MESSAGE_MAGIC,
        .version = MESSAGE_VERSION,
        .options = MESSAGE_LOOPBACK | MESSAGE_RECV_OWN | MESSAGE_FD | MESSAGE_TELL_DROPPED |
                   MESSAGE_CONTROLLER,
        .error_mask = ERROR_MASK,
    };
    (void)snprintf(hello.name, sizeof hello.name, "%.32s", w->name);
    (void)send_message(w, MESSAGE_HELLO, 0, &hello, sizeof hello);
}

void wire_connect(wire *w)
{
    if (w->fd >= 0)
        return;
    if (wire_connect_to(w)) {
        say_hello(w);
        return;
    }
    const int number = errno;
    wire_close(w);
    if (number == EACCES || number == EPERM) {
        w->denied++; /* a new socket gets its group a moment later */
        w->barred = w->denied < DENIED_MAX ? 0 : EACCES;
        return;
    }
    if (number != w->told)
        log_node_warning(w->name, "waiting for canwired at %s: %s", w->path, strerror(number));
    w->told = number;
}
