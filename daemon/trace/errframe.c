/* SPDX-License-Identifier: MIT
 *
 * errframe.c - the error frames that a CAN driver would give its users, from events of the bus.
 */
#include "trace/errframe.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <string.h>

/* Linux 6.0 introduced this name; older headers lack it. */
#ifndef CAN_ERR_CNT
#define CAN_ERR_CNT 0x00000200U
#endif

/* Segment codes of the SJA1000's error code capture without a name in linux/can/error.h; the driver
 * passes them on unchanged. */
#define LOC_ACTIVE_FLAG 0x11
#define LOC_DOMINANT_BITS 0x13
#define LOC_PASSIVE_FLAG 0x16
#define LOC_DELIMITER 0x17
#define LOC_OVERLOAD_FLAG 0x1C

/* ---- Per-error frames ------------------------------------------------------------------------ */

static const struct {
    uint32_t error_class; /* besides PROT and BUSERROR */
    uint8_t protocol;     /* data[2] */
} error_types[CW_ERROR_COUNT] = {
    [CW_ERROR_BIT] = {0, CAN_ERR_PROT_BIT},
    [CW_ERROR_STUFF] = {0, CAN_ERR_PROT_STUFF},
    [CW_ERROR_FORM] = {0, CAN_ERR_PROT_FORM},
    [CW_ERROR_CRC] = {0, CAN_ERR_PROT_UNSPEC},
    [CW_ERROR_ACK] = {CAN_ERR_ACK, CAN_ERR_PROT_UNSPEC},
};

/* data[3] by field; location() refines ID and RTR. BRS and ESI of CAN FD frames have no code of
 * their own. They come just before the DLC. */
static const uint8_t locations[CW_FIELD_COUNT] = {
    [CW_FIELD_SOF] = CAN_ERR_PROT_LOC_SOF,
    [CW_FIELD_SRR] = CAN_ERR_PROT_LOC_SRTR,
    [CW_FIELD_IDE] = CAN_ERR_PROT_LOC_IDE,
    [CW_FIELD_R1] = CAN_ERR_PROT_LOC_RES1,
    [CW_FIELD_R0] = CAN_ERR_PROT_LOC_RES0,
    [CW_FIELD_FDF] = CAN_ERR_PROT_LOC_RES0,
    [CW_FIELD_RES] = CAN_ERR_PROT_LOC_RES0,
    [CW_FIELD_BRS] = CAN_ERR_PROT_LOC_DLC,
    [CW_FIELD_ESI] = CAN_ERR_PROT_LOC_DLC,
    [CW_FIELD_DLC] = CAN_ERR_PROT_LOC_DLC,
    [CW_FIELD_DATA] = CAN_ERR_PROT_LOC_DATA,
    [CW_FIELD_STUFF_COUNT] = CAN_ERR_PROT_LOC_CRC_SEQ,
    [CW_FIELD_CRC] = CAN_ERR_PROT_LOC_CRC_SEQ,
    [CW_FIELD_FIXED_STUFF] = CAN_ERR_PROT_LOC_CRC_SEQ,
    [CW_FIELD_CRC_DELIMITER] = CAN_ERR_PROT_LOC_CRC_DEL,
    [CW_FIELD_ACK_SLOT] = CAN_ERR_PROT_LOC_ACK,
    [CW_FIELD_ACK_DELIMITER] = CAN_ERR_PROT_LOC_ACK_DEL,
    [CW_FIELD_EOF] = CAN_ERR_PROT_LOC_EOF,
    [CW_FIELD_INTERMISSION] = CAN_ERR_PROT_LOC_INTERM,
    [CW_FIELD_ERROR_FLAG] = LOC_ACTIVE_FLAG,
    [CW_FIELD_ERROR_DELIMITER] = LOC_DELIMITER,
    [CW_FIELD_OVERLOAD_FLAG] = LOC_OVERLOAD_FLAG,
    [CW_FIELD_OVERLOAD_DELIMITER] = LOC_DELIMITER,
};

static uint8_t identifier_location(unsigned index)
{
    if (index < 8)
        return CAN_ERR_PROT_LOC_ID28_21;
    if (index < 11)
        return CAN_ERR_PROT_LOC_ID20_18;
    if (index < 16)
        return CAN_ERR_PROT_LOC_ID17_13;
    return index < 24 ? CAN_ERR_PROT_LOC_ID12_05 : CAN_ERR_PROT_LOC_ID04_00;
}

static uint8_t location(const cw_error *error)
{
    if (error->type == CW_ERROR_CRC) /* detected at the ACK delimiter, but it concerns the CRC
                                        sequence */
        return CAN_ERR_PROT_LOC_CRC_SEQ;
    if (error->place.field == CW_FIELD_ID)
        return identifier_location(error->place.index);
    if (error->place.field == CW_FIELD_RTR)
        return error->place.extended ? CAN_ERR_PROT_LOC_RTR : CAN_ERR_PROT_LOC_SRTR;
    return locations[error->place.field];
}

static void set_counters(errframe *out, const cw_event *event)
{
    out->can_id |= CAN_ERR_CNT;
    out->data[6] = (uint8_t)event->tec;
    out->data[7] = (uint8_t)event->rec;
}

/* Sets the details of an error. A TEC above 255 does not fit, and a frame of its own reports
 * bus-off. */
static void set_bus_error(errframe *out, const cw_event *event)
{
    out->can_id |= CAN_ERR_PROT | CAN_ERR_BUSERROR;
    if (event->error.role == CW_ROLE_TRANSMITTER)
        out->data[2] |= CAN_ERR_PROT_TX;
    if (event->tec <= UINT8_MAX)
        set_counters(out, event);
}

static void set_error(errframe *out, const cw_event *event)
{
    out->can_id |= error_types[event->error.type].error_class;
    out->data[2] = error_types[event->error.type].protocol;
    out->data[3] = location(&event->error);
    set_bus_error(out, event);
}

/* Sets the details of dominant bits after a flag (R2, R6), or in the passive flag after a missing
 * ACK (R3 i). */
static void set_tolerated(errframe *out, const cw_event *event)
{
    bool in_flag = event->error.place.field == CW_FIELD_ERROR_FLAG;
    out->data[3] = in_flag ? LOC_PASSIVE_FLAG : LOC_DOMINANT_BITS;
    set_bus_error(out, event);
}

/* ---- State changes --------------------------------------------------------------------------- */

static const struct {
    uint8_t tx; /* data[1] when the transmit counter is the larger one */
    uint8_t rx;
} states[CW_STATE_COUNT] = {
    [CW_STATE_ERROR_ACTIVE] = {CAN_ERR_CRTL_ACTIVE, CAN_ERR_CRTL_ACTIVE},
    [CW_STATE_ERROR_WARNING] = {CAN_ERR_CRTL_TX_WARNING, CAN_ERR_CRTL_RX_WARNING},
    [CW_STATE_ERROR_PASSIVE] = {CAN_ERR_CRTL_TX_PASSIVE, CAN_ERR_CRTL_RX_PASSIVE},
    [CW_STATE_BUS_OFF] = {0, 0}, /* a class of its own */
    [CW_STATE_SLEEPING] = {0, 0}, /* drivers say nothing of it */
};

static void set_state(errframe *out, const cw_event *event)
{
    if (event->state == CW_STATE_BUS_OFF) {
        out->can_id |= CAN_ERR_BUSOFF;
        return;
    }
    out->can_id |= CAN_ERR_CRTL;
    if (event->tec >= event->rec)
        out->data[1] |= states[event->state].tx;
    if (event->tec <= event->rec)
        out->data[1] |= states[event->state].rx;
    set_counters(out, event);
}

/* ---- All events ------------------------------------------------------------------------------ */

bool errframe_from_event(errframe *out, const cw_event *event, unsigned modes)
{
    memset(out, 0, sizeof *out);
    out->can_id = CAN_ERR_FLAG;
    switch (event->kind) {
    case CW_EVENT_STATE:
        set_state(out, event);
        return event->state != CW_STATE_SLEEPING && event->state_before != CW_STATE_SLEEPING;
    case CW_EVENT_RESTART:
        out->can_id |= CAN_ERR_RESTARTED;
        return true;
    case CW_EVENT_ARBITRATION_LOST:
        out->can_id |= CAN_ERR_LOSTARB;
        out->data[0] = event->lost_bit;
        return modes & CW_MODE_LOST_ARBITRATION_REPORTING;
    case CW_EVENT_DROP:
        out->can_id |= CAN_ERR_CRTL;
        out->data[1] = CAN_ERR_CRTL_TX_OVERFLOW;
        return event->why == CW_DROP_QUEUE_FULL;
    case CW_EVENT_ERROR:
        set_error(out, event);
        return modes & CW_MODE_BERR_REPORTING;
    case CW_EVENT_TOLERATED:
        set_tolerated(out, event);
        return modes & CW_MODE_BERR_REPORTING;
    case CW_EVENT_OVERRUN:
        *out = errframe_rx_overflow();
        return true;
    case CW_EVENT_FAULT:
    case CW_EVENT_LINK:
    case CW_EVENT_IMPROPER:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_EXCEPTION:
    case CW_EVENT_RX:
    case CW_EVENT_TX:
    case CW_EVENT_WAKE:
    case CW_EVENT_SKIP:
    case CW_EVENT_SYNC:
    case CW_EVENT_COUNT:
        break;
    }
    return false;
}

errframe errframe_rx_overflow(void)
{
    return (errframe){.can_id = CAN_ERR_FLAG | CAN_ERR_CRTL,
                      .data = {[1] = CAN_ERR_CRTL_RX_OVERFLOW}};
}

/* ---- Limit ----------------------------------------------------------------------------------- */

bool errframe_is_minor(const errframe *frame)
{
    const bool overflow = frame->data[1] & (CAN_ERR_CRTL_TX_OVERFLOW | CAN_ERR_CRTL_RX_OVERFLOW);
    const bool state = (frame->can_id & CAN_ERR_CRTL) && !overflow;
    return !state && !(frame->can_id & (CAN_ERR_BUSOFF | CAN_ERR_RESTARTED));
}

bool errframe_limit_pass(errframe_limit *limit, const errframe *frame, uint64_t tick)
{
    uint64_t refill = (tick - limit->tick) / ERRFRAME_REFILL_TICKS;
    limit->tick += refill * ERRFRAME_REFILL_TICKS;
    limit->used = refill < limit->used ? limit->used - (uint32_t)refill : 0;
    if (!errframe_is_minor(frame))
        return true;
    if (limit->used >= ERRFRAME_BURST) {
        limit->left_out++;
        return false;
    }
    limit->used++;
    return true;
}
