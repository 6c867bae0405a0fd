/* SPDX-License-Identifier: MIT
 *
 * protect.c - counters and checksums in the data of frames, as senders write them.
 */
#include "format/protect.h"

#include "format/frame.h"

static unsigned checksum_bytes(const cw_checksum *c)
{
    if (c->kind == CW_CHECKSUM_NONE)
        return 0;
    return c->kind == CW_CHECKSUM_CRC16 ? 2 : 1;
}

bool cw_protection_valid(const cw_protection *p)
{
    const cw_counter *n = &p->counter;
    const cw_checksum *c = &p->checksum;
    const uint64_t values = n->bits <= 32 ? UINT64_C(1) << n->bits : 0;
    const bool counter = n->bits == 0 || (n->max < values && n->start <= n->max &&
                                          n->bit + n->bits <= 8 * CW_FRAME_DATA_MAX);
    return counter && (unsigned)c->kind < CW_CHECKSUM_COUNT && c->id_length <= CW_DATA_ID_MAX &&
           c->at + checksum_bytes(c) <= CW_FRAME_DATA_MAX &&
           (p->id & CW_FILTER_REMOTE) == 0;
}

bool cw_protection_fits(const cw_protection *p, const cw_frame *frame)
{
    const unsigned length = cw_frame_valid(frame) ? cw_frame_length(frame) : 0;
    const unsigned bits = p->counter.bits ? p->counter.bit + p->counter.bits : 0;
    const unsigned sum = checksum_bytes(&p->checksum);
    return bits <= 8 * length && (sum == 0 || p->checksum.at + sum <= length);
}

/* Writes a value into the counter's bits, the most significant bit first. */
static void write_counter(const cw_counter *n, uint8_t *data, uint32_t value)
{
    for (unsigned i = 0; i < n->bits; i++) {
        const unsigned at = n->bit + i;
        const unsigned mask = 0x80u >> at % 8;
        const bool one = value >> (n->bits - 1u - i) & 1u;
        data[at / 8] = (uint8_t)(one ? data[at / 8] | mask : data[at / 8] & ~mask);
    }
}

/* Returns a CRC of that many bits after one more byte. */
static unsigned crc_next(unsigned crc, unsigned byte, unsigned bits, unsigned polynomial)
{
    crc ^= byte << (bits - 8);
    for (unsigned i = 0; i < 8; i++)
        crc = crc >> (bits - 1) & 1u ? crc << 1 ^ polynomial : crc << 1;
    return crc & ((1u << bits) - 1);
}

/* Returns the checksum after one more byte. */
static unsigned sum_next(const cw_checksum *c, unsigned sum, unsigned byte)
{
    switch (c->kind) {
    case CW_CHECKSUM_XOR:
        return sum ^ byte;
    case CW_CHECKSUM_SUM:
        return (sum + byte) & 0xFF;
    case CW_CHECKSUM_CRC8:
        return crc_next(sum, byte, 8, c->polynomial);
    case CW_CHECKSUM_CRC16:
        return crc_next(sum, byte, 16, c->polynomial);
    case CW_CHECKSUM_NONE:
    case CW_CHECKSUM_COUNT:
        break;
    }
    return sum;
}

/* Adds the data ID: all of its bytes, or the one that the counter chooses. */
static unsigned sum_id(const cw_checksum *c, unsigned sum, uint32_t counter)
{
    if (c->id_length == 0)
        return sum;
    if (c->id_by_counter)
        return sum_next(c, sum, c->id[counter % c->id_length]);
    for (unsigned i = 0; i < c->id_length; i++)
        sum = sum_next(c, sum, c->id[i]);
    return sum;
}

/* Returns the checksum of a frame's data, with the bytes of the checksum itself left out. */
static unsigned sum_of(const cw_checksum *c, const cw_frame *frame, uint32_t counter)
{
    const unsigned end = c->at + checksum_bytes(c);
    unsigned sum = c->start;
    if (c->id_first)
        sum = sum_id(c, sum, counter);
    for (unsigned i = 0; i < cw_frame_length(frame); i++)
        if (i < c->at || i >= end)
            sum = sum_next(c, sum, frame->data[i]);
    if (!c->id_first)
        sum = sum_id(c, sum, counter);
    return sum ^ c->inverted;
}

void cw_protection_write(const cw_protection *p, cw_frame *frame, uint32_t counter)
{
    const cw_checksum *c = &p->checksum;
    write_counter(&p->counter, frame->data, counter);
    if (c->kind == CW_CHECKSUM_NONE)
        return;
    const unsigned sum = sum_of(c, frame, counter);
    frame->data[c->at] = (uint8_t)sum;
    if (checksum_bytes(c) == 2)
        frame->data[c->at + 1] = (uint8_t)(sum >> 8);
}

void cw_protection_invert(const cw_protection *p, cw_frame *frame)
{
    for (unsigned i = 0; i < checksum_bytes(&p->checksum); i++)
        frame->data[p->checksum.at + i] ^= 0xFF;
}
