/* SPDX-License-Identifier: MIT
 *
 * s_8_6.c - transmitter, TEC management.
 */
#include "bench.h"

#define OVERLOAD ">" F " d(ovl) "
#define G "245#C3A5"
#define FORM_ERROR(place) ">" F ":" place " d(form " place " tx act T+8) " ACTIVE AGAIN
#define PASSIVE_ERROR "set=150,0 " TX_ERROR_PASSIVE
#define PASSIVE_ACK_ERROR "set=150,0 >" F ":ack +r r(ack ackend tx pas) "

static const test_case cases[] = {
    {"8.6.1", TX_ERROR "D{0|2|5} X(bit errflag{0|2|5} tx act T+8) " ACTIVE AGAIN, NULL},
    {"8.6.2", OVERLOAD "D{0|3|5} X(bit ovlflag{0|3|5} tx act T+8) " ACTIVE, NULL},
    {"8.6.3", TX_ERROR "D6 d7 d(tol T+8) d7 d(tol T+8) r8 r3 " AGAIN, NULL},
    {"8.6.4",
     PASSIVE_ERROR "r6 {d|d6|d7 d(tol T+8)|d7 d(tol T+8) d|2[d7 d(tol T+8)]} r8 r3 " SUSPEND AGAIN,
     NULL},
    {"8.6.5", OVERLOAD "D6 4[d7 d(tol T+8)] d r8 r3", NULL},
    {"8.6.5", OVERLOAD "D6 2[d7 d(tol T+8)] d7 r8 r3", NULL},
    {"8.6.6",
     ">" G
     ":{sof|id0|dlc0|dlc2|data0|data2|crc0|crc1|crc2|crc3|crc4} ~(bit here tx act T+8) " ACTIVE
     ">" G " r3",
     NULL},
    {"8.6.7", FORM_ERROR("{crcdel|ackdel|eof0|eof3|eof6}"), NULL},
    {"8.6.8", ">" F ":ack +r r(ack ackend tx act T+8) " ACTIVE AGAIN, NULL},
    {"8.6.9", TX_ERROR "D6 r{1|3|6} d(form errdel{1|3|6} tx act T+8) " ACTIVE AGAIN, NULL},
    {"8.6.10", OVERLOAD "D6 r{1|6} d(form ovldel{1|6} tx act T+8) " ACTIVE, NULL},
    {"8.6.11", "set={10|1|0},0 >" F " r3", NULL},
    {"8.6.12", "set=200,0 >" F " r3", NULL},
    {"8.6.13", "set=10,0 " OVERLOAD "D6 d7 r8 r3", NULL},
    {"8.6.14", "set=10,0 " TX_ERROR "D6 d7 r8 r3 " AGAIN, NULL},
    {"8.6.15", "set=10,0 " OVERLOAD "D6 r7 d(ovl) " ACTIVE, NULL},
    {"8.6.16", "set=10,0 " TX_ERROR "D6 r7 d(ovl) " ACTIVE AGAIN, NULL},
    {"8.6.17", PASSIVE_ACK_ERROR PASSIVE SUSPEND AGAIN, NULL},
    {"8.6.17",
     PASSIVE_ACK_ERROR PASSIVE SUSPEND ">" F
                                       ":data0 ~(bit here tx pas T+8) d6 r8 r3 " SUSPEND AGAIN,
     NULL},
    /* Once, however many dominant bits follow (R3 i); the flag starts over at each change. */
    {"8.6.18", PASSIVE_ACK_ERROR "r{0|2|5} d(tol T+8) r6 r8 r3 " SUSPEND AGAIN, NULL},
    {"8.6.18", PASSIVE_ACK_ERROR "r2 d(tol T+8) r d2 r3 d r6 r8 r3 " SUSPEND AGAIN, NULL},
    {"8.6.18", PASSIVE_ACK_ERROR "d(tol T+8) d5 r8 r3 " SUSPEND AGAIN, NULL},
    {"8.6.19", "set=10,0 >07A#55:id3s d(stuff id3s tx act) " ACTIVE ">07A#55 r3", NULL},
    {"8.6.20", "set=10,0 *456#55/123#AA r3 >456#55 r3", NULL},
    {"8.6.21", "set=10,10 *456#55/123#AA:crcdel d(form crcdel rx act R+1) " ACTIVE ">456#55 r3",
     NULL},
};

const section section_8_6 = {"8.6", cases, sizeof cases / sizeof cases[0]};
