/* SPDX-License-Identifier: MIT
 *
 * reloader.h - reads the configuration again beside the bus, whenever somebody asks for it.
 *
 * Reloads are in rounds. Who asks while a round is being read gets the next one, since the file may
 * have changed after it was read; all of them get the same one. A round that takes too long is
 * given up.
 */
#ifndef CANWIRE_ENGINE_RELOADER_H
#define CANWIRE_ENGINE_RELOADER_H

#include "engine/reload.h"

#include <ev.h>

#define RELOADER_LIMIT_S 10 /* for all files of a round */

typedef struct reloader reloader;

typedef struct reloader_calls {
    /* A round begins to be read. */
    void (*begins)(void *user);
    /* It has been read; r is the callee's. False, with nothing changed, after writing why. */
    bool (*take)(void *user, reload *r, FILE *errors);
    /* It is over. errors: NULL, or a line per error, that may be written to. */
    void (*over)(void *user, uint64_t round, char *errors);
} reloader_calls;

/* Nothing is read yet. others: files that canwired has besides those of the configuration, which
 * none may write. They and the calls must live longer. NULL when there is no memory. */
reloader *reloader_new(struct ev_loop *loop, const fileuses *others, const reloader_calls *calls,
                       void *user);

/* Asks for a reload of a file. Returns the round in which it will be; over() tells, later. 0 after
 * writing why there is none. */
uint64_t reloader_ask(reloader *r, const char *file, FILE *errors);

/* Whether anything is being read or is to be. */
bool reloader_is_busy(const reloader *r);

/* Ends all rounds, with an error, and leaves alone what hangs. NULL is fine. */
void reloader_free(reloader *r);

#endif
