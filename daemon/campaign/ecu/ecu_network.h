/* SPDX-License-Identifier: MIT
 *
 * ecu_network.h - a network of its own for a row: only the loopback interface, with multicast.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_NETWORK_H
#define CANWIRE_CAMPAIGN_ECU_ECU_NETWORK_H

#include <stdbool.h>

/* Moves the calling process, which must have a single thread, into a new network namespace. Without
 * privileges there is a new user namespace, too, in which its user and group stay the same.
 * Returns false with errno where the system does not allow it; the network may then be a new one
 * without loopback. */
bool ecu_network_enter(void);

/* Tries it in another process. Returns false with errno. */
bool ecu_network_is_possible(void);

#endif
