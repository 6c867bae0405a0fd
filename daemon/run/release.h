/* SPDX-License-Identifier: MIT
 *
 * release.h - the traffic of nodes without port: when which frame is handed in.
 *
 * The same in canwired and in `canwire sim`. Release k of a `send` is at offset + k * every, k <
 * count, delayed by up to `jitter`; that of a `replay` comes from a file, at its time there or,
 * with `speed: max`, whenever the node has nothing else to send. Replies are rules of the bus.
 */
#ifndef CANWIRE_RUN_RELEASE_H
#define CANWIRE_RUN_RELEASE_H

#include "config/config.h"

typedef struct release_plan release_plan;

/* Is told, in one line, what has to be said about a file. failed: it is replayed no further. */
typedef void release_teller(void *user, bool failed, const char *text);

/* The releases of a configuration, which must live longer. NULL: out of memory. */
release_plan *release_plan_new(const cfg *config, release_teller *tell, void *user);

/* Reads the files ahead from now on, in threads, so that nothing waits for a disk any more; a frame
 * that has not been read in time comes late. False when there is no memory or thread for it. */
bool release_read_ahead(release_plan *plan);

/* Says what has not been said about files. NULL is fine. */
void release_plan_free(release_plan *plan);

/* Goes on where another plan is, on a bus that has run up to a tick: replays that both have go on,
 * others begin there; a `send` passes over all releases before. from: by node the one in the old
 * plan, or CW_NO_NODE. */
void release_take_over(release_plan *plan, release_plan *old, const uint8_t from[CW_NODES_MAX],
                       uint64_t tick);

/* Tick of the next release, CW_NEVER when none is known. */
uint64_t release_next_tick(const release_plan *plan);

/* The frame of the next release and its node; NULL: nothing is handed in with it, a file was only
 * searched. There must be one; it is good until the next release_hand_in(). */
const cw_frame *release_first(const release_plan *plan, unsigned *node);

/* Whether the next release is the only one before a tick, but for those of the same `send`. There
 * must be one. */
bool release_is_alone(const release_plan *plan, uint64_t before);

/* Hands the next release to its node. Returns what cw_node_send() says; on CW_FULL nothing has
 * changed. There must be one. */
cw_status release_hand_in(release_plan *plan, cw_bus *bus);

/* Whether a file is replayed as fast as possible: then release_look() is to be called before the
 * first bit and after each one that may have left its node with nothing to send. */
bool release_is_fast(const release_plan *plan);

/* The end of the next bit after which release_look() is due, if no faults are at work on the
 * bus. */
uint64_t release_look_at(const release_plan *plan, const cw_bus *bus);

/* Plans the next frames of such files, whose nodes have nothing to send, for the coming bit. */
void release_look(release_plan *plan, const cw_bus *bus);

/* Whether a file could not be read to its end. */
bool release_failed(const release_plan *plan);

/* When the last release will be, as far as can be known at a tick: guessed by how much of the
 * files is done. CW_NEVER: not at all. */
uint64_t release_guess_end(const release_plan *plan, uint64_t now);

/* Gives a new bus the replies of a configuration. */
void release_add_replies(cw_bus *bus, const cfg *config);

#endif
