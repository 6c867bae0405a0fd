/* SPDX-License-Identifier: MIT
 *
 * invariants.h - asserts the invariants of a bus between any two steps.
 */
#ifndef CANWIRE_BUS_INVARIANTS_H
#define CANWIRE_BUS_INVARIANTS_H

#include "canwire.h"
#include "format/checked.h"

/* Asserts all invariants. The time that this takes grows with the number of nodes. */
void cw_assert_bus(const cw_bus *bus);

#endif
