/* SPDX-License-Identifier: MIT
 *
 * canframelen.c - times can-utils' exact length of a frame on the wire, on the frames that our
 * encoder is timed with. scripts/bench links it with canframelen.c of can-utils, which it fetches.
 *
 * Output: a line of JSON. Lengths of can-utils include the intermission.
 */
#include "works.h"

#include "canframelen.h" /* of can-utils */

#include <linux/can.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define ROUNDS 15
#define CALLS 20000u
#define INTERMISSION_BITS 3u

static double now_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static struct canfd_frame convert(const cw_frame *f)
{
    struct canfd_frame out = {.can_id = f->id, .len = f->dlc};
    if (f->flags & CW_FRAME_EXTENDED)
        out.can_id |= CAN_EFF_FLAG;
    memcpy(out.data, f->data, 8);
    return out;
}

static double time_calls(struct canfd_frame *frames)
{
    unsigned sum = 0;
    double start = now_ns();
    for (unsigned i = 0; i < CALLS; i++)
        sum += can_frame_length(&frames[i % BENCH_FRAMES], CFL_EXACT, CAN_MTU);
    double ns = (now_ns() - start) / CALLS;
    if (sum == 0)
        bench_fail("can_frame_length() says nothing");
    return ns;
}

static void compare(struct canfd_frame *frames, bool extended, double *best_ns, unsigned *same)
{
    *same = 0;
    for (unsigned i = 0; i < BENCH_FRAMES; i++) {
        cw_bits bits;
        const cw_frame f = bench_frame(i, i % CW_NODES_MAX, extended);
        frames[i] = convert(&f);
        (void)cw_bits_encode(&bits, &f);
        *same += can_frame_length(&frames[i], CFL_EXACT, CAN_MTU) ==
                 bits.length + INTERMISSION_BITS;
    }
    for (unsigned round = 0; round < ROUNDS; round++) {
        double ns = time_calls(frames);
        if (round == 0 || ns < *best_ns)
            *best_ns = ns;
    }
}

int main(void)
{
    static struct canfd_frame frames[BENCH_FRAMES];
    double base_ns, extended_ns;
    unsigned base_same, extended_same;
    compare(frames, false, &base_ns, &base_same);
    compare(frames, true, &extended_ns, &extended_same);
    printf("{\"base_ns\": %.2f, \"extended_ns\": %.2f, \"frames\": %u, "
           "\"base_same\": %u, \"extended_same\": %u}\n",
           base_ns, extended_ns, BENCH_FRAMES, base_same, extended_same);
    return 0;
}
