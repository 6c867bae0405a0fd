/* SPDX-License-Identifier: MIT
 *
 * release.h - releases the frames of nodes without port at their times.
 *
 * canwired and `canwire sim` share these releases. Release k of a `send` is at offset + k * every,
 * k < count, delayed by up to `jitter`. The frames of a `replay` come from a file at their times,
 * or as soon after them as the node's queue has room. With `speed: max` they come whenever the node
 * has nothing else to send. Replies are rules of the bus.
 */
#ifndef CANWIRE_RUN_RELEASE_H
#define CANWIRE_RUN_RELEASE_H

#include "config/config.h"

#define RELEASE_QUIET_S 10u /* a run to the end of the traffic ends after so long without any */

typedef struct release_plan release_plan;

/* Reports a message of one line about a file. failed: its replay has ended. */
typedef void release_reporter(void *user, bool failed, const char *text);

/* Makes the releases of a configuration, which must live longer. Returns NULL without memory. */
release_plan *release_plan_new(const cfg *config, release_reporter *report, void *user);

/* Makes those of all `send`, as they come in another run of the same bus, without replays. */
release_plan *release_plan_of_sends(const cfg *config);

/* Reads the files ahead from now on, in threads, so that no call waits for a disk. A frame that has
 * not been read in time comes late. Returns false without memory or a thread. */
bool release_read_ahead(release_plan *plan);

/* Reports pending messages about files, which the end of the plan would do. */
void release_tell(release_plan *plan);

/* Reports pending messages about files and frees the plan. NULL is allowed. */
void release_plan_free(release_plan *plan);

/* Continues another plan on a bus that has reached a tick. Replays of both plans go on, other
 * replays begin there, and a `send` skips earlier releases. `from` has for each node its old node,
 * or CW_NO_NODE. */
void release_take_over(release_plan *plan, release_plan *old, const uint8_t from[CW_NODES_MAX],
                       uint64_t tick);

/* Returns the tick of the next release, CW_NEVER when none is known. */
uint64_t release_next_tick(const release_plan *plan);

/* Returns a tick before which no node receives a released frame that passes a test. The test must
 * be the same in all calls for a plan. Files may have any frame; least: ticks from the release of
 * one to its reception, at least. */
uint64_t release_next_rx(release_plan *plan, cw_frame_test *test, const void *user,
                         uint64_t least);

/* Returns a tick at which, or after which, a release is to come for sure; 0 when none is. */
uint64_t release_sure_tick(const release_plan *plan);

/* Returns the frame of the next release and its node. NULL: the release hands in no frame, since a
 * file was only searched. A release must exist; the frame is valid until the next
 * release_hand_in(). */
const cw_frame *release_first(const release_plan *plan, unsigned *node);

/* Returns the place of the next release in the configuration. A release must exist. */
cfg_place release_place(const release_plan *plan);

/* Leaves the next release out. A release must exist. */
void release_pass(release_plan *plan);

/* Returns the tick of the next release of another entry than the first one's; CW_NEVER: none is
 * known. A release must exist. */
uint64_t release_second_tick(const release_plan *plan);

/* Returns true when the next release comes whatever happens before. A frame of a file may have to
 * wait, and reading it may fail. */
bool release_is_sure(const release_plan *plan);

/* Returns true when the next release hands in its frame without a new counter or checksum. A
 * release must exist. */
bool release_is_as_written(const release_plan *plan);

/* Returns true when the configuration alone determines the next release, its frame and its tick. A
 * release must exist. */
bool release_is_determined(const release_plan *plan);

/* Hands the next release to its node. Returns the status of cw_node_send(); on CW_FULL nothing has
 * changed. CW_AGAIN: a frame of a file waits for room in its node's queue. A release must exist. */
cw_status release_hand_in(release_plan *plan, cw_bus *bus);

/* Returns true when a file is replayed as fast as possible, or waits for room. The caller then
 * calls release_look() before the first bit, and after each bit that may leave the node without a
 * frame, or with room. */
bool release_is_fast(const release_plan *plan);

/* Returns the end of the next bit after which release_look() is due, if no faults act on the
 * bus. */
uint64_t release_look_at(const release_plan *plan, const cw_bus *bus);

/* Plans the next frames of such files for the coming bit, if their nodes have nothing to send, or
 * have room. */
void release_look(release_plan *plan, const cw_bus *bus);

/* Returns true when a file could not be read to its end. */
bool release_failed(const release_plan *plan);

/* Estimates the tick of the last release by the part of the files that has been read. CW_NEVER:
 * unknown. */
uint64_t release_guess_end(const release_plan *plan, uint64_t now);

/* Adds the replies of a configuration to a new bus. */
void release_add_replies(cw_bus *bus, const cfg *config);

#endif
