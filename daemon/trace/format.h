/* SPDX-License-Identifier: MIT
 *
 * format.h - shared parts of the readers of formats: bytes and lines of a file, complaints.
 *
 * It is private to trace/read.c and the readers of the formats.
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
    bool at_end;  /* the file has nothing behind the buffer */
    bool failed;  /* TRACE_BAD stays: the file cannot be read, or is not a recording */
    size_t first; /* of the bytes that are not handed out yet */
    size_t filled;
    uint64_t offset; /* of the byte at `first` in the file */
    uint64_t entry;  /* offset of the present line, block or packet */
    uint64_t line;   /* of `text`, from 1 */
    bool amid;       /* the line of `text` goes on behind it */
    bool cut;        /* the file ends behind `text`, without the end of a line */
    char *text;      /* the present line, without its end; it also ends at bytes 0 */
    size_t place;    /* characters of `problem` that say where it is */
    char problem[TRACE_PROBLEM_MAX];
    unsigned char buffer[TRACE_BUFFER + 1];
} trace_input;

#define TRACE_BOM_BYTES 3u

/* Returns true when a text begins with a byte order mark of UTF-8, as editors of Windows write
 * it. */
bool trace_has_bom(const unsigned char *bytes, size_t count);

/* Reads the next line into in->text, without a byte order mark in the first one. Returns
 * TRACE_RECORD when there is a line. TRACE_BAD: too long a line, or up to bytes 0 in it. A crash
 * leaves such bytes; what a recorder has appended to them is read as a line of its own. */
trace_result trace_line(trace_input *in);

/* Goes to the end of a line that was too long, or behind the bytes 0 in it. */
void trace_end_line(trace_input *in);

/* Moves to a byte of the file. */
trace_result trace_seek(trace_input *in, uint64_t offset);

/* Returns the next bytes, at most TRACE_BUFFER, all or none. They stay valid until the next call.
 * TRACE_END: the file ends before them; TRACE_BAD: the file ends among them. */
trace_result trace_bytes(trace_input *in, const unsigned char **bytes, size_t count);

/* Skips bytes. TRACE_BAD: the file ends before. */
trace_result trace_skip(trace_input *in, uint64_t count);

/* Shows the next bytes without taking them. Returns their number, at most count. */
size_t trace_peek(trace_input *in, const unsigned char **bytes, size_t count);

/* Complain at a place in in->text, or at a byte of the file. They always return TRACE_BAD; the
 * reader goes on with the next entry. */
trace_result trace_bad_text(trace_input *in, const char *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
trace_result trace_bad_byte(trace_input *in, uint64_t offset, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
trace_result trace_bad_end(trace_input *in); /* the file ends amid the present entry */

/* Returns the first character behind blanks and tabs. */
const char *trace_blanks(const char *text);

/* Returns the length of the word that begins here, up to a blank, a tab or the end. */
size_t trace_word(const char *text);

/* Returns true when the word that begins here is this one, in any case. */
bool trace_is_word(const char *text, const char *word);

/* Takes a word as the name of the record's channel. */
void trace_set_channel(trace_record *record, const char *word, size_t length);

/* Reads seconds with a fraction of 1 to 9 digits. Returns the text behind them, or NULL for other
 * text and for a time out of range. */
const char *trace_seconds(uint64_t *ns, const char *text);


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
    bool unusable; /* its block is not whole, and neither are its packets */
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

/* Goes on behind the present entry, which is not whole: to the next one that is, or to the end of
 * the file. */
trace_result pcapng_recover(trace_input *in, const pcap_state *state);

#endif
