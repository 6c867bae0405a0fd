/* SPDX-License-Identifier: MIT
 *
 * port.c - the shared functions of all kinds of ports: conversion of frames, and counting.
 */
#include "port/kind.h"

#include <errno.h>
#include <linux/can/error.h>
#include <net/if.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define OVERFLOW_TICKS (CW_CLOCK_HZ / 10u) /* between two error frames about lost frames */

#define PORT_ROW(...) CW_STAT_ROW(port_stats, __VA_ARGS__)
#define TUNNEL_ROW(...) CW_STAT_ROW(port_tunnel_info, __VA_ARGS__)
const cw_stat port_tunnel_counters[] = {PORT_TUNNEL_COUNTERS(TUNNEL_ROW){.name = NULL}};
const cw_stat port_counters[] = {PORT_COUNTERS(PORT_ROW){.name = NULL}};

/* ---- Making and closing --------------------------------------------------------------------- */

/* Gives recvmmsg() and sendmmsg() a place for one frame of either size in each message. */
static void prepare_messages(port_messages *m)
{
    for (unsigned i = 0; i < PORT_BATCH; i++) {
        m->vectors[i] = (struct iovec){.iov_base = &m->frames[i], .iov_len = CANFD_MTU};
        m->headers[i].msg_hdr.msg_iov = &m->vectors[i];
        m->headers[i].msg_hdr.msg_iovlen = 1;
    }
}

port *port_new(const port_kind *kind, size_t size)
{
    port *p = calloc(1, size);
    if (!p)
        return NULL;
    p->kind = kind;
    p->fd = -1;
    p->buffer_bytes = PORT_BUFFER_BYTES;
    prepare_messages(&p->messages);
    return p;
}

void port_close(port *p)
{
    if (p)
        p->kind->close(p);
}

unsigned port_index(const port *p)
{
    return p->index;
}

unsigned port_buffer_bytes(const port *p)
{
    return p->buffer_bytes;
}

unsigned port_mtu(const port *p)
{
    return p->kind->mtu ? p->kind->mtu(p) : 0;
}

int port_fd(const port *p)
{
    return p->fd;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Returns the DLC. A len8_dlc that cannot be the DLC of eight bytes is garbage of programs; Linux
 * ignores it, too. */
static uint8_t dlc_of(const struct can_frame *in)
{
    bool raw = in->len == CAN_MAX_DLEN && in->len8_dlc > CAN_MAX_DLEN &&
               in->len8_dlc <= CAN_MAX_RAW_DLC;
    return raw ? in->len8_dlc : in->len;
}

/* Takes DLC and data of a CAN FD frame. As in drivers, a length that no DLC has is rounded up, with
 * zero bytes, and a program cannot choose the ESI. Returns true for such a length. */
static bool take_fd(cw_frame *out, const struct canfd_frame *in)
{
    out->flags |= (uint8_t)(CW_FRAME_FD | (in->flags & CANFD_BRS ? CW_FRAME_BRS : 0));
    out->dlc = (uint8_t)cw_fd_dlc(in->len);
    const unsigned length = cw_frame_length(out);
    if (length > 0)
        memcpy(out->data, in->data, in->len);
    return length > in->len;
}

/* Bytes that programs left behind the data are dropped: rules that change a frame would show
 * them. */
static void take_classical(cw_frame *out, const struct canfd_frame *in)
{
    struct can_frame classic;
    memcpy(&classic, in, sizeof classic);
    out->dlc = dlc_of(&classic);
    memcpy(out->data, classic.data, cw_frame_length(out));
}

/* Converts a frame. The kernel accepts an 11-bit identifier above 7FF, and CAN FD frames with
 * CAN_RTR_FLAG: these are kept, so that the bus sees an invalid frame. */
static void from_socketcan(port *p, cw_frame *out, const struct canfd_frame *in, size_t size)
{
    *out = (cw_frame){.id = in->can_id & CAN_EFF_MASK};
    if (in->can_id & CAN_EFF_FLAG)
        out->flags |= CW_FRAME_EXTENDED;
    if (in->can_id & CAN_RTR_FLAG)
        out->flags |= CW_FRAME_REMOTE;
    if (size == CAN_MTU)
        take_classical(out, in);
    else if (take_fd(out, in))
        p->stats.rounded++;
}

void port_count_drops(port *p, uint32_t drops)
{
    int32_t added = (int32_t)(drops - p->drops); /* the count beside frames may be older */
    if (added <= 0)
        return;
    p->drops = drops;
    p->stats.kernel_dropped += (uint32_t)added;
}

int64_t port_take_control(port *p, struct msghdr *header)
{
    int64_t arrival_ns = 0;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(header); c; c = CMSG_NXTHDR(header, c)) {
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SCM_TIMESTAMPNS) {
            struct timespec time;
            memcpy(&time, CMSG_DATA(c), sizeof time);
            arrival_ns = time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
        } else if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
            uint32_t drops;
            memcpy(&drops, CMSG_DATA(c), sizeof drops);
            port_count_drops(p, drops);
        }
    }
    return arrival_ns;
}

static bool is_frame(const struct canfd_frame *in, size_t size)
{
    return (size == CAN_MTU && in->len <= CAN_MAX_DLEN) ||
           (size == CANFD_MTU && in->len <= CANFD_MAX_DLEN);
}

bool port_is_frame(const port *p, unsigned i)
{
    const struct mmsghdr *header = &p->messages.headers[i];
    return is_frame(&p->messages.frames[i], header->msg_len) &&
           !(header->msg_hdr.msg_flags & MSG_TRUNC);
}

/* Takes an error frame, for the other programs of the port. Returns false without any. */
static bool take_error(port *p, cw_frame *out, const struct canfd_frame *in)
{
    p->stats.errors_ignored++;
    *out = (cw_frame){.id = in->can_id & CAN_ERR_MASK,
                      .dlc = in->len < CAN_MAX_DLEN ? in->len : CAN_MAX_DLEN};
    memcpy(out->data, in->data, out->dlc);
    return p->shared;
}

/* Reads a frame or error frame of an ECU. Returns false for one that means nothing here. */
static bool port_take_one_frame(port *p, port_frame *out, const struct canfd_frame *in, size_t size)
{
    out->is_error = in->can_id & CAN_ERR_FLAG;
    if (out->is_error)
        return take_error(p, &out->frame, in);
    from_socketcan(p, &out->frame, in, size);
    return true;
}

bool port_take_frame(port *p, port_frame *out, const struct canfd_frame *in, size_t size)
{
    if (is_frame(in, size))
        return port_take_one_frame(p, out, in, size);
    p->stats.malformed++;
    return false;
}

/* Returns true when a message is a frame for the bus, and copies it to *out. */
static bool take_message(port *p, port_frame *out, unsigned i)
{
    struct mmsghdr *m = &p->messages.headers[i];
    out->realtime_ns = port_take_control(p, &m->msg_hdr);
    out->client = 0;
    if (m->msg_hdr.msg_flags & MSG_CONFIRM)
        return false;
    if (port_is_frame(p, i))
        return port_take_one_frame(p, out, &p->messages.frames[i], m->msg_len);
    p->stats.malformed++;
    return false;
}

/* Notes a failed read. A link that is down and an ECU that has gone are reported elsewhere. */
static void note_read(port *p, int received)
{
    const int error = received < 0 ? errno : 0;
    if (error == EINTR || error == ENETDOWN || error == ENODEV || error == ECONNRESET)
        return;
    p->read_error = error == EAGAIN ? 0 : error;
    p->stats.read_failed += p->read_error != 0;
}

int port_receive(port *p, int socket, unsigned max)
{
    port_messages *m = &p->messages;
    for (unsigned i = 0; i < max; i++) {
        m->headers[i].msg_hdr.msg_control = m->controls[i];
        m->headers[i].msg_hdr.msg_controllen = p->kind->control_bytes;
    }
    int received = recvmmsg(socket, m->headers, max, MSG_DONTWAIT, NULL);
    note_read(p, received);
    return received;
}

unsigned port_take(port *p, port_frame frames[PORT_BATCH], int received)
{
    unsigned count = 0;
    for (int i = 0; i < received; i++)
        if (take_message(p, &frames[count], (unsigned)i))
            p->stats.read += !frames[count++].is_error;
    return count;
}

unsigned port_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    return p->kind->read(p, frames, max, more);
}

bool port_reading_changed(port *p, int *error)
{
    *error = p->read_error;
    bool added = (p->read_error != 0) != (p->reported_read_error != 0);
    p->reported_read_error = p->read_error;
    return added;
}

void port_count_loopless(port *p, int64_t least, int64_t most, bool counting)
{
    if (!p->loopless_begun) {
        p->loopless_begun = true;
        p->loopless_before = most;
    }
    int64_t added = least - p->loopless_before;
    if (counting && added > 0 && (uint64_t)added > p->stats.loopless)
        p->stats.loopless = (uint64_t)added;
}

void port_pushed_back(port *p)
{
    p->stats.pushed_back++;
    if (p->kind->crowd)
        p->kind->crowd(p);
}

/* ---- Several programs ------------------------------------------------------------------------ */

void port_share(port *p, const port_sharing *sharing)
{
    if (p->kind->share)
        p->kind->share(p, sharing);
}

bool port_is_shared(const port *p)
{
    return p->shared;
}

void port_set_time(port *p, uint64_t tick, int64_t realtime_ns)
{
    p->now_tick = tick;
    p->now_realtime_ns = realtime_ns;
}

void port_handed_in(port *p, const port_frame *frame)
{
    if (p->kind->handed_in)
        p->kind->handed_in(p, frame);
}

void port_ended(port *p, const cw_event *event)
{
    if (p->kind->ended)
        p->kind->ended(p, event);
}

bool port_is_over(const port *p)
{
    return p->kind->is_over && p->kind->is_over(p);
}

bool port_client(const port *p, unsigned n, port_client_info *out)
{
    return p->kind->client && p->kind->client(p, n, out);
}

/* ---- Virtual time ---------------------------------------------------------------------------- */

int port_peer_of(int fd)
{
    struct ucred peer = {.pid = 0};
    socklen_t size = sizeof peer;
    return getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 ? peer.pid : 0;
}

void port_note_told(port *p, int pid, unsigned what)
{
    for (unsigned i = 0; i < p->told_count; i++)
        if (p->told[i].pid == pid || i == PORT_TOLD_MAX - 1) {
            p->told[i].pid = p->told[i].pid == pid ? pid : 0;
            p->told[i].what |= what;
            return;
        }
    p->told[p->told_count++] = (port_told){.pid = pid, .what = what};
}

unsigned port_take_told(port *p, port_told told[PORT_TOLD_MAX])
{
    const unsigned count = p->told_count;
    memcpy(told, p->told, count * sizeof *told);
    p->told_count = 0;
    return count;
}

bool port_tunnel(const port *p, port_tunnel_info *out)
{
    return p->kind->tunnel && p->kind->tunnel(p, out);
}

/* ---- The controller ------------------------------------------------------------------------- */

bool port_has_controller(const port *p)
{
    return p && p->commands;
}

const port_command *port_next_command(const port *p)
{
    return p && p->commands && p->commands->waits ? &p->commands->next : NULL;
}

void port_obeyed(port *p, const char *problem)
{
    port_commands *c = p->commands;
    c->waits = false;
    if (*c->next.settings && !problem)
        memcpy(c->settings, c->next.settings, sizeof c->settings);
    p->kind->obeyed(p, problem);
}

const char *port_settings(const port *p)
{
    return p->commands->settings;
}

message_state port_told_state(const port *p)
{
    return p->commands->told;
}

void port_tell_state(port *p, const message_state *state)
{
    port_commands *c = p->commands;
    if (c->told_any && memcmp(&c->told, state, sizeof *state) == 0)
        return;
    c->told_any = true;
    c->told = *state;
    p->kind->tell_state(p, state);
}

void port_settle(port *p)
{
    p->kind->settle(p);
}

/* ---- Writing and counting -------------------------------------------------------------------- */

/* Writes a frame as Linux has it: above 8 the DLC is in len8_dlc, and len is 8. */
static size_t make_classical(struct canfd_frame *made, const cw_frame *in)
{
    _Static_assert(CW_FILTER_EXTENDED == CAN_EFF_FLAG && CW_FILTER_REMOTE == CAN_RTR_FLAG, "");
    struct can_frame out = {.can_id = cw_frame_can_id(in)};
    out.len = in->dlc < CAN_MAX_DLEN ? in->dlc : CAN_MAX_DLEN;
    out.len8_dlc = in->dlc > CAN_MAX_DLEN ? in->dlc : 0;
    memcpy(out.data, in->data, cw_frame_length(in));
    memcpy(made, &out, sizeof out);
    return sizeof out;
}

size_t port_make_error(struct canfd_frame *out, const cw_frame *in)
{
    *out = (struct canfd_frame){.can_id = in->id | CAN_ERR_FLAG, .len = in->dlc};
    memcpy(out->data, in->data, in->dlc);
    return sizeof(struct can_frame);
}

size_t port_make_frame(struct canfd_frame *out, const cw_frame *in)
{
    if (!(in->flags & CW_FRAME_FD))
        return make_classical(out, in);
    *out = (struct canfd_frame){.can_id = cw_frame_can_id(in), .flags = CANFD_FDF};
    out->flags |= (uint8_t)((in->flags & CW_FRAME_BRS ? CANFD_BRS : 0) |
                            (in->flags & CW_FRAME_ESI ? CANFD_ESI : 0));
    out->len = (uint8_t)cw_frame_length(in);
    memcpy(out->data, in->data, out->len);
    return sizeof *out;
}

void port_count_sent(port *p, uint32_t can_id, port_sent sent)
{
    port_stats *s = &p->stats;
    uint64_t *const frames[] = {&s->written, &s->write_failed, &s->unheard};
    uint64_t *const errors[] = {&s->errors_written, &s->errors_failed, &s->errors_unheard};
    if (sent != PORT_GATHERED)
        (*(can_id & CAN_ERR_FLAG ? errors : frames)[sent])++;
}

static bool write_frame(port *p, const void *frame, uint32_t can_id, size_t size)
{
    const port_sent sent = p->kind->send(p, frame, size);
    port_count_sent(p, can_id, sent);
    return sent == PORT_SENT || sent == PORT_GATHERED;
}

bool port_write(port *p, const cw_frame *frame)
{
    struct canfd_frame out;
    const size_t size = port_make_frame(&out, frame);
    return write_frame(p, &out, out.can_id, size);
}

static bool write_error(port *p, const errframe *frame)
{
    struct can_frame out = {.can_id = frame->can_id, .len = CAN_ERR_DLC};
    memcpy(out.data, frame->data, CAN_ERR_DLC);
    return write_frame(p, &out, out.can_id, sizeof out);
}

void port_gather(port *p)
{
    p->gathers = p->kind->flush;
}

void port_flush(port *p)
{
    if (p->gathers)
        p->kind->flush(p);
    p->gathers = false;
}

bool port_write_error(port *p, const errframe *frame, uint64_t tick)
{
    return errframe_limit_pass(&p->limit, frame, tick) && write_error(p, frame);
}

/* It has a limit of its own. */
void port_report_overflow(port *p, uint64_t tick)
{
    bool early = p->reported_dropped > 0 && tick - p->reported_tick < OVERFLOW_TICKS;
    if (p->reported_dropped == p->stats.kernel_dropped || early)
        return;
    p->reported_dropped = p->stats.kernel_dropped;
    p->reported_tick = tick;
    const errframe overflow = errframe_rx_overflow();
    (void)write_error(p, &overflow);
}

/* Gives the counters. Kernel and gathered frames are asked first, so that all are of one moment. */
void port_get_stats(port *p, port_stats *stats)
{
    if (p->kind->count)
        p->kind->count(p);
    if (p->gathers)
        p->kind->flush(p);
    p->stats.errors_left_out = p->limit.left_out;
    *stats = p->stats;
}

/* Left alone, the buffer of the receiver grows to megabytes. So does that of the sender, by the
 * size of segments, which is 64 KB on one machine. */
void port_bound_tcp(int fd)
{
    const int room = PORT_TCP_BYTES, segment = PORT_TCP_SEGMENT_BYTES;
    (void)setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    (void)setsockopt(fd, IPPROTO_TCP, TCP_MAXSEG, &segment, sizeof segment);
}
