/* SPDX-License-Identifier: MIT
 *
 * s_8_3.c - transmitter, active error frame.
 */
#include "bench.h"

static const test_case cases[] = {
    {"8.3.1", TX_ERROR "D6 d{1|4|7} r8 r3 " AGAIN, NULL},
    {"8.3.2", ">{07A|7C5}#55:crcdel d(form crcdel tx act T+8) D6 r8 r2 d >{07A|7C5}#55@id0 r3",
     NULL},
    {"8.3.3", TX_ERROR "D{0|3|5} X(bit errflag{0|3|5} tx act T+8) " ACTIVE AGAIN, NULL},
    {"8.3.4", TX_ERROR "D6 r{1|3|6} d(form errdel{1|3|6} tx act T+8) " ACTIVE AGAIN, NULL},
};

const section section_8_3 = {"8.3", cases, sizeof cases / sizeof cases[0]};
