/* SPDX-License-Identifier: MIT
 *
 * errframe.c - the error frames that a CAN driver would give its users, from events of the bus.
 */
#include "trace/errframe.h"

#include <linux/can.h>
#include <linux/can/error.h>
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

/* Bits of an identifier count from the first one sent, bit 28 or 10. */
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

/* Returns the place as the SJA1000 captures it: a segment code, not a bit. */
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

/* ---- Habits of drivers ----------------------------------------------------------------------- */

typedef enum bus_errors {
    BUS_ERRORS_NONE = 0, /* the driver has none */
    BUS_ERRORS_PLACES,   /* with the place, as the SJA1000 captures it */
    BUS_ERRORS_KINDS,    /* with the last error code alone */
} bus_errors;

typedef enum reporting {
    REPORTING_NEVER = 0,
    REPORTING_ON_REQUEST, /* by the mode of the node */
    REPORTING_ALWAYS,
} reporting;

/* Returns data[1] for the state and the counters of an event. */
typedef uint8_t crtl_of_state(const cw_event *event);

static crtl_of_state by_larger_counter, by_flags_of_mcp251x, by_counters_of_m_can,
    by_limits_of_flexcan;

/* Sources are named in canwire-controller(7). */
static const struct habits {
    crtl_of_state *crtl;
    bool counters;         /* of states, in data[6..7] ... */
    bool counters_in_all;  /* ... and of all other frames but those of bus-off and restarts */
    bool tells_recovery;   /* that a node is less than error-passive again ... */
    bool tells_active;     /* ... that it is error-active */
    bool tells_restart;    /* ... and so after bus-off */
    bool receive_overflow; /* tells it ... */
    bool with_state;       /* ... together with the state */
    bool transmit_overflow;
    bus_errors bus_errors;
    bool ack_class;        /* CAN_ERR_ACK for a missing acknowledgement */
    uint8_t crc;           /* data[2] of a wrong CRC */
    reporting arbitration; /* of lost ones */
    uint8_t most_rec;      /* in data[7] */
} drivers[ERRFRAME_DRIVERS] = {
    [ERRFRAME_ANY] = {.crtl = by_larger_counter, .counters = true, .tells_recovery = true,
                      .tells_active = true, .tells_restart = true, .receive_overflow = true,
                      .transmit_overflow = true, .bus_errors = BUS_ERRORS_PLACES,
                      .ack_class = true, .arbitration = REPORTING_ON_REQUEST,
                      .most_rec = UINT8_MAX},
    [ERRFRAME_SJA1000] = {.crtl = by_larger_counter, .counters = true, .counters_in_all = true,
                          .tells_recovery = true, .tells_active = true, .receive_overflow = true,
                          .bus_errors = BUS_ERRORS_PLACES, .arbitration = REPORTING_ALWAYS,
                          .most_rec = UINT8_MAX},
    [ERRFRAME_MCP251X] = {.crtl = by_flags_of_mcp251x, .receive_overflow = true,
                          .with_state = true, .most_rec = UINT8_MAX},
    [ERRFRAME_M_CAN] = {.crtl = by_counters_of_m_can, .counters = true, .tells_recovery = true,
                        .receive_overflow = true, .bus_errors = BUS_ERRORS_KINDS,
                        .most_rec = INT8_MAX},
    [ERRFRAME_FLEXCAN] = {.crtl = by_limits_of_flexcan, .tells_recovery = true,
                          .tells_active = true, .bus_errors = BUS_ERRORS_KINDS,
                          .ack_class = true, .crc = CAN_ERR_PROT_BIT, .most_rec = UINT8_MAX},
    [ERRFRAME_BXCAN] = {.crtl = by_larger_counter, .counters = true, .tells_recovery = true,
                        .bus_errors = BUS_ERRORS_KINDS, .ack_class = true,
                        .crc = CAN_ERR_PROT_BIT, .most_rec = UINT8_MAX},
};

static void set_counters(errframe *out, const cw_event *event, const struct habits *habits)
{
    out->can_id |= CAN_ERR_CNT;
    out->data[6] = (uint8_t)event->tec;
    out->data[7] = (uint8_t)(event->rec < habits->most_rec ? event->rec : habits->most_rec);
}

/* ---- Single errors --------------------------------------------------------------------------- */

/* Sets the details of an error. A TEC above 255 does not fit, and a frame of its own reports
 * bus-off. */
static void set_bus_error(errframe *out, const cw_event *event, const struct habits *habits)
{
    out->can_id |= CAN_ERR_PROT | CAN_ERR_BUSERROR;
    if (event->error.role == CW_ROLE_TRANSMITTER)
        out->data[2] |= CAN_ERR_PROT_TX;
    if (event->tec <= UINT8_MAX)
        set_counters(out, event, habits);
}

/* Sets the kind and the place of an error as the error code capture of the SJA1000 has them. */
static void set_error(errframe *out, const cw_event *event, const struct habits *habits)
{
    if (habits->ack_class)
        out->can_id |= error_types[event->error.type].error_class;
    out->data[2] = error_types[event->error.type].protocol;
    out->data[3] = location(&event->error);
    set_bus_error(out, event, habits);
}

/* Sets what the last error code of a controller says. A bit error has the level that was sent, if
 * that is known. */
static void set_last_error(errframe *out, const cw_event *event, const struct habits *habits)
{
    const cw_error *error = &event->error;

    out->can_id |= CAN_ERR_PROT | CAN_ERR_BUSERROR;
    out->data[2] = error_types[error->type].protocol;
    if (error->type == CW_ERROR_BIT && error->sent)
        out->data[2] = error->sent == 1 + CW_RECESSIVE ? CAN_ERR_PROT_BIT1 : CAN_ERR_PROT_BIT0;
    if (error->type == CW_ERROR_CRC) {
        out->data[2] = habits->crc;
        out->data[3] = CAN_ERR_PROT_LOC_CRC_SEQ;
    }
    if (error->type == CW_ERROR_ACK) {
        out->can_id |= habits->ack_class ? CAN_ERR_ACK : 0;
        out->data[3] = CAN_ERR_PROT_LOC_ACK;
    }
}

/* Sets the details of dominant bits after a flag (R2, R6), or in the passive flag after a missing
 * ACK (R3 i). */
static void set_tolerated(errframe *out, const cw_event *event, const struct habits *habits)
{
    bool in_flag = event->error.place.field == CW_FIELD_ERROR_FLAG;
    out->data[3] = in_flag ? LOC_PASSIVE_FLAG : LOC_DOMINANT_BITS;
    set_bus_error(out, event, habits);
}

/* Returns true when the driver tells of the error, which also depends on berr-reporting. */
static bool tell_error(errframe *out, const cw_event *event, unsigned modes,
                       const struct habits *habits)
{
    const bool tolerated = event->kind == CW_EVENT_TOLERATED;

    if (habits->bus_errors == BUS_ERRORS_PLACES && tolerated)
        set_tolerated(out, event, habits);
    else if (habits->bus_errors == BUS_ERRORS_PLACES)
        set_error(out, event, habits);
    else
        set_last_error(out, event, habits);
    return (modes & CW_MODE_BERR_REPORTING) && habits->bus_errors != BUS_ERRORS_NONE &&
           (!tolerated || habits->bus_errors == BUS_ERRORS_PLACES);
}

/* ---- State changes --------------------------------------------------------------------------- */

#define PASSIVE_LIMIT 128u
#define WARNING_LIMIT 96u /* of these controllers */

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

static uint8_t crtl(unsigned state, bool tx, bool rx)
{
    return (uint8_t)((tx ? states[state].tx : 0) | (rx ? states[state].rx : 0));
}

static uint8_t by_larger_counter(const cw_event *event)
{
    return crtl(event->state, event->tec >= event->rec, event->tec <= event->rec);
}

/* The flag of the transmit counter comes first, and only one of the two is told. */
static uint8_t by_flags_of_mcp251x(const cw_event *event)
{
    const unsigned limit = event->state == CW_STATE_ERROR_PASSIVE ? PASSIVE_LIMIT : WARNING_LIMIT;
    const bool tx = event->tec >= limit || (event->rec < limit && event->tec >= event->rec);

    return crtl(event->state, tx, !tx);
}

static uint8_t by_counters_of_m_can(const cw_event *event)
{
    if (event->state == CW_STATE_ERROR_PASSIVE)
        return crtl(event->state, event->tec >= PASSIVE_LIMIT, event->rec >= PASSIVE_LIMIT);
    return crtl(event->state, event->tec > event->rec, event->tec <= event->rec);
}

/* Its two warnings do not exclude each other. */
static uint8_t by_limits_of_flexcan(const cw_event *event)
{
    const bool both = event->tec >= WARNING_LIMIT && event->rec >= WARNING_LIMIT;

    if (event->state == CW_STATE_ERROR_WARNING && both)
        return crtl(event->state, true, true);
    return by_larger_counter(event);
}

/* Returns true when the driver tells of the change. Some are silent when a node gets better. */
static bool tell_state(errframe *out, const cw_event *event, const struct habits *habits)
{
    const bool falls = event->state < event->state_before;

    if (event->state == CW_STATE_BUS_OFF) {
        out->can_id |= CAN_ERR_BUSOFF;
        return true;
    }
    out->can_id |= CAN_ERR_CRTL;
    out->data[1] = habits->crtl(event);
    if (habits->counters)
        set_counters(out, event, habits);
    if (event->state_before == CW_STATE_BUS_OFF)
        return habits->tells_restart;
    return event->state == CW_STATE_ERROR_ACTIVE ? habits->tells_active
                                                 : !falls || habits->tells_recovery;
}

/* Returns an event with the state that its counters say. */
static cw_event with_state(const cw_event *event)
{
    const unsigned larger = event->tec > event->rec ? event->tec : event->rec;
    cw_event state = {.tec = event->tec, .rec = event->rec, .state = CW_STATE_ERROR_ACTIVE};

    if (larger >= PASSIVE_LIMIT)
        state.state = CW_STATE_ERROR_PASSIVE;
    else if (larger >= WARNING_LIMIT)
        state.state = CW_STATE_ERROR_WARNING;
    return state;
}

/* Returns true when the driver tells of the overflow. Some drivers add the state and the
 * counters. */
static bool tell_receive_overflow(errframe *out, const cw_event *event,
                                  const struct habits *habits)
{
    const cw_event state = with_state(event);

    *out = errframe_rx_overflow();
    if (habits->with_state && state.state != CW_STATE_ERROR_ACTIVE)
        out->data[1] |= habits->crtl(&state);
    if (habits->counters_in_all)
        set_counters(out, event, habits);
    return habits->receive_overflow;
}

/* data[0] is the bit that was lost, as the driver gets it from its controller. */
static bool tell_lost_arbitration(errframe *out, const cw_event *event, unsigned modes,
                                  const struct habits *habits)
{
    out->can_id |= CAN_ERR_LOSTARB;
    out->data[0] = event->lost_bit;
    if (habits->counters_in_all)
        set_counters(out, event, habits);
    return habits->arbitration == REPORTING_ALWAYS ||
           (habits->arbitration == REPORTING_ON_REQUEST &&
            (modes & CW_MODE_LOST_ARBITRATION_REPORTING));
}

/* ---- All events ------------------------------------------------------------------------------ */

bool errframe_from_event(errframe *out, const cw_event *event, unsigned modes,
                         errframe_driver driver)
{
    const struct habits *habits = &drivers[driver];

    *out = (errframe){.can_id = CAN_ERR_FLAG};
    switch (event->kind) {
    case CW_EVENT_STATE:
        return tell_state(out, event, habits) && event->state != CW_STATE_SLEEPING &&
               event->state_before != CW_STATE_SLEEPING;
    case CW_EVENT_RESTART:
        out->can_id |= CAN_ERR_RESTARTED;
        return true;
    case CW_EVENT_ARBITRATION_LOST:
        return tell_lost_arbitration(out, event, modes, habits);
    case CW_EVENT_DROP:
        out->can_id |= CAN_ERR_CRTL;
        out->data[1] = CAN_ERR_CRTL_TX_OVERFLOW;
        return event->why == CW_DROP_QUEUE_FULL && habits->transmit_overflow;
    case CW_EVENT_ERROR:
    case CW_EVENT_TOLERATED:
        return tell_error(out, event, modes, habits);
    case CW_EVENT_OVERRUN:
        return tell_receive_overflow(out, event, habits);
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
    case CW_EVENT_CAPTURE:
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
