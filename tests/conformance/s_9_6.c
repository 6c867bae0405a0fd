/* SPDX-License-Identifier: MIT
 *
 * s_9_6.c - bi-state class: error active or error passive.
 */
#include "bench.h"

#define FAILS(flag) ">" F ":data0 ~(bit here tx " flag " T+8) "

static const test_case cases[] = {
    /* 16 x 8 = 128: the last of these flags is active, but suspend is due already. */
    {"9.6.1",
     "set=0,127 15[" FAILS("act") ACTIVE "] " FAILS("act") ACTIVE SUSPEND FAILS("pas")
         PASSIVE SUSPEND AGAIN,
     NULL},
    /* 14 x 9 + 2 = 128. */
    {"9.6.2",
     "set=127,0 14[" RX_ERROR "D6 d(tol R+8) r8 r3] 2[" RX_ERROR ACTIVE
     "] " RX_ERROR_PASSIVE PASSIVE,
     NULL},
};

const section section_9_6 = {"9.6", cases, sizeof cases / sizeof cases[0]};
