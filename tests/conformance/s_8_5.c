/* SPDX-License-Identifier: MIT
 *
 * s_8_5.c - transmitter, error-passive behaviour and bus-off.
 */
#include "bench.h"

#define ERROR "set=150,0 " TX_ERROR_PASSIVE
#define OTHER "<456#AA r3 "

static const test_case cases[] = {
    {"8.5.1", ERROR "r{0|2|5} d6 r8 r3 " OTHER AGAIN, NULL},
    {"8.5.2", ERROR "r6 r8 r2 " OTHER AGAIN, NULL},
    {"8.5.3", ERROR "r6 d{1|4|7} r8 r3 " OTHER AGAIN, NULL},
    {"8.5.4", ERROR "r6 r8 r3 r{0|3|7} " OTHER AGAIN, NULL},
    {"8.5.5", ERROR PASSIVE SUSPEND AGAIN, NULL},
    {"8.5.6", "set=150,0 >" F " offer=456#AA d(ovl) " ACTIVE SUSPEND ">456#AA r3", NULL},
    {"8.5.7", "set=150,0 >" F " offer=456#AA r3 " SUSPEND ">456#AA r3", NULL},
    {"8.5.8", "set=150,0 *456#55/123#AA r3 >456#55 r3", NULL},
    {"8.5.9", "set=150,0 >" F " offer=124#AA r{2|3|9} " OTHER ">124#AA r3", NULL},
    {"8.5.12", ERROR "d5 r5 d6 r7 d(ovl) " ACTIVE SUSPEND AGAIN, NULL},
    {"8.5.13", ERROR "r6 r{1|3|6} d(form errdel{1|3|6} tx pas T+8) " PASSIVE SUSPEND AGAIN, NULL},
    {"8.5.14", ERROR "r6 d6 r8 r3 r8 " AGAIN, NULL},
    /* 8 + 15 x 8 = 128 after the 15th recessive bit: the 16th brings the passive flag. */
    {"8.5.15",
     ">" F ":data0 ~(bit here tx act T+8) 15[X(bit errflag0 tx act T+8)] "
     "X(bit errflag0 tx pas T+8) r6 r8 r3 r8 " AGAIN,
     NULL},
    /* Silent at once; the tail of the frame in between is one of the 128 groups. */
    {"8.5.10",
     "set=250,0 >" F " offer=456#AA d(ovl) D2 X(bit ovlflag2 tx none T+8 drop) r40 withdraw "
     "-2A5#C3 r3 restart d 50[r11] -2A5#C3 r3 +d 76[r11] r10 r(T=0 R=0) >456#AA r3",
     NULL},
    {"8.5.10",
     "set=240,0 " TX_ERROR_PASSIVE "r6 d7 d(tol T+8 drop) r40 withdraw -2A5#C3 r3 "
     "restart 127[r11] r10 r(T=0 R=0) >456#AA r3",
     NULL},
    {"8.5.10",
     "set=248,0 >" F ":data0 ~(bit here tx none T+8 drop) r40 withdraw restart 127[r11] r10 "
     "r(T=0 R=0)",
     NULL},
    {"8.5.10",
     "set=248,0 >" F ":data0 ~(bit here tx none T+8 drop) r40 restart 127[r11] r10 r(T=0 R=0) r20",
     NULL},
    {"8.5.11", "set=256,0 restart 130[r10 d] 127[r11 d] r10 r(T=0 R=0) " AGAIN, NULL},
    {"8.5.11", "set=256,0 restart 127[r21 d] r10 r(T=0 R=0) " AGAIN, NULL},
};

const section section_8_5 = {"8.5", cases, sizeof cases / sizeof cases[0]};
