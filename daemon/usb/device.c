/* SPDX-License-Identifier: MIT
 *
 * device.c - the adapter: requests of the kernel's USB stack on one side, the node on the other.
 */
#include "usb/device.h"

#include "base/text/jsonput.h"
#include "base/text/jsontext.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/can/error.h>
#include <linux/usbip.h>
#include <stdio.h>
#include <string.h>

#define HEAD_BYTES 48u
#define HEAD_WORDS (HEAD_BYTES / 4u)
#define TRANSFER_MAX 65536u /* of a request; the driver's longest has 2048 */
#define RECORDS_MAX (256u << 10)

/* Commands of USB/IP. */
enum { SUBMIT = 1, UNLINK = 2, SUBMITTED = 3, UNLINKED = 4 };

#define ENDPOINT_COMMANDS 1u
#define ENDPOINT_FRAMES 2u

/* Classes of error frames that the driver makes itself, from the status. */
#define OWN_CLASSES (CAN_ERR_CRTL | CAN_ERR_RESTARTED | CAN_ERR_BUSOFF)

typedef struct usb_request {
    uint32_t command;
    uint32_t number;
    bool reads; /* from the device */
    unsigned endpoint;
    uint32_t length; /* SUBMIT: of the data */
    uint32_t victim; /* UNLINK */
    unsigned char setup[8];
} usb_request;

void device_init(usb_device *d, const usb_identity *who, const device_calls *calls, void *user)
{
    d->who = *who;
    d->calls = calls;
    d->user = user;
}

void device_free(usb_device *d)
{
    buffer_free(&d->in);
    buffer_free(&d->out);
    buffer_free(&d->records);
}

/* ---- Answers --------------------------------------------------------------------------------- */

/* Answers a request. status: 0 or a negative errno; length: of the data that were carried. */
static bool device_answer(usb_device *d, uint32_t command, uint32_t number, int status,
                          uint32_t length, const void *data, size_t size)
{
    uint32_t head[HEAD_WORDS] = {0};
    head[0] = htonl(command);
    head[1] = htonl(number);
    head[5] = htonl((uint32_t)status);
    head[6] = htonl(length);
    return buffer_append(&d->out, (const char *)head, sizeof head) &&
           (size == 0 || buffer_append(&d->out, data, size));
}

static bool answer_data(usb_device *d, uint32_t number, const void *data, size_t size)
{
    return device_answer(d, SUBMITTED, number, 0, (uint32_t)size, data, size);
}

static void forget_held(usb_device *d, unsigned place)
{
    d->held_count--;
    memmove(&d->held[place], &d->held[place + 1], (d->held_count - place) * sizeof d->held[0]);
}

static void forget_read(usb_device *d, unsigned place)
{
    d->read_count--;
    memmove(&d->reads[place], &d->reads[place + 1], (d->read_count - place) * sizeof d->reads[0]);
}

/* Returns the place of a frame that the bus has not sent, held_count without one. */
static unsigned find_held(const usb_device *d, uint32_t number)
{
    unsigned i = 0;
    while (i < d->held_count && d->held[i].number != number)
        i++;
    return i;
}

/* A frame was sent. The driver starts its queue again. */
static void answer_sent(usb_device *d, unsigned place)
{
    const held_frame *h = &d->held[place];
    (void)device_answer(d, SUBMITTED, h->number, 0, h->bytes, NULL, 0);
    forget_held(d, place);
    d->burst = d->held_count;
}

/* A frame will not be sent. After ten of them the driver's queue may stand still, and only a
 * success starts it again, or a restart. So the last one of such a row is reported as sent. */
static void answer_failed(usb_device *d, unsigned place)
{
    const uint32_t number = d->held[place].number;
    if (d->held_count == 1 && d->burst >= 10 && d->on && d->state.state != 3) {
        answer_sent(d, place);
        return;
    }
    (void)device_answer(d, SUBMITTED, number, -EPROTO, 0, NULL, 0);
    forget_held(d, place);
}

/* Fails all frames that the bus has not sent, as an unplugged device does. */
static void fail_all(usb_device *d)
{
    while (d->held_count > 0) {
        (void)device_answer(d, SUBMITTED, d->held[0].number, -EPROTO, 0, NULL, 0);
        forget_held(d, 0);
    }
    d->burst = 0;
}

/* ---- Records for the driver ------------------------------------------------------------------ */

/* Returns the bytes of whole records at the start that fit. */
static size_t whole_records(const buffer *records, size_t room)
{
    const unsigned char *first = (const unsigned char *)buffer_first(records);
    const size_t length = buffer_length(records);
    size_t size = 0;
    while (size < length) {
        const size_t one = first[size] | (size_t)first[size + 1] << 8;
        if (size + one > room)
            break;
        size += one;
    }
    return size;
}

/* Answers a request to read with all records that fit. */
static void device_deliver(usb_device *d)
{
    for (unsigned i = 0; i < d->read_count && buffer_length(&d->records) > 0;) {
        const read_request *r = &d->reads[i];
        const size_t size =
            r->endpoint == ENDPOINT_FRAMES ? whole_records(&d->records, r->room) : 0;
        if (size == 0) {
            i++;
            continue;
        }
        (void)answer_data(d, r->number, buffer_first(&d->records), size);
        buffer_take(&d->records, size);
        forget_read(d, i);
    }
}

static void record(usb_device *d, const unsigned char *bytes, size_t size)
{
    if (buffer_length(&d->records) + size > RECORDS_MAX ||
        !buffer_append(&d->records, (const char *)bytes, size))
        d->overrun = true;
}

/* ---- Commands -------------------------------------------------------------------------------- */

static void put_part(buffer *out, const char *prefix, const char *name, unsigned value)
{
    char key[20];
    (void)snprintf(key, sizeof key, "%s%s", prefix, name);
    jsontext_number(out, key, value);
}

/* The driver does not tell the propagation segment: the controller does not need it. */
static void put_timing(buffer *out, const char *prefix, const peak_timing *t)
{
    unsigned phase1 = t->tseg2 > t->sjw ? t->tseg2 : t->sjw;
    if (phase1 > t->tseg1)
        phase1 = t->tseg1;
    put_part(out, prefix, "brp", t->brp);
    put_part(out, prefix, "prop-seg", t->tseg1 - phase1);
    put_part(out, prefix, "phase-seg1", phase1);
    put_part(out, prefix, "phase-seg2", t->tseg2);
    put_part(out, prefix, "sjw", t->sjw);
}

static void put_switch(buffer *out, const char *key, bool on)
{
    jsontext_value(out, key, on ? "true" : "false");
}

/* Writes what the driver has set, as keys of a node. The driver restarts by itself: restart-ms is
 * 0. */
static void put_settings(buffer *out, const usb_device *d)
{
    jsontext_item(out, "{");
    jsontext_string(out, "clock", PEAK_CLOCK);
    if (d->has_slow)
        put_timing(out, "", &d->slow);
    if (d->has_fast && d->fd)
        put_timing(out, "d", &d->fast);
    put_switch(out, "triple-sampling", d->slow.triple);
    put_switch(out, "listen-only", d->listen_only);
    put_switch(out, "one-shot", d->one_shot);
    jsontext_value(out, "restart-ms", "0}");
}

/* Hands an order over to the node, with the settings of the driver where it begins. */
static void order(usb_device *d, message_order what, bool with_settings)
{
    buffer text = {.data = NULL};
    if (with_settings)
        put_settings(&text, d);
    const char *settings = buffer_text(&text);
    if (settings)
        d->calls->order(d->user, what, settings);
    else
        json_no_memory();
    buffer_free(&text);
}

/* On the bus. When it is there already, this is the restart after bus-off, and the driver has
 * forgotten its frames. */
static void set_on(usb_device *d, bool listen_only)
{
    if (d->on) {
        fail_all(d);
        order(d, MESSAGE_RESTART, false);
        return;
    }
    d->on = true;
    d->listen_only = listen_only;
    d->state = (message_state){.state = 0};
    order(d, MESSAGE_ON, true);
}

/* Takes the node off the bus. Nothing of before is told later. */
static void set_off(usb_device *d)
{
    if (d->on)
        order(d, MESSAGE_OFF, false);
    d->on = false;
    d->one_shot = false;
    buffer_take(&d->records, buffer_length(&d->records));
    fail_all(d);
}

/* Obeys a command of the driver. */
static void device_obey(usb_device *d, const peak_command *c)
{
    switch (c->opcode) {
    case PEAK_RESET_MODE:
        set_off(d);
        break;
    case PEAK_NORMAL_MODE:
    case PEAK_LISTEN_ONLY_MODE:
        set_on(d, c->opcode == PEAK_LISTEN_ONLY_MODE);
        break;
    case PEAK_TIMING_SLOW:
        d->slow = c->timing;
        d->has_slow = true;
        break;
    case PEAK_TIMING_FAST:
        d->fast = c->timing;
        d->has_fast = true;
        break;
    default: /* lights, filters, counters that a restart resets anyway */
        break;
    }
}

/* ---- Requests -------------------------------------------------------------------------------- */

/* Answers a request about the device itself. */
static bool take_control(usb_device *d, const usb_request *r, const unsigned char *data)
{
    unsigned char reply[USB_ANSWER_MAX];
    const int size = usb_answer(reply, &d->who, r->setup);
    if (size < 0)
        return device_answer(d, SUBMITTED, r->number, -EPIPE, 0, NULL, 0);
    if (r->reads)
        return answer_data(d, r->number, reply,
                           (uint32_t)size < r->length ? (size_t)size : r->length);
    d->claimed |= usb_is_claim(r->setup, data, r->length);
    return device_answer(d, SUBMITTED, r->number, 0, r->length, NULL, 0);
}

/* Keeps a request that reads until there is something to give. */
static bool take_read(usb_device *d, const usb_request *r)
{
    if (d->read_count == DEVICE_READS_MAX)
        return device_answer(d, SUBMITTED, r->number, -ENOMEM, 0, NULL, 0);
    d->reads[d->read_count++] =
        (read_request){.number = r->number, .room = r->length, .endpoint = r->endpoint};
    device_deliver(d);
    return true;
}

/* Obeys all commands of a request, whatever they say, and answers it at once. */
static bool take_commands(usb_device *d, const usb_request *r, const unsigned char *data)
{
    peak_command command;
    size_t at = 0;
    while (peak_take_command(&command, data, r->length, &at))
        device_obey(d, &command);
    return device_answer(d, SUBMITTED, r->number, 0, r->length, NULL, 0);
}

/* All frames of the driver have the mode that it has. */
static void choose_one_shot(usb_device *d, bool one_shot)
{
    if (d->one_shot == one_shot)
        return;
    d->one_shot = one_shot;
    d->calls->order(d->user, MESSAGE_SET,
                    one_shot ? "{\"one-shot\":true}" : "{\"one-shot\":false}");
}

/* The driver has one frame in a request. */
static bool device_take_frame(usb_device *d, const usb_request *r, const unsigned char *data)
{
    size_t at = 0;
    held_frame held = {.number = r->number, .bytes = r->length};
    if (!d->on || d->held_count == DEVICE_HELD_MAX ||
        peak_take_frame(&held.frame, data, r->length, &at) != PEAK_FRAME)
        return device_answer(d, SUBMITTED, r->number, -EPROTO, 0, NULL, 0);
    choose_one_shot(d, held.frame.one_shot);
    d->held[d->held_count++] = held;
    d->burst++;
    d->calls->send(d->user, held.number, &held.frame);
    return true;
}

/* Takes a request of the kernel for an endpoint, and answers it now or later. */
static bool take_submit(usb_device *d, const usb_request *r, const unsigned char *data)
{
    if (r->endpoint == 0)
        return take_control(d, r, data);
    if (r->endpoint > ENDPOINT_FRAMES)
        return device_answer(d, SUBMITTED, r->number, -EPIPE, 0, NULL, 0);
    if (r->reads)
        return take_read(d, r);
    return r->endpoint == ENDPOINT_COMMANDS ? take_commands(d, r, data)
                                            : device_take_frame(d, r, data);
}

/* Takes a request back. One that has been answered is gone: the kernel knows that by the 0. */
static bool take_unlink(usb_device *d, const usb_request *r)
{
    const unsigned held = find_held(d, r->victim);
    unsigned read = 0;
    while (read < d->read_count && d->reads[read].number != r->victim)
        read++;
    const bool found = held < d->held_count || read < d->read_count;
    if (held < d->held_count)
        forget_held(d, held);
    if (read < d->read_count)
        forget_read(d, read);
    return device_answer(d, UNLINKED, r->number, found ? -ECONNRESET : 0, 0, NULL, 0);
}

/* Reads the head of a request, as USB/IP has it: numbers are big-endian. */
static usb_request parse(const char *bytes)
{
    uint32_t head[HEAD_WORDS];
    memcpy(head, bytes, sizeof head);
    usb_request r = {
        .command = ntohl(head[0]),
        .number = ntohl(head[1]),
        .reads = ntohl(head[3]) == 1,
        .endpoint = ntohl(head[4]),
        .length = ntohl(head[6]),
        .victim = ntohl(head[5]),
    };
    memcpy(r.setup, (const char *)head + 40, sizeof r.setup);
    return r;
}

/* Takes the first request, when it is whole. Returns the number of its bytes; 0: it is not whole,
 * -1: it cannot be understood. */
static long device_take_first(usb_device *d)
{
    if (buffer_length(&d->in) < HEAD_BYTES)
        return 0;
    const usb_request r = parse(buffer_first(&d->in));
    if (r.command == UNLINK)
        return take_unlink(d, &r) ? (long)HEAD_BYTES : -1;
    if (r.command != SUBMIT || r.length > TRANSFER_MAX)
        return -1;
    const size_t whole = HEAD_BYTES + (r.reads ? 0 : r.length);
    if (buffer_length(&d->in) < whole)
        return 0;
    const char *data = buffer_first(&d->in) + HEAD_BYTES;
    return take_submit(d, &r, (const unsigned char *)data) ? (long)whole : -1;
}

bool device_take(usb_device *d, const void *bytes, size_t size)
{
    long taken;
    if (!buffer_append(&d->in, bytes, size))
        return false;
    while ((taken = device_take_first(d)) > 0)
        buffer_take(&d->in, (size_t)taken);
    return taken == 0;
}

/* ---- From the node --------------------------------------------------------------------------- */

void device_begin(usb_device *d, bool fd)
{
    d->fd = fd;
    if (!d->on)
        return;
    order(d, MESSAGE_ON, true);
    for (unsigned i = 0; i < d->held_count; i++)
        d->calls->send(d->user, d->held[i].number, &d->held[i].frame);
}

/* Returns false for an error frame of which nothing is left: the driver makes such ones itself. */
static bool fit_error(struct can_frame *frame)
{
    frame->can_id &= ~(canid_t)OWN_CLASSES;
    return frame->can_id & CAN_ERR_MASK & ~(canid_t)CAN_ERR_CNT;
}

void device_received(usb_device *d, const void *frame, size_t size, uint64_t us)
{
    unsigned char bytes[PEAK_RECORD_MAX];
    struct can_frame classical;
    memcpy(&classical, frame, sizeof classical);
    const bool error = classical.can_id & CAN_ERR_FLAG;
    if (!d->on || (error && !fit_error(&classical)))
        return;
    if (d->overrun) {
        d->overrun = false;
        record(d, bytes, peak_put_overrun(bytes, us));
    }
    if (error)
        record(d, bytes, peak_put_frame(bytes, &classical, sizeof classical, us));
    else
        record(d, bytes, peak_put_frame(bytes, frame, size, us));
}

void device_flush(usb_device *d)
{
    device_deliver(d);
}

/* Records that came before the end of a frame stay before it. */
void device_was_sent(usb_device *d, uint32_t number)
{
    const unsigned place = find_held(d, number);
    device_deliver(d);
    if (place < d->held_count)
        answer_sent(d, place);
}

void device_was_dropped(usb_device *d, uint32_t number)
{
    const unsigned place = find_held(d, number);
    device_deliver(d);
    if (place < d->held_count)
        answer_failed(d, place);
}

static unsigned status_bits(uint32_t state)
{
    static const unsigned bits[] = {0, PEAK_WARNING, PEAK_WARNING | PEAK_PASSIVE, PEAK_BUS_OFF};
    return state < sizeof bits / sizeof bits[0] ? bits[state] : 0;
}

/* The driver compares counters to see which side a state is of, so they come first. A status
 * without bits sets its counters to 0, so they come again. */
void device_state(usb_device *d, const message_state *state, uint64_t us)
{
    unsigned char bytes[PEAK_RECORD_MAX];
    const bool changed = state->state != d->state.state;
    if (!d->on)
        return;
    d->state = *state;
    record(d, bytes, peak_put_counters(bytes, state->tec, state->rec, us));
    if (changed) {
        record(d, bytes, peak_put_status(bytes, status_bits(state->state), us));
        record(d, bytes, peak_put_counters(bytes, state->tec, state->rec, us));
    }
}
