/* SPDX-License-Identifier: MIT
 *
 * s_7_3.c - receiver, active error frame.
 */
#include "bench.h"

static const test_case cases[] = {
    {"7.3.1", RX_ERROR "D6 d(tol R+8) d{0|3|6} r8 r3", NULL},
    {"7.3.2", RX_ERROR "D6 r8 r2 <456#AA r3", NULL},
    {"7.3.3", RX_ERROR "D{0|2|5} X(bit errflag{0|2|5} rx act R+8) " ACTIVE, NULL},
    {"7.3.4", RX_ERROR "D6 r{1|3|6} d(form errdel{1|3|6} rx act R+1) " ACTIVE, NULL},
};

const section section_7_3 = {"7.3", cases, sizeof cases / sizeof cases[0]};
