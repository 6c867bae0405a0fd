/* SPDX-License-Identifier: MIT
 *
 * redata.h - keys of a node's data phase that change while the node is in use (D10, D13).
 */
#ifndef CANWIRE_CONFIG_REDATA_H
#define CANWIRE_CONFIG_REDATA_H

#include "config/change/retime.h"

/* Puts the values that a node has at present. */
void cfg_data_present(cfg_retime *out, const cfg_node_time *time);

/* Changes a data phase. The node's clock and bit timing are changed already. found_anew: its
 * segments were found. Then those of the data phase are found, too, if no keys give them or the
 * clock is another one. *bit_changes becomes true when a common prescaler has changed both.
 * Otherwise it returns false with a message, and *time is undefined. */
bool cfg_change_data(cfg_node_time *time, char *problem, size_t size, bool *bit_changes,
                     const cfg *config, const cfg_retime *change, bool found_anew);

#endif
