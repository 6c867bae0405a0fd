/* SPDX-License-Identifier: MIT
 *
 * read.c - reads recordings of CAN traffic: opens them and detects their format.
 */
#include "trace/format.h"

#include "base/unit.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define PLACE_MAX 48 /* bytes of "LINE:COLUMN" or " byte N" */
#define DETECT_BYTES 1024u

struct trace_reader {
    trace_format format;
    uint64_t size;
    char *file;
    uint64_t damaged; /* entries of this pass */
    uint64_t whole;   /* frames of any kind */
    size_t damage_place;            /* characters of `damage` that say where it is */
    char damage[TRACE_PROBLEM_MAX]; /* of the first one; it does not change any more */
    union {
        candump_state candump;
        asc_state asc;
        pcap_state pcap;
    } state;
    trace_input input;
};

static trace_format detect(trace_input *in);
static void trace_read_start(trace_reader *reader);

/* ---- Opening --------------------------------------------------------------------------------- */

/* Opens a regular file, never a pipe or a device, on which reading could wait. */
static bool read_open_file(trace_reader *reader, const char *file, char problem[TRACE_PROBLEM_MAX])
{
    struct stat info;
    reader->input.fd = open(file, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (reader->input.fd < 0 || fstat(reader->input.fd, &info) != 0) {
        (void)snprintf(problem, TRACE_PROBLEM_MAX, "%s: %s%s", file, strerror(errno),
                       unit_hint(file, errno));
        return false;
    }
    if (!S_ISREG(info.st_mode)) {
        (void)snprintf(problem, TRACE_PROBLEM_MAX, "%s: not a regular file", file);
        return false;
    }
    reader->size = (uint64_t)info.st_size;
    return true;
}

trace_reader *trace_open(const char *file, trace_format format, char problem[TRACE_PROBLEM_MAX])
{
    trace_reader *reader = calloc(1, sizeof *reader);
    char *name = strdup(file);
    if (!reader || !name) {
        (void)snprintf(problem, TRACE_PROBLEM_MAX, "%s: out of memory", file);
        free(reader);
        free(name);
        return NULL;
    }
    reader->file = name;
    reader->input.file = name;
    if (!read_open_file(reader, file, problem)) {
        trace_close(reader);
        return NULL;
    }
    reader->format = format == TRACE_DETECT ? detect(&reader->input) : format;
    if (reader->format == TRACE_DETECT) {
        (void)snprintf(problem, TRACE_PROBLEM_MAX, "%s", reader->input.problem);
        trace_close(reader);
        return NULL;
    }
    trace_read_start(reader);
    return reader;
}

void trace_close(trace_reader *reader)
{
    if (!reader)
        return;
    if (reader->input.fd >= 0)
        (void)close(reader->input.fd);
    free(reader->file);
    free(reader);
}

/* Begins at the start of the file, as if nothing had been read before. */
static void trace_read_start(trace_reader *reader)
{
    memset(&reader->state, 0, sizeof reader->state);
    reader->damaged = 0;
    reader->whole = 0;
    if (reader->format == TRACE_CANDUMP_DELTA)
        reader->state.candump.delta = true;
}

bool trace_rewind(trace_reader *reader)
{
    trace_input *in = &reader->input;
    if (trace_seek(in, 0) != TRACE_RECORD)
        return false;
    in->line = 0;
    in->amid = false;
    trace_read_start(reader);
    return true;
}

/* ---- Detection ------------------------------------------------------------------------------- */

/* Returns true for the first bytes of pcapng, or of pcap in either byte order. */
static bool is_capture(const unsigned char *bytes, size_t count)
{
    static const unsigned char magics[][4] = {
        {0x0A, 0x0D, 0x0D, 0x0A}, {0xA1, 0xB2, 0xC3, 0xD4}, {0xD4, 0xC3, 0xB2, 0xA1},
        {0xA1, 0xB2, 0x3C, 0x4D}, {0x4D, 0x3C, 0xB2, 0xA1},
    };
    for (size_t i = 0; count >= 4 && i < sizeof magics / sizeof magics[0]; i++)
        if (memcmp(bytes, magics[i], 4) == 0)
            return true;
    return false;
}

/* Returns true for a line of candump: "(1.5) can0 123#" or "can0 123 [0]". */
static bool is_candump(const char *line)
{
    line = trace_blanks(line);
    if (*line == '(' || strncmp(line, "DROPCOUNT:", strlen("DROPCOUNT:")) == 0)
        return true;
    const char *second = trace_blanks(line + trace_word(line));
    size_t digits = strspn(second, "0123456789ABCDEFabcdef");
    if (trace_is_word(second, "RX") || trace_is_word(second, "TX"))
        return true;
    return (digits == 3 || digits == 8) &&
           (second[digits] == '#' || strchr("[{", *trace_blanks(second + digits)));
}

static bool is_asc(const char *line)
{
    line = trace_blanks(line);
    return trace_is_word(line, "date") || trace_is_word(line, "base") ||
           strncmp(line, "//", 2) == 0;
}

/* Detects the format of a text by its first line that has one: lines before it may be torn. A text
 * without content is the recording of a silent bus. */
static trace_format detect_text(char *text, size_t count)
{
    static const char ends[] = "\r\n";
    bool any = false;
    for (size_t i = 0, length; i < count; i += length + 1) {
        char *line = text + i;
        length = strcspn(line, ends); /* also ends at a byte 0 */
        line[length] = '\0';
        if (is_candump(line))
            return TRACE_CANDUMP;
        if (is_asc(line))
            return TRACE_ASC;
        any = any || *trace_blanks(line) != '\0';
    }
    return any ? TRACE_DETECT : TRACE_CANDUMP;
}

/* Detects the format, behind bytes 0 of a crash. */
static trace_format detect(trace_input *in)
{
    const unsigned char *bytes;
    char text[DETECT_BYTES + 1];
    size_t zeros = 0;
    size_t count = trace_peek(in, &bytes, TRACE_BUFFER);
    trace_format found = TRACE_DETECT;
    if (in->failed)
        return TRACE_DETECT;
    if (is_capture(bytes, count))
        return TRACE_PCAPNG;
    if (trace_has_bom(bytes, count)) {
        bytes += TRACE_BOM_BYTES;
        count -= TRACE_BOM_BYTES;
    }
    while (zeros < count && bytes[zeros] == 0)
        zeros++;
    count = count - zeros < DETECT_BYTES ? count - zeros : DETECT_BYTES;
    if (count > 0)
        memcpy(text, bytes + zeros, count);
    text[count] = '\0';
    if (count > 0 || zeros == 0)
        found = detect_text(text, count);
    if (found != TRACE_DETECT)
        return found;
    in->line = 1;
    in->text = "";
    (void)trace_bad_text(in, in->text,
                         "this is neither a candump log, nor Vector ASC, nor pcapng (name it with "
                         "'format' if it is)");
    return TRACE_DETECT;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Reads the next entry in the format of the file, which is known by now. */
static trace_result next_entry(trace_reader *reader, trace_record *record)
{
    switch (reader->format) {
    case TRACE_CANDUMP:
    case TRACE_CANDUMP_DELTA:
        return candump_next(&reader->input, &reader->state.candump, record);
    case TRACE_ASC:
        return asc_next(&reader->input, &reader->state.asc, record);
    case TRACE_PCAPNG:
        return pcapng_next(&reader->input, &reader->state.pcap, record);
    case TRACE_DETECT:
        break;
    }
    return TRACE_END;
}

/* Refuses a file without a whole frame, for the first entry that is not whole. */
static trace_result read_refuse(trace_reader *reader)
{
    trace_input *in = &reader->input;
    memcpy(in->problem, reader->damage, sizeof in->problem);
    in->failed = true;
    return TRACE_BAD;
}

/* Makes a record of an entry that is not whole, and goes on behind it. */
static trace_result pass_over(trace_reader *reader, trace_record *record)
{
    trace_input *in = &reader->input;
    const bool capture = reader->format == TRACE_PCAPNG;
    *record = (trace_record){.kind = TRACE_DAMAGED, .place = capture ? in->entry : in->line};
    if (reader->damage[0] == '\0') {
        memcpy(reader->damage, in->problem, sizeof reader->damage);
        reader->damage_place = in->place;
    }
    if (++reader->damaged == TRACE_DAMAGED_MAX && reader->whole == 0)
        return read_refuse(reader);
    if (capture && pcapng_recover(in, &reader->state.pcap) != TRACE_RECORD)
        return TRACE_BAD;
    if (!capture)
        trace_end_line(in);
    record->bytes = in->offset - in->entry;
    return TRACE_RECORD;
}

static bool is_frame(const trace_record *record)
{
    return record->kind != TRACE_OTHER && record->kind != TRACE_MARK;
}

trace_result trace_next(trace_reader *reader, trace_record *record)
{
    trace_input *in = &reader->input;
    *record = (trace_record){.kind = TRACE_FRAME};
    trace_result result = in->failed ? TRACE_BAD : next_entry(reader, record);
    if (result == TRACE_RECORD && in->cut && !is_frame(record))
        result = trace_bad_text(in, in->text, "cut off: the line has no end");
    if (result == TRACE_RECORD)
        reader->whole += is_frame(record);
    if (result == TRACE_BAD && !in->failed)
        result = pass_over(reader, record);
    if (result == TRACE_END && reader->damaged > 0 && reader->whole == 0)
        return read_refuse(reader);
    if (result == TRACE_RECORD && reader->format != TRACE_PCAPNG) {
        record->column = (unsigned)(trace_blanks(in->text) - in->text) + 1;
        record->cut = in->cut;
    }
    return result;
}

const char *trace_problem(const trace_reader *reader)
{
    return reader->input.problem;
}

const char *trace_damage(const trace_reader *reader)
{
    return reader->damage + reader->damage_place;
}

/* Remedies for the times of a file, by its format. */
static const struct {
    const char *no_time;
    const char *stepped_back;
} remedies[] = {
    [TRACE_CANDUMP] = {"record with candump -L or -t a", "if candump -t d made it, say 'format: "
                                                         "candump-delta'"},
    [TRACE_CANDUMP_DELTA] = {"record with candump -t d", "candump -t d makes no such times"},
    [TRACE_ASC] = {"each event of an ASC file begins with one",
                   "if its times are relative, its header needs 'timestamps relative'"},
    [TRACE_PCAPNG] = {"simple packets of pcapng have none", "reordercap sorts them"},
};

const char *trace_stepped_back(const trace_reader *reader)
{
    return remedies[reader->format].stepped_back;
}

/* Uses only members of the reader that do not change while it reads. */
void trace_complain_no_time(char out[TRACE_PROBLEM_MAX], const trace_reader *reader,
                            const trace_record *record)
{
    char place[PLACE_MAX];
    if (reader->format == TRACE_PCAPNG)
        (void)snprintf(place, sizeof place, " byte %" PRIu64, record->place);
    else
        (void)snprintf(place, sizeof place, "%" PRIu64 ":%u", record->place, record->column);
    (void)snprintf(out, TRACE_PROBLEM_MAX,
                   "%s:%s: there is no time stamp: %s, or replay with 'speed: max'", reader->file,
                   place, remedies[reader->format].no_time);
}

void trace_print_place(char out[TRACE_CHANNEL_MAX], const trace_reader *reader, uint64_t place)
{
    (void)snprintf(out, TRACE_CHANNEL_MAX, "%s %" PRIu64,
                   reader->format == TRACE_PCAPNG ? "byte" : "line", place);
}

uint64_t trace_position(const trace_reader *reader)
{
    return reader->input.offset;
}

uint64_t trace_size(const trace_reader *reader)
{
    return reader->size;
}
