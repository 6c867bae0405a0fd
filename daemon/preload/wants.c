/* SPDX-License-Identifier: MIT
 *
 * wants.c - what connections of a CAN_RAW socket ask of their ports.
 */
#include "preload/wants.h"

#include <stdlib.h>
#include <string.h>

static uint32_t options_of(const cansock_raw *raw)
{
    return (raw->loopback ? MESSAGE_LOOPBACK : 0) | (raw->recv_own ? MESSAGE_RECV_OWN : 0) |
           (raw->fd_frames ? MESSAGE_FD : 0) | (raw->join ? MESSAGE_JOIN : 0) | MESSAGE_FLUSHES;
}

conn_wants wants_all(const cansock *s)
{
    return (conn_wants){.options = options_of(&s->raw),
                        .error_mask = s->raw.error_mask,
                        .filtered = s->raw.filters_set,
                        .filter_count = s->raw.filter_count,
                        .filters = s->raw.filters};
}

conn_wants wants_sending(const cansock *s)
{
    return (conn_wants){.options = options_of(&s->raw) & ~MESSAGE_RECV_OWN, .filtered = true};
}

conn_wants wants_copy(const conn_wants *wants)
{
    conn_wants copy = *wants;
    struct can_filter *filters = calloc(wants->filter_count + 1, sizeof *filters);
    if (filters && wants->filter_count > 0)
        memcpy(filters, wants->filters, wants->filter_count * sizeof *filters);
    copy.filter_count = filters ? wants->filter_count : 0;
    copy.filters = filters;
    return copy;
}

void wants_free(conn_wants *wants)
{
    free((void *)(uintptr_t)wants->filters);
    wants->filters = NULL;
}
