/* SPDX-License-Identifier: MIT
 *
 * publish.h - statistics and events over LCM, without ever delaying the bus.
 *
 * The caller's thread encodes messages and puts them into a bounded queue. Another thread calls
 * liblcm, which may block, fail at start (no multicast route) or print help. Messages that do not
 * fit into the queue, or cannot be sent, are dropped and counted.
 */
#ifndef CANWIRE_SERVE_PUBLISH_H
#define CANWIRE_SERVE_PUBLISH_H

#include "base/file/sink.h"
#include "config/config.h"
#include "engine/report.h"
#include "serve/verdicts.h"

#include <jansson.h>

typedef struct publisher publisher;

/* Starts the thread. The config must live longer. Returns NULL without memory or a thread. */
publisher *publisher_start(const cfg *config);

/* Sends queued messages, waiting a second at most, and ends the thread. After another second a
 * thread that hangs in liblcm is left with its memory. NULL is allowed. */
void publisher_stop(publisher *p);

/* Adapts to a changed configuration, in which nodes have other places. */
void publisher_remap(publisher *p, const uint8_t from[CW_NODES_MAX]);

/* Queues one BUS message and a NODE message for every node, and those that only some buses or
 * nodes have. */
void publisher_stats(publisher *p, const cw_bus *bus, const report *beyond);

/* Adds the publisher. The texts are good until the next call. */
void publisher_sink(publisher *p, sink_list *out);

/* Queues a FILE message for each sink. */
void publisher_sinks(publisher *p, const sink_list *all);

/* Queues a GATEWAY message for each gateway in the result of gateways_stats(). */
void publisher_gateways(publisher *p, const json_t *gateways);

/* Queues a VERDICT message, if the bus has expectations. */
void publisher_verdicts(publisher *p, const cw_bus *bus, const verdicts *all);

/* Queues an EVENT message for every node concerned, if events of its kind are wanted. */
void publisher_event(publisher *p, const cw_event *event);

#endif
