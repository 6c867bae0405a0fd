/* SPDX-License-Identifier: MIT
 *
 * report.h - data of the daemon beyond the library, for display: the nodes' interfaces, and the lag
 * of the bus.
 */
#ifndef CANWIRE_ENGINE_REPORT_H
#define CANWIRE_ENGINE_REPORT_H

#include "port/port.h"

/* The state of a node's interface. */
typedef enum report_link {
    REPORT_NO_LINK = 0, /* the node has no port */
    REPORT_LINK_UP,
    REPORT_LINK_DOWN,
    REPORT_LINK_MISSING, /* there is no such interface, or it cannot be opened */
} report_link;

typedef struct report_node {
    report_link link;
    port_stats interface; /* since the node is on the bus, for all its interfaces */
    bool conserved;       /* every frame is accounted for */
    const port *port;     /* as long as the engine does nothing else; NULL: none */
    bool pushed_back;     /* reading its port is paused: its queue is full */
    cw_frame overflowed;  /* the last frame that was dropped by a full queue */
} report_node;

/* Virtual time. */
typedef struct report_virtual {
    bool on;
    unsigned programs; /* that are there */
    bool begun;        /* there were enough once */
    uint64_t now_ns;   /* bus time */
    const char *runs;  /* the words of the program whose turn it is, or NULL */
    bool rests;        /* nothing will happen unless somebody does something from outside */
} report_virtual;

typedef struct report {
    report_node nodes[CW_NODES_MAX];
    uint64_t epoch_ns;   /* since 1970: bus time 0 */
    uint64_t lag_ns;     /* present lag behind real time */
    uint64_t skips;      /* number of times that it was too far behind ... */
    uint64_t skipped_ns; /* ... and the time that it has skipped then */
    report_virtual virtual_time;
} report;

#endif
