/* SPDX-License-Identifier: MIT
 *
 * wire.h - frames as the bench puts them on the wire, encoded independently of lib/ so that the
 * two encoders check each other.
 *
 * A frame is written as can-utils do (123#55, 048C1234#, 123#R4, 123#1122334455667788_F, 123##155),
 * followed by any number of
 *
 *     ^POSITION   this bit is inverted and the CRC runs over it: a valid frame with r0 recessive,
 *                 or a wrong stuff count
 *     ~POSITION   this bit is inverted after stuff count and CRC were computed, before stuffing: a
 *                 CRC error
 *     !sof        the SOF is missing on the wire
 *
 * After ## comes a digit with flags: 1 BRS, 2 ESI, 8 the format from before ISO 11898-1:2015. 55x20
 * is 20 bytes 55. A data frame with a single # has the format that wire_set_format() says; 123#=55
 * is always classical.
 *
 * A POSITION is one of sof id0..28 srr ide rtr r1 r0 fdf res brs esi dlc0..3 data0.. sc0..3 (stuff
 * count) crc0..20 fs0..6 (fixed stuff bits) crcdel ack0..1 ackdel eof0..6 int0..2 susp0..7
 * errflag0.. errdel0.. ovlflag0.. ovldel0..; with an s at its end the stuff bit that follows it.
 * stN is the N-th stuff bit of the frame that is no fixed one, from 0. rtr is RRS, too. ackend is
 * the last bit of the ACK slot, in the format that wire_set_format() says.
 */
#ifndef WIRE_H
#define WIRE_H

#include "canwire.h"

#define WIRE_MAX 768
#define NAME_MAX_LENGTH 16

typedef struct wire_bit {
    bool level;
    bool arbitration; /* M2; a stuff bit belongs to the field of the bit before it */
    cw_place place;
} wire_bit;

typedef struct wire {
    cw_frame frame;
    bool crc_wrong; /* a receiver must not acknowledge */
    bool no_sof;    /* places seen by a receiver are shifted */
    unsigned length;
    unsigned ack; /* wire index of the first bit of the ACK slot */
    unsigned stuff_bits; /* without fixed ones */
    wire_bit bit[WIRE_MAX];
} wire;

/* The format of data frames with a single #. */
typedef enum wire_format {
    WIRE_CLASSICAL,
    WIRE_FD,      /* BRS dominant */
    WIRE_FD_LONG, /* BRS recessive; data are repeated up to 20 bytes, so that the CRC has 21 bits */
    WIRE_FD_NON_ISO,
} wire_format;

void wire_set_format(wire_format format);
bool wire_is_fd(void);

/* Returns what follows the # of a frame of the format, before its data. */
const char *wire_format_text(void);

/* Reads and encodes the frame at text. Returns where it ends, or NULL when it is malformed or
 * the encoder of the library disagrees. */
const char *wire_parse(wire *out, const char *text);

/* Does the same for a frame that a node sends, error passive or not: ESI says so (D8). */
const char *wire_parse_sent(wire *out, const char *text, bool passive);

/* Returns the bytes in the data field. */
unsigned wire_data_bytes(const cw_frame *frame);

/* Reads a position at text. Returns where it ends, or NULL. "stN" is left in *nth_stuff, which
 * is -1 otherwise. */
const char *wire_parse_place(cw_place *out, int *nth_stuff, const char *text);

/* Returns the wire index of the position at text, -1 when the frame has none; *end is the end of
 * the text. */
int wire_find(const wire *w, const char *text, const char **end);

/* Writes a place as it is written in scripts; buffer of NAME_MAX_LENGTH bytes. */
const char *wire_place_text(char *buffer, cw_place place);

/* Returns the number of a lost arbitration bit in the way of the SJA1000. */
unsigned wire_lost_bit(const wire *w, unsigned index);

bool wire_same_place(cw_place a, cw_place b);

#endif
