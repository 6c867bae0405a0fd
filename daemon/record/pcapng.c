/* SPDX-License-Identifier: MIT
 *
 * pcapng.c - writes the events of a bus as a capture for Wireshark: pcapng, SocketCAN frames.
 */
#include "record/pcapng.h"

#include "base/version.h"
#include "trace/errframe.h"
#include "trace/pcapng_format.h"

#include <assert.h>
#include <string.h>

#define BLOCK_BYTES_MAX 512u
#define APPLICATION "canwire " CANWIRE_VERSION
#define VERSION_MAJOR 1u
#define VERSION_MINOR 0u
#define NAME_BYTES 80u /* of BUS:NODE */
#define RESOLUTION_NS 9u /* 10^-9 s */
#define ALL_ERRORS (CW_MODE_BERR_REPORTING | CW_MODE_LOST_ARBITRATION_REPORTING)

/* A block under construction, little-endian. */
typedef struct block {
    size_t length;
    unsigned char bytes[BLOCK_BYTES_MAX];
} block;

/* ---- Blocks ---------------------------------------------------------------------------------- */

static void pcapng_add(block *b, const void *bytes, size_t count)
{
    assert(b->length + count <= BLOCK_BYTES_MAX);
    memcpy(b->bytes + b->length, bytes, count);
    b->length += count;
}

/* Adds the low bytes of a number, the lowest one first. */
static void add_number(block *b, uint64_t value, unsigned bytes)
{
    for (unsigned i = 0; i < bytes; i++) {
        unsigned char byte = (unsigned char)(value >> 8 * i);
        pcapng_add(b, &byte, 1);
    }
}

/* Pads the block: all parts begin at multiples of 4. */
static void pad(block *b)
{
    while (b->length % 4 != 0)
        add_number(b, 0, 1);
}

static void begin_block(block *b, uint32_t type)
{
    b->length = 0;
    add_number(b, type, 4);
    add_number(b, 0, 4); /* its length, see below */
}

/* Writes the block. Its length stands at both ends, so that readers can go backwards. */
static void end_block(FILE *out, block *b)
{
    size_t length = b->length + BLOCK_FOOT;
    block head = {.length = 0};
    add_number(b, length, 4);
    add_number(&head, length, 4);
    memcpy(b->bytes + 4, head.bytes, 4);
    (void)fwrite(b->bytes, 1, b->length, out);
}

static void add_option_head(block *b, unsigned code, size_t length)
{
    add_number(b, code, 2);
    add_number(b, length, 2);
}

static void add_text(block *b, unsigned code, const char *text)
{
    add_option_head(b, code, strlen(text));
    pcapng_add(b, text, strlen(text));
    pad(b);
}

static void add_option(block *b, unsigned code, uint64_t value, unsigned bytes)
{
    add_option_head(b, code, bytes);
    add_number(b, value, bytes);
    pad(b);
}

static void end_options(block *b)
{
    add_option_head(b, OPTION_END, 0);
}

/* ---- Section and interfaces ------------------------------------------------------------------ */

/* Writes the head of a file. Its length is open, as the file grows. */
static void write_section(FILE *out)
{
    block b;
    begin_block(&b, BLOCK_SHB);
    add_number(&b, BYTE_ORDER_MAGIC, 4);
    add_number(&b, VERSION_MAJOR, 2);
    add_number(&b, VERSION_MINOR, 2);
    add_number(&b, UINT64_MAX, 8); /* the length of the section is not known */
    add_text(&b, OPTION_SHB_USERAPPL, APPLICATION);
    end_options(&b);
    end_block(out, &b);
}

/* Writes an interface; `name` is the node's. */
static void write_interface(FILE *out, const cfg *config, const cfg_node *node, const char *name)
{
    block b;
    begin_block(&b, BLOCK_IDB);
    add_number(&b, LINKTYPE_CAN_SOCKETCAN, 2);
    add_number(&b, 0, 2); /* reserved */
    add_number(&b, 0, 4); /* packets are never cut off */
    add_text(&b, OPTION_IF_NAME, node->port && !node->guest ? node->port : name);
    add_text(&b, OPTION_IF_DESCRIPTION, name);
    add_option(&b, OPTION_IF_SPEED, config->bitrate_bps, 8);
    add_option(&b, OPTION_IF_TSRESOL, RESOLUTION_NS, 1);
    end_options(&b);
    end_block(out, &b);
}

void pcapng_add_interfaces(FILE *out, const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        write_interface(out, config, &config->nodes[i], config->nodes[i].name);
}

void pcapng_begin(FILE *out, const cfg *config)
{
    write_section(out);
    pcapng_add_interfaces(out, config);
}

void pcapng_begin_all(FILE *out, const cfg *const *buses, size_t count)
{
    char name[NAME_BYTES];
    write_section(out);
    for (size_t bus = 0; bus < count; bus++)
        for (size_t i = 0; i < buses[bus]->node_count; i++) {
            const cfg_node *node = &buses[bus]->nodes[i];
            (void)snprintf(name, sizeof name, "%s:%s", buses[bus]->bus_name, node->name);
            write_interface(out, buses[bus], node, name);
        }
}

/* ---- Packets --------------------------------------------------------------------------------- */

typedef struct packet {
    unsigned direction; /* EPB_* */
    size_t length;
    unsigned char bytes[CAN_FD_BYTES_MAX];
} packet;

static void set_id(packet *p, uint32_t id)
{
    for (unsigned i = 0; i < 4; i++)
        p->bytes[i] = (unsigned char)(id >> (24 - 8 * i));
}

/* Makes a SocketCAN frame: identifier with the high byte first, then length, flags and data. */
static packet packet_of_frame(const cw_frame *frame)
{
    const bool remote = frame->flags & CW_FRAME_REMOTE;
    packet p = {.direction = EPB_OUTBOUND, .length = CAN_HEAD + cw_frame_length(frame)};
    set_id(&p, frame->id | (frame->flags & CW_FRAME_EXTENDED ? CAN_EXTENDED : 0) |
                   (remote ? CAN_REMOTE : 0));
    if (frame->flags & CW_FRAME_FD) {
        p.bytes[4] = (unsigned char)cw_frame_length(frame);
        p.bytes[5] = (unsigned char)(CAN_FDF | (frame->flags & CW_FRAME_BRS ? CAN_BRS : 0) |
                                     (frame->flags & CW_FRAME_ESI ? CAN_ESI : 0));
    } else {
        p.bytes[4] = frame->dlc < 8 ? frame->dlc : 8; /* a remote frame has the number of
                                                         requested bytes */
        p.bytes[7] = frame->dlc > 8 ? frame->dlc : 0;
    }
    memcpy(p.bytes + CAN_HEAD, frame->data, p.length - CAN_HEAD);
    return p;
}

/* An error frame is one that the interface has received. */
static packet packet_of_error(const errframe *frame)
{
    packet p = {.direction = EPB_INBOUND, .length = CAN_HEAD + sizeof frame->data};
    set_id(&p, frame->can_id);
    p.bytes[4] = sizeof frame->data;
    memcpy(p.bytes + CAN_HEAD, frame->data, sizeof frame->data);
    return p;
}

/* Writes a packet. Its time is in ns, the high half first. */
static void write_packet(FILE *out, const packet *p, unsigned interface, uint64_t time_ns)
{
    block b;
    begin_block(&b, BLOCK_EPB);
    add_number(&b, interface, 4);
    add_number(&b, time_ns >> 32, 4);
    add_number(&b, time_ns, 4);
    add_number(&b, p->length, 4); /* captured, and in all */
    add_number(&b, p->length, 4);
    pcapng_add(&b, p->bytes, p->length);
    pad(&b);
    add_option(&b, OPTION_EPB_FLAGS, p->direction, 4);
    end_options(&b);
    end_block(out, &b);
}

void pcapng_event(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns)
{
    pcapng_event_of_bus(out, config, 0, event, time_ns);
}

bool pcapng_takes(const cw_event *event)
{
    errframe error;
    return event->kind == CW_EVENT_TX ||
           errframe_from_event(&error, event, ALL_ERRORS, ERRFRAME_ANY);
}

void pcapng_event_of_bus(FILE *out, const cfg *config, unsigned first, const cw_event *event,
                         uint64_t time_ns)
{
    packet p;
    errframe error;
    if (event->kind == CW_EVENT_TX)
        p = packet_of_frame(&event->frame);
    else if (errframe_from_event(&error, event, ALL_ERRORS, ERRFRAME_ANY))
        p = packet_of_error(&error);
    else
        return;
    for (unsigned i = 0; i < config->node_count; i++)
        if (event->nodes >> i & 1u)
            write_packet(out, &p, first + i, time_ns);
}
