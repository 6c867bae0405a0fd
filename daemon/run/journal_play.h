/* SPDX-License-Identifier: MIT
 *
 * journal_play.h - repeats the run of a journal: the same inputs, the same events.
 */
#ifndef CANWIRE_RUN_JOURNAL_PLAY_H
#define CANWIRE_RUN_JOURNAL_PLAY_H

#include "run/journal_read.h"

typedef struct journal_player journal_player;

/* The calls of the player to its user. */
typedef struct journal_calls {
    /* Advances the bus to a tick and takes all events, as inputs_advance() does. The tick is the
     * end of a bit and not before the present one. Returns false to end the run of this bus. */
    bool (*advance)(void *user, uint64_t tick);
    inputs_drain *drain;                                 /* takes all events of the bus */
    void (*event)(void *user, const cw_event *event);    /* an event that does not come from the
                                                            bus */
    /* A rule or the name of a guest goes; all events have been taken. May be NULL. */
    void (*renaming)(void *user);
    /* Announces another configuration; `from` has the old node of each node, or CW_NO_NODE. All
     * events of the old one have been taken; it is still the player's configuration. */
    void (*leaving)(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX]);
    void (*changed)(void *user); /* the configuration has changed */
    /* Returns the user of the calls of a bus of a rig. NULL: a rig is refused. */
    void *(*of_bus)(void *user, size_t bus);
} journal_calls;

/* Opens a journal and makes its first bus, or all buses of a rig, at tick 0. Messages go to
 * `errors`, one per line. Returns NULL after a message. */
journal_player *journal_player_open(const char *file, const journal_calls *calls, void *user,
                                    FILE *errors);

/* Frees the player. NULL is allowed. */
void journal_player_close(journal_player *p);

/* Returns the configuration in effect. The pointer stays the same, its contents change. */
const cfg *journal_player_config(const journal_player *p);

/* The first returns the number of buses: 1, or those of a rig. The others return the same as the
 * functions without `_of`, for one of them. */
size_t journal_player_count(const journal_player *p);
const cfg *journal_player_config_of(const journal_player *p, size_t bus);
cw_bus *journal_player_bus_of(const journal_player *p, size_t bus);

/* Returns the bus, which changes with each `changed`. */
cw_bus *journal_player_bus(const journal_player *p);

/* Returns the version of canwire that wrote the journal. */
const char *journal_player_writer(const journal_player *p);

typedef enum journal_outcome {
    JOURNAL_PLAYED = 0, /* to its end */
    JOURNAL_STOPPED,    /* stopped by `advance` */
    JOURNAL_INCOMPLETE, /* played up to a break or cut, which is reported */
    JOURNAL_FAILED,     /* unreadable, or another run, which is reported */
} journal_outcome;

/* Plays the journal. */
journal_outcome journal_play(journal_player *p);

#endif
