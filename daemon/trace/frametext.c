/* SPDX-License-Identifier: MIT
 *
 * frametext.c - frames, filters and positions in frames as people write them.
 */
#include "trace/frametext.h"

#include "base/text/chars.h"
#include "base/text/number.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define DLC_MAX 15u
#define BASE_DIGITS 3u
#define EXTENDED_DIGITS 8u
#define INDEX_MAX 999u
#define FILTER_ERROR_FLAG 0x20000000u /* CAN_ERR_FLAG of the kernel's can_id */
#define ERROR_MASK_ALL 0x1FFFFFFFu    /* CAN_ERR_MASK */
#define OPEN_INDEX_COUNT 256u   /* for positions without an end of their own, without FD */

#define HEX_DIGITS "0123456789ABCDEFabcdef"
#define DECIMAL_DIGITS "0123456789"

static const char identifier_problem[] =
    "identifiers have 3 hexadecimal digits (base, up to 7FF) or 8 (extended, up to 1FFFFFFF)";

static const char frame_problem[] =
    "expected a frame such as 123#DEADBEEF, 12345678#, 123#R4 or 123#1122334455667788_F";

static const char fd_frame_problem[] =
    "expected a CAN FD frame such as 123##1DEADBEEF, behind ## one digit of flags: 1 BRS, 2 ESI, "
    "3 both, or 0";

static const char filter_problem[] =
    "expected a frame filter: an identifier (123, 12345678), ID:MASK or ID~MASK, or ~ and one of "
    "the first two, separated by ','";

static const char position_problem[] =
    "expected a position: sof id[0..28] srr ide rtr r0 r1 dlc[0..3] data[BYTE.BIT] crc[0..14] "
    "crc-delimiter ack-slot ack-delimiter eof[0..6] intermission[0..2] suspend[0..7] stuff[N] "
    "bit[N] error-flag[N] error-delimiter[N] overload-flag[N] overload-delimiter[N]";

static const char fd_position_problem[] =
    "expected a position: sof id[0..28] srr ide rtr r0 r1 fdf res brs esi dlc[0..3] "
    "data[BYTE.BIT] stuff-count[0..3] crc[0..20] fixed-stuff[N] crc-delimiter ack-slot "
    "ack-slot[0..1] ack-delimiter eof[0..6] intermission[0..2] suspend[0..7] stuff[N] bit[N] "
    "error-flag[N] error-delimiter[N] overload-flag[N] overload-delimiter[N]";

static const char error_mask_problem[] =
    "expected an error filter #MASK, 1 to 8 hexadecimal digits with a class of linux/can/error.h";

static const char bytes_problem[] =
    "expected 1 to 8 bytes of two hexadecimal digits such as DEAD..EF or DE AD x1, '.' or 'x' for "
    "any digit, blanks only between bytes";

static const char fd_bytes_problem[] =
    "expected 1 to 64 bytes of two hexadecimal digits such as DEAD..EF or DE AD x1, '.' or 'x' for "
    "any digit, blanks only between bytes";

static const char levels_problem[] =
    "expected 1 to 64 levels such as 10x1: 1 recessive, 0 dominant, x as it is, not all x";
static char *print_fd_flags(char *at, uint8_t flags);
static bool read_identifier(uint32_t *id, uint8_t *flags, const char *text, size_t digits);
static const char *parse_frame_id(cw_frame *frame, const char **text);
static const char *parse_remote(cw_frame *frame, const char *text);
static const char *parse_fd(cw_frame *frame, const char *text);
static const char *parse_data(cw_frame *frame, const char *text);
static const char *parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text);
static const char *parse_byte(text_bytes *bytes, const char *text, unsigned max);
static cw_field find_field(const char *name, size_t length);
static bool parse_index(uint16_t *index, cw_field field, const char *text, bool fd);

const char *text_parse_frame(cw_frame *out, const char *text)
{
    cw_frame frame = {0};
    const char *problem = parse_frame_id(&frame, &text);

    if (!problem && *text == '#')
        problem = parse_fd(&frame, text + 1);
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
    bool wide_id = (frame->flags & CW_FRAME_EXTENDED) || frame->id > CW_BASE_ID_MAX;
    bool fd = frame->flags & (CW_FRAME_FD | CW_FRAME_CUT);
    bool remote = frame->flags & CW_FRAME_REMOTE;
    uint8_t dlc = frame->dlc;
    char *end = chars_hex(out, frame->id, wide_id ? EXTENDED_DIGITS : BASE_DIGITS);

    *end++ = '#';
    if (fd)
        end = print_fd_flags(end, frame->flags);
    else if (remote)
        *end++ = 'R';
    end = chars_bytes(end, frame->data, cw_frame_length(frame));
    if (!fd && remote && dlc > 0)
        *end++ = (char)('0' + (dlc < CW_CLASSICAL_DATA_MAX ? dlc : CW_CLASSICAL_DATA_MAX));
    if (!fd && dlc > CW_CLASSICAL_DATA_MAX) {
        *end++ = '_';
        end = chars_hex(end, dlc, dlc > DLC_MAX ? 2 : 1);
    }
    *end = '\0';
    return end;
}

void text_print_filter(char out[FILTER_TEXT_MAX], const cw_filter *filter)
{
    bool is_extended = filter->value & CW_FILTER_EXTENDED;

    if (!filter->inverted && filter->mask == CW_FILTER_BASE_MASK && !is_extended)
        snprintf(out, FILTER_TEXT_MAX, "%03" PRIX32, filter->value);
    else if (!filter->inverted && filter->mask == CW_FILTER_EXTENDED_MASK && is_extended)
        snprintf(out, FILTER_TEXT_MAX, "%08" PRIX32, filter->value & CW_EXTENDED_ID_MAX);
    else
        snprintf(out, FILTER_TEXT_MAX, "%" PRIX32 "%c%" PRIX32, filter->value,
                 filter->inverted ? '~' : ':', filter->mask);
}

const char *text_parse_filters(cw_filter *out, unsigned *count, unsigned max, const char *text)
{
    /* The first of two passes only checks, so that nothing is written when a later filter is
     * wrong. */
    unsigned found = 0;
    const char *problem = parse_filters(NULL, &found, max, text);

    return problem ? problem : parse_filters(out, count, max, text);
}

const char *text_parse_error_mask(uint32_t *mask, const char *text)
{
    size_t digits = *text == '#' ? strspn(text + 1, HEX_DIGITS) : 0;
    uint32_t value = 0;

    if (!text_parse_hex(&value, text + 1, digits) || !(value & ERROR_MASK_ALL) ||
        text[digits + 1] != '\0')
        return error_mask_problem;
    *mask = value & ERROR_MASK_ALL;
    return NULL;
}

const char *text_parse_id(uint32_t *id, uint8_t *flags, const char *text)
{
    size_t digits = strspn(text, HEX_DIGITS);

    return text[digits] == '\0' && read_identifier(id, flags, text, digits) ? NULL
                                                                           : identifier_problem;
}

/* Blanks may stand between bytes, not in them. */
const char *text_parse_bytes(text_bytes *out, const char *text, bool fd)
{
    const unsigned max = fd ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX;
    text_bytes bytes = {0};

    while ((text = parse_byte(&bytes, text, max)) != NULL && *text != '\0')
        text += strspn(text, " ");
    if (!text)
        return fd ? fd_bytes_problem : bytes_problem;
    *out = bytes;
    return NULL;
}

/* The first level is bit 0 of the sets. One of x alone would change nothing. */
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

/* Returns true for a field that classical frames do not have. */
static bool is_of_fd(cw_field field)
{
    return cw_field_bits(field, false) == 0 && cw_field_bits(field, true) > 0;
}

const char *text_parse_position(cw_field *field, uint16_t *index, const char *text, bool fd)
{
    const char *problem = fd ? fd_position_problem : position_problem;
    size_t length = strcspn(text, "[");
    cw_field found = find_field(text, length);
    bool single = cw_field_bits(found, fd) == 1;
    uint16_t number = 0;

    if (found == CW_FIELD_NONE || (is_of_fd(found) && !fd))
        return problem;
    if (text[length] == '\0' ? !single && cw_field_bits(found, false) != 1
                             : single || !parse_index(&number, found, text + length, fd))
        return problem;
    *field = found;
    *index = number;
    return NULL;
}

/* Prints ESI and BRS as can-utils does. */
static char *print_fd_flags(char *at, uint8_t flags)
{
    *at++ = '#';
    *at++ = (char)('0' + ((flags & CW_FRAME_BRS ? 1 : 0) | (flags & CW_FRAME_ESI ? 2 : 0)));
    return at;
}

/* Reads an identifier of 3 or 8 digits. */
static bool read_identifier(uint32_t *id, uint8_t *flags, const char *text, size_t digits)
{
    const bool extended = digits == EXTENDED_DIGITS;
    uint32_t value;

    if ((!extended && digits != BASE_DIGITS) || !text_parse_hex(&value, text, digits) ||
        value > (extended ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX))
        return false;
    *id = value;
    *flags = extended ? CW_FRAME_EXTENDED : 0;
    return true;
}

/* Reads up to and including the first '#'. */
static const char *parse_frame_id(cw_frame *frame, const char **text)
{
    size_t digits = strspn(*text, HEX_DIGITS);

    if (digits == 0 || (*text)[digits] != '#')
        return frame_problem;
    if (!read_identifier(&frame->id, &frame->flags, *text, digits))
        return identifier_problem;
    *text += digits + 1;
    return NULL;
}

/* Reads the end of a frame: nothing, or "_9".."_F" after a DLC of 8. */
static const char *parse_raw_dlc(cw_frame *frame, const char *text)
{
    if (*text == '\0')
        return NULL;
    if (*text != '_')
        return frame_problem;

    unsigned dlc = text_hex_digit(text[1]);
    if (frame->dlc != CW_CLASSICAL_DATA_MAX || dlc <= CW_CLASSICAL_DATA_MAX || dlc > DLC_MAX ||
        text[2] != '\0')
        return "a raw DLC is _9 to _F after exactly 8 data bytes or R8";
    frame->dlc = (uint8_t)dlc;
    return NULL;
}

/* Reads what follows the R: a DLC, which has no data behind it. */
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

/* Reads pairs of digits up to other text; *count is their number. */
static const char *parse_pairs(cw_frame *frame, unsigned *count, unsigned max, const char **text)
{
    while (text_hex_digit(**text) < 16) {
        uint32_t byte;
        if (!text_parse_hex(&byte, *text, 2))
            return "data bytes have two hexadecimal digits";
        if (*count == max)
            return max == CW_CLASSICAL_DATA_MAX ? "a frame has at most 8 data bytes"
                                                : "a CAN FD frame has at most 64 data bytes";
        frame->data[(*count)++] = (uint8_t)byte;
        *text += 2;
        if (**text == '.' && text_hex_digit((*text)[1]) < 16)
            (*text)++;
    }
    return NULL;
}

/* Reads the bytes, whose number is the DLC unless a raw one follows. */
static const char *parse_data(cw_frame *frame, const char *text)
{
    unsigned count = 0;
    const char *problem = parse_pairs(frame, &count, CW_CLASSICAL_DATA_MAX, &text);

    frame->dlc = (uint8_t)count;
    return problem ? problem : parse_raw_dlc(frame, text);
}

/* Reads the digit of flags and the data. A length that no FD frame has is rounded up, as cansend
 * does (D2). */
static const char *parse_fd(cw_frame *frame, const char *text)
{
    unsigned count = 0, flags = text_hex_digit(*text++);

    if (flags > 15)
        return fd_frame_problem;
    if (*text == '.' && text_hex_digit(text[1]) < 16)
        text++;
    const char *problem = parse_pairs(frame, &count, CW_FRAME_DATA_MAX, &text);
    if (problem || *text != '\0')
        return problem ? problem : fd_frame_problem;
    frame->flags |= CW_FRAME_FD;
    frame->flags |= (uint8_t)((flags & 1u ? CW_FRAME_BRS : 0) | (flags & 2u ? CW_FRAME_ESI : 0));
    frame->dlc = (uint8_t)cw_fd_dlc(count);
    return NULL;
}

/* Reads ID:MASK or ID~MASK as candump does; an identifier of 8 digits is extended. */
static const char *parse_masked(cw_filter *filter, size_t digits, const char **text)
{
    const char *mask = *text + digits + 1;
    size_t mask_digits = strspn(mask, HEX_DIGITS);

    if (!text_parse_hex(&filter->mask, mask, mask_digits) ||
        !text_parse_hex(&filter->value, *text, digits))
        return filter_problem;
    filter->inverted = (*text)[digits] == '~';
    if (filter->value & FILTER_ERROR_FLAG)
        return "error frames (bit 20000000) are never on the bus, a filter cannot ask for them";
    if (digits == EXTENDED_DIGITS)
        filter->value |= CW_FILTER_EXTENDED;
    *text = mask + mask_digits;
    return NULL;
}

/* Reads an identifier alone: only this format, data and remote frames. */
static const char *parse_exact(cw_filter *filter, size_t digits, const char **text)
{
    uint32_t id;
    uint8_t extended;

    if (!read_identifier(&id, &extended, *text, digits))
        return identifier_problem;
    filter->value = id | (extended ? CW_FILTER_EXTENDED : 0);
    filter->mask = extended ? CW_FILTER_EXTENDED_MASK : CW_FILTER_BASE_MASK;
    *text += digits;
    return NULL;
}

/* Reads a filter that is not inverted: a sign behind the digits tells its form. */
static const char *parse_upright(cw_filter *filter, const char **text)
{
    size_t digits = strspn(*text, HEX_DIGITS);
    char after = (*text)[digits];

    if (digits == 0 || digits > EXTENDED_DIGITS)
        return filter_problem;
    if (after == ':' || after == '~')
        return parse_masked(filter, digits, text);
    return parse_exact(filter, digits, text);
}

/* A leading ~ inverts what follows. */
static const char *parse_filter(cw_filter *filter, const char **text)
{
    const bool inverts = **text == '~';
    *text += inverts;
    const char *problem = parse_upright(filter, text);

    if (!problem && inverts && filter->inverted)
        return filter_problem;
    filter->inverted = filter->inverted || inverts;
    return problem;
}

/* Parses filters; with out == NULL they are only checked and counted. */
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
    return "more frame filters than fit (8 in a fault rule or in wake-on, 512 in a node)";
}

/* Reads one digit of a byte with wildcards; returns false for other characters. */
static bool parse_nibble(text_bytes *bytes, char c)
{
    bool any = c == '.' || c == 'x' || c == 'X';
    unsigned digit = any ? 0 : text_hex_digit(c);
    uint8_t *mask = &bytes->mask[bytes->length];
    uint8_t *value = &bytes->value[bytes->length];

    *mask = (uint8_t)(*mask * 16u + (any ? 0 : 0xF));
    *value = (uint8_t)(*value * 16u + digit % 16);
    return digit < 16;
}

/* Adds a byte; returns the text behind it, or NULL. */
static const char *parse_byte(text_bytes *bytes, const char *text, unsigned max)
{
    if (bytes->length == max || !parse_nibble(bytes, text[0]) || !parse_nibble(bytes, text[1]))
        return NULL;
    bytes->length++;
    return text + 2;
}

/* Returns CW_FIELD_NONE for a name that no field has. */
static cw_field find_field(const char *name, size_t length)
{
    for (int i = CW_FIELD_NONE + 1; i < CW_FIELD_COUNT; i++) {
        const char *candidate = cw_field_name((cw_field)i);
        if (strlen(candidate) == length && memcmp(candidate, name, length) == 0)
            return (cw_field)i;
    }
    return CW_FIELD_NONE;
}

static unsigned index_count(cw_field field, bool fd)
{
    unsigned bits = cw_field_bits(field, fd);
    return bits > 0 ? bits : fd ? CW_BITS_MAX : OPEN_INDEX_COUNT;
}

/* Reads "[N]", or "[BYTE.BIT]" for data. */
static bool parse_index(uint16_t *index, cw_field field, const char *text, bool fd)
{
    uint64_t number, bit;

    if (*text++ != '[' || !text_take_uint(&number, &text, INDEX_MAX))
        return false;
    if (field == CW_FIELD_DATA) {
        if (*text++ != '.' || !text_take_uint(&bit, &text, 7))
            return false;
        number = number * 8 + bit;
    }
    if (strcmp(text, "]") != 0 || number >= index_count(field, fd))
        return false;
    *index = (uint16_t)number;
    return true;
}
