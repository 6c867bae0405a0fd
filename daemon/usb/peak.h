/* SPDX-License-Identifier: MIT
 *
 * peak.h - the records of PEAK's PCAN-USB FD, as Linux' driver peak_usb reads and writes them.
 *
 * Numbers are little-endian. The driver writes commands, 8 bytes each, and frames. The adapter
 * writes records with a size, a type and the time in microseconds.
 */
#ifndef CANWIRE_USB_PEAK_H
#define CANWIRE_USB_PEAK_H

#include <linux/can.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PEAK_CLOCK "80MHz" /* of its bit timings */
#define PEAK_RECORD_MAX 92u /* bytes of the longest record: a frame of 64 bytes */

/* ---- From the driver ------------------------------------------------------------------------- */

typedef enum peak_opcode {
    PEAK_RESET_MODE = 0x001, /* off the bus */
    PEAK_NORMAL_MODE = 0x002,
    PEAK_LISTEN_ONLY_MODE = 0x003,
    PEAK_TIMING_SLOW = 0x004, /* of the nominal bit rate */
    PEAK_TIMING_FAST = 0x005, /* of the data bit rate */
    PEAK_END = 0x3ff          /* of the commands; 64 of them have no end */
} peak_opcode;

typedef struct peak_timing {
    unsigned brp, tseg1, tseg2, sjw;
    bool triple; /* of the nominal rate */
} peak_timing;

typedef struct peak_command {
    unsigned opcode; /* a peak_opcode, or one that changes nothing here */
    peak_timing timing;
} peak_command;

/* Takes the command at *at, and moves *at behind it. Returns false at the end. */
bool peak_take_command(peak_command *out, const unsigned char *bytes, size_t size, size_t *at);

typedef struct peak_frame {
    union {
        struct can_frame classical;
        struct canfd_frame fd; /* its flags tell the two apart: CANFD_FDF */
    };
    size_t size; /* CAN_MTU or CANFD_MTU */
    bool one_shot;
} peak_frame;

/* The result of looking for a frame. */
typedef enum peak_found { PEAK_FRAME = 0, PEAK_NO_MORE, PEAK_BROKEN } peak_found;

/* Takes the frame at *at, and moves *at behind it. */
peak_found peak_take_frame(peak_frame *out, const unsigned char *bytes, size_t size, size_t *at);

/* ---- To the driver --------------------------------------------------------------------------- */

/* Bits of a status. */
#define PEAK_PASSIVE 0x20u
#define PEAK_WARNING 0x40u
#define PEAK_BUS_OFF 0x80u

/* Each writes a record of at most PEAK_RECORD_MAX bytes and returns its size. */

/* A frame of linux/can.h, by its size; error frames, too. */
size_t peak_put_frame(unsigned char *out, const void *frame, size_t size, uint64_t us);

size_t peak_put_counters(unsigned char *out, unsigned tec, unsigned rec, uint64_t us);
size_t peak_put_status(unsigned char *out, unsigned bits, uint64_t us);

/* Frames have been lost on their way to the driver. */
size_t peak_put_overrun(unsigned char *out, uint64_t us);

#endif
