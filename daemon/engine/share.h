/* SPDX-License-Identifier: MIT
 *
 * share.h - tells a port how programs share it.
 */
#ifndef CANWIRE_ENGINE_SHARE_H
#define CANWIRE_ENGINE_SHARE_H

#include "config/config.h"
#include "port/port.h"

/* Sets what the configuration says of a node's port; NULL is allowed. */
void share_port(port *p, const cfg *config, unsigned node);

#endif
