/* SPDX-License-Identifier: MIT
 *
 * replay.h - the frames of a recorded file in their order, with their times on the bus.
 *
 * The first entry of the file, of any kind, has the time `offset`. So several nodes that replay a
 * file with different filters stay synchronised. An entry that steps back in time comes at once.
 */
#ifndef CANWIRE_RUN_REPLAY_H
#define CANWIRE_RUN_REPLAY_H

#include "config/config.h"

#define REPLAY_NOTE_MAX 1024

typedef struct replay replay;

typedef enum replay_step {
    REPLAY_FRAME = 0,
    REPLAY_PAUSE, /* many entries were skipped; ask again, no earlier than at *tick */
    REPLAY_LATER, /* the thread has not read so far yet; ask again */
    REPLAY_OVER,
    REPLAY_FAILED /* a file or an entry cannot be read; see replay_problem() */
} replay_step;

/* Opens the file of an entry, which must live longer. It begins at tick `origin`. Returns NULL
 * after writing the reason to problem. */
replay *replay_open(const cfg_traffic *traffic, cw_rate rate, uint64_t origin,
                    char problem[TRACE_PROBLEM_MAX]);

/* Closes the replay. NULL is allowed. */
void replay_close(replay *r);

/* Reads the file in a thread from now on; replay_next() does not wait for it. The first entries
 * have been read when the call returns. Returns false without memory or a thread. */
bool replay_read_ahead(replay *r);

/* Returns the next frame and its tick, which never decreases. With `speed: max` ticks have no
 * meaning. */
replay_step replay_next(replay *r, cw_frame *frame, uint64_t *tick);

/* Moves frames that have not been handed in to another origin. */
void replay_move(replay *r, uint64_t origin);

/* Delays these frames. */
void replay_delay(replay *r, uint64_t ticks);

/* Sets the same entry of another configuration, which must live longer from now on. */
void replay_set_traffic(replay *r, const cfg_traffic *traffic);

const char *replay_problem(const replay *r);

/* Writes a note about the left-out or suspicious entries so far; returns false when there is none.
 * known: the note of this file has been reported, only remarks about these filters are pending. */
bool replay_note(const replay *r, bool known, char note[REPLAY_NOTE_MAX]);

/* Returns how often the file has been read to its end. */
uint64_t replay_passes(const replay *r);

/* Returns the completed part, 0 to 1000; 0 for a loop. */
unsigned replay_permille(const replay *r);

/* Reads the file of an entry to its end. Returns true when it is valid. A message about it goes to
 * `note`, which is empty otherwise. *frames is the number of frames of each pass. */
bool replay_check(const cfg_traffic *traffic, uint64_t *frames, char note[REPLAY_NOTE_MAX]);

#endif
