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

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits('<', frames[i], stuff_error);
}

static void extended_stuff_bits(void)
{
    static const char *const frames[] = {"15557C00#55", "07FC0000#AA", "1D71768A#40",
                                         "10F8E7C9#ADA8"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits('<', frames[i], stuff_error);
}

#define CRC_ERROR "r(crc ackdel rx act R+1) " ACTIVE

static const test_case cases[] = {
    {"7.2.1", "<" F ":ack X(bit ack rx act R+1) " ACTIVE, NULL},
    {"7.2.2", NULL, base_stuff_bits},
    {"7.2.3", NULL, extended_stuff_bits},
    {"7.2.5", "<" F "{~data0|~data1|~crc0|~crc14|~data7~crc3}:ack d " CRC_ERROR, NULL},
    {"7.2.5", "<12345678#A5{~id28|~crc14}:ack d " CRC_ERROR, NULL},
    {"7.2.5", "<001#55!sof:ack d " CRC_ERROR, NULL},
    {"7.2.5", "<" F "~data0:ack r " CRC_ERROR, NULL},
    {"7.2.6", "<" F "~data0:crcdel d(form crcdel rx act R+1) " ACTIVE, NULL},
    {"7.2.7", "<" F ":crcdel d(form crcdel rx act R+1) " ACTIVE, NULL},
    {"7.2.9", "<" F ":ackdel d(form ackdel rx act R+1) " ACTIVE, NULL},
    /* E3: a form error while a CRC error is pending is the only one that is signalled. */
    {"7.2.9", "<" F "~data0:ack d d(form ackdel rx act R+1) " ACTIVE, NULL},
    {"7.2.10", "<" F ":eof{0|1|2|3|4} d(form eof{0|1|2|3|4} rx act R+1) " ACTIVE, NULL},
    {"7.2.11", "<" F ":eof5 d(form eof5 rx act R+1) " ACTIVE, NULL},
};

const section section_7_2 = {"7.2", cases, sizeof cases / sizeof cases[0]};
