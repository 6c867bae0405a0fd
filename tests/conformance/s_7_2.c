/* SPDX-License-Identifier: MIT
 *
 * s_7_2.c - receiver, error detection.
 */
#include "bench.h"

static const char *stuff_error(const wire_bit *bit)
{
    (void)bit;
    return "(stuff here rx act R+1) " ACTIVE;
}

static void base_stuff_bits(void)
{
    static const char *const frames[] = {"07A#55", "41F#00", "6CE#F8", "6D4#1B26", "7EF#R2"};
    /* around BRS, ESI and DLC, and around the borders of bytes */
    static const char *const fd_frames[] = {"758##0", "123##000", "123##300x48", "123##2FFx64",
                                            "269##30080F01F0FF00FE0", "0CC##21F0F"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits("", '<', frames[i], stuff_error);
    for (size_t i = 0; i < sizeof fd_frames / sizeof fd_frames[0]; i++)
        bench_run_stuff_bits("f: ", '<', fd_frames[i], stuff_error);
}

static void extended_stuff_bits(void)
{
    static const char *const frames[] = {"15557C00#55", "07FC0000#AA", "1D71768A#40",
                                         "10F8E7C9#ADA8"};
    static const char *const fd_frames[] = {"1E8EF422##0", "13C4B810##300x48", "0AFE57D4##107FF",
                                            "174E2938##2FFx64"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits("", '<', frames[i], stuff_error);
    for (size_t i = 0; i < sizeof fd_frames / sizeof fd_frames[0]; i++)
        bench_run_stuff_bits("f: ", '<', fd_frames[i], stuff_error);
}

static const char *passive_stuff_error(const wire_bit *bit)
{
    (void)bit;
    return "(stuff here rx pas R+1) " PASSIVE;
}

/* D19: no flag; the node waits until the bus is idle. */
static const char *restricted_stuff_error(const wire_bit *bit)
{
    (void)bit;
    return "(stuff here rx none) r11 ";
}

static void long_frames(void)
{
    static const char *const frames[] = {"078##087x64",      "7FF##187x64",
                                         "555##20Fx64",      "41F##3F0x64",
                                         "1FFFFFFF##087x64", "0AAAAAE0##187x64",
                                         "12345678##20Fx64", "00000000##3F0x64"};

    for (size_t i = 0; bench_in_pass("f:") && i < sizeof frames / sizeof frames[0]; i++) {
        bench_run_stuff_bits("", '<', frames[i], stuff_error);
        bench_run_stuff_bits("set=0,150 ", '<', frames[i], passive_stuff_error);
        bench_run_stuff_bits("init=R r11 set=0,9 ", '<', frames[i], restricted_stuff_error);
    }
}

static void fixed_stuff_bits(void)
{
    if (bench_in_pass("f:"))
        bench_run_fixed_stuff_bits("", '<', "(form here rx act R+1) " ACTIVE);
}

#define CRC_ERROR "+r r(crc ackdel rx act R+1) " ACTIVE

static const test_case cases[] = {
    {"7.2.1", "<" F ":ack X(bit ack rx act R+1) " ACTIVE, NULL},
    {"7.2.2", NULL, base_stuff_bits},
    {"7.2.3", NULL, extended_stuff_bits},
    {"7.2.4", NULL, long_frames},
    {"7.2.5", "<" F "{~data0|~data1|~crc0|~crc14|~data7~crc3}:ack d " CRC_ERROR, NULL},
    {"7.2.5", "fl: <" F "{~sc0|~sc1|~sc2|~sc3|~sc0~sc1|~crc16}:ack {d|r|d|r|d|r} " CRC_ERROR, NULL},
    {"7.2.5", "fl: <12345678#5500{^sc0|^sc1|^sc2|^sc3|^sc0^sc3|^sc1^sc2}:ack {d|r|d|r|d|r} "
              CRC_ERROR, NULL},
    {"7.2.5", "l: <" F "~crc20:ack d " CRC_ERROR, NULL},
    /* A good frame right behind is acknowledged. */
    {"7.2.5", "fl: <" F "{~sc3|~crc3}:ack d " CRC_ERROR "<456#AA r3", NULL},
    {"7.2.5", "<12345678#A5{~id28|~crc14}:ack d " CRC_ERROR, NULL},
    {"7.2.5", "ctn: <001#55!sof:ack d " CRC_ERROR, NULL},
    {"7.2.5", "<" F "~data0:ack r " CRC_ERROR, NULL},
    {"7.2.6", "<" F "~data0:crcdel d(form crcdel rx act R+1) " ACTIVE, NULL},
    {"7.2.6", "fl: <" F "~sc2:crcdel d(form crcdel rx act R+1) " ACTIVE, NULL},
    {"7.2.7", "<" F ":crcdel d(form crcdel rx act R+1) " ACTIVE, NULL},
    {"7.2.8", NULL, fixed_stuff_bits},
    {"7.2.9", "<" F ":ackdel d(form ackdel rx act R+1) " ACTIVE, NULL},
    /* E3: a form error while a CRC error is pending is the only one that is signalled. */
    {"7.2.9", "<" F "~data0:ack d +r d(form ackdel rx act R+1) " ACTIVE, NULL},
    {"7.2.10", "<" F ":eof{0|1|2|3|4} d(form eof{0|1|2|3|4} rx act R+1) " ACTIVE, NULL},
    {"7.2.11", "<" F ":eof5 d(form eof5 rx act R+1) " ACTIVE, NULL},
};

const section section_7_2 = {"7.2", cases, sizeof cases / sizeof cases[0]};
