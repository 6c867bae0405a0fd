/* SPDX-License-Identifier: MIT
 *
 * pool_worker.h - the processes of a pool: what they get and what they give.
 *
 * A process gets orders. For each number it gives the code, the length as 4 bytes of this machine,
 * and the line.
 */
#ifndef CANWIRE_CAMPAIGN_POOL_WORKER_H
#define CANWIRE_CAMPAIGN_POOL_WORKER_H

#include "campaign/pool.h"

typedef struct pool_order {
    uint64_t first;
    uint64_t count;
    bool singly; /* each line is given as soon as it is made */
} pool_order;

#define POOL_HEAD_BYTES 5u

/* Appends a line, with its flag and length before it. Returns false without memory. */
bool pool_add_line(buffer *lines, unsigned char flag, const buffer *line);

/* Does orders that come by a socket until that ends; it then ends the process. */
_Noreturn void pool_worker(const pool_work *work, int fd);

#endif
