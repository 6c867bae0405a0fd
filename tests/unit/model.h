/* SPDX-License-Identifier: MIT
 *
 * model.h - frames as strings of '0' and '1', made from the rules without the library's encoder.
 *
 * For tests only: slow and obvious. Two strings of nodes that start together compare as strcmp()
 * does: the first bit that differs decides, and dominant is '0'.
 */
#ifndef CANWIRE_TEST_MODEL_H
#define CANWIRE_TEST_MODEL_H

#include "canwire.h"

#include <string.h>

#define MODEL_BITS_MAX 200
#define MODEL_TAIL "1111111111" /* CRC delimiter, ACK slot, ACK delimiter, EOF */
#define MODEL_TAIL_BITS 10u
#define MODEL_EOF_BITS 7u

typedef struct model {
    char plain[MODEL_BITS_MAX]; /* SOF to the last CRC bit, without stuff bits */
    char wire[MODEL_BITS_MAX];  /* SOF to EOF with them, ACK slot recessive */
    unsigned at[MODEL_BITS_MAX]; /* index of plain[i] in wire[] */
    unsigned length;             /* of wire[] */
    unsigned stuffed;            /* bits of wire[] up to the last CRC (stuff) bit */
} model;

/* Levels that a receiver must accept either way (F5). */
typedef struct model_levels {
    char srr;
    char r1;
    char r0;
} model_levels;

static inline void model_put(char *text, uint32_t value, unsigned bits)
{
    size_t end = strlen(text);
    for (unsigned n = bits; n-- > 0;)
        text[end++] = value >> n & 1u ? '1' : '0';
    text[end] = '\0';
}

static inline void model_put_level(char *text, char level)
{
    model_put(text, level == '1', 1);
}

/* F6 by long division: the remainder of the text with 15 zeros behind it. */
static inline void model_put_crc(char *text)
{
    static const char generator[] = "1100010110011001";
    char rest[MODEL_BITS_MAX];
    size_t bits = strlen(text);
    strcpy(rest, text);
    model_put(rest, 0, 15);
    for (size_t i = 0; i < bits; i++)
        for (size_t j = 0; rest[i] == '1' && j < 16; j++)
            if (j > 0 && generator[j] == '1')
                rest[i + j] = rest[i + j] == '1' ? '0' : '1';
    strcat(text, rest + bits);
}

static inline void model_put_arbitration(char *text, const cw_frame *f, model_levels levels)
{
    bool remote = f->flags & CW_FRAME_REMOTE;
    model_put(text, 0, 1);
    if (!(f->flags & CW_FRAME_EXTENDED)) {
        model_put(text, f->id, 11);
        model_put(text, remote, 1);
        model_put(text, 0, 1);
    } else {
        model_put(text, f->id >> 18, 11);
        model_put_level(text, levels.srr);
        model_put(text, 1, 1);
        model_put(text, f->id & 0x3FFFFu, 18);
        model_put(text, remote, 1);
        model_put_level(text, levels.r1);
    }
    model_put_level(text, levels.r0);
}

/* Returns true when the last five bits of the text are equal. */
static inline bool model_run_of_five(const char *text, size_t length)
{
    return length >= 5 && (strncmp(text + length - 5, "00000", 5) == 0 ||
                           strncmp(text + length - 5, "11111", 5) == 0);
}

static inline void model_stuff(model *m)
{
    m->length = 0;
    for (size_t i = 0; m->plain[i]; i++) {
        m->at[i] = m->length;
        m->wire[m->length++] = m->plain[i];
        if (model_run_of_five(m->wire, m->length))
            m->wire[m->length++] = m->plain[i] == '1' ? '0' : '1';
    }
    m->stuffed = m->length;
    strcpy(m->wire + m->length, MODEL_TAIL);
    m->length += MODEL_TAIL_BITS;
}

static inline model model_encode_as(const cw_frame *f, model_levels levels)
{
    model m = {.plain = ""};
    unsigned bytes = f->flags & CW_FRAME_REMOTE ? 0 : f->dlc > 8 ? 8 : f->dlc;
    model_put_arbitration(m.plain, f, levels);
    model_put(m.plain, f->dlc, 4);
    for (unsigned i = 0; i < bytes; i++)
        model_put(m.plain, f->data[i], 8);
    model_put_crc(m.plain);
    model_stuff(&m);
    return m;
}

static inline model model_encode(const cw_frame *f)
{
    return model_encode_as(f, (model_levels){.srr = '1', .r1 = '0', .r0 = '0'});
}

#endif
