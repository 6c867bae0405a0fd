/* SPDX-License-Identifier: MIT
 *
 * messages.h - the protocol between a port and its clients, canwire-ports(7) has it for users.
 *
 * A client connects to the Unix socket of a port, of type SOCK_SEQPACKET. Its own socket has an
 * abstract address, as bind() without an address gives it. A socket without address is a plain ECU,
 * whose messages are frames of linux/can.h. All numbers are in the byte order of the machine.
 */
#ifndef CANWIRE_PORT_MESSAGES_H
#define CANWIRE_PORT_MESSAGES_H

#include "port/control.h"

#include <linux/can.h>
#include <stdint.h>

#define MESSAGE_MAGIC "canwire" /* eight bytes with the final 0 */
#define MESSAGE_VERSION 1u
#define MESSAGE_NAME_BYTES 36u /* a name of at most 32 bytes, and zeros */
#define MESSAGE_FILTERS_MAX 512u /* as CAN_RAW_FILTER_MAX */

typedef enum message_type {
    MESSAGE_HELLO = 1, /* the first message of a client, and its answer: message_hello */
    MESSAGE_FRAME,     /* struct can_frame or struct canfd_frame; from the port also error frames */
    MESSAGE_OPTIONS,   /* from a client: message_options */
    MESSAGE_FILTERS,   /* from a client: any number of struct can_filter */
    MESSAGE_DROPPED,   /* from the port: a frame of the client that the bus will not carry */
    MESSAGE_ERROR,     /* from the port: message_error, for a message that it has not understood */
    MESSAGE_FLUSH,     /* asks for the end of earlier frames; the answer comes behind it */
    MESSAGE_CONTROL,   /* from a client that is the controller: message_control */
    MESSAGE_STATE,     /* to such a client: message_state, whenever something in it changes */
} message_type;

/* Flags of a frame from the port. */
#define MESSAGE_LOCAL 0x01u /* of a client of this port, as MSG_DONTROUTE says it */
#define MESSAGE_OWN 0x02u   /* ... of this one; the bus has sent it, as MSG_CONFIRM says it */

/* Options of a client. */
#define MESSAGE_LOOPBACK 0x01u /* the other clients see its frames, as CAN_RAW_LOOPBACK */
#define MESSAGE_RECV_OWN 0x02u /* ... and it does, as CAN_RAW_RECV_OWN_MSGS */
#define MESSAGE_FD 0x04u       /* it takes and sends CAN FD frames, as CAN_RAW_FD_FRAMES */
#define MESSAGE_JOIN 0x08u     /* a frame must pass all filters, as CAN_RAW_JOIN_FILTERS */
#define MESSAGE_TELL_DROPPED 0x10u /* it gets MESSAGE_DROPPED */
#define MESSAGE_FLUSHES 0x20u      /* it may send MESSAGE_FLUSH */
#define MESSAGE_CONTROLLER 0x40u   /* it is the node's controller: MESSAGE_CONTROL, MESSAGE_STATE */
#define MESSAGE_OPTIONS_KNOWN 0x7Fu

/* Each message begins so. */
typedef struct message_head {
    uint8_t type;         /* a message_type */
    uint8_t flags;        /* of a frame from the port; otherwise 0 */
    uint16_t size;        /* of the whole message, in bytes */
    uint32_t number;      /* of a frame: chosen by its sender, and told with its own frames */
    uint32_t lost;        /* from the port: messages that this client had no room for, in all */
    uint32_t reserved;    /* 0 */
    uint64_t realtime_ns; /* from the port: CLOCK_REALTIME of the frame, in ns since 1970 */
    uint64_t bus_ns;      /* ... the same as bus time */
} message_head;

typedef struct message_hello {
    char magic[8];
    uint32_t version;    /* of the client; in the answer, of the port */
    uint32_t options;
    uint32_t error_mask; /* error frames that it gets, as CAN_RAW_ERR_FILTER */
    uint32_t mtu;        /* of the answer: CANFD_MTU for a node that knows CAN FD, otherwise
                            CAN_MTU */
    char name[MESSAGE_NAME_BYTES]; /* of the client; in the answer, of the node */
} message_hello;

typedef struct message_options {
    uint32_t options;
    uint32_t error_mask;
} message_options;

typedef struct message_control {
    uint32_t order;                        /* a message_order */
    char settings[MESSAGE_SETTINGS_BYTES]; /* a JSON object of keys of `canwire set`, or nothing;
                                              the message ends with it */
} message_control;

#define MESSAGE_TEXT_BYTES 120u

typedef struct message_error {
    uint32_t code; /* an errno */
    char text[MESSAGE_TEXT_BYTES];
} message_error;

/* A message of either direction that is not a filter. */
typedef struct message {
    message_head head;
    union {
        message_hello hello;
        message_options options;
        message_error error;
        message_control control;
        message_state state;
        struct can_frame frame;
        struct canfd_frame fd;
        struct can_filter filters[MESSAGE_FILTERS_MAX];
    };
} message;

#endif
