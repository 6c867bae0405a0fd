/* SPDX-License-Identifier: MIT
 *
 * event_read.h - events of a bus from the lines of JSON that output_event() wrote.
 */
#ifndef CANWIRE_RECORD_EVENT_READ_H
#define CANWIRE_RECORD_EVENT_READ_H

#include "canwire.h"
#include "config/config.h"

#include <jansson.h>

typedef enum event_read_result {
    EVENT_READ = 0,
    EVENT_OTHER,       /* a kind that is not an event of the bus, or comes from a newer version */
    EVENT_NO_SUCH_NODE /* the nodes have changed */
} event_read_result;

/* Reads a line of these kinds: error, state, restart, arbitration-lost, drop, tx, rx, skip. The
 * tick is not exact, but *time_ns is, in bus time. The line does not contain the format of an
 * error's frame. */
event_read_result event_read(cw_event *out, uint64_t *time_ns, const json_t *line,
                             const cfg *config);

#endif
