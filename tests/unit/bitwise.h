/* SPDX-License-Identifier: MIT
 *
 * bitwise.h - frames to wire bits, one bit after the other: the reference for the library's
 * encoder.
 */
#ifndef CANWIRE_TEST_BITWISE_H
#define CANWIRE_TEST_BITWISE_H

#include "codec.h"

#include "bits.h"

/* Writes bits one after the other, stuffing and CRC on the way. */
typedef struct bitwise_writer {
    cw_bits *bits;
    unsigned run;
    bool last;
    uint16_t crc;
} bitwise_writer;

static inline void add_to_set(uint64_t set[CW_BIT_WORDS], unsigned n)
{
    set[n / 64] |= UINT64_C(1) << (n % 64);
}

static inline void bitwise_put_raw(bitwise_writer *w, bool level)
{
    if (level)
        add_to_set(w->bits->level, w->bits->length);
    w->bits->length++;
}

static inline void bitwise_put_stuffed(bitwise_writer *w, bool level)
{
    bitwise_put_raw(w, level);
    w->run = level == w->last ? w->run + 1 : 1;
    w->last = level;
    if (w->run < CW_STUFF_RUN)
        return;
    add_to_set(w->bits->stuff, w->bits->length);
    bitwise_put_raw(w, !level);
    w->last = !level;
    w->run = 1;
}

/* A field of the part that the CRC covers, most significant bit first. */
static inline void bitwise_put_field(bitwise_writer *w, uint32_t value, unsigned bits)
{
    while (bits-- > 0) {
        bool level = (value >> bits) & 1u;
        w->crc = cw_crc_next(w->crc, level);
        bitwise_put_stuffed(w, level);
    }
}

static inline void bitwise_put_arbitration(bitwise_writer *w, const cw_frame *frame)
{
    bool remote = frame->flags & CW_FRAME_REMOTE;
    bitwise_put_field(w, CW_DOMINANT, 1); /* SOF */
    if (!(frame->flags & CW_FRAME_EXTENDED)) {
        bitwise_put_field(w, frame->id, CW_BASE_ID_BITS);
        bitwise_put_field(w, remote, 1);
        bitwise_put_field(w, CW_DOMINANT, 2); /* IDE, r0 */
        return;
    }
    bitwise_put_field(w, frame->id >> 18, CW_BASE_ID_BITS);
    bitwise_put_field(w, 3, 2); /* SRR, IDE */
    bitwise_put_field(w, frame->id & 0x3FFFFu, CW_EXTENDED_ID_BITS - CW_BASE_ID_BITS);
    bitwise_put_field(w, remote, 1);
    bitwise_put_field(w, CW_DOMINANT, 2); /* r1, r0 */
}

/* CRC to EOF. The CRC sequence is stuffed, also behind its last bit (F7). */
static inline void bitwise_put_tail(bitwise_writer *w, uint16_t inverted)
{
    w->bits->crc = w->crc ^ inverted;
    for (unsigned n = CW_CRC_BITS; n-- > 0;)
        bitwise_put_stuffed(w, ((unsigned)w->bits->crc >> n) & 1u);
    for (unsigned n = 0; n < 3 + CW_EOF_BITS; n++) /* delimiter, ACK slot, delimiter, EOF */
        bitwise_put_raw(w, CW_RECESSIVE);
}

/* As cw_bits_encode_crc() does it, of a valid frame. */
static inline cw_bits bitwise_encode(const cw_frame *frame, uint16_t inverted)
{
    cw_bits bits = {.length = 0};
    bitwise_writer w = {.bits = &bits, .run = 0, .last = CW_RECESSIVE, .crc = 0};
    bits.extended = frame->flags & CW_FRAME_EXTENDED;
    bits.data_bits = (uint8_t)(8 * cw_frame_length(frame));
    bitwise_put_arbitration(&w, frame);
    bitwise_put_field(&w, frame->dlc, 4);
    for (unsigned byte = 0; byte < cw_frame_length(frame); byte++)
        bitwise_put_field(&w, frame->data[byte], 8);
    bitwise_put_tail(&w, inverted);
    return bits;
}

#endif
