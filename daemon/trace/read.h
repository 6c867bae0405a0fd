/* SPDX-License-Identifier: MIT
 *
 * read.h - reads recordings of CAN traffic, entry by entry: candump, Vector ASC, pcapng.
 *
 * A file is never loaded as a whole; memory is bounded. Every entry is handed out, so that the
 * caller can report each. Some cannot go onto a classical bus, others are not whole. A file is not
 * a recording when it has an entry that is not whole, and no frame that is. The same holds when
 * its first TRACE_DAMAGED_MAX such entries come before any frame.
 */
#ifndef CANWIRE_TRACE_READ_H
#define CANWIRE_TRACE_READ_H

#include "canwire.h"

#define TRACE_CHANNEL_MAX 32  /* bytes of the name of a channel with its final 0 */
#define TRACE_PROBLEM_MAX 600 /* bytes of a message with its final 0 */
#define TRACE_DAMAGED_MAX 1000u

typedef enum trace_format {
    TRACE_DETECT = 0,    /* by the content of the file */
    TRACE_CANDUMP,       /* candump, with -L or on a screen with -t a, z or A */
    TRACE_CANDUMP_DELTA, /* candump -t d: each time is relative to the line before */
    TRACE_ASC,           /* Vector ASC */
    TRACE_PCAPNG         /* pcapng, and the older pcap */
} trace_format;

typedef enum trace_kind {
    TRACE_FRAME = 0,   /* a classical frame, valid as cw_frame_valid() says */
    TRACE_DAMAGED, /* it is not whole: cut, torn, or bytes that nobody wrote, see trace_damage() */
    TRACE_ERROR_FRAME, /* an error on the bus that a driver or a tool noted */
    TRACE_FD_FRAME,    /* a CAN FD frame, valid in the same way */
    TRACE_XL_FRAME,
    TRACE_OTHER, /* an event of a tool, a packet without a CAN frame, an unknown block */
    TRACE_MARK,  /* the beginning of the recording: it is not replayed, but it has a time */
    TRACE_KIND_COUNT
} trace_kind;

typedef struct trace_record {
    trace_kind kind;
    bool timed;                      /* it has a time stamp */
    uint64_t time_ns;                /* since an epoch of the file; may step back */
    bool cut;                        /* the file ends behind it without the end of its line */
    uint64_t place;                  /* line from 1; in pcapng: byte from 0 */
    uint64_t bytes;                  /* of TRACE_DAMAGED, up to the next entry */
    unsigned column;                 /* of the first word of its line, from 1; in pcapng: 0 */
    char channel[TRACE_CHANNEL_MAX]; /* interface or number of the channel; "" when it has none */
    cw_frame frame;                  /* TRACE_FRAME and TRACE_FD_FRAME */
} trace_record;

typedef enum trace_result {
    TRACE_RECORD = 0,
    TRACE_END, /* of the file */
    TRACE_BAD, /* it cannot be read, or is not a recording; see trace_problem() */
    TRACE_LATER /* of trace/ahead.h alone: the entry has not been read yet */
} trace_result;

typedef struct trace_reader trace_reader;

/* Opens a regular file and detects its format. Returns NULL when that fails, with a message in
 * *problem that begins with the name of the file. */
trace_reader *trace_open(const char *file, trace_format format, char problem[TRACE_PROBLEM_MAX]);

/* Closes the reader. NULL is allowed. */
void trace_close(trace_reader *reader);

/* Reads the next entry. */
trace_result trace_next(trace_reader *reader, trace_record *record);

/* Goes back to the beginning. Returns false when the file can no longer be read, see
 * trace_problem(). */
bool trace_rewind(trace_reader *reader);

/* Returns the message after TRACE_BAD: "FILE:LINE:COLUMN: problem and allowed text", or "FILE: byte
 * N: ..." in pcapng. It is valid until the next call. */
const char *trace_problem(const trace_reader *reader);

/* Returns what is wrong with the first entry that is not whole, without its place. It is valid
 * after the first record of kind TRACE_DAMAGED, and no longer changes. */
const char *trace_damage(const trace_reader *reader);

/* Writes a message about an entry without time stamp in the form of trace_problem(). */
void trace_complain_no_time(char out[TRACE_PROBLEM_MAX], const trace_reader *reader,
                            const trace_record *record);

/* Returns what to do about entries that step back in time in a file of this format. */
const char *trace_stepped_back(const trace_reader *reader);

/* Prints "line 12" or "byte 4096", the beginning of an entry. */
void trace_print_place(char out[TRACE_CHANNEL_MAX], const trace_reader *reader, uint64_t place);

/* Return the bytes read so far, and the size of the file when it was opened. */
uint64_t trace_position(const trace_reader *reader);
uint64_t trace_size(const trace_reader *reader);

#endif
