/* SPDX-License-Identifier: MIT
 *
 * works.h - what is measured: pieces of work of any size.
 */
#ifndef CANWIRE_BENCH_WORKS_H
#define CANWIRE_BENCH_WORKS_H

#include "canwire.h"

#define BENCH_FRAMES 1024u /* different ones that a work goes round */
#define BENCH_BIT_TICKS 80u /* 1 Mbit/s */

/* A piece of work. Times and instructions are counted per unit; what start and end cost is not. */
typedef struct bench_work {
    const char *name;
    const char *unit;    /* "frame", "bit" … */
    uint64_t units;      /* enough for counting instructions */
    const void *options; /* of the kind of work */
    void *(*start)(const void *options);
    /* Does at least so many units; returns how many it has done. */
    uint64_t (*run)(void *state, uint64_t units);
    /* Ends the program with a message when what was done was not what is to be measured. */
    void (*end)(void *state);
} bench_work;

extern const bench_work bench_works[];
extern const unsigned bench_work_count;

/* Returns an 8-byte frame with random content, the same ones in each run; extended or not. No two
 * nodes have the same identifiers. */
cw_frame bench_frame(uint64_t number, unsigned node, bool extended);

/* Returns an identifier that bench_frame() does not give to one of the first 32 nodes. */
uint32_t bench_foreign_id(unsigned number);

/* Ends the program with a message. */
_Noreturn void bench_fail(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Allocates memory or ends the program. */
void *bench_alloc(size_t size);

/* Returns the bytes of a node on a bus, without its queue and cw_node_stats. */
size_t bench_bytes_per_node(void);

/* ---- Kinds of work --------------------------------------------------------------------------- */

typedef struct bench_encode_options {
    bool extended;
    bool fd; /* frames of 64 bytes */
} bench_encode_options;

void *bench_encode_start(const void *options);
uint64_t bench_encode_run(void *state, uint64_t units);
uint64_t bench_length_run(void *state, uint64_t units);
void bench_encode_end(void *state);

/* A bus at 100 % load with frames of 8 bytes. */
typedef struct bench_bus_options {
    unsigned nodes;
    unsigned senders; /* that always have frames waiting */
    bool fresh;       /* no frame has data that another one had; otherwise they recur */
    bool lost;        /* events report lost arbitrations, too */
    bool stepping;    /* cw_bus_set_stepping(): every node in every bit */
    bool bit_by_bit;  /* a rule is at work in every bit; the last node must not be a sender */
    bool lockstep;    /* a rule must see the controllers in every bit */
    unsigned every;   /* attempt that gets a wrong CRC bit, 0: none */
    unsigned rules;   /* for identifiers without a sender */
    unsigned wild;    /* of these, with a mask for two of them each; the others are exact */
    int32_t ppm;      /* nodes have clocks of their own, which differ by up to twice that, and
                         delays; 0: all clocks agree */
    unsigned load;    /* percent; 0: as much as fits */
    unsigned fd;      /* bytes of FD frames with BRS, four times as fast; 0: classical frames */
} bench_bus_options;

void *bench_bus_start(const void *options);
uint64_t bench_bus_run_frames(void *state, uint64_t units);
uint64_t bench_bus_run_bits(void *state, uint64_t units);
void bench_bus_end(void *state);

/* Starts the periodic traffic of a car. A unit is a second of bus time. */
void *bench_mix_start(const void *options);
uint64_t bench_mix_run(void *state, uint64_t units);

/* Begins with such a bus so many times. */
uint64_t bench_begin_run(void *state, uint64_t units);
void bench_mix_end(void *state);

/* Its load on the bus after some run. */
unsigned bench_mix_load_permille(void *state);

#endif
