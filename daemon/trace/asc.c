/* SPDX-License-Identifier: MIT
 *
 * asc.c - reads Vector's ASC: a header, then a line for each event.
 *
 *     date Sat Sep 30 10:06:13.191 am 2017
 *     base hex  timestamps absolute
 *        0.015991 1  54C5638x        Rx   d 8 00 11 22 33 44 55 66 77
 *        0.020000 2  123             Tx   r 4
 *        0.030000 1  ErrorFrame
 *        0.040000 CANFD 1 Rx  123  NAME  1 0 9 12 00 11 ... BB  102203 133 303000 ...
 */
#include "base/text/number.h"
#include "trace/format.h"

#include <string.h>
#include <strings.h>

#define DLC_MAX 15u
#define DIGITS_MAX 9u
#define WORD_MAX 24 /* characters of a word that are shown */

static const char line_problem[] =
    "expected an event such as '0.015991 1  123  Rx  d 2 00 11', a comment (//), or one of date, "
    "base, internal events logged, Begin Triggerblock, End TriggerBlock";

/* ---- Words ----------------------------------------------------------------------------------- */

static const char *next_word(const char *text)
{
    return trace_blanks(text + trace_word(text));
}

static bool begins(const char *text, const char *words)
{
    return strncasecmp(text, words, strlen(words)) == 0;
}

/* Reads a word of `length` characters in the base of the file. */
static bool asc_read_number(uint32_t *value, const asc_state *s, const char *word, size_t length)
{
    const char *end = word;
    uint64_t sum;
    if (!s->decimal)
        return text_parse_hex(value, word, length);
    if (length > DIGITS_MAX || !text_take_digits(&sum, &end, UINT32_MAX) || end != word + length)
        return false;
    *value = (uint32_t)sum;
    return true;
}

/* ---- Header ---------------------------------------------------------------------------------- */

/* Reads "base hex|dec timestamps absolute|relative". */
static trace_result read_base(trace_input *in, asc_state *s, const char *text)
{
    const char *base = next_word(text);
    const char *stamps = next_word(base);
    const char *kind = next_word(stamps);
    bool relative = trace_is_word(kind, "relative");
    if (!trace_is_word(base, "hex") && !trace_is_word(base, "dec"))
        return trace_bad_text(in, base, "expected 'hex' or 'dec'");
    if (!trace_is_word(stamps, "timestamps") || (!relative && !trace_is_word(kind, "absolute")))
        return trace_bad_text(in, stamps,
                              "expected 'timestamps absolute' or 'timestamps relative'");
    s->decimal = trace_is_word(base, "dec");
    s->relative = relative;
    s->has_base = true;
    return TRACE_RECORD;
}

/* Reads a line without time. Returns TRACE_RECORD when such a line is allowed. */
static trace_result read_header(trace_input *in, asc_state *s, const char *text)
{
    static const char *const others[] = {"//",
                                         "date ",
                                         "internal events logged",
                                         "no internal events logged",
                                         "previous log file",
                                         "begin triggerblock",
                                         "end triggerblock"};
    if (begins(text, "base "))
        return read_base(in, s, text);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++)
        if (begins(text, others[i]))
            return TRACE_RECORD;
    return trace_bad_text(in, text, "%s", line_problem);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Reads "123" or "54C5638x". */
static trace_result asc_read_id(trace_input *in, const asc_state *s, trace_record *r,
                                const char *word)
{
    size_t length = trace_word(word);
    bool extended = length > 1 && (word[length - 1] == 'x' || word[length - 1] == 'X');
    uint32_t id = 0;
    if (!asc_read_number(&id, s, word, extended ? length - 1 : length))
        return trace_bad_text(in, word,
                              "'%.*s': expected an identifier in base %s, with x behind an "
                              "extended one (names in place of identifiers are not understood)",
                              (int)(length < WORD_MAX ? length : WORD_MAX), word,
                              s->decimal ? "dec" : "hex");
    if (id > (extended ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX))
        return trace_bad_text(in, word, "an identifier is at most 7FF, and 1FFFFFFFx (hex)");
    r->frame.id = id;
    r->frame.flags = extended ? CW_FRAME_EXTENDED : 0;
    return TRACE_RECORD;
}

/* Reads data in the base of the file; *word then follows them. */
static trace_result read_bytes(trace_input *in, const asc_state *s, trace_record *r,
                               unsigned length, const char **word)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < length; i++) {
        if (!asc_read_number(&value, s, *word, trace_word(*word)) || value > UINT8_MAX)
            return trace_bad_text(in, *word, "expected %u data bytes in the file's base", length);
        r->frame.data[i] = (uint8_t)value;
        *word = next_word(*word);
    }
    return TRACE_RECORD;
}

/* Reads "8 00 11 ..."; words such as "Length = 228000 BitCount = 118 ID = 54x" may follow. */
static trace_result asc_read_data(trace_input *in, const asc_state *s, trace_record *r,
                                  const char *word)
{
    uint32_t value = 0;
    if (!asc_read_number(&value, s, word, trace_word(word)) || value > DLC_MAX)
        return trace_bad_text(in, word, "expected a data length code, 0 to 15 in the file's base");
    r->frame.dlc = (uint8_t)value;
    word = next_word(word);
    if (read_bytes(in, s, r, cw_frame_length(&r->frame), &word) != TRACE_RECORD)
        return TRACE_BAD;
    if (asc_read_number(&value, s, word, trace_word(word)))
        return trace_bad_text(in, word, "more data bytes than the data length code says, %u",
                              r->frame.dlc);
    return TRACE_RECORD;
}

/* Reads "r" or "r 4". */
static trace_result read_remote(trace_input *in, const asc_state *s, trace_record *r,
                                const char *word)
{
    uint32_t dlc = 0;
    if (asc_read_number(&dlc, s, word, trace_word(word)) && dlc > DLC_MAX)
        return trace_bad_text(in, word, "expected a data length code, 0 to 15 in the file's base");
    r->frame.flags |= CW_FRAME_REMOTE;
    r->frame.dlc = (uint8_t)dlc;
    return TRACE_RECORD;
}

/* ---- Frames of CAN FD controllers ------------------------------------------------------------ */

/* The word `flags`, the third behind the data. */
#define FLAG_REMOTE 0x10u
#define FLAG_FD 0x1000u /* EDL */

/* Reads a word of one character, '0' or '1'. */
static bool read_digit(bool *on, const char **word)
{
    bool good = trace_word(*word) == 1 && (**word == '0' || **word == '1');
    *on = good && **word == '1';
    if (good)
        *word = next_word(*word);
    return good;
}

/* Reads "BRS ESI DLC LENGTH", with or without the name of the frame before it. */
static trace_result read_fd_head(trace_input *in, const asc_state *s, trace_record *r,
                                 unsigned *length, const char **word)
{
    bool brs, esi;
    uint32_t dlc = 0, value = 0;
    if (trace_word(*word) != 1 || !strchr("01", **word))
        *word = next_word(*word);
    if (!read_digit(&brs, word) || !read_digit(&esi, word))
        return trace_bad_text(in, *word, "expected BRS and ESI of a CAN FD frame, 0 or 1");
    if (!asc_read_number(&dlc, s, *word, trace_word(*word)) || dlc > DLC_MAX)
        return trace_bad_text(in, *word, "expected a data length code, 0 to 15 in the file's base");
    *word = next_word(*word);
    const asc_state decimal = {.decimal = true};
    if (!asc_read_number(&value, &decimal, *word, trace_word(*word)) || value > CW_FRAME_DATA_MAX)
        return trace_bad_text(in, *word, "expected a number of data bytes, 0 to 64");
    r->frame.flags |= (uint8_t)((brs ? CW_FRAME_BRS : 0) | (esi ? CW_FRAME_ESI : 0));
    r->frame.dlc = (uint8_t)dlc;
    *length = value;
    *word = next_word(*word);
    return TRACE_RECORD;
}

/* Decides by the flags, behind duration and length of the frame, which frame it is. A CAN FD
 * controller also has classical ones, but these never have more than 8 bytes. Without flags it is a
 * CAN FD frame. */
static void set_format(trace_record *r, unsigned length, const char *word)
{
    uint32_t flags = 0;
    word = next_word(next_word(word));
    bool classical = text_parse_hex(&flags, word, trace_word(word)) && !(flags & FLAG_FD) &&
                     length <= CW_CLASSICAL_DATA_MAX;
    if (!classical) {
        r->kind = TRACE_FD_FRAME;
        r->frame.flags |= CW_FRAME_FD;
        return;
    }
    r->frame.flags &= CW_FRAME_EXTENDED;
    if (flags & FLAG_REMOTE)
        r->frame.flags |= CW_FRAME_REMOTE;
}

/* Reads an event of a CAN FD controller; `word` follows the number of the channel. */
static trace_result read_fd_event(trace_input *in, const asc_state *s, trace_record *r,
                                  const char *word)
{
    unsigned length = 0;
    bool moved = trace_is_word(word, "Rx") || trace_is_word(word, "Tx");
    bool error = begins(word, "ErrorFrame") || begins(next_word(word), "ErrorFrame");
    if (!moved || error) {
        r->kind = error ? TRACE_ERROR_FRAME : TRACE_OTHER;
        return TRACE_RECORD;
    }
    word = next_word(word);
    if (asc_read_id(in, s, r, word) != TRACE_RECORD)
        return TRACE_BAD;
    word = next_word(word);
    if (read_fd_head(in, s, r, &length, &word) != TRACE_RECORD ||
        read_bytes(in, s, r, length, &word) != TRACE_RECORD)
        return TRACE_BAD;
    set_format(r, length, word);
    if (cw_frame_length(&r->frame) != length)
        return trace_bad_text(in, word, "%u data bytes, but the data length code says %u", length,
                              cw_frame_length(&r->frame));
    return TRACE_RECORD;
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* Reads an event of a channel; `word` follows the number of the channel. A request to transmit
 * (TxRq) is not yet the frame, which has an event of its own. */
static trace_result read_channel_event(trace_input *in, const asc_state *s, trace_record *r,
                                       const char *word)
{
    const char *direction = next_word(word);
    const char *type = next_word(direction);
    bool moved = trace_is_word(direction, "Rx") || trace_is_word(direction, "Tx");
    bool data = trace_is_word(type, "d");
    if (begins(word, "ErrorFrame")) {
        r->kind = TRACE_ERROR_FRAME;
        return TRACE_RECORD;
    }
    if (!moved || (!data && !trace_is_word(type, "r"))) {
        r->kind = TRACE_OTHER;
        return TRACE_RECORD;
    }
    if (asc_read_id(in, s, r, word) != TRACE_RECORD)
        return TRACE_BAD;
    return data ? asc_read_data(in, s, r, next_word(type)) : read_remote(in, s, r, next_word(type));
}

/* Reads a line that begins with a time, relative to the line before or to the start. Events without
 * a channel are not of a bus. */
static trace_result read_event(trace_input *in, asc_state *s, trace_record *r, const char *text)
{
    uint64_t ns;
    const char *word = trace_seconds(&ns, text);
    if (!word || (*word != ' ' && *word != '\t' && *word != '\0'))
        return trace_bad_text(in, text, "expected a time in seconds such as 0.015991");
    s->time_ns = s->relative ? s->time_ns + ns : ns;
    r->place = in->line;
    r->timed = true;
    r->time_ns = s->time_ns;
    word = trace_blanks(word);
    bool fd = trace_is_word(word, "CANFD");
    bool xl = trace_is_word(word, "CANXL");
    if (fd || xl)
        word = next_word(word);
    size_t length = trace_word(word);
    bool channel = length > 0 && strspn(word, "0123456789") == length;
    if (channel)
        trace_set_channel(r, word, length);
    r->kind = xl ? TRACE_XL_FRAME : TRACE_OTHER;
    if (begins(word, "Start of measurement"))
        r->kind = TRACE_MARK;
    if (xl || !channel)
        return TRACE_RECORD;
    r->kind = TRACE_FRAME;
    return fd ? read_fd_event(in, s, r, next_word(word))
              : read_channel_event(in, s, r, next_word(word));
}

/* Reads up to the next event. Lines of the header may stand anywhere between events. */
trace_result asc_next(trace_input *in, asc_state *state, trace_record *record)
{
    for (;;) {
        trace_result result = trace_line(in);
        if (result != TRACE_RECORD)
            return result;
        const char *text = trace_blanks(in->text);
        bool event = *text >= '0' && *text <= '9';
        if (event && !state->has_base)
            return trace_bad_text(in, text,
                                  "'base hex|dec timestamps absolute|relative' must come "
                                  "before the first event");
        if (event)
            return read_event(in, state, record, text);
        if (*text != '\0' && read_header(in, state, text) != TRACE_RECORD)
            return TRACE_BAD;
    }
}
