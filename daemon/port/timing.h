/* SPDX-License-Identifier: MIT
 *
 * timing.h - the protocol between a bus in virtual time and its programs; canwire-ports(7) has it
 * for users.
 *
 * A program connects to the bus's socket of time, of type SOCK_SEQPACKET, beside its connections to
 * ports. Messages have the head of messages.h. Times are bus time in ns.
 */
#ifndef CANWIRE_PORT_TIMING_H
#define CANWIRE_PORT_TIMING_H

#include "port/messages.h"
#include "port/port.h"

#define TIMING_VERSION 1u
#define TIMING_PROGRAM_BYTES 128u
#define TIMING_ANCESTORS 16u
#define TIMING_NEVER INT64_MAX

typedef enum timing_type {
    TIMING_JOIN = 1, /* the first message of a program: timing_join. NOW answers it, or ERROR */
    TIMING_NOW,      /* to the program: it has its turn, at `bus_ns` of the head */
    TIMING_WAIT,     /* from it: its turn ends, until `bus_ns` at the latest */
    TIMING_CANCEL,   /* from it: it no longer wants to wait; NOW answers it */
    TIMING_CHILDREN, /* from it: its turn ends; it waits for a child, for any time */
    TIMING_ERROR = MESSAGE_ERROR /* to it: message_error; the connection ends */
} timing_type;

/* Flags of TIMING_WAIT. */
#define TIMING_MESSAGES PORT_TOLD_MESSAGE /* also until a port has sent it a message ... */
#define TIMING_ROOM PORT_TOLD_ROOM        /* ... or has read one of it, which makes room */

typedef struct timing_join {
    char magic[8]; /* MESSAGE_MAGIC */
    uint32_t version;
    int32_t pid; /* of the program; 0: that of the connection */
    int32_t ancestors[TIMING_ANCESTORS]; /* its parent, the parent of that and so on; 0 ends it */
    char node[MESSAGE_NAME_BYTES];         /* that it is */
    char program[TIMING_PROGRAM_BYTES]; /* its words, which order programs of one node */
} timing_join;

typedef struct timing_message {
    message_head head;
    union {
        timing_join join;
        message_error error;
    };
} timing_message;

#endif
