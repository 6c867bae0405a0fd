/* SPDX-License-Identifier: MIT
 *
 * trace_input.c - bytes, lines and words of a recording, and the places of its errors.
 */
#include "base/text/number.h"
#include "trace/format.h"

#include "base/text/plain.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#define FRACTION_DIGITS 9u
#define SECONDS_MAX (UINT64_MAX / 2 / 1000000000u) /* differences and sums do not overflow */

/* ---- Bytes ----------------------------------------------------------------------------------- */

static trace_result trace_input_fail(trace_input *in)
{
    (void)snprintf(in->problem, sizeof in->problem, "%s: %s", in->file, strerror(errno));
    in->failed = true;
    return TRACE_BAD;
}

trace_result trace_seek(trace_input *in, uint64_t offset)
{
    if (lseek(in->fd, (off_t)offset, SEEK_SET) < 0)
        return trace_input_fail(in);
    in->at_end = false;
    in->first = 0;
    in->filled = 0;
    in->offset = offset;
    return TRACE_RECORD;
}

/* Fills the buffer until it holds so many bytes, or to the end of the file. A read error counts as
 * the end, with a problem. */
static void fill(trace_input *in, size_t count)
{
    if (in->filled - in->first >= count || in->at_end)
        return;
    memmove(in->buffer, in->buffer + in->first, in->filled - in->first);
    in->filled -= in->first;
    in->first = 0;
    while (in->filled < count && !in->at_end) {
        ssize_t got = read(in->fd, in->buffer + in->filled, TRACE_BUFFER - in->filled);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            (void)trace_input_fail(in);
        in->at_end = got <= 0;
        in->filled += got > 0 ? (size_t)got : 0;
    }
}

static void trace_input_take(trace_input *in, size_t count)
{
    in->first += count;
    in->offset += count;
}

size_t trace_peek(trace_input *in, const unsigned char **bytes, size_t count)
{
    fill(in, count);
    size_t there = in->filled - in->first;
    *bytes = in->buffer + in->first;
    return there < count ? there : count;
}

trace_result trace_bytes(trace_input *in, const unsigned char **bytes, size_t count)
{
    size_t there = trace_peek(in, bytes, count);
    if (in->failed)
        return TRACE_BAD;
    if (there == count) {
        trace_input_take(in, count);
        return TRACE_RECORD;
    }
    if (there == 0)
        return TRACE_END;
    return trace_bad_end(in);
}

trace_result trace_skip(trace_input *in, uint64_t count)
{
    while (count > 0) {
        const unsigned char *bytes;
        size_t piece = count < TRACE_BUFFER ? (size_t)count : TRACE_BUFFER;
        size_t there = trace_peek(in, &bytes, piece);
        if (in->failed)
            return TRACE_BAD;
        if (there == 0)
            return trace_bad_end(in);
        trace_input_take(in, there);
        count -= there;
    }
    return TRACE_RECORD;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

bool trace_has_bom(const unsigned char *bytes, size_t count)
{
    return count >= TRACE_BOM_BYTES && memcmp(bytes, "\xEF\xBB\xBF", TRACE_BOM_BYTES) == 0;
}

void trace_end_line(trace_input *in)
{
    bool more = in->amid;
    fill(in, 1);
    const bool zeros = in->filled > in->first && in->buffer[in->first] == 0;
    in->text = "";
    while (more) {
        fill(in, 1);
        const unsigned char *bytes = in->buffer + in->first;
        const size_t there = in->filled - in->first;
        size_t count = 0;
        while (count < there && (bytes[count] == 0) == zeros && bytes[count] != '\n')
            count++;
        const bool ends = count < there && bytes[count] == '\n';
        trace_input_take(in, count + ends);
        more = count == there && there > 0;
        in->amid = !ends;
    }
}

/* Begins a line, or its rest behind what was damaged. */
static void begin_line(trace_input *in)
{
    fill(in, TRACE_LINE_MAX + 1);
    const size_t there = in->filled - in->first;
    if (in->amid || there == 0)
        return;
    if (in->line++ == 0 && trace_has_bom(in->buffer + in->first, there))
        trace_input_take(in, TRACE_BOM_BYTES);
}

trace_result trace_line(trace_input *in)
{
    begin_line(in);
    const size_t there = in->filled - in->first;
    if (in->failed)
        return TRACE_BAD;
    if (there == 0)
        return TRACE_END;
    in->entry = in->offset;
    in->text = (char *)in->buffer + in->first;
    size_t length = there <= TRACE_LINE_MAX ? there : TRACE_LINE_MAX + 1;
    const char *newline = memchr(in->text, '\n', length);
    length = newline ? (size_t)(newline - in->text) : length;
    const char *zero = memchr(in->text, '\0', length);
    length = zero ? (size_t)(zero - in->text) : length;
    const bool too_long = length > TRACE_LINE_MAX;
    in->cut = !newline && !zero && !too_long;
    in->amid = zero || too_long;
    trace_input_take(in, length + (newline && !zero));
    in->text[length - too_long] = '\0'; /* replaces the newline; the buffer has a spare byte */
    if (too_long)
        return trace_bad_text(in, in->text, "this line has more than %u bytes", TRACE_LINE_MAX);
    if (zero)
        return trace_bad_text(in, in->text + length,
                              "a byte 0: a crash leaves such bytes, or this is no text");
    if (length > 0 && in->text[length - 1] == '\r')
        in->text[length - 1] = '\0';
    return TRACE_RECORD;
}

/* ---- Complaints ------------------------------------------------------------------------------ */

/* Returns the column in characters, from 1. */
static size_t column(const trace_input *in, const char *at)
{
    size_t characters = 1;
    for (const char *c = in->text; c < at; c++)
        characters += ((unsigned char)*c & 0xC0u) != 0x80u;
    return characters;
}

/* Appends a message behind the place. It is cut where it has no room. */
static void add_message(trace_input *in, int used, const char *format, va_list args)
{
    size_t start = used < 0 ? 0 : (size_t)used;
    in->place = start < sizeof in->problem ? start : 0;
    if (start < sizeof in->problem)
        (void)vsnprintf(in->problem + start, sizeof in->problem - start, format, args);
    plain_make(in->problem, '?'); /* the file may contain any bytes */
}

trace_result trace_bad_text(trace_input *in, const char *at, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    int used = snprintf(in->problem, sizeof in->problem, "%s:%" PRIu64 ":%zu: ", in->file, in->line,
                        column(in, at));
    add_message(in, used, format, args);
    va_end(args);
    return TRACE_BAD;
}

trace_result trace_bad_byte(trace_input *in, uint64_t offset, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    int used =
        snprintf(in->problem, sizeof in->problem, "%s: byte %" PRIu64 ": ", in->file, offset);
    add_message(in, used, format, args);
    va_end(args);
    return TRACE_BAD;
}

trace_result trace_bad_end(trace_input *in)
{
    return trace_bad_byte(in, in->entry, "cut off: the file ends at byte %" PRIu64,
                          in->offset + (in->filled - in->first));
}

/* ---- Words ----------------------------------------------------------------------------------- */

const char *trace_blanks(const char *text)
{
    return text + strspn(text, " \t");
}

size_t trace_word(const char *text)
{
    return strcspn(text, " \t");
}

bool trace_is_word(const char *text, const char *word)
{
    size_t length = trace_word(text);
    return length == strlen(word) && strncasecmp(text, word, length) == 0;
}

void trace_set_channel(trace_record *record, const char *word, size_t length)
{
    size_t kept = length < TRACE_CHANNEL_MAX - 1 ? length : TRACE_CHANNEL_MAX - 1;
    memcpy(record->channel, word, kept);
    record->channel[kept] = '\0';
}

const char *trace_seconds(uint64_t *ns, const char *text)
{
    uint64_t seconds, fraction;
    if (!text_take_digits(&seconds, &text, SECONDS_MAX) || *text++ != '.')
        return NULL;
    const char *end = text;
    if (!text_take_digits(&fraction, &end, UINT32_MAX) || end > text + FRACTION_DIGITS)
        return NULL;
    for (const char *at = end; at < text + FRACTION_DIGITS; at++)
        fraction *= 10;
    *ns = seconds * 1000000000u + fraction;
    return end;
}
