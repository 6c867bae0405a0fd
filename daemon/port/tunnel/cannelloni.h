/* SPDX-License-Identifier: MIT
 *
 * cannelloni.h - the formats of cannelloni: packets of UDP (version 2), and the stream of TCP.
 *
 * A packet has a head of five bytes (version, operation, sequence number, number of frames) and
 * frames. A frame has its identifier as in linux/can.h, its length, for CAN FD with 80 hex and then
 * flags, and its data. The stream has frames only, behind a greeting. All numbers are big-endian.
 */
#ifndef CANWIRE_PORT_CANNELLONI_H
#define CANWIRE_PORT_CANNELLONI_H

#include <linux/can.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CANNELLONI_GREETING "CANNELLONIv1" /* without a final 0 */
#define CANNELLONI_GREETING_BYTES 12u
#define CANNELLONI_HEAD_BYTES 5u
#define CANNELLONI_FRAME_MAX 70u /* bytes of the longest frame */

/* Writes a frame of `size`, that of struct can_frame or canfd_frame. Returns the bytes. */
size_t cannelloni_put_frame(uint8_t out[CANNELLONI_FRAME_MAX], const void *frame, size_t size);

/* Reads a frame from the start of some bytes. Returns those that it has; 0: there are too few, and
 * -1: it is not one. size: of struct can_frame or canfd_frame. */
int cannelloni_take_frame(struct canfd_frame *out, size_t *size, const uint8_t *in, size_t bytes);

void cannelloni_put_head(uint8_t out[CANNELLONI_HEAD_BYTES], uint8_t number, unsigned frames);

/* Returns the number of frames in a packet, if all of it is right; otherwise -1. */
int cannelloni_check(const uint8_t *in, size_t bytes);

#define CANNELLONI_SEEN 32u /* packets that are remembered */

/* The sequence numbers of a peer. */
typedef struct cannelloni_sequence {
    bool begun;
    uint8_t next; /* number of the packet that comes next */
    struct {
        bool there;
        uint8_t number;
        uint32_t content; /* to tell a packet that comes twice from another one */
        int64_t ns;
    } seen[CANNELLONI_SEEN]; /* at the number modulo their count */
} cannelloni_sequence;

/* A packet among those of its peer. */
typedef enum cannelloni_place {
    CANNELLONI_NEXT = 0,  /* it comes next, perhaps behind missing ones */
    CANNELLONI_LATE,      /* it has been missing */
    CANNELLONI_DUPLICATE, /* it has come before */
    CANNELLONI_RESTART    /* the peer has begun again */
} cannelloni_place;

/* Finds the place of a packet. ns: time of its arrival. missing: packets before it that have not
 * come. */
cannelloni_place cannelloni_follow(cannelloni_sequence *s, const uint8_t *in, size_t bytes,
                                   int64_t ns, unsigned *missing);

#endif
