/* SPDX-License-Identifier: MIT
 *
 * descriptors.c - what the adapter answers to control requests: who it is, and its firmware.
 */
#include "usb/device.h"

#include <linux/usb/ch9.h>
#include <stdio.h>
#include <string.h>

#define VENDOR 0x0c72u /* PEAK */
#define PRODUCT 0x0012u /* PCAN-USB FD */
#define PACKET_BYTES 512u
#define LANGUAGE 0x0409u
#define FIRMWARE_INFO_BYTES 36u
#define FIRMWARE_INFO_TYPE 2 /* with the numbers of endpoints */

enum { TEXT_LANGUAGES = 0, TEXT_MAKER, TEXT_PRODUCT, TEXT_SERIAL };

/* PEAK's own requests. */
#define REQUEST_INFO 0
#define REQUEST_FUNCTION 2
#define FUNCTION_LOADED 5 /* a driver comes or goes */
#define INFO_FIRMWARE 1

static const unsigned char device_descriptor[] = {
    18,   USB_DT_DEVICE, 0x00, 0x02, /* USB 2.0 */
    0,    0,             0,    64,
    VENDOR & 0xff, VENDOR >> 8, PRODUCT & 0xff, PRODUCT >> 8,
    0x00, 0x01,
    TEXT_MAKER, TEXT_PRODUCT, TEXT_SERIAL, 1,
};

#define ENDPOINT(address)                                                                          \
    7, USB_DT_ENDPOINT, address, USB_ENDPOINT_XFER_BULK, PACKET_BYTES & 0xff, PACKET_BYTES >> 8, 0

enum { EP_COMMANDS_OUT = 0x01, EP_COMMANDS_IN = 0x81, EP_DATA_OUT = 0x02, EP_DATA_IN = 0x82 };

static const unsigned char configuration[] = {
    9, USB_DT_CONFIG, 9 + 9 + 4 * 7, 0, 1, 1, 0, 0x80, 100 / 2,
    9, USB_DT_INTERFACE, 0, 0, 4, 0, 0, 0, 0,
    ENDPOINT(EP_COMMANDS_OUT), ENDPOINT(EP_COMMANDS_IN),
    ENDPOINT(EP_DATA_OUT), ENDPOINT(EP_DATA_IN),
};

static const unsigned char qualifier[] = {10, USB_DT_DEVICE_QUALIFIER, 0x00, 0x02, 0, 0, 0, 64,
                                          1,  0};

/* Writes a text as a string descriptor: UTF-16, low bytes first. Returns its bytes. */
static int put_text(unsigned char *answer, const char *text)
{
    const size_t length = strlen(text);
    answer[0] = (unsigned char)(2 + 2 * length);
    answer[1] = USB_DT_STRING;
    for (size_t i = 0; i < length; i++) {
        answer[2 + 2 * i] = (unsigned char)text[i];
        answer[3 + 2 * i] = 0;
    }
    return answer[0];
}

/* Gives a text of the device. Returns its bytes, -1: there is none, and the request stalls. */
static int answer_text(unsigned char *answer, const usb_identity *who, unsigned number)
{
    static const unsigned char languages[] = {4, USB_DT_STRING, LANGUAGE & 0xff, LANGUAGE >> 8};
    switch (number) {
    case TEXT_LANGUAGES:
        memcpy(answer, languages, sizeof languages);
        return sizeof languages;
    case TEXT_MAKER:
        return put_text(answer, "canwire");
    case TEXT_PRODUCT:
        return put_text(answer, "PCAN-USB FD");
    case TEXT_SERIAL:
        return put_text(answer, who->serial);
    default:
        return -1;
    }
}

/* Returns the bytes of a descriptor, -1 for one that the device does not have. */
static int answer_descriptor(unsigned char *answer, const usb_identity *who, unsigned type,
                             unsigned number)
{
    switch (type) {
    case USB_DT_DEVICE:
        memcpy(answer, device_descriptor, sizeof device_descriptor);
        return sizeof device_descriptor;
    case USB_DT_CONFIG:
        memcpy(answer, configuration, sizeof configuration);
        return sizeof configuration;
    case USB_DT_DEVICE_QUALIFIER:
        memcpy(answer, qualifier, sizeof qualifier);
        return sizeof qualifier;
    case USB_DT_STRING:
        return answer_text(answer, who, number);
    default:
        return -1;
    }
}

/* Firmware 3.2.0: from 2 on the driver offers ISO and non-ISO CAN FD. That of Linux 6.12 does not
 * find the endpoints by itself. */
static int answer_firmware(unsigned char *answer, const usb_identity *who)
{
    memset(answer, 0, FIRMWARE_INFO_BYTES);
    answer[0] = FIRMWARE_INFO_BYTES;
    answer[2] = FIRMWARE_INFO_TYPE;
    answer[5] = 1; /* boot loader 1.0.0 */
    answer[8] = 1; /* hardware */
    answer[9] = 3;
    answer[10] = 2;
    for (unsigned i = 0; i < 4; i++) { /* device and serial number */
        answer[12 + i] = (unsigned char)(who->number >> 8 * i);
        answer[20 + i] = (unsigned char)(who->number >> 8 * i);
    }
    answer[28] = EP_COMMANDS_OUT;
    answer[29] = EP_COMMANDS_IN;
    answer[30] = EP_DATA_OUT;
    answer[32] = EP_DATA_IN;
    return FIRMWARE_INFO_BYTES;
}

/* Answers a request that all devices know. Settings are accepted and change nothing: there is one
 * of each. */
static int answer_standard(unsigned char *answer, const usb_identity *who,
                           const unsigned char setup[8])
{
    switch (setup[1]) {
    case USB_REQ_GET_DESCRIPTOR:
        return answer_descriptor(answer, who, setup[3], setup[2]);
    case USB_REQ_GET_STATUS:
        answer[0] = answer[1] = 0;
        return 2;
    case USB_REQ_GET_CONFIGURATION:
        answer[0] = 1;
        return 1;
    case USB_REQ_GET_INTERFACE:
        answer[0] = 0;
        return 1;
    case USB_REQ_SET_CONFIGURATION:
    case USB_REQ_SET_INTERFACE:
    case USB_REQ_CLEAR_FEATURE:
    case USB_REQ_SET_FEATURE:
    case USB_REQ_SET_ADDRESS:
        return 0;
    default:
        return -1;
    }
}

bool usb_is_claim(const unsigned char setup[8], const unsigned char *data, size_t length)
{
    return (setup[0] & USB_TYPE_MASK) == USB_TYPE_VENDOR && setup[1] == REQUEST_FUNCTION &&
           setup[2] == FUNCTION_LOADED && length > 1 && data[1] != 0;
}

int usb_answer(unsigned char answer[USB_ANSWER_MAX], const usb_identity *who,
               const unsigned char setup[8])
{
    const unsigned kind = setup[0] & USB_TYPE_MASK;
    if (kind == USB_TYPE_STANDARD)
        return answer_standard(answer, who, setup);
    if (kind == USB_TYPE_VENDOR && setup[1] == REQUEST_INFO && setup[2] == INFO_FIRMWARE)
        return answer_firmware(answer, who);
    return kind == USB_TYPE_VENDOR && setup[1] == REQUEST_FUNCTION ? 0 : -1;
}
