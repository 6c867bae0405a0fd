/* SPDX-License-Identifier: MIT
 *
 * wire.c - the bench's own frame encoder: a list of bits, the CRC by long division.
 */
#include "wire.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHANGES_MAX 8
#define LONG_BYTES 20
#define NON_ISO_DIGIT 8u
#define CRC_BITS_MAX 21
#define FIXED_DISTANCE 4 /* CRC bits that follow a fixed stuff bit (D4) */

/* A polynomial, the leading term included (F6, D6). */
typedef struct divisor {
    unsigned bits; /* of the CRC */
    const char *terms;
} divisor;

static const divisor crc15 = {15, "1100010110011001"};
static const divisor crc17 = {17, "110110100001011011"};
static const divisor crc21 = {21, "1100000010100010011001"};

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
    {"fdf", CW_FIELD_FDF},
    {"res", CW_FIELD_RES},
    {"brs", CW_FIELD_BRS},
    {"esi", CW_FIELD_ESI},
    {"dlc", CW_FIELD_DLC},
    {"data", CW_FIELD_DATA},
    {"sc", CW_FIELD_STUFF_COUNT},
    {"fs", CW_FIELD_FIXED_STUFF},
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

static wire_format format_of_frames;

static bool parse_frame(cw_frame *out, const char **text);
static bool parse_changes(change *out, unsigned *count, bool *no_sof, const char **text);
static void build(wire *w, const change *changes, unsigned count);
static void drop_sof(wire *w);
static bool library_agrees(const wire *w);

void wire_set_format(wire_format format)
{
    format_of_frames = format;
}

bool wire_is_fd(void)
{
    return format_of_frames != WIRE_CLASSICAL;
}

const char *wire_format_text(void)
{
    static const char *const texts[] = {"", "#0", "#1", "#8"};

    return texts[format_of_frames];
}

static bool is_fd(const cw_frame *frame)
{
    return (frame->flags & CW_FRAME_FD) != 0;
}

/* Takes ESI out of the set of flags that the node decides itself. */
static void set_esi(cw_frame *frame, bool passive)
{
    if (is_fd(frame))
        frame->flags = (uint8_t)((frame->flags & ~CW_FRAME_ESI) | (passive ? CW_FRAME_ESI : 0));
}

static const char *parse_and_build(wire *out, const char *text, bool sent, bool passive)
{
    change changes[CHANGES_MAX] = {0};
    unsigned count = 0;

    *out = (wire){0};
    if (!parse_frame(&out->frame, &text))
        return NULL;
    if (!parse_changes(changes, &count, &out->no_sof, &text))
        return NULL;
    if (sent)
        set_esi(&out->frame, passive);
    build(out, changes, count);
    if (count == 0 && !library_agrees(out))
        return NULL;
    if (out->no_sof)
        drop_sof(out);
    return text;
}

const char *wire_parse(wire *out, const char *text)
{
    return parse_and_build(out, text, false, false);
}

const char *wire_parse_sent(wire *out, const char *text, bool passive)
{
    return parse_and_build(out, text, true, passive);
}

unsigned wire_data_bytes(const cw_frame *frame)
{
    static const unsigned bytes[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    const unsigned most = is_fd(frame) ? 64 : 8;

    if (frame->flags & CW_FRAME_REMOTE)
        return 0;
    return bytes[frame->dlc & 0xF] < most ? bytes[frame->dlc & 0xF] : most;
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
    if (strncmp(text, "ackend", 6) == 0) {
        *out = (cw_place){.field = CW_FIELD_ACK_SLOT, .index = wire_is_fd()};
        return text + 6;
    }
    for (size_t i = 0; i < NAME_COUNT; i++) {
        size_t length = strlen(names[i].name);
        if (strncmp(text, names[i].name, length) != 0)
            continue;
        out->field = names[i].field;
        out->index = (uint16_t)strtol(text + length, &end, 10);
        out->stuff = *end == 's' || out->field == CW_FIELD_FIXED_STUFF;
        return end + (*end == 's' ? 1 : 0);
    }
    return NULL;
}

int wire_find(const wire *w, const char *text, const char **end)
{
    cw_place place;
    int nth;

    *end = wire_parse_place(&place, &nth, text);
    for (unsigned i = 0; *end && i < w->length; i++) {
        bool stuff = w->bit[i].place.stuff && w->bit[i].place.field != CW_FIELD_FIXED_STUFF;
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
    bool shows_stuff = place.stuff && place.field != CW_FIELD_FIXED_STUFF;
    snprintf(buffer, NAME_MAX_LENGTH, "%s%u%s", name, place.index, shows_stuff ? "s" : "");
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

/* Reads bytes and how often the last one is repeated. Returns their number. */
static unsigned parse_bytes(cw_frame *out, const char **text)
{
    const char *p = *text;
    unsigned count = 0;

    while (is_hex(p[0]) && is_hex(p[1]) && count < CW_FRAME_DATA_MAX) {
        uint8_t byte = (uint8_t)(hex_value(p[0]) << 4 | hex_value(p[1]));
        unsigned times = 1;
        p += 2;
        if (*p == 'x') {
            char *end;
            times = (unsigned)strtoul(p + 1, &end, 10);
            p = end;
        }
        for (; times > 0 && count < CW_FRAME_DATA_MAX; times--)
            out->data[count++] = byte;
    }
    *text = p;
    return count;
}

static void parse_data(cw_frame *out, const char **text)
{
    const char *p = *text;
    unsigned bytes = parse_bytes(out, &p);

    while (wire_data_bytes(out) < bytes && out->dlc < 15)
        out->dlc++;
    if (*p == '_') {
        out->dlc = (uint8_t)hex_value(p[1]);
        p += 2;
    }
    *text = p;
}

static void parse_fd_flags(cw_frame *out, unsigned digit)
{
    out->flags |= CW_FRAME_FD;
    out->flags |= digit & 1 ? CW_FRAME_BRS : 0;
    out->flags |= digit & 2 ? CW_FRAME_ESI : 0;
    out->flags |= digit & NON_ISO_DIGIT ? CW_FRAME_NON_ISO : 0;
}

/* Gives a classical data frame the format of all frames. */
static void convert(cw_frame *out)
{
    unsigned bytes = wire_data_bytes(out);

    if (!wire_is_fd())
        return;
    out->flags |= CW_FRAME_FD;
    out->flags |= format_of_frames == WIRE_FD_NON_ISO ? CW_FRAME_NON_ISO : 0;
    if (format_of_frames != WIRE_FD_LONG)
        return;
    out->flags |= CW_FRAME_BRS;
    for (unsigned i = bytes; bytes > 0 && i < LONG_BYTES; i++)
        out->data[i] = out->data[i % bytes];
    while (bytes > 0 && wire_data_bytes(out) < LONG_BYTES)
        out->dlc++;
}

static bool parse_content(cw_frame *out, const char **text)
{
    const char *p = *text;
    bool as_it_is = *p == '=';

    if (*p == '#') {
        if (!is_hex(p[1]))
            return false;
        parse_fd_flags(out, hex_value(p[1]));
        p += 2;
        parse_data(out, &p);
    } else if (*p == 'R') {
        out->flags |= CW_FRAME_REMOTE;
        p++;
        if (is_hex(*p))
            out->dlc = (uint8_t)hex_value(*p++);
    } else {
        p += as_it_is;
        parse_data(out, &p);
        if (!as_it_is)
            convert(out);
    }
    *text = p;
    return true;
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
    *text = p;
    return parse_content(out, text);
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
        bit->place = (cw_place){.field = field, .index = (uint16_t)(first + i)};
        bit->level = (value >> (bits - 1 - i) & 1) != 0;
        bit->arbitration = field == CW_FIELD_ID || field == CW_FIELD_SRR || field == CW_FIELD_RTR;
    }
}

/* Puts r1 and r0 of a classical frame, or FDF to ESI. */
static void put_reserved(raw *r, const cw_frame *frame)
{
    if (is_fd(frame)) {
        put(r, CW_FIELD_FDF, 0, 1, 1);
        put(r, CW_FIELD_RES, 0, 1, 0);
        put(r, CW_FIELD_BRS, 0, 1, (frame->flags & CW_FRAME_BRS) != 0);
        put(r, CW_FIELD_ESI, 0, 1, (frame->flags & CW_FRAME_ESI) != 0);
        return;
    }
    if (frame->flags & CW_FRAME_EXTENDED)
        put(r, CW_FIELD_R1, 0, 1, 0);
    put(r, CW_FIELD_R0, 0, 1, 0);
}

static void put_header(raw *r, const cw_frame *frame)
{
    unsigned rtr = (frame->flags & CW_FRAME_REMOTE) != 0;

    put(r, CW_FIELD_SOF, 0, 1, 0);
    if (frame->flags & CW_FRAME_EXTENDED) {
        put(r, CW_FIELD_ID, 0, 11, frame->id >> 18);
        put(r, CW_FIELD_SRR, 0, 1, 1);
        put(r, CW_FIELD_IDE, 0, 1, 1);
        r->bit[r->length - 1].arbitration = true;
        put(r, CW_FIELD_ID, 11, 18, frame->id & 0x3FFFF);
        put(r, CW_FIELD_RTR, 0, 1, rtr);
    } else {
        put(r, CW_FIELD_ID, 0, 11, frame->id);
        put(r, CW_FIELD_RTR, 0, 1, rtr);
        put(r, CW_FIELD_IDE, 0, 1, 0);
    }
    put_reserved(r, frame);
    put(r, CW_FIELD_DLC, 0, 4, frame->dlc);
}

static void put_data(raw *r, const cw_frame *frame)
{
    for (unsigned i = 0; i < wire_data_bytes(frame); i++)
        put(r, CW_FIELD_DATA, 8 * i, 8, frame->data[i]);
}

/* Returns the remainder of the message, with as many zeros appended as the CRC has bits, divided by
 * the generator. A CRC that begins with its top bit 1 has the first bit inverted. */
static unsigned crc_of(const raw *r, const divisor *by, bool first_inverted)
{
    bool rest[WIRE_MAX + CRC_BITS_MAX] = {false};
    unsigned crc = 0;

    for (unsigned i = 0; i < r->length; i++)
        rest[i] = r->bit[i].level != (i == 0 && first_inverted);
    for (unsigned i = 0; i < r->length; i++) {
        bool divide = rest[i];
        for (unsigned k = 0; divide && k <= by->bits; k++)
            rest[i + k] = rest[i + k] != (by->terms[k] == '1');
    }
    for (unsigned k = 0; k < by->bits; k++)
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

/* Appends bits with stuff bits. Without one at the end, a run there gets none (D3). */
static void stuff(raw *out, const raw *r, bool also_at_end)
{
    unsigned run = 0;

    for (unsigned i = 0; i < r->length; i++) {
        bool same = out->length > 0 && out->bit[out->length - 1].level == r->bit[i].level;
        out->bit[out->length++] = r->bit[i];
        run = same ? run + 1 : 1;
        if (run < 5 || (i + 1 == r->length && !also_at_end))
            continue;
        out->bit[out->length] = r->bit[i];
        out->bit[out->length].level = !r->bit[i].level;
        out->bit[out->length++].place.stuff = true;
        run = 1;
    }
}

/* Appends bits with a fixed stuff bit before the first one and after every fourth one (D4). */
static void stuff_fixed(raw *out, const raw *r)
{
    for (unsigned i = 0; i < r->length; i++) {
        if (i % FIXED_DISTANCE == 0) {
            bool before = out->bit[out->length - 1].level;
            put(out, CW_FIELD_FIXED_STUFF, i / FIXED_DISTANCE, 1, !before);
            out->bit[out->length - 1].place.stuff = true;
        }
        out->bit[out->length++] = r->bit[i];
    }
}

static void put_classical(wire *w, raw *out, raw *body, const change *changes, unsigned count)
{
    put(body, CW_FIELD_CRC, 0, crc15.bits, crc_of(body, &crc15, false));
    w->crc_wrong = invert(body, '~', changes, count) || w->no_sof;
    stuff(out, body, true);
    w->stuff_bits = out->length - body->length;
}

/* The stuff count with its parity as D5 writes it. */
static void put_stuff_count(raw *r, unsigned stuff_bits)
{
    static const char *const gray[] = {"000", "001", "011", "010", "110", "111", "101", "100"};
    const char *digits = gray[stuff_bits % 8];
    unsigned ones = 0;

    for (unsigned i = 0; i < 3; i++) {
        put(r, CW_FIELD_STUFF_COUNT, i, 1, digits[i] == '1');
        ones += digits[i] == '1';
    }
    put(r, CW_FIELD_STUFF_COUNT, 3, 1, ones % 2);
}

static void append(raw *out, const raw *r)
{
    memcpy(&out->bit[out->length], r->bit, r->length * sizeof r->bit[0]);
    out->length += r->length;
}

/* Puts what follows the stuff count of an FD frame, before its fixed stuff bits are there. */
static void put_fd_crc(raw *check, const raw *stuffed, const cw_frame *frame)
{
    static raw covered;
    const bool non_iso = (frame->flags & CW_FRAME_NON_ISO) != 0;
    const divisor *by = wire_data_bytes(frame) <= 16 ? &crc17 : &crc21;

    covered = *stuffed;
    append(&covered, check);
    put(check, CW_FIELD_CRC, 0, by->bits, crc_of(&covered, by, !non_iso));
}

static void put_fd(wire *w, raw *out, raw *body, const change *changes, unsigned count)
{
    raw check = {0};

    stuff(out, body, false);
    w->stuff_bits = out->length - body->length;
    if (!(w->frame.flags & CW_FRAME_NON_ISO))
        put_stuff_count(&check, w->stuff_bits);
    const bool count_wrong = invert(&check, '^', changes, count); /* under a CRC that is right */
    put_fd_crc(&check, out, &w->frame);
    const bool data_wrong = invert(body, '~', changes, count);
    const bool check_wrong = invert(&check, '~', changes, count);
    w->crc_wrong = data_wrong || count_wrong || check_wrong || w->no_sof;
    out->length = 0;
    stuff(out, body, false);
    stuff_fixed(out, &check);
}

static void build(wire *w, const change *changes, unsigned count)
{
    raw body = {0}, out = {0};

    put_header(&body, &w->frame);
    put_data(&body, &w->frame);
    invert(&body, '^', changes, count);
    if (is_fd(&w->frame))
        put_fd(w, &out, &body, changes, count);
    else
        put_classical(w, &out, &body, changes, count);
    put(&out, CW_FIELD_CRC_DELIMITER, 0, 1, 1);
    w->ack = out.length;
    put(&out, CW_FIELD_ACK_SLOT, 0, 1, 1);
    if (is_fd(&w->frame))
        put(&out, CW_FIELD_ACK_SLOT, 1, 1, 1);
    put(&out, CW_FIELD_ACK_DELIMITER, 0, 1, 1);
    put(&out, CW_FIELD_EOF, 0, 7, 0x7F);
    memcpy(w->bit, out.bit, out.length * sizeof out.bit[0]);
    w->length = out.length;
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
