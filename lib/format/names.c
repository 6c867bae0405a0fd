/* SPDX-License-Identifier: MIT
 *
 * names.c - the words of events and configuration for the enums of canwire.h.
 */
#include "canwire.h"

#include <assert.h>

const char *cw_field_name(cw_field field)
{
    static const char *const names[CW_FIELD_COUNT] = {
        [CW_FIELD_NONE] = "none",
        [CW_FIELD_SOF] = "sof",
        [CW_FIELD_ID] = "id",
        [CW_FIELD_SRR] = "srr",
        [CW_FIELD_IDE] = "ide",
        [CW_FIELD_RTR] = "rtr",
        [CW_FIELD_R1] = "r1",
        [CW_FIELD_R0] = "r0",
        [CW_FIELD_FDF] = "fdf",
        [CW_FIELD_RES] = "res",
        [CW_FIELD_BRS] = "brs",
        [CW_FIELD_ESI] = "esi",
        [CW_FIELD_DLC] = "dlc",
        [CW_FIELD_DATA] = "data",
        [CW_FIELD_STUFF_COUNT] = "stuff-count",
        [CW_FIELD_CRC] = "crc",
        [CW_FIELD_FIXED_STUFF] = "fixed-stuff",
        [CW_FIELD_CRC_DELIMITER] = "crc-delimiter",
        [CW_FIELD_ACK_SLOT] = "ack-slot",
        [CW_FIELD_ACK_DELIMITER] = "ack-delimiter",
        [CW_FIELD_EOF] = "eof",
        [CW_FIELD_INTERMISSION] = "intermission",
        [CW_FIELD_SUSPEND] = "suspend",
        [CW_FIELD_ERROR_FLAG] = "error-flag",
        [CW_FIELD_ERROR_DELIMITER] = "error-delimiter",
        [CW_FIELD_OVERLOAD_FLAG] = "overload-flag",
        [CW_FIELD_OVERLOAD_DELIMITER] = "overload-delimiter",
        [CW_FIELD_STUFF] = "stuff",
        [CW_FIELD_BIT] = "bit",
    };
    assert(field < CW_FIELD_COUNT);
    return names[field];
}

const char *cw_error_type_name(cw_error_type type)
{
    static const char *const names[CW_ERROR_COUNT] = {"bit", "stuff", "form", "crc", "ack"};
    assert(type < CW_ERROR_COUNT);
    return names[type];
}

const char *cw_flag_name(cw_flag flag)
{
    static const char *const names[] = {"none", "active", "passive"};
    assert(flag <= CW_FLAG_PASSIVE);
    return names[flag];
}

const char *cw_state_name(cw_state state)
{
    static const char *const names[CW_STATE_COUNT] = {"error-active", "error-warning",
                                                      "error-passive", "bus-off",
                                                      "sleeping"};
    assert(state < CW_STATE_COUNT);
    return names[state];
}

const char *cw_drop_name(cw_drop why)
{
    static const char *const names[CW_DROP_COUNT] = {"queue-full",  "one-shot",  "bus-off",
                                                     "listen-only", "bad-frame", "fault",
                                                     "removed",     "link-down", "slot-missed"};
    assert(why < CW_DROP_COUNT);
    return names[why];
}

const char *cw_event_name(cw_event_kind kind)
{
    static const char *const names[CW_EVENT_COUNT] = {
        "fault",    "link",
        "drop",     "restart",
        "arbitration-lost", "improper-arbitration",
        "error",
        "tolerated", "overload",
        "protocol-exception", "overrun",
        "rx",       "tx",
        "wake",     "state",
        "skip",     "sync",
        "capture",
    };
    assert(kind < CW_EVENT_COUNT);
    return names[kind];
}

const char *cw_wake_name(cw_wake wake)
{
    static const char *const names[CW_WAKE_COUNT] = {"pattern", "frame", "host"};
    assert(wake < CW_WAKE_COUNT);
    return names[wake];
}
