/* SPDX-License-Identifier: MIT
 *
 * fdnodes.h - the nodes of a configuration that know CAN FD frames.
 */
#ifndef CANWIRE_CONFIG_FDNODES_H
#define CANWIRE_CONFIG_FDNODES_H

#include "config/config.h"

/* Returns the set of the nodes whose programs may write CAN FD frames, by index. */
uint64_t cfg_fd_nodes(const cfg *config);

#endif
