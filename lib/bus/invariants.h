/* SPDX-License-Identifier: MIT
 *
 * invariants.h - asserts the invariants of a bus between any two steps.
 */
#ifndef CANWIRE_BUS_INVARIANTS_H
#define CANWIRE_BUS_INVARIANTS_H

#include "canwire.h"

/* 1 in debug and sanitizer builds, which call cw_assert_bus() after each step. */
#ifndef CW_CHECKED
#define CW_CHECKED 0
#endif

/* Asserts all invariants. The time that this takes grows with the number of nodes. */
void cw_assert_bus(const cw_bus *bus);

#endif
