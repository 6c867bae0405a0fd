/* SPDX-License-Identifier: MIT
 *
 * s_8_4.c - transmitter, overload frame.
 */
#include "bench.h"

#define OVERLOAD ">" F " d(ovl) "

static const test_case cases[] = {
    {"8.4.1", "set=200,0 >" F " r{0|1} d(ovl) " ACTIVE, NULL},
    {"8.4.1", ">" F " r{0|1} d(ovl) " ACTIVE, NULL},
    {"8.4.2", "set=200,0 " TX_ERROR_PASSIVE "r6 r7 d(ovl) " ACTIVE SUSPEND AGAIN, NULL},
    {"8.4.2", "set=200,0 " OVERLOAD "D6 r7 d(ovl) " ACTIVE, NULL},
    {"8.4.2", TX_ERROR "D6 r7 d(ovl) " ACTIVE AGAIN, NULL},
    {"8.4.3", ">" F " offer={07A|7C5}#55 d(ovl) D6 r8 r2 d >{07A|7C5}#55@id0 r3", NULL},
    {"8.4.4", OVERLOAD "D{0|1|5} X(bit ovlflag{0|1|5} tx act T+8) " ACTIVE, NULL},
    {"8.4.5", OVERLOAD "D6 r{1|3|6} d(form ovldel{1|3|6} tx act T+8) " ACTIVE, NULL},
};

const section section_8_4 = {"8.4", cases, sizeof cases / sizeof cases[0]};
