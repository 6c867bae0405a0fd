/* SPDX-License-Identifier: MIT
 *
 * fuzz.h - what the fuzz targets share: taking an input apart, and a bus that is watched.
 *
 * Each fuzz_NAME.c defines LLVMFuzzerTestOneInput(). It is linked with libFuzzer for `make fuzz`,
 * and with replay.c for `make test`, which runs what has been found once. A target must do the
 * same for the same input, whatever came before.
 */
#ifndef CANWIRE_FUZZ_H
#define CANWIRE_FUZZ_H

#include "canwire.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Ends the program, which is what a fuzzer looks for, when the condition does not hold. */
#define REQUIRE(condition)                                                                         \
    do {                                                                                           \
        if (!(condition))                                                                          \
            fuzz_fail(__FILE__, __LINE__, #condition);                                             \
    } while (0)

_Noreturn void fuzz_fail(const char *file, int line, const char *condition);

/* Runs the target; always returns 0. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* ---- Input as numbers; all 0 when it is used up ---------------------------------------------- */

typedef struct fuzz_input {
    const uint8_t *data;
    size_t left;
} fuzz_input;

uint8_t fuzz_u8(fuzz_input *in);
uint32_t fuzz_u32(fuzz_input *in);

/* Reads a number from 0 to limit - 1. limit is at most 65536; up to 256 it takes one byte of
 * input. */
unsigned fuzz_below(fuzz_input *in, unsigned limit);

bool fuzz_bool(fuzz_input *in);

/* Reads a frame, valid more often than not. */
cw_frame fuzz_frame(fuzz_input *in);

/* ---- Text ------------------------------------------------------------------------------------ */

/* Returns the input with a final 0, to be freed; a string ends at the first 0 in it. */
char *fuzz_text(const uint8_t *data, size_t size);

/* ---- A bus that is watched ------------------------------------------------------------------- */

#define FUZZ_KINDS CW_EVENT_COUNT

typedef struct fuzz_bus {
    void *memory;
    cw_bus *bus;
    unsigned nodes;
    unsigned triggering; /* of them: those with triggers */
    uint32_t bit_ticks;
    uint64_t last_tick; /* of an event */
    uint64_t count[FUZZ_KINDS]; /* events, once for each node they concern */
    uint64_t events;
    uint64_t hash; /* over all events */
    cw_event last;
    bool partial; /* nodes have been removed: their statistics are gone */
    void (*take)(void *user, const cw_event *event); /* gets each event; may be NULL */
    void *user;
    bool trace;   /* FUZZ_TRACE is in the environment: events go to standard error */
    char label;   /* ... behind this */
} fuzz_bus;

/* Opens a bus. Returns false when the configuration is invalid. */
bool fuzz_bus_open(fuzz_bus *b, const cw_bus_config *config);

/* Changes to another bus, see cw_bus_take_over(); with CW_INVALID nothing has changed. */
cw_status fuzz_bus_take_over(fuzz_bus *b, const cw_bus_config *config, const uint8_t *from);
void fuzz_bus_close(fuzz_bus *b);

/* Takes and checks all events: in time order, of nodes that exist, with counters in range. */
void fuzz_bus_poll(fuzz_bus *b);

/* Advances to a tick, taking events whenever the ring is full. */
void fuzz_bus_advance(fuzz_bus *b, uint64_t tick);

/* Hands a frame in; advances as far as needed when the inbox is full. */
void fuzz_bus_send(fuzz_bus *b, unsigned node, const cw_frame *frame, uint64_t tick);

/* Statistics must agree with the events, and each frame handed in must be somewhere. */
void fuzz_bus_check(const fuzz_bus *b);

/* Sends frames at random times from all nodes for so many bits; checks the bus at the end. */
void fuzz_bus_traffic(fuzz_bus *b, unsigned bits, uint64_t seed);

/* Returns a number that depends on the whole input. */
uint64_t fuzz_hash(const uint8_t *data, size_t size);

/* Numbers that are the same in every run; *state must not be 0. */
uint32_t fuzz_random(uint64_t *state);

#endif
