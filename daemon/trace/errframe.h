/* SPDX-License-Identifier: MIT
 *
 * errframe.h - the error frames that a CAN driver would give its users, from events of the bus.
 *
 * As linux/can/error.h has them and as the SJA1000 driver uses them.
 */
#ifndef CANWIRE_TRACE_ERRFRAME_H
#define CANWIRE_TRACE_ERRFRAME_H

#include "canwire.h"

/* A SocketCAN frame of eight bytes with CAN_ERR_FLAG in can_id. */
typedef struct errframe {
    uint32_t can_id;
    uint8_t data[8];
} errframe;

/* Makes the error frame for a node's event, if there is one: state changes, restart and queue
 * overflow always, single bus errors and lost arbitration only with the CW_MODE_*_REPORTING that
 * asks for it among the modes. */
bool errframe_from_event(errframe *out, const cw_event *event, unsigned modes);

/* That frames were lost on their way to the bus. */
errframe errframe_rx_overflow(void);

/* Whether the frame may be left out in a storm: all but state changes, restarts and overflows on
 * the way to the bus. */
bool errframe_is_minor(const errframe *frame);

/* Lets ERRFRAME_BURST minor frames pass at once, and one more each ERRFRAME_REFILL_TICKS of bus
 * time, so that a storm of errors cannot drown a reader. */
#define ERRFRAME_BURST 256u
#define ERRFRAME_REFILL_TICKS (CW_CLOCK_HZ / 1000u)

typedef struct errframe_limit {
    uint32_t used;      /* of the burst */
    uint64_t tick;      /* up to which used is right */
    uint64_t left_out;  /* in all */
} errframe_limit;

/* Whether a frame passes at that tick; counts it when not. */
bool errframe_limit_pass(errframe_limit *limit, const errframe *frame, uint64_t tick);

#endif
