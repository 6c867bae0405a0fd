/* SPDX-License-Identifier: MIT
 *
 * work_encode.c - frames to wire bits, and how many they are.
 */
#include "works.h"

#include <stdlib.h>
#include <string.h>

typedef struct encoding {
    cw_frame frames[BENCH_FRAMES];
    uint64_t wire_bits;
    uint64_t done;
} encoding;

/* Makes a frame of 64 bytes of one of 8. */
static void lengthen(cw_frame *frame, unsigned number)
{
    frame->flags |= CW_FRAME_FD | CW_FRAME_BRS;
    frame->dlc = (uint8_t)cw_fd_dlc(CW_FRAME_DATA_MAX);
    for (unsigned i = 8; i < CW_FRAME_DATA_MAX; i += 8) {
        const cw_frame more = bench_frame(BENCH_FRAMES * i + number, 0, false);
        memcpy(frame->data + i, more.data, 8);
    }
}

void *bench_encode_start(const void *options)
{
    const bench_encode_options *o = options;
    encoding *e = bench_alloc(sizeof *e);
    for (unsigned i = 0; i < BENCH_FRAMES; i++) {
        e->frames[i] = bench_frame(i, i % CW_NODES_MAX, o->extended);
        if (o->fd)
            lengthen(&e->frames[i], i);
    }
    return e;
}

uint64_t bench_encode_run(void *state, uint64_t units)
{
    encoding *e = state;
    cw_bits bits;
    for (uint64_t i = 0; i < units; i++) {
        (void)cw_bits_encode(&bits, &e->frames[i % BENCH_FRAMES]);
        e->wire_bits += bits.length;
    }
    e->done += units;
    return units;
}

uint64_t bench_length_run(void *state, uint64_t units)
{
    encoding *e = state;
    for (uint64_t i = 0; i < units; i++)
        e->wire_bits += cw_frame_wire_bits(&e->frames[i % BENCH_FRAMES]);
    e->done += units;
    return units;
}

/* Frames of 8 bytes or more have 108 wire bits at least. */
void bench_encode_end(void *state)
{
    encoding *e = state;
    if (e->wire_bits < 108 * e->done)
        bench_fail("the frames were not encoded");
    free(e);
}
