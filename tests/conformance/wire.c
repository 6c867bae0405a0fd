/* SPDX-License-Identifier: MIT
 *
 * wire.c - the bench's own frame encoder: a list of bits, the CRC by long division.
 */
#include "wire.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHANGES_MAX 8
#define CRC_BITS 15
#define DIVISOR "1100010110011001" /* F6, the leading term included */

typedef struct change {
    char kind; /* ^ or ~ */
    cw_place place;
} change;

typedef struct raw { /* the frame before stuffing */
    unsigned length;
    wire_bit bit[WIRE_MAX];
} raw;

typedef struct field_name {
    const char *name;
    cw_field field;
} field_name;

/* A name comes before those that are its beginning. */
static const field_name names[] = {
    {"sof", CW_FIELD_SOF},
    {"ide", CW_FIELD_IDE},
    {"id", CW_FIELD_ID},
    {"srr", CW_FIELD_SRR},
    {"rtr", CW_FIELD_RTR},
    {"r1", CW_FIELD_R1},
    {"r0", CW_FIELD_R0},
    {"dlc", CW_FIELD_DLC},
    {"data", CW_FIELD_DATA},
    {"crcdel", CW_FIELD_CRC_DELIMITER},
    {"crc", CW_FIELD_CRC},
    {"ackdel", CW_FIELD_ACK_DELIMITER},
    {"ack", CW_FIELD_ACK_SLOT},
    {"eof", CW_FIELD_EOF},
    {"int", CW_FIELD_INTERMISSION},
    {"susp", CW_FIELD_SUSPEND},
    {"errflag", CW_FIELD_ERROR_FLAG},
    {"errdel", CW_FIELD_ERROR_DELIMITER},
    {"ovlflag", CW_FIELD_OVERLOAD_FLAG},
    {"ovldel", CW_FIELD_OVERLOAD_DELIMITER},
    {"none", CW_FIELD_NONE},
};
#define NAME_COUNT (sizeof names / sizeof names[0])

static bool parse_frame(cw_frame *out, const char **text);
static bool parse_changes(change *out, unsigned *count, bool *no_sof, const char **text);
static void build(wire *w, const change *changes, unsigned count);
static void drop_sof(wire *w);
static bool library_agrees(const wire *w);

const char *wire_parse(wire *out, const char *text)
{
    change changes[CHANGES_MAX] = {0};
    unsigned count = 0;

    *out = (wire){0};
    if (!parse_frame(&out->frame, &text))
        return NULL;
    if (!parse_changes(changes, &count, &out->no_sof, &text))
        return NULL;
    build(out, changes, count);
    if (count == 0 && !library_agrees(out))
        return NULL;
    if (out->no_sof)
        drop_sof(out);
    return text;
}

const char *wire_parse_place(cw_place *out, int *nth_stuff, const char *text)
{
    char *end;

    *out = (cw_place){0};
    *nth_stuff = -1;
    if (strncmp(text, "st", 2) == 0) {
        *nth_stuff = (int)strtol(text + 2, &end, 10);
        return end > text + 2 ? end : NULL;
    }
    for (size_t i = 0; i < NAME_COUNT; i++) {
        size_t length = strlen(names[i].name);
        if (strncmp(text, names[i].name, length) != 0)
            continue;
        out->field = names[i].field;
        out->index = (uint8_t)strtol(text + length, &end, 10);
        out->stuff = *end == 's';
        return end + (out->stuff ? 1 : 0);
    }
    return NULL;
}

int wire_find(const wire *w, const char *text, const char **end)
{
    cw_place place;
    int nth;

    *end = wire_parse_place(&place, &nth, text);
    for (unsigned i = 0; *end && i < w->length; i++) {
        bool stuff = w->bit[i].place.stuff;
        if (nth >= 0 ? stuff && nth-- == 0 : wire_same_place(w->bit[i].place, place))
            return (int)i;
    }
    return -1;
}

const char *wire_place_text(char *buffer, cw_place place)
{
    const char *name = "?";

    for (size_t i = 0; i < NAME_COUNT; i++) {
        if (names[i].field == place.field)
            name = names[i].name;
    }
    snprintf(buffer, NAME_MAX_LENGTH, "%s%u%s", name, place.index, place.stuff ? "s" : "");
    return buffer;
}

unsigned wire_lost_bit(const wire *w, unsigned index)
{
    const unsigned base_bits = 11, srr = 11, ide = 12, further = 13, last = 31;
    bool extended = (w->frame.flags & CW_FRAME_EXTENDED) != 0;
    cw_place place = w->bit[index].place;

    if (place.field == CW_FIELD_IDE)
        return ide;
    if (place.field == CW_FIELD_RTR && extended)
        return last;
    if (place.field == CW_FIELD_RTR || place.field == CW_FIELD_SRR)
        return srr;
    return place.index < base_bits ? place.index : further + place.index - base_bits;
}

bool wire_same_place(cw_place a, cw_place b)
{
    return a.field == b.field && a.index == b.index && a.stuff == b.stuff;
}

/* ---- Reading --------------------------------------------------------------------------------- */

static unsigned hex_value(char c)
{
    return (unsigned)(c <= '9' ? c - '0' : c - 'A' + 10);
}

static bool is_hex(char c)
{
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'F');
}

static void parse_data(cw_frame *out, const char **text)
{
    const char *p = *text;

    for (; is_hex(p[0]) && is_hex(p[1]); p += 2)
        out->data[out->dlc++] = (uint8_t)(hex_value(p[0]) << 4 | hex_value(p[1]));
    if (*p == '_') {
        out->dlc = (uint8_t)hex_value(p[1]);
        p += 2;
    }
    *text = p;
}

static bool parse_frame(cw_frame *out, const char **text)
{
    const unsigned extended_digits = 8;
    const char *p = *text;
    unsigned digits = 0;

    for (; is_hex(*p); p++, digits++)
        out->id = out->id << 4 | hex_value(*p);
    if (*p++ != '#')
        return false;
    if (digits == extended_digits)
        out->flags |= CW_FRAME_EXTENDED;
    if (*p == 'R') {
        out->flags |= CW_FRAME_REMOTE;
        p++;
        if (is_hex(*p))
            out->dlc = (uint8_t)hex_value(*p++);
    } else {
        parse_data(out, &p);
    }
    *text = p;
    return true;
}

static bool parse_changes(change *out, unsigned *count, bool *no_sof, const char **text)
{
    const char *p = *text;
    int nth;

    for (; p && (*p == '^' || *p == '~') && *count < CHANGES_MAX; ++*count) {
        out[*count].kind = *p;
        p = wire_parse_place(&out[*count].place, &nth, p + 1);
    }
    if (p && strncmp(p, "!sof", 4) == 0) {
        *no_sof = true;
        p += 4;
    }
    *text = p;
    return p != NULL;
}

/* ---- Encoding -------------------------------------------------------------------------------- */

static void put(raw *r, cw_field field, unsigned first, unsigned bits, unsigned value)
{
    for (unsigned i = 0; i < bits; i++) {
        wire_bit *bit = &r->bit[r->length++];
        bit->place = (cw_place){.field = field, .index = (uint8_t)(first + i)};
        bit->level = (value >> (bits - 1 - i) & 1) != 0;
        bit->arbitration = field == CW_FIELD_ID || field == CW_FIELD_SRR || field == CW_FIELD_RTR;
    }
}

static void put_header(raw *r, const cw_frame *frame)
{
    bool extended = (frame->flags & CW_FRAME_EXTENDED) != 0;
    unsigned rtr = (frame->flags & CW_FRAME_REMOTE) != 0;

    put(r, CW_FIELD_SOF, 0, 1, 0);
    if (extended) {
        put(r, CW_FIELD_ID, 0, 11, frame->id >> 18);
        put(r, CW_FIELD_SRR, 0, 1, 1);
        put(r, CW_FIELD_IDE, 0, 1, 1);
        r->bit[r->length - 1].arbitration = true;
        put(r, CW_FIELD_ID, 11, 18, frame->id & 0x3FFFF);
        put(r, CW_FIELD_RTR, 0, 1, rtr);
        put(r, CW_FIELD_R1, 0, 1, 0);
    } else {
        put(r, CW_FIELD_ID, 0, 11, frame->id);
        put(r, CW_FIELD_RTR, 0, 1, rtr);
        put(r, CW_FIELD_IDE, 0, 1, 0);
    }
    put(r, CW_FIELD_R0, 0, 1, 0);
    put(r, CW_FIELD_DLC, 0, 4, frame->dlc);
}

static void put_data(raw *r, const cw_frame *frame)
{
    unsigned bytes = frame->dlc < 8 ? frame->dlc : 8;

    if (frame->flags & CW_FRAME_REMOTE)
        return;
    for (unsigned i = 0; i < bytes; i++)
        put(r, CW_FIELD_DATA, 8 * i, 8, frame->data[i]);
}

/* Returns the remainder of the message, with 15 zeros appended, divided by the generator. */
static unsigned crc_of(const raw *r)
{
    bool rest[WIRE_MAX + CRC_BITS] = {false};
    unsigned crc = 0;

    for (unsigned i = 0; i < r->length; i++)
        rest[i] = r->bit[i].level;
    for (unsigned i = 0; i < r->length; i++) {
        bool divide = rest[i];
        for (unsigned k = 0; divide && k <= CRC_BITS; k++)
            rest[i + k] = rest[i + k] != (DIVISOR[k] == '1');
    }
    for (unsigned k = 0; k < CRC_BITS; k++)
        crc = crc << 1 | rest[r->length + k];
    return crc;
}

static bool invert(raw *r, char kind, const change *changes, unsigned count)
{
    bool any = false;

    for (unsigned c = 0; c < count; c++) {
        for (unsigned i = 0; i < r->length && changes[c].kind == kind; i++) {
            if (!wire_same_place(r->bit[i].place, changes[c].place))
                continue;
            r->bit[i].level = !r->bit[i].level;
            any = true;
        }
    }
    return any;
}

static void stuff(wire *w, const raw *r)
{
    unsigned run = 0;

    for (unsigned i = 0; i < r->length; i++) {
        bool same = w->length > 0 && w->bit[w->length - 1].level == r->bit[i].level;
        w->bit[w->length++] = r->bit[i];
        run = same ? run + 1 : 1;
        if (run < 5)
            continue;
        w->bit[w->length] = r->bit[i];
        w->bit[w->length].level = !r->bit[i].level;
        w->bit[w->length++].place.stuff = true;
        w->stuff_bits++;
        run = 1;
    }
}

static void build(wire *w, const change *changes, unsigned count)
{
    raw body = {0}, tail = {0};

    put_header(&body, &w->frame);
    put_data(&body, &w->frame);
    invert(&body, '^', changes, count);
    put(&body, CW_FIELD_CRC, 0, CRC_BITS, crc_of(&body));
    w->crc_wrong = invert(&body, '~', changes, count) || w->no_sof;
    stuff(w, &body);
    put(&tail, CW_FIELD_CRC_DELIMITER, 0, 1, 1);
    put(&tail, CW_FIELD_ACK_SLOT, 0, 1, 1);
    put(&tail, CW_FIELD_ACK_DELIMITER, 0, 1, 1);
    put(&tail, CW_FIELD_EOF, 0, 7, 0x7F);
    w->ack = w->length + 1;
    memcpy(&w->bit[w->length], tail.bit, tail.length * sizeof tail.bit[0]);
    w->length += tail.length;
}

static void drop_sof(wire *w)
{
    memmove(&w->bit[0], &w->bit[1], --w->length * sizeof w->bit[0]);
    w->ack--;
}

static bool library_agrees(const wire *w)
{
    cw_bits bits;

    if (cw_bits_encode(&bits, &w->frame) != CW_OK || bits.length != w->length)
        return false;
    for (unsigned i = 0; i < w->length; i++) {
        if (cw_bits_level(&bits, i) != w->bit[i].level)
            return false;
        if (!wire_same_place(cw_bits_place(&bits, i), w->bit[i].place))
            return false;
    }
    return true;
}
