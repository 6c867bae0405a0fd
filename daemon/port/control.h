/* SPDX-License-Identifier: MIT
 *
 * control.h - what a program orders that is the controller of a node, and what it is told.
 */
#ifndef CANWIRE_PORT_CONTROL_H
#define CANWIRE_PORT_CONTROL_H

#include <stdint.h>

#define MESSAGE_SETTINGS_BYTES 1024u

/* The order of a controller. Its settings are taken before anything else. */
typedef enum message_order {
    MESSAGE_SET = 0, /* nothing else */
    MESSAGE_OFF,     /* the node leaves the bus: its frames are dropped */
    MESSAGE_ON,      /* ... comes onto it */
    MESSAGE_RESTART, /* ... leaves bus-off, as the standard says */
    MESSAGE_ORDERS
} message_order;

typedef struct message_state {
    uint32_t state; /* 0 error-active, 1 error-warning, 2 error-passive, 3 bus-off, 4 sleeping */
    uint32_t tec;
    uint32_t rec;
} message_state;

#endif
