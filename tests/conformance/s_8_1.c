/* SPDX-License-Identifier: MIT
 *
 * s_8_1.c - transmitter, valid frame format.
 */
#include "bench.h"

static void base_frames(void)
{
    bench_run_frames('>', false);
}

static void extended_frames(void)
{
    bench_run_frames('>', true);
}

/* Runs 29 identifiers that differ from the node's in one bit. */
static void extended_losses(void)
{
    for (unsigned n = 0; n < 29; n++) {
        unsigned id = 0x1FFFFFFF & ~(1u << n);
        bench_run("*1FFFFFFF#55/%08X#AA r3 >1FFFFFFF#55 r3", id);
    }
}

/* Two parts of an FD frame, divided at a stuff bit. */
#define FD_STUFF(number, before, head, tail) {number, "f: " before ">" head " >" tail " r11", NULL}

static const test_case cases[] = {
    {"8.1.1", NULL, base_frames},
    {"8.1.2", NULL, extended_frames},
    {"8.1.3", "*7FF#55/{3FF|5FF|6FF|77F|7BF|7DF|7EF|7F7|7FB|7FD|7FE}#AA r3 >7FF#55 r3", NULL},
    {"8.1.4", NULL, extended_losses},
    {"8.1.4", "*1FFFFFFF#55/7FF#{AA|R1} r3 >1FFFFFFF#55 r3", NULL},
    {"8.1.5", ">" F " d(ovl) " ACTIVE, NULL},
    /* Every position named here must be a stuff bit of the frame. */
    {"8.1.6", ">078#E1E1E1E1E1E1E1E1:rtr0s >078#E1E1E1E1E1E1E1E1@rtr0s r3", NULL},
    {"8.1.6", "ctn: >47F#1F:data7s >47F#1F@data7s r3", NULL},
    {"8.1.6", "ctn: >758#:dlc3s >758#@dlc3s r3", NULL},
    {"8.1.6", "ctn: >756#F842:data8s >756#F842@data8s r3", NULL},
    {"8.1.6", "ctn: >39E#F7D4:crc10s >39E#F7D4@crc10s r3", NULL},
    {"8.1.6", "ctn: >{6CE#F8|6D4#1B26}:crc14s >{6CE#F8|6D4#1B26}@crc14s r3", NULL},
    {"8.1.6", ">7EF#R2:crc13s >7EF#R2@crc13s r3", NULL},
    {"8.1.7", "ctn: >00000000#:r10s >00000000#@r10s r3", NULL},
    {"8.1.7", ">07FC0000#AA:srr0s >07FC0000#AA@srr0s r3", NULL},
    {"8.1.7", "ctn: >07EFB7DB#44:crc10s >07EFB7DB#44@crc10s r3", NULL},
    {"8.1.7",
     "ctn: >{1D71768A#40|1136568B#B1AE}:crc14s >{1D71768A#40|1136568B#B1AE}@crc14s r3", NULL},
    FD_STUFF("8.1.6", "", "758##0:ide0s", "758##0@ide0s"),
    FD_STUFF("8.1.6", "", "123##000:dlc1s", "123##000@dlc1s"),
    FD_STUFF("8.1.6", "set=128,0 ", "123##100x64:dlc2s", "123##100x64@dlc2s"),
    FD_STUFF("8.1.6", "set=128,0 ", "123##000x64:dlc3s", "123##000x64@dlc3s"),
    FD_STUFF("8.1.6", "", "676##0E007:data7s", "676##0E007@data7s"),
    FD_STUFF("8.1.6", "", "615##055F0:data11s", "615##055F0@data11s"),
    FD_STUFF("8.1.6", "", "456##1A5{1F|E0}:data15", "456##1A5{1F|E0}@data15"),
    FD_STUFF("8.1.7", "", "13C4B810##0:rtr0s", "13C4B810##0@rtr0s"),
    FD_STUFF("8.1.7", "", "1E8EF422##0:dlc1s", "1E8EF422##0@dlc1s"),
    FD_STUFF("8.1.7", "set=128,0 ", "12345678##100x64:dlc2s", "12345678##100x64@dlc2s"),
    FD_STUFF("8.1.7", "", "0AFE57D4##107FF:data3s", "0AFE57D4##107FF@data3s"),
    {"8.1.8", "<456#AA r2 offer={07A|7C5}#55 d >{07A|7C5}#55@id0 r3", NULL},
    {"8.1.8", ">456#AA offer={01E80000|1F140000}#55 r2 d >{01E80000|1F140000}#55@id0 r3", NULL},
};

const section section_8_1 = {"8.1", cases, sizeof cases / sizeof cases[0]};
