/* SPDX-License-Identifier: MIT
 *
 * s_7_4.c - receiver, overload frame.
 */
#include "bench.h"

#define OVERLOAD "<" F " d(ovl) "

static const test_case cases[] = {
    {"7.4.1", "<" F " r{0|1} d(ovl) " ACTIVE, NULL},
    {"7.4.2", "<" F ":eof6 d(ovl) " ACTIVE, NULL},
    {"7.4.3", RX_ERROR "D6 r7 d(ovl) " ACTIVE, NULL},
    {"7.4.3", OVERLOAD "D6 r7 d(ovl) " ACTIVE, NULL},
    {"7.4.4", OVERLOAD "D{0|2|5} X(bit ovlflag{0|2|5} rx act R+8) " ACTIVE, NULL},
    {"7.4.5", OVERLOAD "D6 r{1|3|6} d(form ovldel{1|3|6} rx act R+1) " ACTIVE, NULL},
    {"7.4.6", RX_ERROR "D6 r8 r{0|1} d(ovl) " ACTIVE, NULL},
    {"7.4.7", OVERLOAD "D6 r8 r{0|1} d(ovl) " ACTIVE, NULL},
    /* Only overload frames that the host asks for are limited (O1). */
    {"7.4.7", OVERLOAD "4[D6 r8 d(ovl)] " ACTIVE, NULL},
};

const section section_7_4 = {"7.4", cases, sizeof cases / sizeof cases[0]};
