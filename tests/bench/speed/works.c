/* SPDX-License-Identifier: MIT
 *
 * works.c - the list of what is measured.
 */
#include "works.h"

#define ENCODE(work, ...)                                                                          \
    {.name = "encode-" work, .unit = "frame", .units = 2000,                                       \
     .options = &(const bench_encode_options){__VA_ARGS__},                                        \
     .start = bench_encode_start, .run = bench_encode_run, .end = bench_encode_end}

#define LENGTH(work, ...)                                                                          \
    {.name = "length-" work, .unit = "frame", .units = 2000,                                       \
     .options = &(const bench_encode_options){__VA_ARGS__},                                        \
     .start = bench_encode_start, .run = bench_length_run, .end = bench_encode_end}

#define FRAMES(work, ...) MORE_FRAMES(work, 2000, __VA_ARGS__)

/* It takes many frames until all queues and identifiers of 64 nodes have been in use. */
#define MORE_FRAMES(work, count, ...)                                                              \
    {.name = work, .unit = "frame", .units = count,                                                \
     .options = &(const bench_bus_options){__VA_ARGS__}, .start = bench_bus_start,                 \
     .run = bench_bus_run_frames, .end = bench_bus_end}

#define BITS(work, ...)                                                                            \
    {.name = work, .unit = "bit", .units = 20000,                                                  \
     .options = &(const bench_bus_options){__VA_ARGS__}, .start = bench_bus_start,                 \
     .run = bench_bus_run_bits, .end = bench_bus_end}

/* scripts/bench knows these names. */
const bench_work bench_works[] = {
    ENCODE("base", .extended = false),
    ENCODE("extended", .extended = true),
    ENCODE("fd-64", .fd = true),
    LENGTH("base", .extended = false),
    LENGTH("extended", .extended = true),
    LENGTH("fd-64", .fd = true),
    FRAMES("clean-2", .nodes = 2, .senders = 2),
    FRAMES("clean-4", .nodes = 4, .senders = 4),
    FRAMES("clean-fresh-4", .nodes = 4, .senders = 4, .fresh = true),
    FRAMES("clean-16", .nodes = 16, .senders = 16),
    MORE_FRAMES("clean-64", 20000, .nodes = 64, .senders = 64),
    FRAMES("fd-8-2", .nodes = 2, .senders = 2, .fd = 8),
    MORE_FRAMES("fd-8-64", 20000, .nodes = 64, .senders = 64, .fd = 8),
    FRAMES("fd-64-2", .nodes = 2, .senders = 2, .fd = 64),
    FRAMES("fd-64-4", .nodes = 4, .senders = 4, .fd = 64),
    FRAMES("fd-64-16", .nodes = 16, .senders = 16, .fd = 64),
    MORE_FRAMES("fd-64-64", 20000, .nodes = 64, .senders = 64, .fd = 64),
    FRAMES("fd-lost-4", .nodes = 4, .senders = 4, .fd = 64, .lost = true),
    FRAMES("timed-clean-2", .nodes = 2, .senders = 2, .ppm = 100, .load = 60),
    FRAMES("timed-clean-4", .nodes = 4, .senders = 4, .ppm = 100, .load = 60),
    FRAMES("timed-clean-16", .nodes = 16, .senders = 16, .ppm = 100, .load = 60),
    FRAMES("timed-clean-64", .nodes = 64, .senders = 64, .ppm = 100, .load = 60),
    FRAMES("clean-load-4", .nodes = 4, .senders = 4, .load = 60),
    FRAMES("clean-lost-2", .nodes = 2, .senders = 2, .lost = true),
    FRAMES("clean-lost-4", .nodes = 4, .senders = 4, .lost = true),
    FRAMES("clean-lost-16", .nodes = 16, .senders = 16, .lost = true),
    MORE_FRAMES("clean-lost-64", 20000, .nodes = 64, .senders = 64, .lost = true),
    FRAMES("receivers-1", .nodes = 2, .senders = 1),
    MORE_FRAMES("receivers-63", 20000, .nodes = 64, .senders = 1),
    BITS("every-node-2", .nodes = 2, .senders = 2, .stepping = true),
    BITS("every-node-4", .nodes = 4, .senders = 4, .stepping = true),
    BITS("every-node-16", .nodes = 16, .senders = 16, .stepping = true),
    BITS("every-node-64", .nodes = 64, .senders = 64, .stepping = true),
    BITS("lockstep-4", .nodes = 4, .senders = 4, .lockstep = true),
    BITS("lockstep-16", .nodes = 16, .senders = 16, .lockstep = true),
    BITS("lockstep-64", .nodes = 64, .senders = 64, .lockstep = true),
    BITS("bit-by-bit-4", .nodes = 4, .senders = 3, .bit_by_bit = true),
    BITS("bit-by-bit-16", .nodes = 16, .senders = 15, .bit_by_bit = true),
    BITS("bit-by-bit-64", .nodes = 64, .senders = 63, .bit_by_bit = true),
    FRAMES("faulted-100", .nodes = 4, .senders = 4, .every = 100),
    FRAMES("faulted-10", .nodes = 4, .senders = 4, .every = 10),
    FRAMES("rules-1", .nodes = 4, .senders = 4, .rules = 1),
    FRAMES("rules-10", .nodes = 4, .senders = 4, .rules = 10),
    FRAMES("rules-100", .nodes = 4, .senders = 4, .rules = 100),
    FRAMES("rules-1000", .nodes = 4, .senders = 4, .rules = 1000),
    FRAMES("wild-10", .nodes = 4, .senders = 4, .rules = 1000, .wild = 10),
    FRAMES("wild-100", .nodes = 4, .senders = 4, .rules = 1000, .wild = 100),
    BITS("saturated-8", .nodes = 8, .senders = 8),
    BITS("saturated-lost-8", .nodes = 8, .senders = 8, .lost = true),
    BITS("timed-100-2", .nodes = 2, .senders = 2, .ppm = 100),
    BITS("timed-100-4", .nodes = 4, .senders = 4, .ppm = 100),
    BITS("timed-100-16", .nodes = 16, .senders = 16, .ppm = 100),
    BITS("timed-100-64", .nodes = 64, .senders = 64, .ppm = 100),
    BITS("timed-3000-2", .nodes = 2, .senders = 2, .ppm = 3000),
    BITS("timed-3000-4", .nodes = 4, .senders = 4, .ppm = 3000),
    BITS("timed-3000-16", .nodes = 16, .senders = 16, .ppm = 3000),
    BITS("timed-3000-64", .nodes = 64, .senders = 64, .ppm = 3000),
    BITS("timed-light-4", .nodes = 4, .senders = 4, .ppm = 100, .load = 10),
    {.name = "begin", .unit = "bus", .units = 100, .start = bench_mix_start,
     .run = bench_begin_run, .end = bench_mix_end},
    {.name = "mix", .unit = "bus second", .units = 1, .start = bench_mix_start,
     .run = bench_mix_run, .end = bench_mix_end},
};

const unsigned bench_work_count = sizeof bench_works / sizeof bench_works[0];
