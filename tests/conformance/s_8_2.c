/* SPDX-License-Identifier: MIT
 *
 * s_8_2.c - transmitter, error detection.
 */
#include "bench.h"

/* Inverts every bit up to the CRC but the stuff bits and recessive bits of the arbitration. */
static void invert_every_bit(const char *frame)
{
    wire w;
    char place[NAME_MAX_LENGTH];

    if (!wire_parse(&w, frame))
        bench_count("malformed frame");
    for (unsigned i = 0; i + 1 < w.ack; i++) {
        const wire_bit *bit = &w.bit[i];
        if (bit->place.stuff || (bit->arbitration && bit->level))
            continue;
        bench_run(">%s:%s ~(bit here tx act T+8) " ACTIVE ">%s r3", frame,
                  wire_place_text(place, bit->place), frame);
    }
}

static void base_bits(void)
{
    invert_every_bit("245#C3A5");
    invert_every_bit("07A#R1");
}

static void extended_bits(void)
{
    invert_every_bit("0915A5C3#C3A5");
}

/* Writes the script of a wrong stuff bit. R3 ii: the recessive stuff bits before the RTR cost
 * nothing. The rest are bit errors, including the one behind the RTR. */
static const char *stuff_bit_error(const wire_bit *bit)
{
    if (bit->level && bit->arbitration && bit->place.field != CW_FIELD_RTR)
        return "(stuff here tx act) " ACTIVE;
    return "(bit here tx act T+8) " ACTIVE;
}

static void base_stuff_bits(void)
{
    static const char *const frames[] = {"07A#55", "7EF#R2", "756#F842", "6CE#F8", "758#", "7F0#"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits('>', frames[i], stuff_bit_error);
}

static void extended_stuff_bits(void)
{
    static const char *const frames[] = {"07FC0000#AA", "00000000#", "0AAAAAE0#55",
                                         "1FFFFFF0#"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits('>', frames[i], stuff_bit_error);
}

#define FORM_ERROR(place) ">" F ":" place " d(form " place " tx act T+8) " ACTIVE AGAIN

static const test_case cases[] = {
    {"8.2.1", NULL, base_bits},
    {"8.2.2", NULL, extended_bits},
    {"8.2.3", NULL, base_stuff_bits},
    {"8.2.4", NULL, extended_stuff_bits},
    {"8.2.5", FORM_ERROR("{crcdel|ackdel|eof0|eof3|eof6}"), NULL},
    {"8.2.6", ">" F ":ack r(ack ack tx act T+8) " ACTIVE AGAIN, NULL},
};

const section section_8_2 = {"8.2", cases, sizeof cases / sizeof cases[0]};
