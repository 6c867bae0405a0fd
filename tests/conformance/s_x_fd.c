/* SPDX-License-Identifier: MIT
 *
 * s_x_fd.c - FD frames beyond the numbered cases.
 */
#include "net.h"
#include "timed_fd.h"

#include <stdio.h>

#define TOLERANT "protocol=T r11 "
#define RESTRICTED "init=R r11 set=5,9 "
#define NON_ISO "protocol=Fn r11 "
#define EIGHT "123#5555555555555555" /* without stuff bits behind the identifier */

static const net_case net_cases[] = {
    {"f: formats mix",
     0,
     {{"123##055 124#=66", "tx tx rx:125##1AAx64", 0, 0, 0, 0, 0},
      {"125##1AAx64", "lost8 rx:123##055 lost10 rx:124#=66 tx", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* D9: after the arbitration field. The flag begins in the DLC; the others have an error in the
     * stuff bit after that. */
    {"f: same identifier, classical and FD",
     12,
     {{"123#=55", "bit:dlc1s:tx:active tx", 7, 0, 0, 0, 0},
      {"123##055", "bit:fdf0:tx:active drop rx:123#=55", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "stuff:dlc1s:rx:active rx:123#=55", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"f: same identifier, remote and FD",
     0,
     {{"123#R1", "lost11 rx:123##055 tx", 0, 0, 0, 0, 0},
      {"123##055", "tx rx:123#R1", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"f: a tolerant node waits",
     0,
     {{"123##055 124#=66", "tx tx", 0, 0, 0, 0, 0},
      {"", "rx:123##055 rx:124#=66", 0, 0, 0, 0, 0},
      {"", "exc rx:124#=66", 0, 0, 0, 0, NET_TOLERANT}},
     NULL,
     NULL,
     0},
    /* It sends in the third bit of the intermission, and the other one joins and wins. */
    {"f: a tolerant node keeps its frame",
     0,
     {{"123##055 124##066", "tx tx rx:456#=77", 0, 0, 0, 0, 0},
      {"456#=77", "lost0 exc lost0 exc tx", 0, 0, 0, 0, NET_TOLERANT},
      {"", "rx:123##055 rx:124##066 rx:456#=77", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* D17: it takes FD frames for classical ones with one byte, and their data for a CRC delimiter.
     */
    {"f: a classical node destroys an FD frame",
     12,
     {{"123##00000000000000000", "bit:data21s:tx:active drop", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "stuff:data21s:rx:active", 0, 1, 0, 0, 0},
      {"", "form:crcdel0:rx:active tol", 0, 9, 0, 0, NET_CLASSICAL}},
     NULL,
     NULL,
     0},
    /* One receiver sees another frame. */
    {"f: BRS read wrongly",
     7,
     {{EIGHT, "form:eof0:tx:active tx", 7, 0, 0, 0, 0},
      {"", "form:eof0:rx:active rx:" EIGHT, 0, 0, 0, 0, 0},
      {"", "crc:ackdel0:rx:active tol rx:" EIGHT, 0, 8, 0, 0, 0}},
     EIGHT,
     "brs",
     2},
    {"f: ESI read wrongly",
     7,
     {{EIGHT, "form:eof0:tx:active tx", 7, 0, 0, 0, 0},
      {"", "form:eof0:rx:active rx:" EIGHT, 0, 0, 0, 0, 0},
      {"", "crc:ackdel0:rx:active tol rx:" EIGHT, 0, 8, 0, 0, 0}},
     EIGHT,
     "esi",
     2},
    /* A classical frame to it, with a stuff error in the DLC. */
    {"f: FDF read wrongly",
     12,
     {{EIGHT, "bit:dlc0:tx:active tx", 7, 0, 0, 0, 0},
      {"", "stuff:dlc1s:rx:active rx:" EIGHT, 0, 0, 0, 0, 0},
      {"", "stuff:dlc1s:rx:active tol rx:" EIGHT, 0, 8, 0, 0, 0}},
     EIGHT,
     "fdf",
     2},
    /* Twelve bytes to it, to the third bit of EOF. The next bit is no fixed stuff bit. */
    {"f: DLC read wrongly",
     7,
     {{EIGHT, "form:eof4:tx:active tx", 7, 0, 0, 0, 0},
      {"", "form:eof4:rx:active rx:" EIGHT, 0, 0, 0, 0, 0},
      {"", "form:fs0:rx:active tol rx:" EIGHT, 0, 8, 0, 0, 0}},
     EIGHT,
     "dlc3",
     2},
    /* An exception to it alone: it waits, and misses the frame. */
    {"f: res read wrongly",
     0,
     {{"123#55 124#66", "tx tx", 0, 0, 0, 0, 0},
      {"", "rx:123#55 rx:124#66", 0, 0, 0, 0, 0},
      {"", "exc rx:124#66", 0, 0, 0, 0, 0}},
     "123#55",
     "res",
     2},
    /* The receivers that read the stuff count right need not suffer. */
    {"f: a passive receiver with a wrong stuff count",
     0,
     {{"123#55", "tx", 0, 0, 0, 0, 0},
      {"", "rx:123#55", 0, 0, 0, 0, 0},
      {"", "crc:ackdel0:rx:passive", 0, 151, 0, 150, 0}},
     "123#55",
     "sc1",
     2},
};

static void several_nodes(void)
{
    for (size_t i = 0; i < sizeof net_cases / sizeof net_cases[0]; i++)
        net_run(&net_cases[i]);
}

/* Compares the encoder of the bench with that of the library: wire_parse() does. */
static void random_frames(void)
{
    static const char *const bytes[] = {"00", "FF", "1F", "F8", "0F", "E0", "55", "3C"};

    for (unsigned n = 0; bench_in_pass("f:") && n < 2000; n++) {
        char text[2 * CW_FRAME_DATA_MAX + 16];
        const bool extended = bench_random() % 2;
        const cw_frame shape = {.flags = CW_FRAME_FD, .dlc = (uint8_t)(bench_random() % 16)};
        const unsigned id = bench_random() & (extended ? 0x1FFFFFFF : 0x7FF);
        wire w;
        int used = snprintf(text, sizeof text, "%0*X##%X", extended ? 8 : 3, id,
                            (bench_random() & 3) | (n % 4 == 0 ? 8u : 0u));
        for (unsigned i = 0; i < wire_data_bytes(&shape); i++)
            used += snprintf(text + used, sizeof text - (size_t)used, "%s",
                             bytes[bench_random() % 8]);
        bench_count(wire_parse(&w, text) ? NULL : text);
    }
}

static const test_case cases[] = {
    /* Frames of both formats at one node. */
    {"XF1", "f: <123#=55 r3 <123##055 r3 <12345678##1AAx64 r3 <123#R2 r3 <123##0 r3", NULL},
    {"XF1", "f: >123#=55 r3 >123##055 r3 >12345678##1AAx64 r3 >123#R2 r3 <123##0 r3", NULL},
    {"XF1", "f: *456##055/123#=AA r3 >456##055 r3", NULL},
    {"XF1", "f: *456#=55/123##1AAx20 r3 >456#=55 r3", NULL},
    {"XF1", "f: *12345678##055/123##1AA r3 >12345678##055 r3", NULL},
    {"XF1", "f: *123#R1/123##055 r3 >123#R1 r3", NULL},
    {"XF1", "f: <123#=1122334455667788_F r3 <123##3112233445566778899AABBCC r3", NULL},
    {"XF1", "f: >123##055:fdf ~(bit fdf tx act T+8) " ACTIVE ">123##055 r3", NULL},
    {"XF1", "f: >123#=55:r0 ~(bit r0 tx act T+8) " ACTIVE ">123#=55 r3", NULL},
    /* D7: the second bit of the ACK slot. */
    {"XF2", "flo: set=0,9 <" F ":ack1 d <" F "@ackdel r3", NULL},
    {"XF2", "flo: set=0,150 <" F ":ack1 d <" F "@ackdel r3", NULL},
    {"XF2", "flo: <" F "~crc5:ack {r|d|r|d} {r|r|d|d} r(crc ackdel rx act R+1) " ACTIVE, NULL},
    {"XF2", "flo: <" F ":ack1 d d(form ackdel rx act R+1) " ACTIVE, NULL},
    {"XF2", "flo: init=L r11 <" F ":ack {d|r|d} {d|d|r} <" F "@ackdel r3", NULL},
    {"XF2", "flo: set=150,0 >" F ":ack r d >" F "@ackdel r3 r8", NULL},
    {"XF2", "flo: >" F ":ack r d d(form ackdel tx act T+8) " ACTIVE AGAIN, NULL},
    {"XF2", "flo: init=A r11 >" F ":ack r {r|d} >" F "@ackdel r3", NULL},
    /* D19: no flag of either kind; eleven recessive bits, and it takes part again. */
    {"XF3", RESTRICTED "<" F " r3 refuse=" F " <456#AA r3", NULL},
    {"XF3", RESTRICTED "<" F ":ack X(bit ack rx none) r11 <" F " r3", NULL},
    {"XF3", RESTRICTED "<" F ":{crcdel|ackdel|eof0|eof5} d(form {crcdel|ackdel|eof0|eof5} rx none) "
            "r11 <" F " r3", NULL},
    {"XF3", RESTRICTED "<" F ":eof6 d r11 <" F " r3", NULL},
    {"XF3", RESTRICTED "<" F " r{0|1} d r11 <" F " r3", NULL},
    {"XF3", RESTRICTED "<" F " r2 <456#AA r3", NULL},
    {"XF3", RESTRICTED "<" F "~data0:ack {r|d} +r r(crc ackdel rx none) r11 <" F " r3", NULL},
    {"XF3", RESTRICTED "<" F ":crcdel d(form crcdel rx none) d20 r10 d r10 -" F " r3 <" F
            " r3", NULL},
    {"XF3", RESTRICTED "overload=2 <" F " r3 <" F " r3", NULL},
    {"XF3", "init=R r11 set=5,150 <" F ":crcdel d(form crcdel rx none) r11 <" F " r3", NULL},
    {"XF3", "f: " RESTRICTED "<123##055^res:res r(exc) -123##055^res@brs r3 <" F " r3", NULL},
    {"XF3", "f: " RESTRICTED "<123##055:fs3 ~(form fs3 rx none) r11 <" F " r3", NULL},
    {"XF3", "offer=" F " modes=R r30 modes= r11 " AGAIN, NULL},
    /* D16: eleven recessive bits, then it may send, too, or join. */
    {"XF4", "f: " TOLERANT "<123##055:fdf offer=456#=AA r(exc) r(at none) d5 r10 d r11 >456#=AA r3 "
            "away", NULL},
    {"XF4", "f: " TOLERANT "<123##055:fdf offer=456#=AA r(exc) -123##055@res r2 >456#=AA r3 away",
     NULL},
    {"XF4", "f: " TOLERANT "<123##055:fdf offer=456#=AA r(exc) -123##055@res r d r11 >456#=AA r3 "
            "away", NULL},
    {"XF4", "f: " TOLERANT "<123##055:fdf r(exc) -123##055@res r2 d *07A#=55/001#=@id0 "
            "r3 >07A#=55 r3 away", NULL},
    {"XF4", "f: " TOLERANT "*456#=55/123##0AA:fdf r(exc) -123##0AA@res r2 >456#=55 r3 away", NULL},
    {"XF4", "f: " TOLERANT "<123##055:fdf r(exc) -123##055:dlc0 d6 r8 r2 -456#=AA r3 <456#=AA r3 "
            "away", NULL},
    {"XF4", "f: init=L protocol=T r11 set=5,9 <123##055:fdf r(exc) -123##055@res r2 <456#=AA r3 "
            "away", NULL},
    {"XF4", "f: set=150,5 <123##055^res:res r(exc) offer=456#AA -123##055^res@brs r2 >456#AA "
            "r11", NULL},
    {"XF4", "f: >123##055:res ~(bit res tx act T+8) " ACTIVE ">123##055 r3", NULL},
    /* Frames from before ISO 11898-1:2015. */
    {"XF5", "f: " NON_ISO "<123##8{|55|55x16|55x20|FFx64} r3 <12345678##900x64 r3 away", NULL},
    {"XF5", "f: " NON_ISO ">123##8{|55|55x16|55x20|FFx64} r3 >12345678##900x64 r3 away", NULL},
    {"XF5", "f: " NON_ISO "<123##855:fs{0|1|2|3|4} ~(form here rx act R+1) " ACTIVE
            "<123##855 r3 away", NULL},
    {"XF5", "f: " NON_ISO "<123##955x64:fs{0|1|2|3|4|5} ~(form here rx act R+1) " ACTIVE
            "<123##855 r3 away", NULL},
    {"XF5", "f: " NON_ISO ">123##855:fs{0|1|2|3|4} ~(form here tx act T+8) " ACTIVE
            ">123##855 r3 away", NULL},
    {"XF5", "f: " NON_ISO "<123##855~crc{0|9|16}:ack d r r(crc ackdel rx act R+1) " ACTIVE
            "<123##855 r3 <124##855x20 r3 away", NULL},
    {"XF5", "f: " NON_ISO ">123#=55 r3 <123#R2 r3 away", NULL},
    {"XF6", NULL, several_nodes},
    {"XF7", NULL, random_frames},
    {"XF8", NULL, timed_run_transmitter_at_res},
    {"XF9", NULL, timed_run_stuff_bit_after_fdf},
    {"XF10", NULL, timed_run_delimiter_with_tdc},
    {"XF11", NULL, timed_run_last_compared},
    {"XF12", NULL, timed_run_first_compared},
    {"XF13", NULL, timed_run_edges_after_exception},
};

const section section_x_fd = {"XF", cases, sizeof cases / sizeof cases[0]};
