/* SPDX-License-Identifier: MIT
 *
 * invariants.h - asserts the invariants of a bus between any two steps.
 */
#ifndef CANWIRE_BUS_INVARIANTS_H
#define CANWIRE_BUS_INVARIANTS_H

#include "canwire.h"

/* 1 in debug and sanitizer builds, where each step is followed by cw_assert_bus(). */
#ifndef CW_CHECKED
#define CW_CHECKED 0
#endif

/* Asserts all invariants. Takes a time that grows with the number of nodes. */
void cw_assert_bus(const cw_bus *bus);

#endif
