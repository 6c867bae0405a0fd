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

static const test_case cases[] = {
    {"7.1.1", NULL, base_frames},
    {"7.1.2", NULL, extended_frames},
    {"7.1.3", "*123#R1/123#55 r3 >123#R1 r3", NULL},
    {"7.1.3", "*048C1234#11/123#55 r3 >048C1234#11 r3", NULL},
    {"7.1.3", "*048C1234#11/123#R2 r3 >048C1234#11 r3", NULL},
    {"7.1.3", "*048C1235#11/048C1234#11 r3 >048C1235#11 r3", NULL},
    {"7.1.3", "*048C1234#R1/048C1234#11 r3 >048C1234#R1 r3", NULL},
    {"7.1.3", "*123#55/048BFFFF#11 r3 >123#55 r3", NULL},
    {"7.1.4", "<123#55^r0 r3", NULL},
    {"7.1.4", "<2AA#^r0 r3", NULL},
    {"7.1.5", "<12345678#A5{^srr|^r1|^r0|^srr^r1|^srr^r0|^r1^r0|^srr^r1^r0} r3", NULL},
    {"7.1.5", "<1FFFFFFF#0000{^srr|^r1|^r0|^srr^r1|^srr^r0|^r1^r0|^srr^r1^r0} r3", NULL},
    {"7.1.8", "<123#1122334455667788_{9|A|B|C|D|E|F} r3", NULL},
    {"7.1.8", "<12345678#1122334455667788_{9|A|B|C|D|E|F} r3", NULL},
    {"7.1.8", "<123#R{9|F} r3", NULL},
    /* The third intermission bit, or the bit after it, is the next SOF. */
    {"7.1.9", "<123#55 {r3|r2} <456#AA r3", NULL},
    {"7.1.9", "<12345678#55 {r3|r2} <048C1234#AA {r3|r2} <7FF# r3", NULL},
    /* Every position named here must be a stuff bit of the frame. */
    {"7.1.10", "<07A#55:id3s <07A#55@id3s r3", NULL},
    {"7.1.10", "<560#C3:id10s <560#C3@id10s r3", NULL},
    {"7.1.10", "<078#E1E1E1E1E1E1E1E1:rtr0s <078#E1E1E1E1E1E1E1E1@rtr0s r3", NULL},
    {"7.1.10", "<758#:dlc3s <758#@dlc3s r3", NULL},
    {"7.1.10", "<554#C3:r00s <554#C3@r00s r3", NULL},
    {"7.1.10", "<47F#1F:data7s <47F#1F@data7s r3", NULL},
    {"7.1.10", "<756#F842:data8s <756#F842@data8s r3", NULL},
    {"7.1.10", "<39E#F7D4:crc10s <39E#F7D4@crc10s r3", NULL},
    {"7.1.10", "<26D#0FEF:crc0s <26D#0FEF@crc0s r3", NULL},
    {"7.1.10", "<{6CE#F8|6D4#1B26}:crc14s <{6CE#F8|6D4#1B26}@crc14s r3", NULL},
    {"7.1.10", "<7FF#FFFFFFFFFFFFFFFF:data59s <7FF#FFFFFFFFFFFFFFFF@data59s r3", NULL},
    {"7.1.10", "<000#0000000000000000:data61s <000#0000000000000000@data61s r3", NULL},
    {"7.1.11", "<00000000#:r10s <00000000#@r10s r3", NULL},
    {"7.1.11", "<1FFFFFFF#FFFF:id12s <1FFFFFFF#FFFF@id12s r3", NULL},
    {"7.1.11", "<07FC0000#AA:srr0s <07FC0000#AA@srr0s r3", NULL},
    {"7.1.11", "<020CA021#8F:ide0s <020CA021#8F@ide0s r3", NULL},
    {"7.1.11", "<0AAAAAE0#55:id28s <0AAAAAE0#55@id28s r3", NULL},
    {"7.1.11", "<140F266F#F876:data8s <140F266F#F876@data8s r3", NULL},
    {"7.1.11", "<07EFB7DB#44:crc10s <07EFB7DB#44@crc10s r3", NULL},
    {"7.1.11", "<{1D71768A#40|1136568B#B1AE}:crc14s <{1D71768A#40|1136568B#B1AE}@crc14s r3", NULL},
    {"7.1.12", "<" F ":eof6 d(ovl) " ACTIVE, NULL},
};

const section section_7_1 = {"7.1", cases, sizeof cases / sizeof cases[0]};
