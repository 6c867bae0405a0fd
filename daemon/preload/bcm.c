/* SPDX-License-Identifier: MIT
 *
 * bcm.c - sockets of CAN_BCM: their connections, and the requests of programs.
 */
#include "preload/bcm.h"

#include "preload/bcm_op.h"
#include "preload/raw.h"
#include "preload/relay.h"
#include "preload/wants.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define OPTIONS (MESSAGE_LOOPBACK | MESSAGE_RECV_OWN | MESSAGE_FD | MESSAGE_FLUSHES)
#define SECONDS_MAX (400 * 24 * 60 * 60) /* of an interval */
#define MICROSECONDS 1000000

/* ---- Connections ----------------------------------------------------------------------------- */

/* Gives a frame of a port to all jobs that receive, each of which looks if it is meant. */
static void bcm_take_frame(cansock *s, int number, message *m, size_t size)
{
    struct canfd_frame frame = {.can_id = 0};
    const size_t bytes = size - sizeof m->head;
    memcpy(&frame, &m->fd, bytes < sizeof frame ? bytes : sizeof frame);
    for (bcm_op *op = s->bcm->rx; op; op = op->next)
        bcm_rx_frame(op, ifmap_at(number)->index, m->head.realtime_ns, &frame, bytes);
}

/* Returns the identifiers that the jobs of an interface receive. */
static conn_wants wants(const cansock *s, int number)
{
    const int index = ifmap_at(number)->index;
    conn_wants w = {.options = OPTIONS, .filtered = true};
    struct can_filter *filters = calloc(MESSAGE_FILTERS_MAX, sizeof *filters);
    w.filters = filters;
    for (const bcm_op *op = filters ? s->bcm->rx : NULL; op; op = op->next) {
        const bool extended = op->as.can_id & CAN_EFF_FLAG;
        if (op->index != 0 && op->index != index)
            continue;
        if (w.filter_count == MESSAGE_FILTERS_MAX) { /* too many: all frames */
            w.filter_count = 1;
            filters[0] = (struct can_filter){.can_id = 0};
            break;
        }
        filters[w.filter_count++] = (struct can_filter){
            .can_id = op->as.can_id,
            .can_mask = (extended ? CAN_EFF_MASK : CAN_SFF_MASK) | CAN_EFF_FLAG | CAN_RTR_FLAG};
    }
    return w;
}

static const relay_user user = {.frame = bcm_take_frame, .wants = wants};

/* Connects to an interface. one: it must be there, or else it is tried again. Returns 0 or an
 * errno. The lock is not held meanwhile. */
static int bcm_connect_to(cansock *s, int number)
{
    table_lock();
    conn_wants w = wants(s, number);
    const bool has = s->side[number] >= 0;
    table_unlock();
    const int fd = has ? -1 : table_hide(conn_open(ifmap_at(number), &w));
    const int error = has || fd >= 0 ? 0 : errno;
    table_lock();
    if (!has && s->side[number] < 0)
        relay_attach(s, number, fd);
    else
        table_close_hidden(fd);
    table_unlock();
    wants_free(&w);
    return error;
}

/* Connects to the interface of a request, or to all. */
static int connect_for(cansock *s, int index)
{
    const iface *in = ifmap_of_index(index);
    if (in)
        return bcm_connect_to(s, ifmap_number(in));
    if (index != 0)
        return ENODEV;
    int error = ENODEV;
    bool there = false;
    for (int i = 0; i < ifmap_count(); i++) {
        error = bcm_connect_to(s, i);
        there = there || error == 0;
    }
    return there ? 0 : error;
}

/* Tells the ports which identifiers the jobs want. */
static void send_filters(cansock *s)
{
    for (int i = 0; i < ifmap_count(); i++) {
        table_lock();
        conn_wants w = wants(s, i);
        const int fd = table_hold(s->side[i]);
        table_unlock();
        if (fd >= 0)
            conn_set_filters(fd, &w);
        table_lock();
        table_release(fd);
        table_unlock();
        wants_free(&w);
    }
}

/* ---- Requests -------------------------------------------------------------------------------- */

static bool is_interval(const struct bcm_timeval *span)
{
    return span->tv_sec >= 0 && span->tv_sec <= SECONDS_MAX && span->tv_usec >= 0 &&
           span->tv_usec < MICROSECONDS;
}

/* TX_SEND sends one frame at once, without a job. Returns 0 or an errno, as the kernel does. */
static int send_one(const bcm_request *r, size_t size)
{
    const unsigned longest = r->frame_bytes == CANFD_MTU ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
    if (r->head.nframes != 1 || size != sizeof r->head + r->frame_bytes)
        return EINVAL;
    if (((const struct can_frame *)(const void *)r->frames)->len > longest)
        return EINVAL;
    bcm_transmit(r->socket, r->index, r->frames, r->frame_bytes);
    return 0;
}

/* Answers TX_READ or RX_READ with the job as it is now. */
static int tell_status(const bcm_op *op, unsigned opcode)
{
    if (!op)
        return EINVAL;
    bcm_op_tell(op, opcode, op->frames, op->as.nframes);
    return 0;
}

/* Does what a request says, with the lock. */
static int bcm_obey(const bcm_request *r, size_t size)
{
    struct bcm *b = r->socket->bcm;
    switch (r->head.opcode) {
    case TX_SETUP:
        return bcm_tx_setup(r);
    case RX_SETUP:
        return bcm_rx_setup(r);
    case TX_DELETE:
        return bcm_op_delete(&b->tx, r) ? 0 : EINVAL;
    case RX_DELETE:
        return bcm_op_delete(&b->rx, r) ? 0 : EINVAL;
    case TX_READ:
        return tell_status(bcm_op_find(b->tx, r), TX_STATUS);
    case RX_READ:
        return tell_status(bcm_op_find(b->rx, r), RX_STATUS);
    case TX_SEND:
        return send_one(r, size);
    default:
        return EINVAL;
    }
}

/* Reads a request. Returns 0 or an errno. */
static int parse(bcm_request *r, cansock *s, const void *bytes, size_t size, int index)
{
    *r = (bcm_request){.socket = s, .index = s->index ? s->index : index};
    if (!s->bcm->connected)
        return ENOTCONN;
    if (s->bcm->foreign)
        return EOPNOTSUPP;
    if (size < sizeof r->head)
        return EINVAL;
    memcpy(&r->head, bytes, sizeof r->head);
    r->frame_bytes = r->head.flags & CAN_FD_FRAME ? CANFD_MTU : CAN_MTU;
    r->frames = (const unsigned char *)bytes + sizeof r->head;
    if ((size - sizeof r->head) % r->frame_bytes != 0)
        return EINVAL;
    if (r->head.nframes > (size - sizeof r->head) / r->frame_bytes)
        return r->head.opcode == TX_SETUP || r->head.opcode == RX_SETUP ? EINVAL : 0;
    const bool timed = r->head.flags & SETTIMER;
    return timed && (!is_interval(&r->head.ival1) || !is_interval(&r->head.ival2)) ? EINVAL : 0;
}

int bcm_send(cansock *s, const void *bytes, size_t size, int index)
{
    bcm_request r;
    int error = parse(&r, s, bytes, size, index);
    if (error)
        return error;
    const bool sets = r.head.opcode == TX_SETUP || r.head.opcode == RX_SETUP;
    const bool receives = r.head.opcode == RX_SETUP || r.head.opcode == RX_DELETE;
    if (r.index == 0 && (r.head.opcode == TX_SETUP || r.head.opcode == TX_SEND))
        return ENODEV;
    if (sets || r.head.opcode == TX_SEND)
        error = connect_for(s, r.index);
    if (error)
        return error;
    table_lock();
    error = bcm_obey(&r, size);
    table_unlock();
    if (error == 0 && receives)
        send_filters(s);
    return error;
}

/* ---- Sockets --------------------------------------------------------------------------------- */

int bcm_make(cansock *s)
{
    s->bcm = calloc(1, sizeof *s->bcm);
    if (!s->bcm)
        return ENOMEM;
    table_lock();
    const int error = relay_make(s, &user);
    table_unlock();
    return error;
}

int bcm_connect(cansock *s, const struct sockaddr *address, socklen_t size)
{
    int index = 0;
    const int error = raw_index_of(&index, address, size);
    if (error)
        return size < sizeof(sa_family_t) ? EINVAL : error;
    if (s->bcm->connected)
        return EISCONN;
    if (index != 0 && !ifmap_of_index(index))
        return ENODEV;
    s->index = index;
    s->bcm->connected = true;
    return 0;
}

void bcm_stop(cansock *s)
{
    table_lock();
    bcm_op_delete_all(&s->bcm->tx);
    bcm_op_delete_all(&s->bcm->rx);
    table_unlock();
}

/* Deletes all jobs. Their items leave the pump, so that nothing runs for the socket any more. */
void bcm_free(cansock *s)
{
    if (!s->bcm)
        return;
    bcm_op_delete_all(&s->bcm->tx);
    bcm_op_delete_all(&s->bcm->rx);
    free(s->bcm);
    s->bcm = NULL;
}

void bcm_forked(void)
{
    for (int fd = table_next(0); fd >= 0; fd = table_next(fd + 1)) {
        cansock *s = table_at(fd);
        if (!s->bcm)
            continue;
        relay_stop(s);
        bcm_op_delete_all(&s->bcm->tx);
        bcm_op_delete_all(&s->bcm->rx);
        s->bcm->foreign = true;
    }
}
