/* SPDX-License-Identifier: MIT
 *
 * device.h - the adapter: requests of the kernel's USB stack on one side, the node on the other.
 *
 * A request of USB/IP is a head of 48 bytes, and data. All but two kinds are answered at once. A
 * frame is answered when the bus has sent it, so the driver's echo comes then. A request to read is
 * answered when there is something to read. Both can be taken back by the kernel at any time.
 *
 * It does no input and output of its own: see serve.h.
 */
#ifndef CANWIRE_USB_DEVICE_H
#define CANWIRE_USB_DEVICE_H

#include "base/text/buffer.h"
#include "port/control.h"
#include "usb/peak.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define USB_SERIAL_MAX 100u
#define USB_ANSWER_MAX 256u

typedef struct usb_identity {
    char serial[USB_SERIAL_MAX + 1]; /* in sysfs and for udev: the interface's name */
    uint32_t number;                 /* of the device, as the driver logs it */
} usb_identity;

#define DEVICE_HELD_MAX 64u  /* frames; the driver has ten */
#define DEVICE_READS_MAX 64u /* requests to read; the driver has four */

/* Requests of the device to its node. */
typedef struct device_calls {
    /* Hands a frame in. The number comes back with its end. */
    void (*send)(void *user, uint32_t number, const peak_frame *frame);
    void (*order)(void *user, message_order order, const char *settings);
} device_calls;

typedef struct held_frame {
    uint32_t number; /* of the request */
    uint32_t bytes;  /* of the request: what the driver hears that it has sent */
    peak_frame frame;
} held_frame;

typedef struct read_request {
    uint32_t number;
    uint32_t room;
    unsigned endpoint;
} read_request;

typedef struct usb_device {
    usb_identity who;
    const device_calls *calls;
    void *user;
    buffer in;      /* from the kernel: perhaps part of a request */
    buffer out;     /* for the kernel */
    buffer records; /* for requests to read */
    held_frame held[DEVICE_HELD_MAX]; /* in the order in which they came */
    unsigned held_count;
    unsigned burst; /* frames since the last one that was sent: see answer_failed() */
    read_request reads[DEVICE_READS_MAX];
    unsigned read_count;
    bool claimed;   /* a driver has taken it, and nobody was told yet */
    bool on;        /* the driver has set it on the bus */
    bool listen_only;
    bool one_shot;
    bool fd;        /* the node knows CAN FD */
    bool has_slow;
    bool has_fast;
    peak_timing slow;
    peak_timing fast;
    bool overrun;   /* records were lost */
    message_state state; /* as the driver knows it */
} usb_device;

/* Sets up a device; all of it must be zero. */
void device_init(usb_device *d, const usb_identity *who, const device_calls *calls, void *user);
void device_free(usb_device *d);

/* Takes bytes from the kernel. Returns false when they cannot be understood, or memory is short. */
bool device_take(usb_device *d, const void *bytes, size_t size);

/* The node is there: says what the driver has asked for up to now. fd: it knows CAN FD. */
void device_begin(usb_device *d, bool fd);

/* Takes what comes from the node. us: bus time. Frames and states wait for device_flush(). So those
 * that come together share a request to read. The end of a frame does not wait. */
void device_received(usb_device *d, const void *frame, size_t size, uint64_t us);
void device_was_sent(usb_device *d, uint32_t number);
void device_was_dropped(usb_device *d, uint32_t number);
void device_state(usb_device *d, const message_state *state, uint64_t us);
void device_flush(usb_device *d);

/* Returns true when a control request tells that a driver has taken the adapter. data: `length`
 * bytes. */
bool usb_is_claim(const unsigned char setup[8], const unsigned char *data, size_t length);

/* Answers a control request of 8 bytes. Returns the number of bytes in `answer`, 0 for one that
 * only sends; -1: the adapter does not know it. */
int usb_answer(unsigned char answer[USB_ANSWER_MAX], const usb_identity *who,
               const unsigned char setup[8]);

#endif
