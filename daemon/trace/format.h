/* SPDX-License-Identifier: MIT
 *
 * format.h - what the readers of the formats share: bytes and lines of a file, complaints.
 *
 * Private to trace/read.c and the readers of the formats.
 */
#ifndef CANWIRE_TRACE_FORMAT_H
#define CANWIRE_TRACE_FORMAT_H

#include "trace/read.h"

#include <stddef.h>

#define TRACE_LINE_MAX 4096u /* bytes of a line */
#define TRACE_BUFFER (64u * 1024u)
#define TRACE_INTERFACES_MAX 256u /* of one section of pcapng */

/* A file, read through a buffer. */
typedef struct trace_input {
    const char *file;
    int fd;
    bool at_end;  /* there is nothing behind what is in the buffer */
    size_t first; /* of what has not been handed out yet */
    size_t filled;
    uint64_t offset; /* of the byte at `first` in the file */
    uint64_t line;   /* of `text`, from 1 */
    char *text;      /* the present line, without its end */
    char problem[TRACE_PROBLEM_MAX];
    unsigned char buffer[TRACE_BUFFER + 1];
} trace_input;

#define TRACE_BOM_BYTES 3u

/* Whether a text begins with a byte order mark of UTF-8, as editors of Windows write it. */
bool trace_has_bom(const unsigned char *bytes, size_t count);

/* The next line goes to in->text, TRACE_RECORD when there is one; of the first one without a byte
 * order mark. */
trace_result trace_line(trace_input *in);

/* The next bytes, at most TRACE_BUFFER, all or none. They stay where they are until the next call.
 * TRACE_END: the file ends before the first of them; TRACE_BAD: amid them. */
trace_result trace_bytes(trace_input *in, const unsigned char **bytes, size_t count);

/* Passes over bytes. TRACE_BAD: the file ends before. */
trace_result trace_skip(trace_input *in, uint64_t count);

/* Looks at the next bytes without taking them; returns how many there are, at most count. */
size_t trace_peek(trace_input *in, const unsigned char **bytes, size_t count);

/* Complaints, always TRACE_BAD: at a place in in->text, and at a byte of the file. */
trace_result trace_bad_text(trace_input *in, const char *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
trace_result trace_bad_byte(trace_input *in, uint64_t offset, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Behind the blanks and tabs. */
const char *trace_blanks(const char *text);

/* Length of the word that begins here: up to a blank, a tab or the end. */
size_t trace_word(const char *text);

/* Whether the word that begins here is this one, in any case. */
bool trace_is_word(const char *text, const char *word);

/* A word as name of the record's channel. */
void trace_set_channel(trace_record *record, const char *word, size_t length);

/* Seconds with a fraction of 1 to 9 digits. NULL when it is something else or too long ago or
 * ahead, else what comes behind. */
const char *trace_seconds(uint64_t *ns, const char *text);

/* A hexadecimal number of 1 to 8 digits, exactly `length` of them, false when it is none. */
bool trace_hex(uint32_t *value, const char *text, size_t length);

typedef struct candump_state {
    bool delta;
    bool explains; /* indented lines that follow explain an error frame */
    uint64_t time_ns;
    bool timed;
} candump_state;

typedef struct asc_state {
    bool has_base;
    bool decimal;
    bool relative;
    uint64_t time_ns;
} asc_state;

typedef struct pcap_interface {
    uint16_t link_type;
    uint8_t resolution; /* if_tsresol */
    uint32_t snap_length;
    int64_t offset_s;
    char name[TRACE_CHANNEL_MAX];
} pcap_interface;

typedef struct pcap_state {
    bool begun;
    bool classic; /* pcap, not pcapng */
    bool big_endian;
    unsigned interface_count;
    pcap_interface interfaces[TRACE_INTERFACES_MAX];
} pcap_state;

trace_result candump_next(trace_input *in, candump_state *state, trace_record *record);
trace_result asc_next(trace_input *in, asc_state *state, trace_record *record);
trace_result pcapng_next(trace_input *in, pcap_state *state, trace_record *record);

#endif
