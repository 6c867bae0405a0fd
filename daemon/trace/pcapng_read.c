/* SPDX-License-Identifier: MIT
 *
 * pcapng_read.c - reads captures: pcapng and the older pcap, with LINKTYPE_CAN_SOCKETCAN (227).
 *
 * A pcapng file is a sequence of blocks: type, length, body, length again. Each section (SHB) has
 * its own byte order and its own interfaces (IDB); packets are in EPB, SPB or the obsolete PB.
 */
#include "base/text/wide.h"
#include "trace/format.h"
#include "trace/pcapng_format.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define BLOCK_MAX (16u * 1024u * 1024u)
#define BLOCK_LEAST (BLOCK_HEAD + BLOCK_FOOT)
#define IDB_READ_MAX 8192u /* bytes of it that are read */

#define RESOLUTION_DEFAULT 6u /* 10^-6 s */
#define RESOLUTION_BINARY 0x80u
#define RESOLUTION_DECIMAL_MAX 19u
#define RESOLUTION_BINARY_MAX 63u
#define NS_PER_S UINT64_C(1000000000)
#define SECONDS_MAX (UINT64_MAX / 2 / NS_PER_S)

#define PCAP_HEAD 24u
#define PCAP_PACKET_HEAD 16u
#define PCAP_US 0xA1B2C3D4u
#define PCAP_NS 0xA1B23C4Du

/* ---- Numbers --------------------------------------------------------------------------------- */

static uint32_t big32(const unsigned char *b)
{
    return (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 8 | b[3];
}

static uint32_t ordered32(bool big_endian, const unsigned char *b)
{
    uint32_t big = big32(b);
    return big_endian ? big : __builtin_bswap32(big);
}

static uint32_t get32(const pcap_state *s, const unsigned char *b)
{
    return ordered32(s->big_endian, b);
}

static uint16_t get16(const pcap_state *s, const unsigned char *b)
{
    return (uint16_t)(s->big_endian ? b[0] << 8 | b[1] : b[1] << 8 | b[0]);
}

static uint64_t get64(const pcap_state *s, const unsigned char *b)
{
    uint64_t first = get32(s, b);
    uint64_t second = get32(s, b + 4);
    return s->big_endian ? first << 32 | second : second << 32 | first;
}

/* Returns the next bytes, which must exist. */
static trace_result need(trace_input *in, const unsigned char **bytes, size_t count)
{
    trace_result result = trace_bytes(in, bytes, count);
    return result == TRACE_END ? trace_bad_end(in) : result;
}

/* Refuses the file as a whole. */
static trace_result pcapng_read_refuse(trace_input *in)
{
    in->failed = true;
    return TRACE_BAD;
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* Converts a count in units of the interface to nanoseconds; returns false on overflow. */
static bool time_of(uint64_t *ns, const pcap_interface *i, uint64_t count)
{
    unsigned power = i->resolution & ~RESOLUTION_BINARY;
    uint64_t units = 1; /* in a second */
    uint64_t rest;
    if (i->resolution & RESOLUTION_BINARY)
        units <<= power;
    else
        for (unsigned k = 0; k < power; k++)
            units *= 10;
    uint64_t seconds = count / units;
    if (seconds > SECONDS_MAX)
        return false;
    int64_t whole = (int64_t)seconds + i->offset_s;
    if (whole < 0 || (uint64_t)whole > SECONDS_MAX)
        return false;
    *ns = (uint64_t)whole * NS_PER_S +
          wide_divide(&rest, wide_product(count % units, NS_PER_S), units).low;
    return true;
}

/* ---- Packets --------------------------------------------------------------------------------- */

/* A packet as announced; `captured` bytes of it follow in the file. */
typedef struct packet {
    uint64_t place; /* of its block */
    uint32_t captured;
    uint16_t link_type;
} packet;

/* A capture may have cut frames off: their data are not known. */
static trace_result pcapng_take_data(trace_input *in, trace_record *r, const packet *p,
                                     const unsigned char *b)
{
    unsigned length = b[4];
    if (p->captured < CAN_HEAD + length)
        return trace_bad_byte(
            in, p->place, "%" PRIu32 " bytes of a CAN frame of %u: cut off when it was captured",
            p->captured, CAN_HEAD + length);
    memcpy(r->frame.data, b + CAN_HEAD, length);
    return TRACE_RECORD;
}

/* Reads the identifier and whether it is an extended one. */
static trace_result pcapng_take_id(trace_input *in, trace_record *r, const packet *p, uint32_t id)
{
    r->frame.flags = (uint8_t)(id & CAN_EXTENDED ? CW_FRAME_EXTENDED : 0);
    r->frame.id = id & (CAN_REMOTE - 1);
    if (r->frame.id > (r->frame.flags ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX))
        return trace_bad_byte(
            in, p->place, "the identifier %" PRIX32 " of a base frame is over 7FF", r->frame.id);
    return TRACE_RECORD;
}

/* Reads a classical frame. A DLC above 8 stands in a byte of its own. */
static trace_result pcapng_take_frame(trace_input *in, trace_record *r, const packet *p,
                                      const unsigned char *b)
{
    uint32_t id = big32(b);
    uint8_t length = b[4];
    if (length > 8)
        return trace_bad_byte(in, p->place, "a classical CAN frame with %u data bytes", length);
    if (pcapng_take_id(in, r, p, id) != TRACE_RECORD)
        return TRACE_BAD;
    r->frame.dlc = length == 8 && b[7] > 8 && b[7] <= 15 ? b[7] : length;
    if (id & CAN_REMOTE) {
        r->frame.flags |= CW_FRAME_REMOTE;
        return TRACE_RECORD;
    }
    return pcapng_take_data(in, r, p, b);
}

/* Reads a CAN FD frame. A length that none has is rounded up (D2), as drivers do. */
static trace_result read_fd_frame(trace_input *in, trace_record *r, const packet *p,
                                  const unsigned char *b)
{
    uint8_t length = b[4];
    if (length > CW_FRAME_DATA_MAX)
        return trace_bad_byte(in, p->place, "a CAN FD frame with %u data bytes", length);
    if (pcapng_take_id(in, r, p, big32(b) & ~CAN_REMOTE & ~CAN_ERROR) != TRACE_RECORD)
        return TRACE_BAD;
    r->frame.flags |= (uint8_t)(CW_FRAME_FD | (b[5] & CAN_BRS ? CW_FRAME_BRS : 0) |
                                (b[5] & CAN_ESI ? CW_FRAME_ESI : 0));
    r->frame.dlc = (uint8_t)cw_fd_dlc(length);
    return pcapng_take_data(in, r, p, b);
}

/* Takes the bytes of a packet, and the padding up to `space`. */
static trace_result read_packet(trace_input *in, trace_record *r, const packet *p, uint32_t space)
{
    const unsigned char *b;
    uint32_t count = p->captured < CAN_FD_BYTES_MAX ? p->captured : CAN_FD_BYTES_MAX;
    r->place = p->place;
    if (p->link_type != LINKTYPE_CAN_SOCKETCAN) {
        r->kind = TRACE_OTHER;
        return trace_skip(in, space);
    }
    if (count < CAN_HEAD)
        return trace_bad_byte(in, p->place,
                              "%" PRIu32 " bytes of a CAN frame: cut off when it was captured",
                              p->captured);
    trace_result result = need(in, &b, count);
    if (result != TRACE_RECORD)
        return TRACE_BAD;
    if (b[4] & CAN_XLF)
        r->kind = TRACE_XL_FRAME;
    else if ((b[5] & CAN_FDF) || p->captured > CAN_BYTES_MAX)
        r->kind = TRACE_FD_FRAME;
    else if (big32(b) & CAN_ERROR)
        r->kind = TRACE_ERROR_FRAME;
    if (r->kind == TRACE_FRAME)
        result = pcapng_take_frame(in, r, p, b);
    else if (r->kind == TRACE_FD_FRAME)
        result = read_fd_frame(in, r, p, b);
    return result == TRACE_RECORD ? trace_skip(in, space - count) : result;
}

/* Sets the time of a packet, counted in units of its interface. */
static trace_result stamp(trace_input *in, trace_record *r, const packet *p,
                          const pcap_interface *i, uint64_t count)
{
    r->timed = true;
    if (!time_of(&r->time_ns, i, count))
        return trace_bad_byte(in, p->place, "the time of this packet is out of range");
    return TRACE_RECORD;
}

/* ---- Interfaces ------------------------------------------------------------------------------ */

/* Takes the options that change how packets are read. Others do not matter. */
static void read_option(const pcap_state *s, pcap_interface *i, unsigned code,
                        const unsigned char *value, unsigned length)
{
    if (code == OPTION_IF_NAME) {
        unsigned kept = length < TRACE_CHANNEL_MAX - 1 ? length : TRACE_CHANNEL_MAX - 1;
        memcpy(i->name, value, kept);
        i->name[kept] = '\0';
    } else if (code == OPTION_IF_TSRESOL && length >= 1) {
        i->resolution = value[0];
    } else if (code == OPTION_IF_TSOFFSET && length >= 8) {
        i->offset_s = (int64_t)get64(s, value);
    }
}

/* Options may end without their end mark. One that is cut off ends them, too. */
static void read_options(const pcap_state *s, pcap_interface *i, const unsigned char *b,
                         size_t left)
{
    while (left >= 4) {
        unsigned code = get16(s, b);
        unsigned length = get16(s, b + 2);
        size_t whole = 4 + ((length + 3u) & ~3u);
        if (code == OPTION_END || whole > left)
            return;
        read_option(s, i, code, b + 4, length);
        b += whole;
        left -= whole;
    }
}

/* Returns false for a resolution or an offset with which times would overflow. */
static bool interface_valid(const pcap_interface *i)
{
    unsigned power = i->resolution & ~RESOLUTION_BINARY;
    bool offset = i->offset_s <= (int64_t)SECONDS_MAX && i->offset_s >= -(int64_t)SECONDS_MAX;
    return offset && power <= (i->resolution & RESOLUTION_BINARY ? RESOLUTION_BINARY_MAX
                                                                 : RESOLUTION_DECIMAL_MAX);
}

/* An interface that cannot be read still has its number, which packets refer to. */
static trace_result read_interface(trace_input *in, pcap_state *s, uint64_t place, uint32_t body)
{
    const unsigned char *b;
    uint32_t count = body < IDB_READ_MAX ? body : IDB_READ_MAX;
    if (s->interface_count == TRACE_INTERFACES_MAX)
        return trace_bad_byte(in, place, "more than %u interfaces", TRACE_INTERFACES_MAX);
    const unsigned number = s->interface_count++;
    pcap_interface *i = &s->interfaces[number];
    i->unusable = true;
    if (body < 8)
        return trace_bad_byte(in, place, "an interface block that is too short");
    if (need(in, &b, count) != TRACE_RECORD)
        return TRACE_BAD;
    *i = (pcap_interface){
        .link_type = get16(s, b), .snap_length = get32(s, b + 4), .resolution = RESOLUTION_DEFAULT};
    (void)snprintf(i->name, sizeof i->name, "%u", number);
    read_options(s, i, b + 8, count - 8);
    i->unusable = !interface_valid(i);
    if (i->unusable)
        return trace_bad_byte(in, place,
                              "time stamps of this interface have an unknown resolution");
    return trace_skip(in, body - count);
}

/* ---- What is not whole ----------------------------------------------------------------------- */

/* Returns true for a number that may be the length of a block. */
static bool is_length(uint32_t length)
{
    return length >= BLOCK_LEAST && length % 4 == 0 && length <= BLOCK_MAX;
}

static uint32_t packet_max(const pcap_state *s)
{
    return s->interfaces[0].link_type == LINKTYPE_CAN_SOCKETCAN ? CAN_XL_BYTES_MAX : BLOCK_MAX;
}

/* Returns true for the head of a packet, which has content. */
static bool is_packet(const pcap_state *s, const unsigned char *head)
{
    const uint32_t captured = get32(s, head + 8);
    const uint32_t fractions = s->interfaces[0].resolution == 9 ? 1000000000u : 1000000u;
    return captured > 0 && captured <= packet_max(s) && captured <= get32(s, head + 12) &&
           get32(s, head + 4) < fractions;
}

/* Returns the bytes of a whole block that may begin here; 0 for other bytes. */
static uint32_t whole_block(const pcap_state *s, const unsigned char *b, size_t there)
{
    if (there < BLOCK_LEAST)
        return 0;
    const bool section = big32(b) == BLOCK_SHB;
    const bool big = section ? big32(b + BLOCK_HEAD) == BYTE_ORDER_MAGIC : s->big_endian;
    const uint32_t type = ordered32(big, b);
    const uint32_t length = ordered32(big, b + 4);
    const bool known = (type >= BLOCK_IDB && type <= BLOCK_EPB) || type == BLOCK_DSB ||
                       (section && ordered32(big, b + BLOCK_HEAD) == BYTE_ORDER_MAGIC);
    if (!known || !is_length(length) || length > there)
        return 0;
    return ordered32(big, b + length - BLOCK_FOOT) == length ? length : 0;
}

/* Returns true when these bytes may be the head of a packet and, as far as they go, of a CAN frame
 * in it. */
static bool may_be_packet(const pcap_state *s, const unsigned char *b, size_t there)
{
    if (there < PCAP_PACKET_HEAD || !is_packet(s, b))
        return false;
    if (there < PCAP_PACKET_HEAD + CAN_HEAD || s->interfaces[0].link_type != LINKTYPE_CAN_SOCKETCAN)
        return true;
    const unsigned char *frame = b + PCAP_PACKET_HEAD;
    const uint32_t captured = get32(s, b + 8);
    const unsigned length = frame[4];
    if (length & CAN_XLF)
        return captured == CAN_XL_HEAD + (uint32_t)(frame[7] << 8 | frame[6]);
    return length <= CW_FRAME_DATA_MAX && captured <= CAN_FD_BYTES_MAX &&
           (captured >= CAN_HEAD + length || (big32(frame) & CAN_REMOTE));
}

/* Returns the bytes of a whole packet that may begin here, which another one or the end of the file
 * follows; 0 for other bytes. */
static uint32_t whole_packet(const pcap_state *s, const unsigned char *b, size_t there)
{
    if (!may_be_packet(s, b, there) || there - PCAP_PACKET_HEAD < get32(s, b + 8))
        return 0;
    const uint32_t length = PCAP_PACKET_HEAD + get32(s, b + 8);
    return there == length || may_be_packet(s, b + length, there - length) ? length : 0;
}

/* Takes bytes up to those that may be a whole entry, or all, but not behind a limit. Only the
 * buffer is searched for its end, so that a longer one is passed over. */
static trace_result search(trace_input *in, const pcap_state *s, uint64_t limit)
{
    for (;;) {
        const unsigned char *b;
        const size_t there = trace_peek(in, &b, TRACE_BUFFER);
        const size_t most = there == TRACE_BUFFER ? there / 2 : there;
        const size_t end = limit - in->offset < most ? (size_t)(limit - in->offset) : most;
        size_t i = 0;
        if (in->failed)
            return TRACE_BAD;
        while (i < end && (s->classic ? whole_packet(s, b + i, there - i)
                                      : whole_block(s, b + i, there - i)) == 0)
            i++;
        if (trace_skip(in, i) != TRACE_RECORD)
            return TRACE_BAD;
        if (i < end || there == 0 || in->offset == limit)
            return TRACE_RECORD;
    }
}

/* Returns true for what may follow an entry. */
static bool may_follow(const pcap_state *s, const unsigned char *b, size_t there)
{
    if (s->classic)
        return there < PCAP_PACKET_HEAD || may_be_packet(s, b, there);
    return there < BLOCK_HEAD || big32(b) == BLOCK_SHB || is_length(get32(s, b + 4));
}

/* Returns true when an entry lacks bytes, so that the next one begins in it. Often nothing else
 * tells so: entries have equal lengths. */
static bool lacks_bytes(trace_input *in, const pcap_state *s)
{
    const unsigned char *b;
    const uint64_t end = in->offset;
    const size_t there = trace_peek(in, &b, PCAP_PACKET_HEAD + CAN_HEAD);
    if (may_follow(s, b, there))
        return false;
    if (trace_seek(in, in->entry + BLOCK_HEAD) != TRACE_RECORD ||
        search(in, s, end) != TRACE_RECORD)
        return true;
    const bool lacks = in->offset < end;
    return trace_seek(in, end) != TRACE_RECORD || lacks;
}

static trace_result bad_gap(trace_input *in)
{
    return trace_bad_byte(in, in->entry, "bytes are missing: the next entry begins amid this one");
}

/* An entry may have its length, but lack bytes, so that the next one begins in it. */
trace_result pcapng_recover(trace_input *in, const pcap_state *s)
{
    const unsigned char *b;
    if (trace_seek(in, in->entry) != TRACE_RECORD)
        return TRACE_BAD;
    const size_t there = trace_peek(in, &b, TRACE_BUFFER);
    const uint32_t length = s->classic ? whole_packet(s, b, there) : whole_block(s, b, there);
    const uint64_t end = in->entry + length;
    if (in->failed || trace_skip(in, there > 0) != TRACE_RECORD ||
        search(in, s, UINT64_MAX) != TRACE_RECORD)
        return TRACE_BAD;
    return length > 0 && in->offset > end ? trace_seek(in, end) : TRACE_RECORD;
}

/* ---- Blocks ---------------------------------------------------------------------------------- */

/* Each section begins anew, with its own byte order and no interfaces. */
static trace_result read_section(trace_input *in, pcap_state *s, uint64_t place,
                                 const unsigned char *magic)
{
    s->big_endian = big32(magic) == BYTE_ORDER_MAGIC;
    s->interface_count = 0;
    if (get32(s, magic) != BYTE_ORDER_MAGIC)
        return trace_bad_byte(in, place, "a section without the byte order mark 1A2B3C4D");
    return TRACE_RECORD;
}

/* Reads EPB and PB, which keep the interface in different places; the rest of the block is
 * options. */
static trace_result read_enhanced(trace_input *in, pcap_state *s, trace_record *r, uint64_t place,
                                  uint32_t type, uint32_t body)
{
    const unsigned char *b;
    if (body < 20)
        return trace_bad_byte(in, place, "a packet block that is too short");
    if (need(in, &b, 20) != TRACE_RECORD)
        return TRACE_BAD;
    uint32_t number = type == BLOCK_PB ? get16(s, b) : get32(s, b);
    packet p = {.place = place, .captured = get32(s, b + 12)};
    uint64_t count = (uint64_t)get32(s, b + 4) << 32 | get32(s, b + 8);
    if (number >= s->interface_count || s->interfaces[number].unusable)
        return trace_bad_byte(in, place,
                              "a packet of interface %" PRIu32 ", which is not described", number);
    if (p.captured > body - 20)
        return trace_bad_byte(in, place, "a packet that is longer than its block");
    const pcap_interface *i = &s->interfaces[number];
    p.link_type = i->link_type;
    trace_set_channel(r, i->name, strlen(i->name));
    if (stamp(in, r, &p, i, count) != TRACE_RECORD)
        return TRACE_BAD;
    return read_packet(in, r, &p, body - 20);
}

/* Reads an SPB, a packet of the first interface without time. */
static trace_result read_simple(trace_input *in, pcap_state *s, trace_record *r, uint64_t place,
                                uint32_t body)
{
    const unsigned char *b;
    if (body < 4 || s->interface_count == 0 || s->interfaces[0].unusable)
        return trace_bad_byte(in, place,
                              body < 4 ? "a packet block that is too short"
                                       : "a packet before any interface is described");
    if (need(in, &b, 4) != TRACE_RECORD)
        return TRACE_BAD;
    const pcap_interface *i = &s->interfaces[0];
    packet p = {.place = place, .captured = get32(s, b), .link_type = i->link_type};
    if (i->snap_length > 0 && p.captured > i->snap_length)
        p.captured = i->snap_length;
    if (p.captured > body - 4)
        return trace_bad_byte(in, place, "a packet that is longer than its block");
    trace_set_channel(r, i->name, strlen(i->name));
    return read_packet(in, r, &p, body - 4);
}

/* Reads the body of a block. *reported: it is an entry of the file. */
static trace_result read_body(trace_input *in, pcap_state *s, trace_record *r, bool *reported,
                              uint64_t place, uint32_t type, uint32_t body)
{
    *reported = type == BLOCK_EPB || type == BLOCK_PB || type == BLOCK_SPB;
    if (type == BLOCK_EPB || type == BLOCK_PB)
        return read_enhanced(in, s, r, place, type, body);
    if (type == BLOCK_SPB)
        return read_simple(in, s, r, place, body);
    if (type == BLOCK_IDB)
        return read_interface(in, s, place, body);
    *reported = type != BLOCK_SHB && type != BLOCK_NRB && type != BLOCK_ISB && type != BLOCK_DSB;
    r->kind = TRACE_OTHER;
    r->place = place;
    return trace_skip(in, body);
}

/* Both lengths of a block must be the same: otherwise it is not known where the next one begins. */
static trace_result read_block(trace_input *in, pcap_state *s, trace_record *r, bool *reported)
{
    const unsigned char *b;
    uint64_t place = in->entry = in->offset;
    trace_result result = trace_bytes(in, &b, BLOCK_HEAD);
    if (result != TRACE_RECORD)
        return result;
    unsigned char head[BLOCK_HEAD];
    memcpy(head, b, sizeof head);
    if (big32(head) == BLOCK_SHB && trace_peek(in, &b, 4) == 4 &&
        read_section(in, s, place, b) != TRACE_RECORD)
        return TRACE_BAD;
    uint32_t type = get32(s, head);
    uint32_t length = get32(s, head + 4);
    if (!is_length(length))
        return trace_bad_byte(in, place,
                              "a block of %" PRIu32 " bytes: multiples of 4 from 12 to "
                              "%u are allowed",
                              length, BLOCK_MAX);
    result = read_body(in, s, r, reported, place, type, length - BLOCK_HEAD - BLOCK_FOOT);
    if (result != TRACE_RECORD)
        return TRACE_BAD;
    if (need(in, &b, BLOCK_FOOT) != TRACE_RECORD)
        return TRACE_BAD;
    if (get32(s, b) != length)
        return trace_bad_byte(in, place,
                              "the two lengths of this block differ: %" PRIu32 " and %" PRIu32,
                              length, get32(s, b));
    return lacks_bytes(in, s) ? bad_gap(in) : TRACE_RECORD;
}

/* ---- pcap ------------------------------------------------------------------------------------ */

/* The magic number also tells the byte order and the unit of times. */
static trace_result read_classic_head(trace_input *in, pcap_state *s)
{
    const unsigned char *b;
    if (need(in, &b, PCAP_HEAD) != TRACE_RECORD)
        return pcapng_read_refuse(in);
    bool ns = big32(b) == PCAP_NS || big32(b) == __builtin_bswap32(PCAP_NS);
    s->big_endian = big32(b) == PCAP_NS || big32(b) == PCAP_US;
    s->interfaces[0] = (pcap_interface){.link_type = (uint16_t)(get32(s, b + 20) & 0xFFFFu),
                                        .resolution = ns ? 9 : RESOLUTION_DEFAULT,
                                        .name = "0"};
    return TRACE_RECORD;
}

/* Reads a packet of pcap, which has no other blocks. */
static trace_result read_classic(trace_input *in, pcap_state *s, trace_record *r)
{
    const unsigned char *b;
    packet p = {.place = in->entry = in->offset, .link_type = s->interfaces[0].link_type};
    trace_result result = trace_bytes(in, &b, PCAP_PACKET_HEAD);
    if (result != TRACE_RECORD)
        return result;
    uint64_t scale = s->interfaces[0].resolution == 9 ? NS_PER_S : 1000000u;
    uint64_t count = get32(s, b) * scale + get32(s, b + 4);
    p.captured = get32(s, b + 8);
    if (!is_packet(s, b))
        return trace_bad_byte(in, p.place, "a packet of %" PRIu32 " bytes of %" PRIu32
                              ": 1 to %u are allowed", p.captured, get32(s, b + 12), packet_max(s));
    trace_set_channel(r, "0", 1);
    if (stamp(in, r, &p, &s->interfaces[0], count) != TRACE_RECORD)
        return TRACE_BAD;
    result = read_packet(in, r, &p, p.captured);
    return result == TRACE_RECORD && lacks_bytes(in, s) ? bad_gap(in) : result;
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* Finds the form of the file by its first bytes. Another file is refused as a whole. */
static trace_result pcapng_read_begin(trace_input *in, pcap_state *s)
{
    const unsigned char *b;
    size_t count = trace_peek(in, &b, BLOCK_HEAD + 4);
    uint32_t magic = count >= 4 ? big32(b) : 0;
    s->begun = true;
    if (in->failed)
        return TRACE_BAD;
    if (magic == PCAP_US || magic == PCAP_NS || magic == __builtin_bswap32(PCAP_US) ||
        magic == __builtin_bswap32(PCAP_NS)) {
        s->classic = true;
        return read_classic_head(in, s);
    }
    if (magic == BLOCK_SHB && count == BLOCK_HEAD + 4)
        return TRACE_RECORD;
    (void)trace_bad_byte(in, 0, "this is neither pcapng nor pcap");
    return pcapng_read_refuse(in);
}

/* Reads up to the next packet: blocks of other kinds are not entries. */
trace_result pcapng_next(trace_input *in, pcap_state *state, trace_record *record)
{
    if (!state->begun && pcapng_read_begin(in, state) != TRACE_RECORD)
        return TRACE_BAD;
    if (state->classic)
        return read_classic(in, state, record);
    for (;;) {
        bool reported = false;
        *record = (trace_record){.kind = TRACE_FRAME};
        trace_result result = read_block(in, state, record, &reported);
        if (result != TRACE_RECORD || reported)
            return result;
    }
}
