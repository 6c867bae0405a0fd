/* SPDX-License-Identifier: MIT
 *
 * peak.c - the records of PEAK's PCAN-USB FD, as Linux' driver peak_usb reads and writes them.
 */
#include "usb/peak.h"

#include <string.h>

#define COMMAND_BYTES 8u
#define OPCODE_MASK 0x3ffu

/* Types of records. */
#define FROM_BUS 0x0001u
#define ERROR_COUNTERS 0x0002u
#define STATUS 0x0003u
#define OVERRUN 0x0101u
#define TO_BUS 0x1000u

/* Flags of frames. */
#define IS_REMOTE 0x01u
#define IS_EXTENDED 0x02u
#define IS_ONE_SHOT 0x08u
#define IS_FD 0x10u
#define HAS_BRS 0x20u
#define HAS_ESI 0x40u

#define TIME_HEAD_BYTES 12u  /* size, type, time */
#define FROM_BUS_BYTES 28u   /* without data */
#define TO_BUS_BYTES 20u     /* ... which has no time */
#define CLASSICAL_DATA 8u

static unsigned get16(const unsigned char *at)
{
    return at[0] | (unsigned)at[1] << 8;
}

static uint32_t get32(const unsigned char *at)
{
    return get16(at) | (uint32_t)get16(at + 2) << 16;
}

static void put16(unsigned char *at, unsigned value)
{
    at[0] = (unsigned char)(value & 0xff);
    at[1] = (unsigned char)(value >> 8 & 0xff);
}

static void put32(unsigned char *at, uint32_t value)
{
    put16(at, value & 0xffff);
    put16(at + 2, value >> 16);
}

/* ---- From the driver ------------------------------------------------------------------------- */

/* All but the prescaler have a byte each; numbers are less one. */
static peak_timing take_timing(const unsigned char *at, bool fast)
{
    const unsigned sjw_mask = fast ? 0x0f : 0x7f;
    return (peak_timing){
        .brp = (get16(at + 6) & 0x3ff) + 1,
        .tseg1 = (at[5] & (fast ? 0x1f : 0xff)) + 1u,
        .tseg2 = (at[4] & sjw_mask) + 1u,
        .sjw = (at[3] & sjw_mask) + 1u,
        .triple = !fast && (at[3] & 0x80),
    };
}

bool peak_take_command(peak_command *out, const unsigned char *bytes, size_t size, size_t *at)
{
    if (size - *at < COMMAND_BYTES)
        return false;
    const unsigned char *here = bytes + *at;
    *out = (peak_command){.opcode = get16(here) & OPCODE_MASK};
    if (out->opcode == PEAK_END)
        return false;
    if (out->opcode == PEAK_TIMING_SLOW || out->opcode == PEAK_TIMING_FAST)
        out->timing = take_timing(here, out->opcode == PEAK_TIMING_FAST);
    *at += COMMAND_BYTES;
    return true;
}

static const unsigned char fd_lengths[] = {0, 1, 2,  3,  4,  5,  6,  7,
                                           8, 12, 16, 20, 24, 32, 48, 64};

/* Takes the CAN FD part of a record. Its DLC is known to be at most 15. */
static void take_fd(peak_frame *out, unsigned dlc, unsigned flags)
{
    out->size = CANFD_MTU;
    out->fd.len = fd_lengths[dlc];
    out->fd.flags = (unsigned char)(CANFD_FDF | (flags & HAS_BRS ? CANFD_BRS : 0) |
                                    (flags & HAS_ESI ? CANFD_ESI : 0));
}

static void take_classical(peak_frame *out, unsigned dlc)
{
    out->size = CAN_MTU;
    out->classical.len = dlc < CAN_MAX_DLEN ? (unsigned char)dlc : CAN_MAX_DLEN;
    out->classical.len8_dlc = dlc > CAN_MAX_DLEN ? (unsigned char)dlc : 0;
}

/* Returns the bytes of data that a frame has in its record. */
static size_t data_bytes(const peak_frame *f)
{
    return f->fd.can_id & CAN_RTR_FLAG ? 0 : f->fd.len; /* the length is at one place in both */
}

/* Takes a frame of the driver. A record that ends in its data is broken. */
static peak_found usb_peak_take_frame(peak_frame *out, const unsigned char *at, size_t size)
{
    const unsigned flags = get16(at + 14), dlc = at[12] >> 4;
    *out = (peak_frame){.one_shot = flags & IS_ONE_SHOT};
    out->fd.can_id = get32(at + 16) & (flags & IS_EXTENDED ? CAN_EFF_MASK : CAN_SFF_MASK);
    out->fd.can_id |= flags & IS_EXTENDED ? CAN_EFF_FLAG : 0;
    out->fd.can_id |= flags & IS_REMOTE ? CAN_RTR_FLAG : 0;
    if (flags & IS_FD)
        take_fd(out, dlc, flags);
    else
        take_classical(out, dlc);
    if (size < TO_BUS_BYTES + data_bytes(out))
        return PEAK_BROKEN;
    memcpy(out->fd.data, at + TO_BUS_BYTES, data_bytes(out));
    return PEAK_FRAME;
}

peak_found peak_take_frame(peak_frame *out, const unsigned char *bytes, size_t size, size_t *at)
{
    const size_t left = size - *at;
    const size_t own = left >= 2 ? get16(bytes + *at) : 0;
    if (own == 0)
        return PEAK_NO_MORE;
    const unsigned char *here = bytes + *at;
    if (own > left || own < TO_BUS_BYTES || get16(here + 2) != TO_BUS)
        return PEAK_BROKEN;
    *at += own;
    return usb_peak_take_frame(out, here, own);
}

/* ---- To the driver --------------------------------------------------------------------------- */

/* Writes the head of a record, and zeros up to its end. Returns its size. */
static size_t put_head(unsigned char *out, size_t size, unsigned type, uint64_t us)
{
    memset(out, 0, size);
    put16(out, (unsigned)size);
    put16(out + 2, type);
    put32(out + 4, (uint32_t)us);
    put32(out + 8, (uint32_t)(us >> 32));
    return size;
}

/* Returns the least DLC whose length is enough. */
static unsigned fd_dlc(unsigned length)
{
    unsigned dlc = 0;
    while (dlc < CANFD_MAX_DLC && fd_lengths[dlc] < length)
        dlc++;
    return dlc;
}

/* Returns the flags of a frame. Those of an error frame stay in its identifier, which the driver
 * passes on as it is. */
static unsigned flags_of(canid_t can_id, const struct canfd_frame *fd)
{
    unsigned flags = 0;
    if (fd)
        flags = IS_FD | (fd->flags & CANFD_BRS ? HAS_BRS : 0) |
                (fd->flags & CANFD_ESI ? HAS_ESI : 0);
    if (can_id & CAN_ERR_FLAG)
        return flags;
    return flags | (can_id & CAN_EFF_FLAG ? IS_EXTENDED : 0) |
           (can_id & CAN_RTR_FLAG ? IS_REMOTE : 0);
}

size_t peak_put_frame(unsigned char *out, const void *frame, size_t size, uint64_t us)
{
    struct canfd_frame fd = {.can_id = 0};
    struct can_frame classical;
    const bool is_fd = size == CANFD_MTU;
    memcpy(&classical, frame, sizeof classical);
    memcpy(&fd, frame, is_fd ? sizeof fd : sizeof classical);
    const canid_t can_id = classical.can_id;
    const unsigned raw =
        classical.len8_dlc > CAN_MAX_DLEN ? classical.len8_dlc : classical.len;
    const unsigned dlc = is_fd ? fd_dlc(fd.len) : raw;
    const size_t data = is_fd ? fd_lengths[dlc] : CLASSICAL_DATA;
    const size_t whole = put_head(out, (FROM_BUS_BYTES + data + 3) / 4 * 4, FROM_BUS, us);
    out[20] = (unsigned char)(dlc << 4);
    put16(out + 22, flags_of(can_id, is_fd ? &fd : NULL));
    put32(out + 24, can_id & CAN_ERR_FLAG ? can_id : can_id & CAN_EFF_MASK);
    memcpy(out + FROM_BUS_BYTES, is_fd ? fd.data : classical.data, data);
    return whole;
}

/* Writes a record with both error counters, of a byte each. */
size_t peak_put_counters(unsigned char *out, unsigned tec, unsigned rec, uint64_t us)
{
    const size_t whole = put_head(out, TIME_HEAD_BYTES + 4, ERROR_COUNTERS, us);
    out[14] = (unsigned char)(tec < 255 ? tec : 255);
    out[15] = (unsigned char)(rec < 255 ? rec : 255);
    return whole;
}

size_t peak_put_status(unsigned char *out, unsigned bits, uint64_t us)
{
    const size_t whole = put_head(out, TIME_HEAD_BYTES + 4, STATUS, us);
    out[12] = (unsigned char)bits;
    return whole;
}

size_t peak_put_overrun(unsigned char *out, uint64_t us)
{
    return put_head(out, TIME_HEAD_BYTES + 4, OVERRUN, us);
}
