/* SPDX-License-Identifier: MIT
 *
 * s_7_5.c - receiver, error-passive behaviour.
 */
#include "bench.h"

#define REC_PASSIVE "set=0,150 " RX_ERROR_PASSIVE
#define OVERLOAD_AT_ITS_END "d(ovl) " ACTIVE

static const test_case cases[] = {
    {"7.5.1", REC_PASSIVE "r{0|2|5} d6 r8 r2 <456#AA r3", NULL},
    {"7.5.2", REC_PASSIVE "r6 r8 r2 <456#AA r3", NULL},
    {"7.5.3", REC_PASSIVE "r6 d(tol R+8) d{0|3|6} r8 r3 <456#AA r3", NULL},
    {"7.5.4", "set=128,0 9[" RX_ERROR_PASSIVE PASSIVE "]", NULL},
    {"7.5.5", REC_PASSIVE "r{0|2|5} d5 r6 r7 " OVERLOAD_AT_ITS_END, NULL},
    {"7.5.6", REC_PASSIVE "r6 r{1|3|6} d(form errdel{1|3|6} rx pas R+1) r6 r7 " OVERLOAD_AT_ITS_END,
     NULL},
    /* 1 + 15 x 8 = 121: still active; 129 after the 16th recessive bit: passive after the 17th. */
    {"7.5.7", RX_ERROR "16[X(bit errflag0 rx act R+8)] X(bit errflag0 rx pas R+8) " PASSIVE, NULL},
};

const section section_7_5 = {"7.5", cases, sizeof cases / sizeof cases[0]};
