/* SPDX-License-Identifier: MIT
 *
 * net.h - several controllers on one wire of the bench.
 */
#ifndef NET_H
#define NET_H

#include "bench.h"

#define NET_NODES_MAX 4
#define NET_CLASSICAL 0x10000u /* with the modes of a node: it knows classical frames only (D17) */
#define NET_TOLERANT 0x20000u  /* it tolerates FD frames */
#define NET_ALL (-1) /* the wire: every node samples the inverted bit */

typedef struct net_node {
    const char *frames; /* to be sent, separated by blanks; NULL: no such node */
    const char *log;   /* expected reports: lostN TYPE:POSITION:ROLE:FLAG ovl tol rx:F tx drop */
    unsigned tec, rec; /* at the end */
    unsigned tec_before, rec_before;
    unsigned modes; /* CW_MODE_*, NET_CLASSICAL, NET_TOLERANT */
} net_node;

typedef struct net_case {
    const char *name;
    unsigned longest_dominant; /* run on the wire; 0: not checked */
    net_node node[NET_NODES_MAX];
    const char *flip_frame; /* NULL: no disturbance; else a bit of the first attempt is inverted */
    const char *flip_at;
    int flip_node; /* the node whose samples change, or NET_ALL */
} net_case;

/* Runs the case as one elementary test. */
void net_run(const net_case *c);

#endif
