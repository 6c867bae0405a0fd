/* SPDX-License-Identifier: MIT
 *
 * text.c - frames, filters, numbers, times and positions as people write them.
 */
#include "base/text.h"

#include "base/chars.h"
#include "base/wide.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define CLASSIC_DATA_MAX 8u
#define DLC_MAX 15u
#define BASE_DIGITS 3u
#define EXTENDED_DIGITS 8u
#define MASK_DIGITS_MAX 8u
#define BASE_ID_MAX 0x7FFu
#define EXTENDED_ID_MAX 0x1FFFFFFFu
#define FILTER_ERROR_FLAG 0x20000000u /* CAN_ERR_FLAG of the kernel's can_id */
#define ERROR_MASK_ALL 0x1FFFFFFFu    /* CAN_ERR_MASK */
#define EXPONENT_DIGITS_MAX 3u
#define FRACTION_DIGITS_MAX 19u /* 10^19 is the largest power of ten in 64 bits */
#define OPEN_INDEX_COUNT 256u   /* for positions without an end of their own */

#define NS_PER_S UINT64_C(1000000000)
#define LOG_SECONDS_DIGITS 10u
#define LOG_SECONDS_END UINT64_C(10000000000)

#define HEX_DIGITS "0123456789ABCDEFabcdef"
#define DECIMAL_DIGITS "0123456789"

/* A decimal number kept exactly: (whole * 10^digits + fraction) / 10^digits. */
typedef struct decimal {
    uint64_t whole;
    uint64_t fraction;
    unsigned digits; /* of the fraction, without trailing zeros */
} decimal;

typedef struct time_unit {
    const char *name;
    uint64_t ns; /* 0: bit times */
} time_unit;

/* How many index values a position has; 0: it is written without index. */
static const uint16_t index_counts[CW_FIELD_COUNT] = {
    [CW_FIELD_ID] = 29,
    [CW_FIELD_DLC] = 4,
    [CW_FIELD_DATA] = 64,
    [CW_FIELD_CRC] = 15,
    [CW_FIELD_EOF] = 7,
    [CW_FIELD_INTERMISSION] = 3,
    [CW_FIELD_SUSPEND] = 8,
    [CW_FIELD_ERROR_FLAG] = OPEN_INDEX_COUNT,
    [CW_FIELD_ERROR_DELIMITER] = OPEN_INDEX_COUNT,
    [CW_FIELD_OVERLOAD_FLAG] = OPEN_INDEX_COUNT,
    [CW_FIELD_OVERLOAD_DELIMITER] = OPEN_INDEX_COUNT,
    [CW_FIELD_STUFF] = OPEN_INDEX_COUNT,
    [CW_FIELD_BIT] = OPEN_INDEX_COUNT,
};

static const char identifier_problem[] =
    "identifiers have 3 hexadecimal digits (base, up to 7FF) or 8 (extended, up to 1FFFFFFF)";
static const char frame_problem[] =
    "expected a frame such as 123#DEADBEEF, 12345678#, 123#R4 or 123#1122334455667788_F";
static const char filter_problem[] =
    "expected a frame filter: an identifier (123, 12345678), ID:MASK or ID~MASK, separated by ','";
static const char position_problem[] =
    "expected a position: sof id[0..28] srr ide rtr r0 r1 dlc[0..3] data[BYTE.BIT] crc[0..14] "
    "crc-delimiter ack-slot ack-delimiter eof[0..6] intermission[0..2] suspend[0..7] stuff[N] "
    "bit[N] error-flag[N] error-delimiter[N] overload-flag[N] overload-delimiter[N]";
#define SIZE_DIGITS_MAX 9u /* so that nothing overflows */
static const char size_problem[] = "expected a size such as 64kB, 100MB, 2GB or 512MiB";
static const char time_problem[] =
    "expected a time with unit such as 10ms (units: ns us ms s min h bit)";
static const char uint_problem[] =
    "digits only: no sign, unit, prefix, separator, fraction or leading 0";
static const char probability_problem[] =
    "expected a decimal fraction from 0 to 1 such as 0.05 or 1e-5, at most 19 decimals";
static const char error_mask_problem[] =
    "expected an error filter #MASK, 1 to 8 hexadecimal digits with a class of linux/can/error.h";
static const char bytes_problem[] =
    "expected 1 to 8 bytes of two hexadecimal digits such as DEAD..EF or DE AD x1, '.' or 'x' for "
    "any digit, blanks only between bytes";
static const char levels_problem[] =
    "expected 1 to 64 levels such as 10x1: 1 recessive, 0 dominant, x as it is, not all x";
static const char percent_problem[] = "expected a part such as 60%, from 0.1% to 100%";

static char *print_fd_flags(char *at, uint8_t flags);
static char *print_log(char out[TIME_TEXT_MAX], uint64_t s, uint64_t us);
static unsigned hex_digit(char c);
static uint32_t hex_value(const char *text, size_t digits);
static bool identifier_valid(uint32_t id, size_t digits);
static const char *parse_frame_id(cw_frame *frame, const char **text);
static const char *parse_remote(cw_frame *frame, const char *text);
static const char *parse_data(cw_frame *frame, const char *text);
static const char *parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text);
static const char *parse_byte(text_bytes *bytes, const char *text);
static bool add_digit(uint64_t *value, char c);
static bool parse_decimal(decimal *out, const char **text);
static bool parse_exponent(int *exponent, const char **text);
static bool scale_fraction(decimal *number, int exponent);
static uint64_t power_of_ten(unsigned exponent);
static const char *apply_unit(cfg_time *out, decimal number, const time_unit *unit);
static uint64_t saturated_ticks(wide ns, wide bits, uint32_t bit_ticks);
static cw_field find_field(const char *name, size_t length);
static bool parse_index(uint16_t *index, cw_field field, const char *text);

const char *text_parse_frame(cw_frame *out, const char *text)
{
    cw_frame frame = {0};
    const char *problem = parse_frame_id(&frame, &text);

    if (!problem && *text == '#')
        problem = "CAN FD frames (##) are not supported yet";
    else if (!problem && (*text == 'R' || *text == 'r'))
        problem = parse_remote(&frame, text + 1);
    else if (!problem)
        problem = parse_data(&frame, text);
    if (!problem)
        *out = frame;
    return problem;
}

char *text_print_frame(char out[FRAME_TEXT_MAX], const cw_frame *frame)
{
    bool wide_id = (frame->flags & CW_FRAME_EXTENDED) || frame->id > BASE_ID_MAX;
    bool fd = frame->flags & CW_FRAME_FD, remote = frame->flags & CW_FRAME_REMOTE;
    uint8_t dlc = frame->dlc;
    char *end = chars_hex(out, frame->id, wide_id ? EXTENDED_DIGITS : BASE_DIGITS);

    *end++ = '#';
    if (fd)
        end = print_fd_flags(end, frame->flags);
    else if (remote)
        *end++ = 'R';
    /* of a CAN FD frame what is kept of it */
    end = chars_bytes(end, frame->data, cw_frame_length(frame));
    if (!fd && remote && dlc > 0)
        *end++ = (char)('0' + (dlc < CLASSIC_DATA_MAX ? dlc : CLASSIC_DATA_MAX));
    if (!fd && dlc > CLASSIC_DATA_MAX) {
        *end++ = '_';
        end = chars_hex(end, dlc, dlc > DLC_MAX ? 2 : 1);
    }
    *end = '\0';
    return end;
}

void text_print_filter(char out[FILTER_TEXT_MAX], const cw_filter *filter)
{
    const uint32_t base = CW_FILTER_EXTENDED | BASE_ID_MAX;
    const uint32_t extended = CW_FILTER_EXTENDED | EXTENDED_ID_MAX;
    bool is_extended = filter->value & CW_FILTER_EXTENDED;

    if (!filter->inverted && filter->mask == base && !is_extended)
        snprintf(out, FILTER_TEXT_MAX, "%03" PRIX32, filter->value);
    else if (!filter->inverted && filter->mask == extended && is_extended)
        snprintf(out, FILTER_TEXT_MAX, "%08" PRIX32, filter->value & EXTENDED_ID_MAX);
    else
        snprintf(out, FILTER_TEXT_MAX, "%" PRIX32 "%c%" PRIX32, filter->value,
                 filter->inverted ? '~' : ':', filter->mask);
}

const char *text_parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text)
{
    /* Two passes, so that nothing is written when a later filter is wrong. */
    unsigned found = 0;
    const char *problem = parse_filters(NULL, &found, max, text);

    return problem ? problem : parse_filters(out, count, max, text);
}

const char *text_parse_error_mask(uint32_t *mask, const char *text)
{
    size_t digits = *text == '#' ? strspn(text + 1, HEX_DIGITS) : 0;
    uint32_t value = digits > 0 && digits <= MASK_DIGITS_MAX ? hex_value(text + 1, digits) : 0;

    if (!(value & ERROR_MASK_ALL) || text[digits + 1] != '\0')
        return error_mask_problem;
    *mask = value & ERROR_MASK_ALL;
    return NULL;
}

const char *text_parse_id(uint32_t *id, uint8_t *flags, const char *text)
{
    size_t digits = strspn(text, HEX_DIGITS);

    if (digits > EXTENDED_DIGITS || text[digits] != '\0' ||
        !identifier_valid(hex_value(text, digits), digits))
        return identifier_problem;
    *id = hex_value(text, digits);
    *flags = digits == EXTENDED_DIGITS ? CW_FRAME_EXTENDED : 0;
    return NULL;
}

const char *text_parse_bytes(text_bytes *out, const char *text)
{
    text_bytes bytes = {0};

    while ((text = parse_byte(&bytes, text)) != NULL && *text != '\0')
        text += strspn(text, " ");
    if (!text)
        return bytes_problem;
    *out = bytes;
    return NULL;
}

const char *text_parse_levels(text_levels *out, const char *text)
{
    size_t length = strlen(text);
    text_levels levels = {.bits = (uint16_t)length};

    if (length == 0 || length > CW_PATTERN_MAX || text[strspn(text, "01xX")] != '\0')
        return levels_problem;
    for (size_t i = 0; i < length; i++) {
        levels.level |= (uint64_t)(text[i] == '1') << i;
        levels.mask |= (uint64_t)(text[i] == '0' || text[i] == '1') << i;
    }
    if (levels.mask == 0)
        return levels_problem;
    *out = levels;
    return NULL;
}

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

const char *text_parse_uint(uint64_t *out, const char *text)
{
    size_t digits = strspn(text, DECIMAL_DIGITS);
    uint64_t value = 0;

    if (digits == 0 || text[digits] != '\0' || (digits > 1 && *text == '0'))
        return uint_problem;
    for (; *text; text++)
        if (!add_digit(&value, *text))
            return "the number is too large";
    *out = value;
    return NULL;
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
    /* Below 1 with 19 digits the quotient is at most 2^64 - 2, so "always" stays distinct. */
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
    static const struct {
        const char *name;
        uint64_t bytes;
    } units[] = {
        {"", 1},          {"kB", 1000},     {"MB", 1000000},   {"GB", 1000000000},
        {"KiB", 1 << 10}, {"MiB", 1 << 20}, {"GiB", 1 << 30},
    };
    size_t digits = strspn(text, "0123456789");
    uint64_t number = 0;

    if (digits == 0 || digits > SIZE_DIGITS_MAX || (text[0] == '0' && digits > 1))
        return size_problem;
    for (size_t i = 0; i < digits; i++)
        number = number * 10 + (uint64_t)(text[i] - '0');
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++)
        if (strcmp(text + digits, units[i].name) == 0) {
            *bytes = number * units[i].bytes;
            return NULL;
        }
    return size_problem;
}

uint64_t text_time_ticks(cfg_time time, uint32_t bit_ticks)
{
    return saturated_ticks(wide_of(time.ns), wide_of(time.bits), bit_ticks);
}

uint64_t text_time_ticks_sum(cfg_time start, uint64_t k, cfg_time step, uint32_t bit_ticks)
{
    return saturated_ticks(wide_sum(wide_product(k, step.ns), wide_of(start.ns)),
                           wide_sum(wide_product(k, step.bits), wide_of(start.bits)), bit_ticks);
}

const char *text_parse_position(cw_field *field, uint16_t *index, const char *text)
{
    size_t length = strcspn(text, "[");
    cw_field found = find_field(text, length);
    uint16_t number = 0;

    if (found == CW_FIELD_NONE)
        return position_problem;
    if (index_counts[found] == 0 ? text[length] != '\0'
                                 : !parse_index(&number, found, text + length))
        return position_problem;
    *field = found;
    *index = number;
    return NULL;
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
    int used = snprintf(out, TIME_TEXT_MAX, "%" PRIu64, digits == 9 ? seconds : ns / unit);
    if (part > 0) {
        used +=
            snprintf(out + used, TIME_TEXT_MAX - (size_t)used, ".%0*" PRIu64, (int)digits, part);
        while (out[used - 1] == '0')
            used--;
    }
    strcpy(out + used, names[digits / 3]);
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

/* ESI and BRS as can-utils write them. */
static char *print_fd_flags(char *at, uint8_t flags)
{
    *at++ = '#';
    *at++ = (char)('0' + ((flags & CW_FRAME_BRS ? 1 : 0) | (flags & CW_FRAME_ESI ? 2 : 0)));
    return at;
}

/* Ten digits of seconds, more where it takes more. */
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

/* Value of one hexadecimal digit, or 16. */
static unsigned hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return (unsigned)(c - '0');
    if (c >= 'A' && c <= 'F')
        return (unsigned)(c - 'A') + 10;
    if (c >= 'a' && c <= 'f')
        return (unsigned)(c - 'a') + 10;
    return 16;
}

/* Value of at most 8 hexadecimal digits. */
static uint32_t hex_value(const char *text, size_t digits)
{
    uint32_t value = 0;

    for (size_t i = 0; i < digits; i++)
        value = value << 4 | hex_digit(text[i]);
    return value;
}

/* A bare identifier of 3 or 8 digits, in range. */
static bool identifier_valid(uint32_t id, size_t digits)
{
    if (digits == BASE_DIGITS)
        return id <= BASE_ID_MAX;
    return digits == EXTENDED_DIGITS && id <= EXTENDED_ID_MAX;
}

/* Reads up to and including the first '#'. */
static const char *parse_frame_id(cw_frame *frame, const char **text)
{
    size_t digits = strspn(*text, HEX_DIGITS);

    if (digits == 0 || (*text)[digits] != '#')
        return frame_problem;
    if (digits > EXTENDED_DIGITS || !identifier_valid(hex_value(*text, digits), digits))
        return identifier_problem;
    frame->id = hex_value(*text, digits);
    frame->flags = digits == EXTENDED_DIGITS ? CW_FRAME_EXTENDED : 0;
    *text += digits + 1;
    return NULL;
}

/* The end of a frame: nothing, or "_9".."_F" after a DLC of 8. */
static const char *parse_raw_dlc(cw_frame *frame, const char *text)
{
    if (*text == '\0')
        return NULL;
    if (*text != '_')
        return frame_problem;

    unsigned dlc = hex_digit(text[1]);
    if (frame->dlc != CLASSIC_DATA_MAX || dlc <= CLASSIC_DATA_MAX || dlc > DLC_MAX ||
        text[2] != '\0')
        return "a raw DLC is _9 to _F after exactly 8 data bytes or R8";
    frame->dlc = (uint8_t)dlc;
    return NULL;
}

static const char *parse_remote(cw_frame *frame, const char *text)
{
    frame->flags |= CW_FRAME_REMOTE;
    if (*text == '\0')
        return NULL;
    if (*text < '0' || *text > '8')
        return "the DLC of a remote frame is R0 to R8, or R8_9 to R8_F";
    frame->dlc = (uint8_t)(*text - '0');
    return parse_raw_dlc(frame, text + 1);
}

static const char *parse_data(cw_frame *frame, const char *text)
{
    while (hex_digit(*text) < 16) {
        if (hex_digit(text[1]) > 15)
            return "data bytes have two hexadecimal digits";
        if (frame->dlc == CLASSIC_DATA_MAX)
            return "a frame has at most 8 data bytes";
        frame->data[frame->dlc++] = (uint8_t)hex_value(text, 2);
        text += 2;
        if (*text == '.' && hex_digit(text[1]) < 16)
            text++;
    }
    return parse_raw_dlc(frame, text);
}

/* ID:MASK or ID~MASK as candump takes them; 8 digits of identifier mean extended. */
static const char *parse_masked(cw_filter *filter, size_t digits, const char **text)
{
    const char *mask = *text + digits + 1;
    size_t mask_digits = strspn(mask, HEX_DIGITS);

    if (mask_digits == 0 || mask_digits > MASK_DIGITS_MAX)
        return filter_problem;
    filter->inverted = (*text)[digits] == '~';
    filter->value = hex_value(*text, digits);
    filter->mask = hex_value(mask, mask_digits);
    if (filter->value & FILTER_ERROR_FLAG)
        return "error frames (bit 20000000) are never on the bus, a filter cannot ask for them";
    if (digits == EXTENDED_DIGITS)
        filter->value |= CW_FILTER_EXTENDED;
    *text = mask + mask_digits;
    return NULL;
}

/* A bare identifier: this format only, data and remote frames. */
static const char *parse_exact(cw_filter *filter, size_t digits, const char **text)
{
    bool extended = digits == EXTENDED_DIGITS;
    uint32_t id = hex_value(*text, digits);

    if (!identifier_valid(id, digits))
        return identifier_problem;
    filter->value = id | (extended ? CW_FILTER_EXTENDED : 0);
    filter->mask = CW_FILTER_EXTENDED | (extended ? EXTENDED_ID_MAX : BASE_ID_MAX);
    *text += digits;
    return NULL;
}

static const char *parse_filter(cw_filter *filter, const char **text)
{
    size_t digits = strspn(*text, HEX_DIGITS);
    char after = (*text)[digits];

    if (digits == 0 || digits > EXTENDED_DIGITS)
        return filter_problem;
    if (after == ':' || after == '~')
        return parse_masked(filter, digits, text);
    return parse_exact(filter, digits, text);
}

/* With out == NULL the filters are only checked and counted. */
static const char *parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text)
{
    for (unsigned n = 0; n < max; n++) {
        cw_filter filter = {0};
        const char *problem = parse_filter(&filter, &text);

        if (problem)
            return problem;
        if (out)
            out[n] = filter;
        if (*text == '\0') {
            *count = n + 1;
            return NULL;
        }
        if (*text++ != ',')
            return filter_problem;
    }
    return "more frame filters than fit (8 in a fault rule)";
}

/* One digit of a byte with wildcards, or false. */
static bool parse_nibble(text_bytes *bytes, char c)
{
    bool any = c == '.' || c == 'x' || c == 'X';
    unsigned digit = any ? 0 : hex_digit(c);
    uint8_t *mask = &bytes->mask[bytes->length];
    uint8_t *value = &bytes->value[bytes->length];

    *mask = (uint8_t)(*mask * 16u + (any ? 0 : 0xF));
    *value = (uint8_t)(*value * 16u + digit % 16);
    return digit < 16;
}

/* Adds a byte; returns what follows, or NULL. */
static const char *parse_byte(text_bytes *bytes, const char *text)
{
    if (bytes->length == CLASSIC_DATA_MAX || !parse_nibble(bytes, text[0]) ||
        !parse_nibble(bytes, text[1]))
        return NULL;
    bytes->length++;
    return text + 2;
}

/* Adds one decimal digit; false when the number leaves 64 bits. */
static bool add_digit(uint64_t *value, char c)
{
    uint64_t digit = (uint64_t)(c - '0');

    if (*value > (UINT64_MAX - digit) / 10)
        return false;
    *value = *value * 10 + digit;
    return true;
}

/* The digits after the point: at least one, at most 19 that count. */
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
    size_t digits = strspn(*text, DECIMAL_DIGITS);

    *out = (decimal){0};
    if (digits == 0 || (digits > 1 && **text == '0'))
        return false;
    for (size_t i = 0; i < digits; i++)
        if (!add_digit(&out->whole, *(*text)++))
            return false;
    if (**text != '.')
        return true;
    ++*text;
    return parse_fraction(out, text);
}

/* Of at most FRACTION_DIGITS_MAX. */
static uint64_t power_of_ten(unsigned exponent)
{
    uint64_t power = 1;

    assert(exponent <= FRACTION_DIGITS_MAX);
    while (exponent-- > 0)
        power *= 10;
    return power;
}

/* Nothing, or "e-5"; without leading zeros. */
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

/* Shifts the point of a number, as long as it stays within 0..1 and 19 decimals. */
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

/* Rounds up once; CW_NEVER when the sum leaves 64 bits. 25 ns are 2 ticks. */
static uint64_t saturated_ticks(wide ns, wide bits, uint32_t bit_ticks)
{
    static_assert(CW_CLOCK_HZ / 2 * 25 == NS_PER_S, "a tick is 12.5 ns");
    uint64_t rest;
    wide pairs = wide_divide(&rest, ns, 25);

    if (pairs.high > 0 || bits.high > 0)
        return CW_NEVER;
    wide ticks = wide_sum(wide_product(pairs.low, 2), wide_of((rest * 2 + 24) / 25));
    ticks = wide_sum(ticks, wide_product(bits.low, bit_ticks));
    return ticks.high > 0 ? CW_NEVER : ticks.low;
}

static cw_field find_field(const char *name, size_t length)
{
    for (int i = CW_FIELD_NONE + 1; i < CW_FIELD_COUNT; i++) {
        const char *candidate = cw_field_name((cw_field)i);
        if (strlen(candidate) == length && memcmp(candidate, name, length) == 0)
            return (cw_field)i;
    }
    return CW_FIELD_NONE;
}

/* A decimal number of at most 3 digits without leading zeros. */
static bool parse_small(unsigned *out, const char **text)
{
    size_t digits = strspn(*text, DECIMAL_DIGITS);

    if (digits == 0 || digits > 3 || (digits > 1 && **text == '0'))
        return false;
    *out = 0;
    for (; digits > 0; digits--)
        *out = *out * 10 + (unsigned)(*(*text)++ - '0');
    return true;
}

/* "[N]", or "[BYTE.BIT]" for data. */
static bool parse_index(uint16_t *index, cw_field field, const char *text)
{
    unsigned number;
    unsigned bit;

    if (*text++ != '[' || !parse_small(&number, &text))
        return false;
    if (field == CW_FIELD_DATA) {
        if (*text++ != '.' || !parse_small(&bit, &text) || bit > 7)
            return false;
        number = number * 8 + bit;
    }
    if (strcmp(text, "]") != 0 || number >= index_counts[field])
        return false;
    *index = (uint16_t)number;
    return true;
}
