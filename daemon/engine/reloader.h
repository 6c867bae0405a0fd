/* SPDX-License-Identifier: MIT
 *
 * reloader.h - reads the configuration again beside the bus, on request.
 *
 * Reloads are in rounds. Requests during a round share the next one, since the file may have
 * changed after it was read. A round that takes too long is given up.
 */
#ifndef CANWIRE_ENGINE_RELOADER_H
#define CANWIRE_ENGINE_RELOADER_H

#include "config/rig.h"
#include "engine/reload.h"

#include <ev.h>

#define RELOADER_LIMIT_S 10 /* for all files of a round */

typedef struct reloader reloader;

typedef struct reloader_calls {
    /* Reports the beginning of a round. */
    void (*begins)(void *user);
    /* Takes over the result r of a round. Returns false, with nothing changed, after writing the
     * reason. */
    bool (*take)(void *user, reload *r, FILE *errors);
    /* Reports the end of a round. errors: NULL, or a line per error, in a text that may be
     * modified. */
    void (*over)(void *user, uint64_t round, char *errors);
} reloader_calls;

/* Makes a reloader. others: further files of canwired, which no configuration may write. They and
 * the calls must live longer. Returns NULL without memory. */
reloader *reloader_new(struct ev_loop *loop, const fileuses *others, const reloader_calls *calls,
                       void *user);

/* Refuses reloads when the file of a rig has another text than that, which must live longer. */
void reloader_keep_rig(reloader *r, const rig *config);

/* Requests a reload of a file. Returns its round, whose end over() reports later. Returns 0 after
 * writing the reason. */
uint64_t reloader_ask(reloader *r, const char *file, FILE *errors);

/* Returns true while a round is being read or is requested. */
bool reloader_is_busy(const reloader *r);

/* Ends all rounds, with an error, and leaves threads that hang. NULL is allowed. */
void reloader_free(reloader *r);

#endif
