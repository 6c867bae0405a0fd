/* SPDX-License-Identifier: MIT
 *
 * candump.c - reads the output of candump: its log (-L, -l) and its lines on a screen.
 *
 *     (1436509052.249713) vcan0 123#DEADBEEF              log; with -x "R" or "T" behind it
 *     (000.000000)  vcan0  123   [4]  DE AD BE EF   '....'  -t a, z, d or A; -a; -x; -S; -i; -8
 */
#include "base/text/number.h"
#include "trace/format.h"

#include "trace/frametext.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#define BASE_DIGITS 3u
#define EXTENDED_DIGITS 8u
#define ERROR_FLAG 0x20000000u /* CAN_ERR_FLAG */
#define YEAR_MAX 2200u /* nanoseconds since 1970 do not overflow */

#define HEX_DIGITS "0123456789ABCDEFabcdef"

static const char line_problem[] =
    "expected a line of candump such as '(1436509052.249713) vcan0 123#DEADBEEF' or "
    "'(000.000000)  vcan0  123   [4]  DE AD BE EF'";
static const char stamp_problem[] = "expected a time such as (1436509052.249713), (000.000000) or "
                                    "(2024-02-29 12:34:56.000000)";
static const char length_problem[] = "expected a length: [0] to [8], {9} to {F}, [00] to [64] for "
                                     "CAN FD";

/* ---- Time stamps ----------------------------------------------------------------------------- */

/* Returns the days from 1970-01-01 to a day of the Gregorian calendar, which has a cycle of 400
 * years. */
static uint64_t days_since_1970(unsigned year, unsigned month, unsigned day)
{
    unsigned y = month <= 2 ? year - 1 : year; /* years begin in March: leap days come last */
    unsigned m = month <= 2 ? month + 9 : month - 3;
    uint64_t days = (uint64_t)y * 365 + y / 4 - y / 100 + y / 400 + (m * 153 + 2) / 5 + day - 1;
    return days - 719468;
}

/* Reads a date and time of day as UTC: only differences count. */
static const char *read_date(uint64_t *ns, const char *text)
{
    unsigned year;
    unsigned month;
    unsigned day;
    unsigned hour;
    unsigned minute;
    int used = 0;
    uint64_t seconds;
    if (sscanf(text, "%4u-%2u-%2u %2u:%2u:%n", &year, &month, &day, &hour, &minute, &used) != 5 ||
        used == 0 || year < 1970 || year > YEAR_MAX || month < 1 || month > 12 || day < 1 ||
        day > 31 || hour > 23 || minute > 59)
        return NULL;
    const char *end = trace_seconds(&seconds, text + used);
    if (!end || seconds >= 61 * UINT64_C(1000000000))
        return NULL;
    uint64_t minutes = (days_since_1970(year, month, day) * 24 + hour) * 60 + minute;
    *ns = minutes * 60 * UINT64_C(1000000000) + seconds;
    return end;
}

/* Reads "(...)", if it is there. Returns false after a complaint. */
static bool read_stamp(trace_input *in, candump_state *s, trace_record *r, const char **text)
{
    uint64_t ns;
    if (**text != '(')
        return true;
    const char *end = trace_seconds(&ns, *text + 1);
    if (!end)
        end = read_date(&ns, *text + 1);
    if (!end || *end != ')') {
        (void)trace_bad_text(in, *text, "%s", stamp_problem);
        return false;
    }
    s->time_ns = s->delta ? s->time_ns + ns : ns;
    r->timed = true;
    r->time_ns = s->time_ns;
    *text = trace_blanks(end + 1);
    return true;
}

/* ---- Log lines ------------------------------------------------------------------------------- */

/* Returns true for the identifier of an error frame: its 8 digits contain the flag of error
 * frames. */
static bool is_error_id(const char *text)
{
    uint32_t id;
    return strspn(text, HEX_DIGITS) == EXTENDED_DIGITS &&
           text_parse_hex(&id, text, EXTENDED_DIGITS) && (id & ERROR_FLAG);
}

/* Reads the direction and the flags behind a frame, single letters, with -x. */
static trace_result read_log_tail(trace_input *in, const char *text)
{
    for (text = trace_blanks(text); *text != '\0'; text = trace_blanks(text + trace_word(text)))
        if (trace_word(text) != 1 || !strchr("RTBE-", *text))
            return trace_bad_text(in, text, "expected the end of the line behind the frame");
    return TRACE_RECORD;
}

/* Reads a frame as cansend takes it, which tells its kind. Of error and XL frames only the kind is
 * kept. */
static trace_result read_log_frame(trace_input *in, trace_record *r, const char *word)
{
    char text[FRAME_TEXT_MAX];
    size_t length = trace_word(word);
    const char *sign = memchr(word, '#', length);
    assert(sign);
    if (is_error_id(word))
        r->kind = TRACE_ERROR_FRAME;
    else if (sign[1] == '#')
        r->kind = TRACE_FD_FRAME;
    else if (memchr(sign, ':', length - (size_t)(sign - word)))
        r->kind = TRACE_XL_FRAME; /* 05123#81:00:12345678#... */
    if (r->kind != TRACE_FRAME && r->kind != TRACE_FD_FRAME)
        return TRACE_RECORD;
    if (length >= sizeof text)
        return trace_bad_text(in, word, "%s", line_problem);
    memcpy(text, word, length);
    text[length] = '\0';
    const char *problem = text_parse_frame(&r->frame, text);
    if (problem)
        return trace_bad_text(in, word, "'%s': %s", text, problem);
    return read_log_tail(in, word + length);
}

/* ---- Screen lines ---------------------------------------------------------------------------- */

/* Reads "RX - -" or "TX B E" before the identifier, with -x. Without it BRS and ESI of CAN FD
 * frames are not known. */
static const char *read_direction(uint8_t *fd_flags, const char *text)
{
    *fd_flags = 0;
    if (!trace_is_word(text, "RX") && !trace_is_word(text, "TX"))
        return text;
    text = trace_blanks(text + trace_word(text));
    for (unsigned i = 0; i < 2 && trace_word(text) == 1 && strchr("BE-", *text); i++) {
        *fd_flags |= *text == 'B' ? CW_FRAME_BRS : *text == 'E' ? CW_FRAME_ESI : 0;
        text = trace_blanks(text + 1);
    }
    return text;
}

/* The number of digits tells the format. *text then follows the identifier. */
static trace_result candump_read_id(trace_input *in, trace_record *r, const char **text)
{
    uint32_t id = 0;
    size_t digits = trace_word(*text);
    bool good =
        (digits == BASE_DIGITS || digits == EXTENDED_DIGITS) && text_parse_hex(&id, *text, digits);
    if (!good)
        return trace_bad_text(in, *text, "%s", line_problem);
    if (digits == EXTENDED_DIGITS && (id & ERROR_FLAG))
        r->kind = TRACE_ERROR_FRAME;
    else if (id > (digits == BASE_DIGITS ? CW_BASE_ID_MAX : CW_EXTENDED_ID_MAX))
        return trace_bad_text(in, *text,
                              "an identifier is at most 7FF with 3 digits and 1FFFFFFF with 8");
    r->frame.id = id;
    r->frame.flags = digits == EXTENDED_DIGITS ? CW_FRAME_EXTENDED : 0;
    *text = trace_blanks(*text + digits);
    return TRACE_RECORD;
}

/* Reads the decimal length of a CAN FD frame, "[08]", or of a frame that has 64 bytes of room. */
static trace_result read_fd_length(trace_input *in, trace_record *r, unsigned *count,
                                   const char *text)
{
    const char *end = text + 1;
    uint64_t length;
    if (!text_take_digits(&length, &end, CW_FRAME_DATA_MAX) || end != text + 3 || *end != ']')
        return trace_bad_text(in, text, "%s", length_problem);
    *count = (unsigned)length;
    r->frame.flags |= CW_FRAME_FD;
    r->frame.dlc = (uint8_t)cw_fd_dlc(*count);
    return TRACE_RECORD;
}

/* Reads "[4]", "{F}" for a DLC above 8, or "[08]" for a CAN FD frame. *count is the number of data
 * bytes that follow. */
static trace_result read_length(trace_input *in, trace_record *r, unsigned *count,
                                const char **text)
{
    const char *t = *text;
    uint32_t length = 0;
    size_t digits = strspn(t[0] == '\0' ? t : t + 1, HEX_DIGITS);
    bool raw = t[0] == '{';
    if ((t[0] != '[' && !raw) || digits < 1 || digits > 2 || t[digits + 1] != (raw ? '}' : ']'))
        return trace_bad_text(in, t, "%s", length_problem);
    *text = trace_blanks(t + digits + 2);
    if (digits == 2 && !raw) {
        r->kind = r->kind == TRACE_FRAME ? TRACE_FD_FRAME : r->kind;
        return read_fd_length(in, r, count, t);
    }
    (void)text_parse_hex(&length, t + 1, digits);
    if (digits != 1 || (length > CW_CLASSICAL_DATA_MAX) != raw)
        return trace_bad_text(in, t, "%s", length_problem);
    r->frame.dlc = (uint8_t)length;
    *count = cw_frame_length(&r->frame);
    return TRACE_RECORD;
}

/* Reads two hexadecimal digits or, with -i, eight binary ones. Returns their number, 0 for other
 * text. */
static size_t read_byte(uint8_t *byte, const char *text)
{
    uint32_t value = 0;
    size_t digits = strspn(text, "01");
    if (digits == 8) {
        for (size_t i = 0; i < digits; i++)
            value = value << 1 | (uint32_t)(text[i] - '0');
    } else {
        digits = strspn(text, HEX_DIGITS);
        if (digits != 2 || !text_parse_hex(&value, text, digits))
            return 0;
    }
    *byte = (uint8_t)value;
    return digits;
}

static void reverse(uint8_t *bytes, unsigned count)
{
    for (unsigned i = 0; i < count / 2; i++) {
        uint8_t byte = bytes[i];
        bytes[i] = bytes[count - 1 - i];
        bytes[count - 1 - i] = byte;
    }
}

/* Reads the data. With -S the last byte comes first, and ` separates the bytes. */
static trace_result candump_read_data(trace_input *in, trace_record *r, unsigned count,
                                      const char *text)
{
    bool swapped = false;
    for (unsigned i = 0; i < count; i++) {
        size_t digits = read_byte(&r->frame.data[i], text);
        if (digits == 0)
            return trace_bad_text(in, text, "expected %u data bytes, two digits each", count);
        text += digits;
        bool mark = *text == '`';
        swapped = swapped || mark;
        text = mark ? text + 1 : trace_blanks(text);
    }
    if (swapped)
        reverse(r->frame.data, count);
    if (*text != '\0' && *text != '\'' && *text != '`')
        return trace_bad_text(in, text, "expected the end of the line behind %u data bytes", count);
    return TRACE_RECORD;
}

/* Reads identifier, length and data in columns. A remote frame has words in place of data. */
static trace_result read_screen_frame(trace_input *in, trace_record *r, const char *text)
{
    static const char remote[] = "remote request";
    uint8_t fd_flags;
    unsigned count = 0; /* compilers do not see that it is assigned */
    text = read_direction(&fd_flags, text);
    if (candump_read_id(in, r, &text) != TRACE_RECORD ||
        read_length(in, r, &count, &text) != TRACE_RECORD)
        return TRACE_BAD;
    if (r->kind == TRACE_FD_FRAME)
        r->frame.flags |= fd_flags;
    if (r->kind != TRACE_FRAME && r->kind != TRACE_FD_FRAME)
        return TRACE_RECORD;
    if (r->kind == TRACE_FD_FRAME || strncmp(text, remote, strlen(remote)) != 0)
        return candump_read_data(in, r, count, text);
    r->frame.flags |= CW_FRAME_REMOTE;
    text = trace_blanks(text + strlen(remote));
    if (*text != '\0')
        return trace_bad_text(in, text, "expected the end of the line behind 'remote request'");
    return TRACE_RECORD;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Reads the time, if there is one, and the interface. A frame with '#' is one of a log. */
static trace_result candump_read_line(trace_input *in, candump_state *s, trace_record *r)
{
    const char *text = trace_blanks(in->text);
    r->place = in->line;
    if (strncmp(text, "DROPCOUNT:", strlen("DROPCOUNT:")) == 0) {
        r->kind = TRACE_OTHER; /* candump -d: the kernel has lost frames */
        return TRACE_RECORD;
    }
    const char *escape = strchr(text, '\x1B');
    if (escape)
        return trace_bad_text(in, escape, "an escape sequence: record without colours (-c)");
    if (!read_stamp(in, s, r, &text))
        return TRACE_BAD;
    size_t length = trace_word(text);
    trace_set_channel(r, text, length);
    const char *second = trace_blanks(text + length);
    if (*second == '\0')
        return trace_bad_text(in, trace_blanks(in->text), "%s", line_problem);
    if (memchr(second, '#', trace_word(second)))
        return read_log_frame(in, r, second);
    return read_screen_frame(in, r, second);
}

/* Reads up to the next entry. Lines of candump -e only explain the error frame before them. */
trace_result candump_next(trace_input *in, candump_state *state, trace_record *record)
{
    for (;;) {
        trace_result result = trace_line(in);
        if (result != TRACE_RECORD)
            return result;
        bool explanation = state->explains && in->text[0] == '\t'; /* candump -e */
        if (explanation || *trace_blanks(in->text) == '\0')
            continue;
        result = candump_read_line(in, state, record);
        state->explains = record->kind == TRACE_ERROR_FRAME;
        return result;
    }
}
