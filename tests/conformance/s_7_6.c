/* SPDX-License-Identifier: MIT
 *
 * s_7_6.c - receiver, REC management.
 */
#include "bench.h"

#define OVERLOAD "<" F " d(ovl) "
#define TOLERANT "protocol=T r11 set=0,9 "
#define OTHER_WINS "*456#55/123#AA"

static void fixed_stuff_bits(void)
{
    if (bench_in_pass("f:"))
        bench_run_fixed_stuff_bits("set=0,10 ", '<', "(form here rx act R+1) " ACTIVE);
}

static const test_case cases[] = {
    {"7.6.1", RX_ERROR "D{0|2|5} X(bit errflag{0|2|5} rx act R+8) " ACTIVE, NULL},
    {"7.6.2", OVERLOAD "D{0|2|5} X(bit ovlflag{0|2|5} rx act R+8) " ACTIVE, NULL},
    {"7.6.3", RX_ERROR "D6 d(tol R+8) d6 d(tol R+8) d7 d(tol R+8) r8 r3", NULL},
    {"7.6.4", OVERLOAD "D6 d7 d(tol R+8) d7 d(tol R+8) r8 r3", NULL},
    {"7.6.5", "set=0,10 <" F ":ack X(bit ack rx act R+1) " ACTIVE, NULL},
    {"7.6.6", "set=0,10 " RX_ERROR ACTIVE, NULL},
    /* REC -1 at the ACK slot goes without saying in <, +1 stands here. */
    {"7.6.7", "set=0,9 <" F ":ackdel d(form ackdel rx act R+1) " ACTIVE, NULL},
    {"7.6.8", "set=0,9 <" F ":eof{1|2|4} d(form eof{1|2|4} rx act R+1) " ACTIVE, NULL},
    /* d in place of a recessive stuff bit, r in place of a dominant one. */
    {"7.6.9", "set=0,10 <07A#55:id{3|7}s {d|r}(stuff id{3|7}s rx act R+1) " ACTIVE, NULL},
    {"7.6.9", "ctn: set=0,10 <07A#55:dlc0s d(stuff dlc0s rx act R+1) " ACTIVE, NULL},
    {"7.6.9", "set=0,10 <015F458E#8629:ide0s r(stuff ide0s rx act R+1) " ACTIVE, NULL},
    {"7.6.9",
     "ctn: set=0,10 <756#F842:data{4|8}s {r|d}(stuff data{4|8}s rx act R+1) " ACTIVE, NULL},
    {"7.6.9", "ctn: set=0,10 <39E#F7D4:crc{2|6}s {d|r}(stuff crc{2|6}s rx act R+1) " ACTIVE, NULL},
    {"7.6.9", "f: set=0,10 <{103##0|123##0}:dlc1s d(stuff dlc1s rx act R+1) " ACTIVE, NULL},
    {"7.6.9", "f: set=0,10 <123##3FFx{48|64}:dlc2s r(stuff dlc2s rx act R+1) " ACTIVE, NULL},
    {"7.6.9",
     "f: set=0,10 <{72B##0F000|7C0##207F855}:data8s {d|r}(stuff data8s rx act R+1) " ACTIVE,
     NULL},
    {"7.6.10", "set=0,10 <" F "~data0:ack {r|d} +r r(crc ackdel rx act R+1) " ACTIVE, NULL},
    {"7.6.11", "set=0,10 " RX_ERROR "D6 d(tol R+8) r8 r3", NULL},
    {"7.6.12", RX_ERROR "D6 r{1|6} d(form errdel{1|6} rx act R+1) " ACTIVE, NULL},
    {"7.6.13", OVERLOAD "D6 r{1|6} d(form ovldel{1|6} rx act R+1) " ACTIVE, NULL},
    {"7.6.14", "set=0,{10|127|1|0} <" F " r3", NULL},
    {"7.6.15", "set=0,{128|130|255} <" F " r3", NULL},
    {"7.6.16", "set=0,9 <" F ":eof6 d(ovl) " ACTIVE, NULL},
    {"7.6.17", "set=0,9 " OVERLOAD "D6 d7 r8 r3", NULL},
    {"7.6.18", "set=0,9 " RX_ERROR "D6 d(tol R+8) d6 r8 r3", NULL},
    {"7.6.19", "set=0,9 " RX_ERROR "D6 r7 d(ovl) " ACTIVE, NULL},
    {"7.6.20", "set=0,9 " OVERLOAD "D6 r7 d(ovl) " ACTIVE, NULL},
    {"7.6.21", "set=8,8 " OTHER_WINS ":crcdel d(form crcdel rx act R+1) " ACTIVE ">456#55 r3",
     NULL},
    {"7.6.22", NULL, fixed_stuff_bits},
    /* As 7.1.6. */
    {"7.6.23", "f: " TOLERANT "<{123##055x16|12345678##155x64}:fdf r(exc) "
               "-{123##055x16|12345678##155x64}@res r3 <456#=AA r3 away", NULL},
    {"7.6.23", "f: " TOLERANT "<123#=55^r0:r0 r(exc) -123#=55^r0@dlc0 r3 <456#=AA r3 away", NULL},
    {"7.6.23", "f: set=0,9 <{123##055|12345678##155x64}^res:res r(exc) "
               "-{123##055|12345678##155x64}^res@brs r3 <456#=AA r3", NULL},
};

const section section_7_6 = {"7.6", cases, sizeof cases / sizeof cases[0]};
