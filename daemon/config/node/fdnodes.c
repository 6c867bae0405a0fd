/* SPDX-License-Identifier: MIT
 *
 * fdnodes.c - the nodes of a configuration that know CAN FD frames.
 */
#include "config/node/fdnodes.h"

uint64_t cfg_fd_nodes(const cfg *config)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus;
    uint64_t found = 0;
    cfg_bus_config(&bus, nodes, config);
    for (unsigned i = 0; i < bus.node_count; i++)
        if ((nodes[i].protocol & CW_PROTOCOL_MASK) == CW_FD)
            found |= UINT64_C(1) << i;
    return found;
}
