/* SPDX-License-Identifier: MIT
 *
 * report.h - what the daemon knows of its bus beyond the library, to be shown: the nodes'
 * interfaces, and how it keeps pace.
 */
#ifndef CANWIRE_ENGINE_REPORT_H
#define CANWIRE_ENGINE_REPORT_H

#include "port/port.h"

/* Of a node's interface. */
typedef enum report_link {
    REPORT_NO_LINK = 0, /* the node has no port */
    REPORT_LINK_UP,
    REPORT_LINK_DOWN,
    REPORT_LINK_MISSING, /* there is no such interface, or it cannot be opened */
} report_link;

typedef struct report_node {
    report_link link;
    port_stats interface; /* since the node is on the bus, whatever interfaces it has had */
    bool conserved;       /* every frame is accounted for */
    bool pushed_back;     /* its port is not read just now: its queue is full */
    cw_frame overflowed;  /* the last one that was dropped because its queue was full */
} report_node;

typedef struct report {
    report_node nodes[CW_NODES_MAX];
    uint64_t epoch_ns;   /* since 1970: bus time 0 */
    uint64_t lag_ns;     /* how far the bus is behind real time just now */
    uint64_t skips;      /* how often it was too far behind ... */
    uint64_t skipped_ns; /* ... and the time that it has skipped, in all */
} report;

#endif
