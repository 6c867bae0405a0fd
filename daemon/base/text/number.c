/* SPDX-License-Identifier: MIT
 *
 * number.c - numbers, spans of time and bus time as people write them.
 */
#include "base/text/number.h"

#include "base/text/chars.h"
#include "base/text/wide.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define NS_PER_S UINT64_C(1000000000)
#define DECIMAL_DIGITS "0123456789"
#define EXPONENT_DIGITS_MAX 3u
#define FRACTION_DIGITS_MAX 19u /* 10^19 is the largest power of ten in 64 bits */
#define LOG_SECONDS_DIGITS 10u
#define LOG_SECONDS_END UINT64_C(10000000000)

/* A decimal number, kept exactly: (whole * 10^digits + fraction) / 10^digits. */
typedef struct decimal {
    uint64_t whole;
    uint64_t fraction;
    unsigned digits; /* of the fraction, without trailing zeros */
} decimal;

typedef struct time_unit {
    const char *name;
    uint64_t ns; /* 0: bit times */
} time_unit;

/* A unit of something else, as a number of the smallest one. */
typedef struct scale_unit {
    const char *name;
    uint64_t size; /* 0: ends a list */
} scale_unit;

#define NUMBER_MAX 32u /* bytes of a number that people write, and of its unit */
#define UNIT_MAX 8u
#define SIZE_DIGITS_MAX 9u
static const char size_problem[] = "expected a size such as 64kB, 100MB, 2GB or 512MiB";

static const char frequency_problem[] =
    "expected a frequency such as 16MHz or 8.333MHz (units: Hz kHz MHz GHz), in whole Hz";

static const char length_problem[] =
    "expected a length with unit such as 40m (units: mm cm m km), in whole millimetres";

static const char line_delay_problem[] =
    "expected the delay of a metre such as 5ns/m (units: ps/m ns/m), in whole picoseconds";

static const char sample_point_problem[] =
    "expected a part of the bit such as 87.5% or 0.875, from 10% to 99.9%";

static const char time_problem[] =
    "expected a time with unit such as 10ms (units: ns us ms s min h bit)";

static const char uint_problem[] =
    "digits only: no sign, unit, prefix, separator, fraction or leading 0";

static const char probability_problem[] =
    "expected a decimal fraction from 0 to 1 such as 0.05 or 1e-5, at most 19 decimals";
static const char percent_problem[] = "expected a part such as 60%, from 0.1% to 100%";
static char *print_log(char out[TIME_TEXT_MAX], uint64_t s, uint64_t us);
static bool add_digit(uint64_t *value, char c);
static bool parse_decimal(decimal *out, const char **text);
static bool parse_exponent(int *exponent, const char **text);
static bool scale_fraction(decimal *number, int exponent);
static uint64_t power_of_ten(unsigned exponent);
static const char *apply_unit(cfg_time *out, decimal number, const time_unit *unit);
static bool parse_quantity(uint64_t *out, const char *text, const scale_unit *units);
static uint64_t saturated_ticks(wide ns, wide bits, cw_rate rate);
static bool sum_of_times(cfg_time *out, cfg_time start, uint64_t k, cfg_time step);

const char *text_parse_percent(uint16_t *permille, const char *text)
{
    decimal number;

    if (!parse_decimal(&number, &text) || strcmp(text, "%") != 0 || number.digits > 1 ||
        number.whole > 100)
        return percent_problem;
    uint64_t value = number.whole * 10 + number.fraction;
    if (value == 0 || value > 1000)
        return percent_problem;
    *permille = (uint16_t)value;
    return NULL;
}

bool text_take_digits(uint64_t *out, const char **text, uint64_t most)
{
    const char *at = *text;
    uint64_t value = 0;

    for (; *at >= '0' && *at <= '9'; at++)
        if (!add_digit(&value, *at) || value > most)
            return false;
    if (at == *text)
        return false;
    *out = value;
    *text = at;
    return true;
}

bool text_take_uint(uint64_t *out, const char **text, uint64_t most)
{
    const bool padded = (*text)[0] == '0' && (*text)[1] >= '0' && (*text)[1] <= '9';

    return !padded && text_take_digits(out, text, most);
}

const char *text_parse_uint(uint64_t *out, const char *text)
{
    size_t digits = strspn(text, DECIMAL_DIGITS);

    if (digits == 0 || text[digits] != '\0' || (digits > 1 && *text == '0'))
        return uint_problem;
    return text_take_digits(out, &text, UINT64_MAX) ? NULL : "the number is too large";
}

unsigned text_hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return (unsigned)(c - '0');
    if (c >= 'A' && c <= 'F')
        return (unsigned)(c - 'A') + 10;
    return c >= 'a' && c <= 'f' ? (unsigned)(c - 'a') + 10 : 16;
}

bool text_parse_hex(uint32_t *value, const char *text, size_t length)
{
    uint32_t sum = 0;

    for (size_t i = 0; i < length; i++) {
        const unsigned digit = text_hex_digit(text[i]);
        if (digit > 15)
            return false;
        sum = sum << 4 | digit;
    }
    if (length == 0 || length > 8)
        return false;
    *value = sum;
    return true;
}

/* Copies a number without the separators of its digits. Returns where its unit begins, or NULL when
 * it has no digit or is too long. */
static const char *join_digits(char out[NUMBER_MAX], const char *text)
{
    size_t used = 0;

    for (; *text; text++) {
        const bool between = used > 0 && text[1] >= '0' && text[1] <= '9';
        if ((*text >= '0' && *text <= '9') || (*text == '.' && between))
            out[used++] = *text;
        else if (!between || !strchr("_' ", *text))
            break;
        if (used == NUMBER_MAX)
            return NULL;
    }
    out[used] = '\0';
    return used > 0 ? text + (*text == ' ') : NULL;
}

bool text_meant_uint(uint64_t *out, const char *text)
{
    static const scale_unit units[] = {
        {"", 1},          {"bit/s", 1},          {"bps", 1},          {"Hz", 1},
        {"k", 1000},      {"kbit/s", 1000},      {"kbps", 1000},      {"kHz", 1000},
        {"kbit", 1000},   {"kbaud", 1000},       {"kb/s", 1000},      {"K", 1000},
        {"M", 1000000},   {"Mbit/s", 1000000},   {"Mbps", 1000000},   {"MHz", 1000000},
        {"Mbit", 1000000}, {"Mbaud", 1000000},   {"Mb/s", 1000000},   {NULL, 0},
    };
    char number[NUMBER_MAX + UNIT_MAX];
    const char *unit = join_digits(number, text);

    if (!unit || strlen(unit) >= UNIT_MAX)
        return false;
    strcat(number, unit);
    return parse_quantity(out, number, units);
}

const char *text_parse_probability(uint64_t *out, const char *text)
{
    decimal number;
    int exponent;

    if (!parse_decimal(&number, &text) || !parse_exponent(&exponent, &text) || *text != '\0' ||
        !scale_fraction(&number, exponent))
        return probability_problem;
    if (number.whole > 1 || (number.whole == 1 && number.digits > 0))
        return probability_problem;
    /* The quotient of a number below 1 with 19 digits is at most 2^64 - 2, so "always" stays
     * distinct. */
    uint64_t rest;
    *out = number.whole == 1 ? UINT64_MAX
                             : wide_divide(&rest, (wide){.high = number.fraction},
                                           power_of_ten(number.digits))
                                   .low;
    return NULL;
}

const char *text_parse_time(cfg_time *out, const char *text)
{
    static const time_unit units[] = {
        {"ns", 1},       {"us", 1000},           {"ms", 1000000},
        {"s", NS_PER_S}, {"min", 60 * NS_PER_S}, {"h", 3600 * NS_PER_S},
        {"bit", 0},
    };
    decimal number;

    if (!parse_decimal(&number, &text))
        return time_problem;
    if (*text == '\0' && number.whole == 0 && number.digits == 0) {
        *out = (cfg_time){0};
        return NULL;
    }
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++)
        if (strcmp(text, units[i].name) == 0)
            return apply_unit(out, number, &units[i]);
    return time_problem;
}

const char *text_parse_size(uint64_t *bytes, const char *text)
{
    static const scale_unit units[] = {
        {"", 1},          {"kB", 1000},     {"MB", 1000000},   {"GB", 1000000000},
        {"KiB", 1 << 10}, {"MiB", 1 << 20}, {"GiB", 1 << 30},  {NULL, 0},
    };
    const size_t digits = strspn(text, DECIMAL_DIGITS);

    if (digits > SIZE_DIGITS_MAX || text[digits] == '.')
        return size_problem;
    return parse_quantity(bytes, text, units) ? NULL : size_problem;
}

const char *text_parse_frequency(uint64_t *hz, const char *text)
{
    static const scale_unit units[] = {
        {"", 1}, {"Hz", 1}, {"kHz", 1000}, {"MHz", 1000000}, {"GHz", 1000000000}, {NULL, 0},
    };

    return parse_quantity(hz, text, units) ? NULL : frequency_problem;
}

const char *text_parse_length(uint64_t *mm, const char *text)
{
    static const scale_unit units[] = {
        {"mm", 1}, {"cm", 10}, {"m", 1000}, {"km", 1000000}, {NULL, 0},
    };

    if (strcmp(text, "0") == 0) {
        *mm = 0;
        return NULL;
    }
    return parse_quantity(mm, text, units) ? NULL : length_problem;
}

const char *text_parse_line_delay(uint64_t *ps, const char *text)
{
    static const scale_unit units[] = {{"ps/m", 1}, {"ns/m", 1000}, {NULL, 0}};

    return parse_quantity(ps, text, units) ? NULL : line_delay_problem;
}

const char *text_parse_sample_point(uint16_t *permille, const char *text)
{
    const size_t length = strlen(text);
    decimal number;
    uint16_t value = 0;

    if (text_parse_percent(&value, text)) {
        if (length > strlen("0.875") || !parse_decimal(&number, &text) || *text != '\0' ||
            number.whole > 0)
            return sample_point_problem;
        value = (uint16_t)(number.fraction * (1000 / power_of_ten(number.digits)));
    }
    if (value < 100 || value > 999)
        return sample_point_problem;
    *permille = value;
    return NULL;
}

/* Rounds up once. 25 ns are 2 ticks. */
uint64_t text_time_ticks(cfg_time time, cw_rate rate)
{
    static_assert(CW_CLOCK_HZ / 2 * 25 == NS_PER_S, "a tick is 12.5 ns");
    const uint64_t ticks = time.ns / 25 * 2 + (time.ns % 25 * 2 + 24) / 25;
    return cw_after(cw_rate_ticks_or_never(rate, time.bits), ticks);
}

uint64_t text_time_ticks_sum(cfg_time start, uint64_t k, cfg_time step, cw_rate rate)
{
    cfg_time sum;

    if (sum_of_times(&sum, start, k, step))
        return text_time_ticks(sum, rate);
    return saturated_ticks(wide_sum(wide_product(k, step.ns), wide_of(start.ns)),
                           wide_sum(wide_product(k, step.bits), wide_of(start.bits)), rate);
}

/* A nanosecond is 2 / 25 ticks. */
cw_span text_time_fine(cfg_time time, cw_rate rate)
{
    const uint64_t most = UINT64_C(1) << 60;
    const uint64_t ticks = text_time_ticks(time, rate);

    if (ticks >= most / CW_TICK)
        return (cw_span)most;
    const uint64_t of_ns = ((time.ns * 2 % 25) * CW_TICK + 12) / 25 + time.ns * 2 / 25 * CW_TICK;
    return (cw_span)(of_ns + cw_rate_ticks(rate, time.bits) * CW_TICK);
}

char *text_print_seconds(char out[TIME_TEXT_MAX], uint64_t tick)
{
    uint64_t ns = tick % CW_CLOCK_HZ * NS_PER_S / CW_CLOCK_HZ;
    char *end = chars_decimal(out, tick / CW_CLOCK_HZ);

    *end++ = '.';
    end = chars_digits(end, ns, 9);
    *end = '\0';
    return end;
}

void text_print_span(char out[TIME_TEXT_MAX], uint64_t ticks)
{
    static const char *const names[] = {"ns", "us", "ms", "s"};
    uint64_t seconds = ticks / CW_CLOCK_HZ;
    uint64_t ns = ticks % CW_CLOCK_HZ * NS_PER_S / CW_CLOCK_HZ;
    uint64_t unit = 1;
    unsigned digits = 0;

    while (digits < 9 && (seconds > 0 || ns / unit >= 1000)) {
        unit *= 1000;
        digits += 3;
    }
    uint64_t part = ns % unit;
    char *end = chars_decimal(out, digits == 9 ? seconds : ns / unit);
    if (part > 0) {
        *end++ = '.';
        end = chars_digits(end, part, digits);
        while (end[-1] == '0')
            end--;
    }
    strcpy(end, names[digits / 3]);
}

char *text_print_log_time(char out[TIME_TEXT_MAX], uint64_t tick)
{
    uint64_t us = tick % CW_CLOCK_HZ / (CW_CLOCK_HZ / 1000000u);

    return print_log(out, tick / CW_CLOCK_HZ, us);
}

char *text_print_log_ns(char out[TIME_TEXT_MAX], uint64_t ns)
{
    return print_log(out, ns / NS_PER_S, ns % NS_PER_S / 1000);
}

/* Prints seconds with ten digits, or more for larger numbers. */
static char *print_log(char out[TIME_TEXT_MAX], uint64_t s, uint64_t us)
{
    char *end = out;

    *end++ = '(';
    end = s < LOG_SECONDS_END ? chars_digits(end, s, LOG_SECONDS_DIGITS) : chars_decimal(end, s);
    *end++ = '.';
    end = chars_digits(end, us, 6);
    *end++ = ')';
    *end = '\0';
    return end;
}

/* Adds one decimal digit; returns false when the number leaves 64 bits. */
static bool add_digit(uint64_t *value, char c)
{
    uint64_t digit = (uint64_t)(c - '0');

    if (*value > (UINT64_MAX - digit) / 10)
        return false;
    *value = *value * 10 + digit;
    return true;
}

/* Reads the digits after the point: at least one, and at most 19 that count. */
static bool parse_fraction(decimal *number, const char **text)
{
    size_t written = strspn(*text, DECIMAL_DIGITS);
    size_t digits = written;

    while (digits > 0 && (*text)[digits - 1] == '0')
        digits--;
    if (written == 0 || digits > FRACTION_DIGITS_MAX)
        return false;
    number->digits = (unsigned)digits;
    for (size_t i = 0; i < digits; i++)
        add_digit(&number->fraction, (*text)[i]);
    *text += written;
    return true;
}

/* Reads DIGITS or DIGITS.DIGITS without sign, leading zeros or exponent. */
static bool parse_decimal(decimal *out, const char **text)
{
    *out = (decimal){0};
    if (!text_take_uint(&out->whole, text, UINT64_MAX))
        return false;
    if (**text != '.')
        return true;
    ++*text;
    return parse_fraction(out, text);
}

/* Returns 10^exponent; the exponent is at most FRACTION_DIGITS_MAX. */
static uint64_t power_of_ten(unsigned exponent)
{
    uint64_t power = 1;

    assert(exponent <= FRACTION_DIGITS_MAX);
    while (exponent-- > 0)
        power *= 10;
    return power;
}

/* Reads nothing, or "e-5" without leading zeros. */
static bool parse_exponent(int *exponent, const char **text)
{
    *exponent = 0;
    if (**text != 'e' && **text != 'E')
        return true;
    ++*text;
    bool negative = **text == '-';
    if (**text == '-' || **text == '+')
        ++*text;
    size_t digits = strspn(*text, DECIMAL_DIGITS);
    if (digits == 0 || digits > EXPONENT_DIGITS_MAX)
        return false;
    for (; digits > 0; digits--)
        *exponent = *exponent * 10 + (*(*text)++ - '0');
    if (negative)
        *exponent = -*exponent;
    return true;
}

/* Shifts the point of a number. The result must stay within 0..1 and 19 decimals. */
static bool scale_fraction(decimal *number, int exponent)
{
    wide digits = wide_sum(wide_product(number->whole, power_of_ten(number->digits)),
                           wide_of(number->fraction));
    int decimals = (int)number->digits - exponent;
    uint64_t rest;

    for (; decimals > 0; decimals--) {
        wide tenth = wide_divide(&rest, digits, 10);
        if (rest != 0)
            break;
        digits = tenth;
    }
    if (digits.high == 0 && digits.low == 0)
        decimals = 0;
    if (decimals < 0 || decimals > (int)FRACTION_DIGITS_MAX)
        return false;
    uint64_t scale = power_of_ten((unsigned)decimals);
    if (digits.high > 0 || digits.low > scale)
        return false;
    *number = (decimal){
        .whole = digits.low / scale,
        .fraction = digits.low % scale,
        .digits = (unsigned)decimals,
    };
    return true;
}

/* Multiplies exactly. Returns what is wrong, or NULL. */
static const char *apply_unit(cfg_time *out, decimal number, const time_unit *unit)
{
    uint64_t rest;
    wide fraction = wide_divide(&rest, wide_product(number.fraction, unit->ns),
                                power_of_ten(number.digits));
    wide ns = wide_sum(wide_product(number.whole, unit->ns), fraction);

    if (unit->ns == 0 && number.digits > 0)
        return "bit times are whole numbers";
    if (rest != 0)
        return "times are whole nanoseconds";
    if (ns.high > 0)
        return "the time is too large";
    *out = (cfg_time){.ns = ns.low, .bits = unit->ns == 0 ? number.whole : 0};
    return NULL;
}

/* Reads a decimal number with one of these units. It must be a whole number of the smallest one. */
static bool parse_quantity(uint64_t *out, const char *text, const scale_unit *units)
{
    decimal number;

    if (!parse_decimal(&number, &text))
        return false;
    while (units->size > 0 && strcmp(text, units->name) != 0)
        units++;
    uint64_t rest;
    wide part = wide_divide(&rest, wide_product(number.fraction, units->size),
                            power_of_ten(number.digits));
    wide whole = wide_sum(wide_product(number.whole, units->size), part);

    if (units->size == 0 || rest != 0 || whole.high > 0)
        return false;
    *out = whole.low;
    return true;
}

/* Finds start + k * step. Returns false when it exceeds 64 bits. */
static bool sum_of_times(cfg_time *out, cfg_time start, uint64_t k, cfg_time step)
{
    return !__builtin_mul_overflow(k, step.ns, &out->ns) &&
           !__builtin_add_overflow(out->ns, start.ns, &out->ns) &&
           !__builtin_mul_overflow(k, step.bits, &out->bits) &&
           !__builtin_add_overflow(out->bits, start.bits, &out->bits);
}

/* Does the same as text_time_ticks() for longer times; returns CW_NEVER when the ticks exceed 64
 * bits. */
static uint64_t saturated_ticks(wide ns, wide bits, cw_rate rate)
{
    uint64_t rest;
    wide pairs = wide_divide(&rest, ns, 25);

    if (pairs.high > 0 || bits.high > 0)
        return CW_NEVER;
    wide ticks = wide_sum(wide_product(pairs.low, 2), wide_of((rest * 2 + 24) / 25));
    return ticks.high > 0 ? CW_NEVER : cw_after(cw_rate_ticks_or_never(rate, bits.low), ticks.low);
}
