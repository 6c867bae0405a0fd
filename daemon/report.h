/* SPDX-License-Identifier: MIT
 *
 * report.h - what the daemon knows of its bus beyond the library, to be shown: the nodes' interfaces.
 */
#ifndef CANWIRE_REPORT_H
#define CANWIRE_REPORT_H

#include "port.h"

typedef struct report_node {
    port_stats interface; /* since the node is on the bus, whatever interfaces it has had */
    bool conserved;       /* every frame is accounted for */
} report_node;

typedef struct report {
    report_node nodes[CW_NODES_MAX];
} report;

#endif
