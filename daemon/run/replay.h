/* SPDX-License-Identifier: MIT
 *
 * replay.h - the frames of a recorded file, one after the other, with the times they get on the
 * bus.
 *
 * The first entry of the file, whatever it is, stands at `offset`; so files that several nodes
 * replay with different filters stay together. An entry that steps back in time comes at once.
 */
#ifndef CANWIRE_RUN_REPLAY_H
#define CANWIRE_RUN_REPLAY_H

#include "config/config.h"

#define REPLAY_NOTE_MAX 1024

typedef struct replay replay;

typedef enum replay_step {
    REPLAY_FRAME = 0,
    REPLAY_PAUSE, /* many entries were passed over; ask again, no earlier than at *tick */
    REPLAY_LATER, /* the file is read ahead, and that has not come so far; ask again */
    REPLAY_OVER,
    REPLAY_FAILED /* the file cannot be read, or something in it; see replay_problem() */
} replay_step;

/* Opens the file of an entry, which must live longer. It begins at tick `origin`. NULL after
 * writing what is wrong to problem. */
replay *replay_open(const cfg_traffic *traffic, cw_rate rate, uint64_t origin,
                    char problem[TRACE_PROBLEM_MAX]);

/* NULL is fine. */
void replay_close(replay *r);

/* From now on the file is read by a thread, and replay_next() does not wait for it; what comes
 * first has been read at the return. False when there is no memory or thread. */
bool replay_read_ahead(replay *r);

/* The next frame and its tick, never before that of the frame before. With `speed: max` ticks mean
 * nothing. */
replay_step replay_next(replay *r, cw_frame *frame, uint64_t *tick);

/* Another beginning, for what has not been handed in yet. */
void replay_move(replay *r, uint64_t origin);

/* The same, so much later. */
void replay_delay(replay *r, uint64_t ticks);

/* The same entry in another configuration, which must live longer from now on. */
void replay_set_traffic(replay *r, const cfg_traffic *traffic);

const char *replay_problem(const replay *r);

/* What was left out, or looks wrong, of the entries so far; false when there is nothing to say.
 * known: it has been said of this file, only what concerns these filters has not. */
bool replay_note(const replay *r, bool known, char note[REPLAY_NOTE_MAX]);

/* How much of it is done, 0 to 1000; of a loop always 0. */
unsigned replay_permille(const replay *r);

/* Reads the file of an entry to its end. Returns whether it is good; what is to be said about it,
 * if anything, goes to `note`, else it is empty. *frames is how many would be sent each time. */
bool replay_check(const cfg_traffic *traffic, uint64_t *frames, char note[REPLAY_NOTE_MAX]);

#endif
