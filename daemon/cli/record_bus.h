/* SPDX-License-Identifier: MIT
 *
 * record_bus.h - records the events of a running bus in a file or a stream of the user.
 */
#ifndef CANWIRE_CLI_RECORD_BUS_H
#define CANWIRE_CLI_RECORD_BUS_H

#include "config/config.h"

#include <stdbool.h>

typedef struct record_order {
    cfg_record what; /* its file is also the name in messages */
    int stream;      /* a descriptor to write to in place of a file; -1: none */
    bool frames_only;
    bool quiet;       /* tells losses and errors alone */
    const char *tool; /* "canwire NAME", for messages */
} record_order;

/* Records until the bus ends, or a signal or the reader of the stream ends it. Returns the exit
 * status after messages. */
int record_bus(const char *bus, const record_order *order);

#endif
