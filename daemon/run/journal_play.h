/* SPDX-License-Identifier: MIT
 *
 * journal_play.h - runs again what a journal has written down: the same inputs, the same events.
 */
#ifndef CANWIRE_RUN_JOURNAL_PLAY_H
#define CANWIRE_RUN_JOURNAL_PLAY_H

#include "run/journal_read.h"

typedef struct journal_player journal_player;

/* What the player does with whom it plays for. */
typedef struct journal_calls {
    /* Advances the bus to a tick, which is the end of a bit and not before now, with all events
     * taken, as inputs_advance(). False: the run is over, there is nothing more to play. */
    bool (*advance)(void *user, uint64_t tick);
    inputs_drain *drain;                                 /* takes all events of the bus */
    void (*event)(void *user, const cw_event *event);    /* one that is not the bus's own */
    /* The bus goes over to another configuration; by node the old one, or CW_NO_NODE. All events of
     * the old one have been taken, and it is the player's configuration for the last time. */
    void (*leaving)(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX]);
    void (*changed)(void *user); /* it has gone over */
} journal_calls;

/* Opens a journal and makes the bus that it begins with, at tick 0. Messages go to errors, one a
 * line. NULL after one. */
journal_player *journal_player_open(const char *file, const journal_calls *calls, void *user,
                                    FILE *errors);

/* NULL is fine. */
void journal_player_close(journal_player *p);

/* The configuration in effect; always the same pointer, but what it says changes. */
const cfg *journal_player_config(const journal_player *p);

/* The bus as it is; another one after each `changed`. */
cw_bus *journal_player_bus(const journal_player *p);

/* The version of canwire that wrote the journal. */
const char *journal_player_writer(const journal_player *p);

typedef enum journal_outcome {
    JOURNAL_PLAYED = 0, /* to its end */
    JOURNAL_STOPPED,    /* `advance` has said so */
    JOURNAL_INCOMPLETE, /* as far as it goes: it is broken or cut off there, which is said */
    JOURNAL_FAILED,     /* it cannot be understood, or the run is another one, which is said */
} journal_outcome;

/* Plays it. */
journal_outcome journal_play(journal_player *p);

#endif
