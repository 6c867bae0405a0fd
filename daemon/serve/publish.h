/* SPDX-License-Identifier: MIT
 *
 * publish.h - statistics and events over LCM, without ever holding up the bus.
 *
 * Messages are encoded by the caller's thread and put into a bounded queue; a thread of its own
 * talks to liblcm, which may block, fail at start (no multicast route) or print help. What does not
 * fit into the queue, or cannot be sent, is dropped and counted.
 */
#ifndef CANWIRE_SERVE_PUBLISH_H
#define CANWIRE_SERVE_PUBLISH_H

#include "config/config.h"
#include "engine/report.h"

#include <jansson.h>

typedef struct publisher publisher;

/* Starts the thread. NULL when there is no memory or no thread. The config must live longer. */
publisher *publisher_start(const cfg *config);

/* Sends what is queued, waiting a second at most, and ends the thread. One that hangs in liblcm is
 * left behind with its memory, for the process to end: another second later. NULL is fine. */
void publisher_stop(publisher *p);

/* The configuration has changed: nodes have other places. */
void publisher_remap(publisher *p, const uint8_t from[CW_NODES_MAX]);

/* Queues one BUS message and a NODE message for every node. */
void publisher_stats(publisher *p, const cw_bus *bus, const report *beyond);

/* Queues a FILE message for each file, of what journal_to_json() or recordings_json() says. */
void publisher_files(publisher *p, const char *kind, const json_t *files);

/* Queues an EVENT message for every node that it concerns, if events of its kind are wanted. */
void publisher_event(publisher *p, const cw_event *event);

#endif
