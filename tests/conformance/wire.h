/* SPDX-License-Identifier: MIT
 *
 * wire.h - frames as the bench puts them on the wire, encoded independently of lib/ so that the
 * two encoders check each other.
 *
 * A frame is written as can-utils do (123#55, 048C1234#, 123#R4, 123#1122334455667788_F), followed
 * by any number of
 *
 *     ^POSITION   this bit is inverted and the CRC runs over it: a valid frame with r0 recessive
 *     ~POSITION   this bit is inverted after the CRC was computed, before stuffing: a CRC error
 *     !sof        the SOF is missing on the wire
 *
 * A POSITION is one of sof id0..28 srr ide rtr r1 r0 dlc0..3 data0.. crc0..14 crcdel ack ackdel
 * eof0..6 int0..2 susp0..7 errflag0.. errdel0.. ovlflag0.. ovldel0..; with an s at its end the
 * stuff bit that follows it. stN is the N-th stuff bit of the frame, from 0.
 */
#ifndef WIRE_H
#define WIRE_H

#include "canwire.h"

#define WIRE_MAX 200
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
    unsigned ack; /* wire index of the ACK slot */
    unsigned stuff_bits;
    wire_bit bit[WIRE_MAX];
} wire;

/* Reads and encodes the frame at text. Returns where it ends, or NULL when it is malformed or
 * the encoder of the library disagrees. */
const char *wire_parse(wire *out, const char *text);

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
