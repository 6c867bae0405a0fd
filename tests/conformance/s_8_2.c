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
    static const char *const fd_frames[] = {"758##0", "123##000", "676##0E007", "615##155F0"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits("", '>', frames[i], stuff_bit_error);
    for (size_t i = 0; i < sizeof fd_frames / sizeof fd_frames[0]; i++)
        bench_run_stuff_bits("f: ", '>', fd_frames[i], stuff_bit_error);
}

static void extended_stuff_bits(void)
{
    static const char *const frames[] = {"07FC0000#AA", "00000000#", "0AAAAAE0#55",
                                         "1FFFFFF0#"};
    static const char *const fd_frames[] = {"1E8EF422##0", "0AFE57D4##107FF"};

    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++)
        bench_run_stuff_bits("", '>', frames[i], stuff_bit_error);
    for (size_t i = 0; i < sizeof fd_frames / sizeof fd_frames[0]; i++)
        bench_run_stuff_bits("f: ", '>', fd_frames[i], stuff_bit_error);
}

static const char *passive_stuff_bit_error(const wire_bit *bit)
{
    if (bit->level && bit->arbitration && bit->place.field != CW_FIELD_RTR)
        return "(stuff here tx pas) " PASSIVE SUSPEND;
    return "(bit here tx pas T+8) " PASSIVE SUSPEND;
}

/* D8: the frames with ESI are those of a passive node. */
static void long_frames(void)
{
    static const char *const active[] = {"078##087x64", "7FF##187x64", "1FFFFFFF##087x64",
                                         "0AAAAAE0##187x64"};
    static const char *const passive[] = {"555##20Fx64", "41F##3F0x64", "12345678##20Fx64",
                                          "00000000##3F0x64"};

    for (size_t i = 0; bench_in_pass("f:") && i < sizeof active / sizeof active[0]; i++) {
        bench_run_stuff_bits("", '>', active[i], stuff_bit_error);
        bench_run_stuff_bits("set=200,0 ", '>', passive[i], passive_stuff_bit_error);
    }
}

/* D14: also a transmitter's own one. */
static void fixed_stuff_bits(void)
{
    if (bench_in_pass("f:"))
        bench_run_fixed_stuff_bits("", '>', "(form here tx act T+8) " ACTIVE);
}

#define FORM_ERROR(place) ">" F ":" place " d(form " place " tx act T+8) " ACTIVE AGAIN

static const test_case cases[] = {
    {"8.2.1", NULL, base_bits},
    {"8.2.2", NULL, extended_bits},
    {"8.2.3", NULL, base_stuff_bits},
    {"8.2.4", NULL, extended_stuff_bits},
    {"8.2.5", FORM_ERROR("{crcdel|ackdel|eof0|eof3|eof6}"), NULL},
    {"8.2.5", NULL, fixed_stuff_bits},
    {"8.2.6", ">" F ":ack +r r(ack ackend tx act T+8) " ACTIVE AGAIN, NULL},
    {"8.2.7", "flo: >" F ":ack {r|d} d >" F "@ackdel r3", NULL},
    {"8.2.8", NULL, long_frames},
};

const section section_8_2 = {"8.2", cases, sizeof cases / sizeof cases[0]};
