/* SPDX-License-Identifier: MIT
 *
 * s_7_1.c - receiver, valid frame format.
 */
#include "bench.h"

static void base_frames(void)
{
    bench_run_frames('<', false);
}

static void extended_frames(void)
{
    bench_run_frames('<', true);
}

/* Two parts of an FD frame, divided at a stuff bit. */
#define FD_STUFF(number, head, tail) {number, "f: <" head " <" tail " r3", NULL}

/* Nodes and frames of protocol exceptions (D16). The frame behind one is acknowledged. */
#define TOLERANT "protocol=T r11 "
#define FD_FRAME "123##055"
#define EXCEPTION(frame) "<" frame ":fdf r(exc) -" frame "@res "
#define RECESSIVE_R0 "<123#=55^r0:r0 r(exc) -123#=55^r0@dlc0 "
#define BEHIND "r3 <456#=AA r3 away"

static const test_case cases[] = {
    {"7.1.1", NULL, base_frames},
    {"7.1.2", NULL, extended_frames},
    {"7.1.3", "*123#R1/123#55 r3 >123#R1 r3", NULL},
    {"7.1.3", "*048C1234#11/123#55 r3 >048C1234#11 r3", NULL},
    {"7.1.3", "*048C1234#11/123#R2 r3 >048C1234#11 r3", NULL},
    {"7.1.3", "*048C1235#11/048C1234#11 r3 >048C1235#11 r3", NULL},
    {"7.1.3", "*048C1234#R1/048C1234#11 r3 >048C1234#R1 r3", NULL},
    {"7.1.3", "*123#55/048BFFFF#11 r3 >123#55 r3", NULL},
    {"7.1.4", "c: <123#55^r0 r3", NULL},
    {"7.1.4", "c: <2AA#^r0 r3", NULL},
    {"7.1.5", "c: <12345678#A5{^srr|^r1|^r0|^srr^r1|^srr^r0|^r1^r0|^srr^r1^r0} r3", NULL},
    {"7.1.5", "c: <1FFFFFFF#0000{^srr|^r1|^r0|^srr^r1|^srr^r0|^r1^r0|^srr^r1^r0} r3", NULL},
    {"7.1.5", "tn: <12345678#A5{^srr|^r0|^srr^r0} r3", NULL},
    {"7.1.5", "tn: <1FFFFFFF#0000{^srr|^r0|^srr^r0} r3", NULL},
    /* RRS and SRR (D2). */
    {"7.1.5", "flo: <{123|7FF|000}#55^rtr r3", NULL},
    {"7.1.5", "flo: <{12345678|12345678|12345678|12345678}#A5{|^srr|^rtr|^srr^rtr} r3", NULL},
    {"7.1.5", "flo: <1B5F5257#^rtr:fdf0s <1B5F5257#^rtr@fdf0s r3", NULL},
    {"7.1.5", "flo: <1C48CF77#55^srr^rtr:fdf0s <1C48CF77#55^srr^rtr@fdf0s r3", NULL},
    /* FD frames of DLC A and F; a classical frame whose FDF is recessive. */
    {"7.1.6", "f: " TOLERANT "<{123##055x16|12345678##155x64}:fdf r(exc) "
              "-{123##055x16|12345678##155x64}@res " BEHIND, NULL},
    {"7.1.6", "f: " TOLERANT "<123#=55^r0:r0 r(exc) -123#=55^r0@dlc0 " BEHIND, NULL},
    {"7.1.6", "f: " TOLERANT "<12345678#=55^r1:r1 r(exc) -12345678#=55^r1@r0 " BEHIND, NULL},
    {"7.1.6", "f: <{123##055|12345678##155x64}^res:res r(exc) "
              "-{123##055|12345678##155x64}^res@brs " BEHIND, NULL},
    /* Switched off, it is a form error. */
    {"7.1.6", "f: protocol=Tx r11 <{123##055|12345678##155}:fdf r(form r{0|1}0 rx act R+1) " ACTIVE
              "<123#=55 r3 away", NULL},
    {"7.1.6", "f: protocol=Fx r11 <{123##055|12345678##155}^res:res r(form res rx act R+1) " ACTIVE,
     NULL},
    /* Eleven recessive bits: to the second bit of the intermission, from a second ACK bit on. */
    {"7.1.7", "f: " TOLERANT EXCEPTION(FD_FRAME) "{r4|r3|r2} <456#=AA r3 away", NULL},
    {"7.1.7", "f: " TOLERANT EXCEPTION(FD_FRAME) "r -456#=AA r3 <456#=AA r3 away", NULL},
    {"7.1.7", "f: " TOLERANT RECESSIVE_R0 "{r4|r3} <456#=AA r3 away", NULL},
    {"7.1.7", "f: " TOLERANT RECESSIVE_R0 "r2 -456#=AA r3 <456#=AA r3 away", NULL},
    {"7.1.7", "f: <123##055^res:res r(exc) -123##055^res@brs {r4|r3|r2} <456##0AA r3", NULL},
    {"7.1.7", "f: <123##055^res:res r(exc) -123##055^res@brs r -456#AA r3 <456#AA r3", NULL},
    {"7.1.8", "ctn: <123#1122334455667788_{9|A|B|C|D|E|F} r3", NULL},
    {"7.1.8", "ctn: <12345678#1122334455667788_{9|A|B|C|D|E|F} r3", NULL},
    {"7.1.8", "<123#R{9|F} r3", NULL},
    /* The third intermission bit, or the bit after it, is the next SOF. */
    {"7.1.9", "<123#55 {r3|r2} <456#AA r3", NULL},
    {"7.1.9", "<12345678#55 {r3|r2} <048C1234#AA {r3|r2} <7FF# r3", NULL},
    /* Every position named here must be a stuff bit of the frame. */
    {"7.1.10", "<07A#55:id3s <07A#55@id3s r3", NULL},
    {"7.1.10", "<560#C3:id10s <560#C3@id10s r3", NULL},
    {"7.1.10", "<078#E1E1E1E1E1E1E1E1:rtr0s <078#E1E1E1E1E1E1E1E1@rtr0s r3", NULL},
    {"7.1.10", "ctn: <758#:dlc3s <758#@dlc3s r3", NULL},
    {"7.1.10", "ctn: <554#C3:r00s <554#C3@r00s r3", NULL},
    {"7.1.10", "ctn: <47F#1F:data7s <47F#1F@data7s r3", NULL},
    {"7.1.10", "ctn: <756#F842:data8s <756#F842@data8s r3", NULL},
    {"7.1.10", "ctn: <39E#F7D4:crc10s <39E#F7D4@crc10s r3", NULL},
    {"7.1.10", "ctn: <26D#0FEF:crc0s <26D#0FEF@crc0s r3", NULL},
    {"7.1.10", "ctn: <{6CE#F8|6D4#1B26}:crc14s <{6CE#F8|6D4#1B26}@crc14s r3", NULL},
    {"7.1.10", "ctn: <7FF#FFFFFFFFFFFFFFFF:data59s <7FF#FFFFFFFFFFFFFFFF@data59s r3", NULL},
    {"7.1.10", "ctn: <000#0000000000000000:data61s <000#0000000000000000@data61s r3", NULL},
    {"7.1.11", "ctn: <00000000#:r10s <00000000#@r10s r3", NULL},
    {"7.1.11", "<1FFFFFFF#FFFF:id12s <1FFFFFFF#FFFF@id12s r3", NULL},
    {"7.1.11", "<07FC0000#AA:srr0s <07FC0000#AA@srr0s r3", NULL},
    {"7.1.11", "<020CA021#8F:ide0s <020CA021#8F@ide0s r3", NULL},
    {"7.1.11", "<0AAAAAE0#55:id28s <0AAAAAE0#55@id28s r3", NULL},
    {"7.1.11", "ctn: <140F266F#F876:data8s <140F266F#F876@data8s r3", NULL},
    {"7.1.11", "ctn: <07EFB7DB#44:crc10s <07EFB7DB#44@crc10s r3", NULL},
    {"7.1.11",
     "ctn: <{1D71768A#40|1136568B#B1AE}:crc14s <{1D71768A#40|1136568B#B1AE}@crc14s r3", NULL},
    FD_STUFF("7.1.10", "{758##0|77C##0}:ide0s", "{758##0|77C##0}@ide0s"),
    FD_STUFF("7.1.10", "{103##0|123##000}:dlc1s", "{103##0|123##000}@dlc1s"),
    FD_STUFF("7.1.10", "123##300x{48|64}:dlc2s", "123##300x{48|64}@dlc2s"),
    FD_STUFF("7.1.10", "123##200x64:dlc3s", "123##200x64@dlc3s"),
    FD_STUFF("7.1.10", "269##30080F01F0FF00FE0:data1s", "269##30080F01F0FF00FE0@data1s"),
    FD_STUFF("7.1.10", "{6AA##00000|630##2F8}:data3s", "{6AA##00000|630##2F8}@data3s"),
    FD_STUFF("7.1.10", "{676##2E007|0CC##21F0F}:data7s", "{676##2E007|0CC##21F0F}@data7s"),
    FD_STUFF("7.1.10", "{72B##0F000|7C0##207F855}:data8s", "{72B##0F000|7C0##207F855}@data8s"),
    FD_STUFF("7.1.10", "{615##055F0|0CC##21F0F}:data11s", "{615##055F0|0CC##21F0F}@data11s"),
    /* A run of five at the end of the data: the first fixed stuff bit takes the place (D3). */
    FD_STUFF("7.1.10", "456##1A5{1F|E0}:data15", "456##1A5{1F|E0}@data15"),
    FD_STUFF("7.1.10", "{000##000x64|7FF##3FFx64}:sc0", "{000##000x64|7FF##3FFx64}@sc0"),
    FD_STUFF("7.1.11", "{13C4B810##0|12345670##1}:rtr0s", "{13C4B810##0|12345670##1}@rtr0s"),
    FD_STUFF("7.1.11", "{1E8EF422##0|12345678##0}:dlc1s", "{1E8EF422##0|12345678##0}@dlc1s"),
    FD_STUFF("7.1.11", "12345678##300x{48|64}:dlc2s", "12345678##300x{48|64}@dlc2s"),
    FD_STUFF("7.1.11", "12345678##200x64:dlc3s", "12345678##200x64@dlc3s"),
    FD_STUFF("7.1.11", "{0AFE57D4##107FF|0FCB3BD5##1FF}:data3s",
             "{0AFE57D4##107FF|0FCB3BD5##1FF}@data3s"),
    FD_STUFF("7.1.11", "{1BF64B71##2E007|174E2938##00FF0}:data7s",
             "{1BF64B71##2E007|174E2938##00FF0}@data7s"),
    FD_STUFF("7.1.11", "{00000000##000x64|1FFFFFFF##3FFx64}:sc0",
             "{00000000##000x64|1FFFFFFF##3FFx64}@sc0"),
    {"7.1.12", "<" F ":eof6 d(ovl) " ACTIVE, NULL},
};

const section section_7_1 = {"7.1", cases, sizeof cases / sizeof cases[0]};
