/* SPDX-License-Identifier: MIT
 *
 * descriptors.h - what the adapter answers to control requests: who it is, and its firmware.
 */
#ifndef CANWIRE_USB_DESCRIPTORS_H
#define CANWIRE_USB_DESCRIPTORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define USB_SERIAL_MAX 100u
#define USB_ANSWER_MAX 256u

typedef struct usb_identity {
    char serial[USB_SERIAL_MAX + 1]; /* in sysfs and for udev: the interface's name */
    uint32_t number;                 /* of the device, as the driver logs it */
} usb_identity;

/* Returns true when a control request tells that a driver has taken the adapter. data: `length`
 * bytes. */
bool usb_is_claim(const unsigned char setup[8], const unsigned char *data, size_t length);

/* Answers a control request of 8 bytes. Returns the number of bytes in `answer`, 0 for one that
 * only sends; -1: the adapter does not know it. */
int usb_answer(unsigned char answer[USB_ANSWER_MAX], const usb_identity *who,
               const unsigned char setup[8]);

#endif
