/* SPDX-License-Identifier: MIT
 *
 * checked.h - whether the engine asserts what costs time.
 */
#ifndef CANWIRE_FORMAT_CHECKED_H
#define CANWIRE_FORMAT_CHECKED_H

/* 1 in debug and sanitizer builds, which also call cw_assert_bus() after each step. */
#ifndef CW_CHECKED
#define CW_CHECKED 0
#endif

#endif
