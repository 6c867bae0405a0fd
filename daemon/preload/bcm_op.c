/* SPDX-License-Identifier: MIT
 *
 * bcm_op.c - the jobs of CAN_BCM sockets: making, finding, telling.
 */
#include "preload/bcm_op.h"

#include "preload/conn.h"
#include "preload/relay.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#define NS_PER_S INT64_C(1000000000)
#define FLAGS_AT 5u          /* of a frame: a byte that only CAN FD frames use */
#define FLAGS_OF_FRAME 0x0Fu /* the others are of bcm_rx.c */
#define LENGTH_AT 4u

/* ---- Making ---------------------------------------------------------------------------------- */

bcm_op *bcm_op_find(bcm_op *first, const bcm_request *request)
{
    for (; first; first = first->next)
        if (first->as.can_id == request->head.can_id && first->index == request->index &&
            first->frame_bytes == request->frame_bytes)
            return first;
    return NULL;
}

bcm_op *bcm_op_new(bcm_op **first, const bcm_request *request, unsigned room)
{
    bcm_op *op = calloc(1, sizeof *op);
    unsigned char *frames = calloc(room, request->frame_bytes);
    unsigned char *last = calloc(room, request->frame_bytes);
    if (!op || !frames || !last) {
        free(op);
        free(frames);
        free(last);
        return NULL;
    }
    *op = (bcm_op){.next = *first,
                   .socket = request->socket,
                   .index = request->index,
                   .frame_bytes = request->frame_bytes,
                   .room = room,
                   .frames = frames,
                   .last = last};
    op->as.can_id = request->head.can_id;
    op->timer = op->throttle = (pump_item){.fd = -1, .due_ns = PUMP_NEVER, .user = op};
    *first = op;
    return op;
}

/* Frees a job that is in no list of a socket any more. */
static void delete(bcm_op *op)
{
    pump_remove(&op->timer);
    pump_remove(&op->throttle);
    free(op->frames);
    free(op->last);
    free(op);
}

bool bcm_op_delete(bcm_op **first, const bcm_request *request)
{
    bcm_op *found = bcm_op_find(*first, request);
    for (bcm_op **at = first; found && *at; at = &(*at)->next)
        if (*at == found) {
            *at = found->next;
            delete(found);
            return true;
        }
    return false;
}

void bcm_op_delete_all(bcm_op **first)
{
    while (*first) {
        bcm_op *op = *first;
        *first = op->next;
        delete(op);
    }
}

int bcm_op_copy(unsigned char *to, const bcm_request *request)
{
    const size_t size = request->frame_bytes;
    const unsigned longest = size == CANFD_MTU ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
    for (unsigned i = 0; i < request->head.nframes; i++)
        if (request->frames[i * size + LENGTH_AT] > longest)
            return EINVAL;
    if (request->head.nframes > 0)
        memcpy(to, request->frames, request->head.nframes * size);
    return 0;
}

void bcm_op_set(bcm_op *op, const bcm_request *request)
{
    const bcm_head *head = &request->head;
    op->as.flags = head->flags;
    op->as.nframes = head->nframes;
    if (!(head->flags & SETTIMER))
        return;
    op->as.count = head->count;
    op->as.ival1 = head->ival1;
    op->as.ival2 = head->ival2;
}

int64_t bcm_op_ns(const struct bcm_timeval *span)
{
    return span->tv_sec * NS_PER_S + span->tv_usec * INT64_C(1000);
}

/* ---- To the bus ------------------------------------------------------------------------------ */

void bcm_transmit(cansock *s, int index, const void *frame, size_t size)
{
    const iface *in = ifmap_of_index(index);
    const int number = in ? ifmap_number(in) : -1;
    if (number < 0 || s->side[number] < 0)
        return;
    const int error = conn_send(s->side[number], frame, size, MSG_DONTWAIT);
    s->sent[number] += error == 0;
    if (error == ENETDOWN)
        relay_lose(s, number);
}

void bcm_op_transmit(bcm_op *op)
{
    const unsigned char *frame = op->frames + op->current * op->frame_bytes;
    if (op->as.nframes == 0)
        return;
    op->current = op->current + 1 < op->as.nframes ? op->current + 1 : 0;
    bcm_transmit(op->socket, op->index, frame, op->frame_bytes);
}

/* ---- To the program -------------------------------------------------------------------------- */

static uint64_t realtime_ns(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (uint64_t)(now.tv_sec * NS_PER_S + now.tv_nsec);
}

void bcm_op_tell(const bcm_op *op, unsigned opcode, const void *frames, unsigned count)
{
    const size_t bytes = count * op->frame_bytes;
    const bool received = opcode == RX_CHANGED;
    message_head head = {.type = MESSAGE_FRAME};
    unsigned char *body = calloc(1, sizeof op->as + bytes);
    if (!body)
        return;
    bcm_head told = op->as;
    told.opcode = opcode;
    told.nframes = count;
    head.realtime_ns = received ? op->realtime_ns : realtime_ns();
    head.reserved = (uint32_t)op->from;
    memcpy(body, &told, sizeof told);
    if (bytes > 0)
        memcpy(body + sizeof told, frames, bytes);
    for (unsigned i = 0; i < count; i++)
        body[sizeof told + i * op->frame_bytes + FLAGS_AT] &= FLAGS_OF_FRAME;
    relay_put(op->socket, &head, body, sizeof told + bytes);
    free(body);
}
