/* SPDX-License-Identifier: MIT
 *
 * port_socketcan.c - a port on a raw CAN socket.
 *
 * What the socket reads is what the ECU's programs wrote: its own frames the kernel does not loop
 * back to it, and frames flagged as confirmed are passed over all the same.
 */
#include "port.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define RECEIVE_BUFFER_BYTES (8 << 20)
#define CONTROL_BYTES 128

struct port {
    int fd;
    unsigned index;
    port_stats stats;
    errframe_limit limit;
    /* of one read */
    struct mmsghdr messages[PORT_BATCH];
    struct iovec vectors[PORT_BATCH];
    struct canfd_frame buffers[PORT_BATCH];
    unsigned char controls[PORT_BATCH][CONTROL_BYTES];
};

/* ---- Opening --------------------------------------------------------------------------------- */

static bool set_option(int fd, int level, int option, int value)
{
    return setsockopt(fd, level, option, &value, sizeof value) == 0;
}

static bool set_options(int fd)
{
    /* without CAP_NET_ADMIN the kernel's own limit has to do */
    if (!set_option(fd, SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES))
        (void)set_option(fd, SOL_SOCKET, SO_RCVBUF, RECEIVE_BUFFER_BYTES);
    return set_option(fd, SOL_SOCKET, SO_TIMESTAMPNS, 1) &&
           set_option(fd, SOL_SOCKET, SO_RXQ_OVFL, 1) &&
           set_option(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1) &&
           set_option(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, (int)CAN_ERR_MASK);
}

static bool bind_to(port *p, const char *interface)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    p->index = if_nametoindex(interface);
    address.can_ifindex = (int)p->index;
    if (p->index == 0)
        return false;
    return bind(p->fd, (const struct sockaddr *)&address, sizeof address) == 0;
}

/* found: there is such an interface. */
static void explain(char error[PORT_ERROR_TEXT_MAX], const char *interface, bool found, int number)
{
    const char *remedy = "";
    if (number == ENODEV && found)
        remedy = " for CAN: it is another kind of interface";
    else if (number == ENODEV)
        remedy = " (make it: ip link add NAME type vcan; ip link set NAME up)";
    else if (number == EAFNOSUPPORT)
        remedy = " (this kernel has no CAN: modprobe can-raw vcan)";
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: %s%s", interface, strerror(number), remedy);
}

static void prepare_messages(port *p)
{
    for (unsigned i = 0; i < PORT_BATCH; i++) {
        p->vectors[i] = (struct iovec){.iov_base = &p->buffers[i], .iov_len = CANFD_MTU};
        p->messages[i].msg_hdr.msg_iov = &p->vectors[i];
        p->messages[i].msg_hdr.msg_iovlen = 1;
    }
}

bool port_exists(const char *interface)
{
    return if_nametoindex(interface) != 0;
}

port *port_open(const char *interface, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = calloc(1, sizeof *p);
    if (!p) {
        explain(error, interface, false, ENOMEM);
        return NULL;
    }
    prepare_messages(p);
    p->fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (p->fd < 0 || !set_options(p->fd) || !bind_to(p, interface)) {
        explain(error, interface, p->index != 0, errno);
        port_close(p);
        return NULL;
    }
    return p;
}

void port_close(port *p)
{
    if (!p)
        return;
    if (p->fd >= 0)
        (void)close(p->fd);
    free(p);
}

unsigned port_index(const port *p)
{
    return p->index;
}

int port_fd(const port *p)
{
    return p->fd;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* The kernel lets an 11-bit identifier above 7FF through: the value is kept, so that the bus sees
 * that it is invalid. */
static void from_socketcan(cw_frame *out, const struct canfd_frame *in, size_t size)
{
    *out = (cw_frame){.id = in->can_id & CAN_EFF_MASK};
    if (in->can_id & CAN_EFF_FLAG)
        out->flags |= CW_FRAME_EXTENDED;
    if (in->can_id & CAN_RTR_FLAG)
        out->flags |= CW_FRAME_REMOTE;
    if (size == CANFD_MTU) {
        out->flags |= CW_FRAME_FD;
        memcpy(out->data, in->data, CANFD_MAX_DLEN);
        return;
    }
    struct can_frame classic;
    memcpy(&classic, in, sizeof classic);
    bool raw_dlc = classic.len == CAN_MAX_DLEN && classic.len8_dlc > CAN_MAX_DLEN;
    out->dlc = raw_dlc ? classic.len8_dlc : classic.len;
    memcpy(out->data, classic.data, CAN_MAX_DLEN);
}

static int64_t arrival_ns(struct msghdr *header)
{
    for (struct cmsghdr *c = CMSG_FIRSTHDR(header); c; c = CMSG_NXTHDR(header, c)) {
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS)
            continue;
        struct timespec time;
        memcpy(&time, CMSG_DATA(c), sizeof time);
        return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
    }
    return 0;
}

/* Whether a message is a frame for the bus; if so it is put into *out. */
static bool take_message(port *p, port_frame *out, unsigned i)
{
    struct mmsghdr *m = &p->messages[i];
    bool whole = m->msg_len == CAN_MTU || m->msg_len == CANFD_MTU;
    if (!whole || (m->msg_hdr.msg_flags & MSG_CONFIRM))
        return false;
    if (p->buffers[i].can_id & CAN_ERR_FLAG) {
        p->stats.errors_ignored++;
        return false;
    }
    from_socketcan(&out->frame, &p->buffers[i], m->msg_len);
    out->realtime_ns = arrival_ns(&m->msg_hdr);
    return true;
}

unsigned port_read(port *p, port_frame frames[PORT_BATCH], bool *more)
{
    for (unsigned i = 0; i < PORT_BATCH; i++) {
        p->messages[i].msg_hdr.msg_control = p->controls[i];
        p->messages[i].msg_hdr.msg_controllen = CONTROL_BYTES;
    }
    int received = recvmmsg(p->fd, p->messages, PORT_BATCH, MSG_DONTWAIT, NULL);
    unsigned count = 0;
    for (int i = 0; i < received; i++)
        if (take_message(p, &frames[count], (unsigned)i))
            count++;
    /* what has happened to the interface is told once; frames may wait behind it */
    bool error = received < 0 && errno != EAGAIN && errno != EINTR;
    *more = received == PORT_BATCH || error;
    p->stats.read += count;
    return count;
}

/* ---- Writing and counting -------------------------------------------------------------------- */

static void to_socketcan(struct can_frame *out, const cw_frame *in)
{
    *out = (struct can_frame){.can_id = in->id};
    if (in->flags & CW_FRAME_EXTENDED)
        out->can_id |= CAN_EFF_FLAG;
    if (in->flags & CW_FRAME_REMOTE)
        out->can_id |= CAN_RTR_FLAG;
    out->len = in->dlc < CAN_MAX_DLEN ? in->dlc : CAN_MAX_DLEN;
    out->len8_dlc = in->dlc > CAN_MAX_DLEN ? in->dlc : 0;
    memcpy(out->data, in->data, cw_frame_length(in));
}

static bool write_frame(port *p, const struct can_frame *frame, uint64_t *written,
                        uint64_t *failed)
{
    bool good = send(p->fd, frame, sizeof *frame, MSG_DONTWAIT) == sizeof *frame;
    (*(good ? written : failed))++;
    return good;
}

bool port_write(port *p, const cw_frame *frame)
{
    struct can_frame out;
    to_socketcan(&out, frame);
    return write_frame(p, &out, &p->stats.written, &p->stats.write_failed);
}

bool port_write_error(port *p, const errframe *frame, uint64_t tick)
{
    if (!errframe_limit_pass(&p->limit, frame, tick))
        return false;
    struct can_frame out = {.can_id = frame->can_id, .len = CAN_ERR_DLC};
    memcpy(out.data, frame->data, CAN_ERR_DLC);
    return write_frame(p, &out, &p->stats.errors_written, &p->stats.errors_failed);
}

void port_get_stats(port *p, port_stats *stats)
{
    uint32_t memory[SK_MEMINFO_VARS] = {0};
    socklen_t size = sizeof memory;
    if (getsockopt(p->fd, SOL_SOCKET, SO_MEMINFO, memory, &size) == 0)
        p->stats.kernel_dropped = memory[SK_MEMINFO_DROPS];
    p->stats.errors_left_out = p->limit.left_out;
    *stats = p->stats;
}
