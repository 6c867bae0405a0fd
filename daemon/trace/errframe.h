/* SPDX-License-Identifier: MIT
 *
 * errframe.h - the error frames that a CAN driver would give its users, from events of the bus.
 *
 * The frames follow linux/can/error.h and the SJA1000 driver. Other drivers tell less, or tell it
 * in another way: see canwire-controller(7).
 */
#ifndef CANWIRE_TRACE_ERRFRAME_H
#define CANWIRE_TRACE_ERRFRAME_H

#include "canwire.h"

/* A SocketCAN frame of eight bytes with CAN_ERR_FLAG in can_id. */
typedef struct errframe {
    uint32_t can_id;
    uint8_t data[8];
} errframe;

/* The drivers of Linux whose habits are known. */
typedef enum errframe_driver {
    ERRFRAME_ANY = 0, /* none of them: everything, with all details */
    ERRFRAME_SJA1000,
    ERRFRAME_MCP251X,
    ERRFRAME_M_CAN,
    ERRFRAME_FLEXCAN,
    ERRFRAME_BXCAN,
    ERRFRAME_DRIVERS
} errframe_driver;

/* Makes the error frame for a node's event, if the driver has one. Without a driver, state changes,
 * restarts and queue overflows always have one. Single bus errors and lost arbitration need their
 * CW_MODE_*_REPORTING among the modes. */
bool errframe_from_event(errframe *out, const cw_event *event, unsigned modes,
                         errframe_driver driver);

/* Makes the error frame for frames that were lost on their way to the bus, or by an overrun. */
errframe errframe_rx_overflow(void);

/* Returns true when the frame may be left out in a storm. State changes and restarts are never left
 * out. */
bool errframe_is_minor(const errframe *frame);

/* Limits error frames, so that a storm of errors does not overload a reader. ERRFRAME_BURST minor
 * frames pass at once, and one more each ERRFRAME_REFILL_TICKS of bus time. */
#define ERRFRAME_BURST 256u
#define ERRFRAME_REFILL_TICKS (CW_CLOCK_HZ / 1000u)

typedef struct errframe_limit {
    uint32_t used;      /* of the burst */
    uint64_t tick;      /* `used` is valid up to this tick */
    uint64_t left_out;  /* in all */
} errframe_limit;

/* Returns true when a frame passes at that tick; counts it otherwise. */
bool errframe_limit_pass(errframe_limit *limit, const errframe *frame, uint64_t tick);

#endif
