/* SPDX-License-Identifier: MIT
 *
 * gathered.c - frames of linux/can.h that one call of the kernel is to send to a socket.
 */
#include "port/gathered.h"

#include <string.h>

port_sent gathered_take(gathered *self, port *p, const void *frame, size_t size)
{
    const unsigned i = self->count++;
    memcpy(&self->frames[i], frame, size);
    self->vectors[i] = (struct iovec){.iov_base = &self->frames[i], .iov_len = size};
    self->headers[i] =
        (struct mmsghdr){.msg_hdr = {.msg_iov = &self->vectors[i], .msg_iovlen = 1}};
    if (self->count == GATHERED_MAX)
        p->kind->flush(p);
    return PORT_GATHERED;
}

unsigned gathered_send(gathered *self, port *p, int socket, gathered_one *one)
{
    int sent = 0;
    if (self->count > 1) /* for a single one send() costs less */
        sent = sendmmsg(socket, self->headers, self->count, MSG_DONTWAIT | MSG_NOSIGNAL);
    const unsigned at_once = sent > 0 ? (unsigned)sent : 0;
    for (unsigned i = 0; i < self->count; i++)
        port_count_sent(p, self->frames[i].can_id,
                        i < at_once ? PORT_SENT
                                    : one(p, &self->frames[i], self->vectors[i].iov_len));
    self->count = 0;
    return at_once;
}
