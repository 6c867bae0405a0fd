/* SPDX-License-Identifier: MIT
 *
 * frames.c - the frames that all works use, and what else they share.
 */
#include "works.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define NODE_BITS 6 /* of an identifier: who sends it */

/* SplitMix64: returns a well-mixed value for each number. */
static uint64_t scramble(uint64_t number)
{
    uint64_t z = number * UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
    return z ^ z >> 31;
}

cw_frame bench_frame(uint64_t number, unsigned node, bool extended)
{
    uint64_t id = scramble(2 * number + 1);
    uint64_t data = scramble(2 * number + 2);
    cw_frame f = {.dlc = 8, .flags = extended ? CW_FRAME_EXTENDED : 0};
    f.id = (uint32_t)(id << NODE_BITS | node) & (extended ? 0x1FFFFFFFu : 0x7FFu);
    for (unsigned i = 0; i < 8; i++)
        f.data[i] = (uint8_t)(data >> 8 * i);
    return f;
}

uint32_t bench_foreign_id(unsigned number)
{
    return (number << NODE_BITS & 0x7C0u) | (1u << (NODE_BITS - 1)) | (number >> 5 & 0x1Fu);
}

void bench_fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fputs("bench: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    exit(1);
}

void *bench_alloc(size_t size)
{
    void *memory = calloc(1, size);
    if (!memory)
        bench_fail("out of memory");
    return memory;
}
