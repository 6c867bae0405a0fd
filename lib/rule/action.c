/* SPDX-License-Identifier: MIT
 *
 * action.c - the table of actions: kind, needs, ranges of numbers, and the function that acts.
 */
#include "rule/private.h"

#define NUMBER(member, from, to)                                                                   \
    {                                                                                              \
        .offset = offsetof(cw_rule, member), .bytes = sizeof((const cw_rule *)0)->member,          \
        .least = (from), .most = (to)                                                              \
    }
#define KEEP_OR(member, to)                                                                        \
    {                                                                                              \
        .offset = offsetof(cw_rule, member), .bytes = sizeof((const cw_rule *)0)->member,          \
        .most = (to), .may_keep = true                                                             \
    }

/* An action: its name, its kind, its traits, and what it has besides. */
#define ROW(what, called, sort, has, ...)                                                          \
    [CW_ACTION_##what] = {.name = (called), .kind = CW_KIND_##sort, .traits = (has), __VA_ARGS__}

const cw_action_row cw_actions[CW_ACTION_COUNT] = {
    ROW(FLIP, "flip", POSITION, CW_NEEDS_FRAME | CW_HAS_POSITION, .levels = cw_flip),
    ROW(FORCE, "force", POSITION, CW_NEEDS_FRAME | CW_HAS_POSITION, .levels = cw_force),
    ROW(GLITCH, "glitch", POSITION, CW_NEEDS_FRAME | CW_HAS_POSITION,
        .ranges = {NUMBER(bits, 0, CW_PATTERN_MAX)}, .levels = cw_glitch),
    ROW(STUCK, "stuck", LEVEL, CW_LASTS | CW_EACH_BIT | CW_ON_LINE, .levels = cw_hold_level),
    ROW(NOISE, "noise", LEVEL, CW_LASTS | CW_EACH_BIT | CW_FOR_ATTEMPT | CW_RANDOM_BITS,
        .ranges = {NUMBER(burst_least, 0, CW_BURST_MAX), NUMBER(burst_most, 0, CW_BURST_MAX)},
        .levels = cw_flip_at_random),
    ROW(NO_ACK, "no-ack", LEVEL, CW_LASTS | CW_FOR_ATTEMPT | CW_REWIRES),
    ROW(PULSE, "pulse", POSITION, CW_HAS_POSITION | CW_IN_TIME, .levels = cw_hold_level),
    ROW(JITTER, "jitter", LEVEL, CW_LASTS | CW_IN_TIME),
    ROW(RAMP, "ramp", LEVEL, CW_LASTS | CW_EACH_BIT | CW_IN_TIME),
    ROW(RAW, "raw", LEVEL, CW_EACH_BIT | CW_REWIRES, .ranges = {NUMBER(bits, 1, CW_RAW_MAX)}),
    ROW(DISCONNECT, "disconnect", LEVEL, CW_LASTS | CW_REWIRES),
    ROW(PARTITION, "partition", LEVEL, CW_LASTS | CW_REWIRES),
    ROW(WRONG_CRC, "wrong-crc", CONTROL, CW_NEEDS_FRAME | CW_IN_ENCODING),
    ROW(BUS_OFF, "bus-off", CONTROL, 0),
    ROW(ERROR_FLAG, "error-flag", CONTROL, 0),
    ROW(RESTART, "restart", CONTROL, 0),
    ROW(COUNTERS, "counters", CONTROL, 0,
        .ranges = {KEEP_OR(tec, CW_TEC_MAX), KEEP_OR(rec, CW_REC_MAX)}),
    ROW(OVERLOAD, "overload", CONTROL, 0, .ranges = {NUMBER(number, 1, CW_OVERLOADS_MAX)}),
    ROW(SET, "set", CONTROL, 0),
    ROW(SOFTWARE_RESET, "software-reset", CONTROL, 0),
    ROW(HARDWARE_RESET, "hardware-reset", CONTROL, 0),
    ROW(DROP, "drop", HOST, CW_NEEDS_FRAME | CW_AT_HOST, .host = cw_drop_frame),
    ROW(DELAY, "delay", HOST, CW_NEEDS_FRAME | CW_AT_HOST, .host = cw_delay_frame),
    ROW(DUPLICATE, "duplicate", HOST, CW_NEEDS_FRAME | CW_AT_HOST,
        .ranges = {NUMBER(number, 0, CW_COPIES_MAX)}, .host = cw_copy_frame),
    ROW(REORDER, "reorder", HOST, CW_NEEDS_FRAME | CW_AT_HOST, .host = cw_let_overtake),
    ROW(CHANGE, "change", HOST, CW_NEEDS_FRAME | CW_AT_HOST, .host = cw_change_frame),
    ROW(COUNTER, "counter", HOST, CW_NEEDS_FRAME | CW_AT_HOST | CW_IN_MAKING,
        .ranges = {NUMBER(number, 0, CW_COUNTER_FAULTS - 1)}, .host = cw_fault_counter),
    ROW(CHECKSUM, "checksum", HOST, CW_NEEDS_FRAME | CW_AT_HOST | CW_IN_MAKING,
        .host = cw_fault_checksum),
    ROW(SEND, "send", TRAFFIC, CW_LASTS | CW_SENDS_FRAME, .traffic = cw_send_periodically),
    ROW(BABBLE, "babble", TRAFFIC, CW_LASTS | CW_EACH_BIT | CW_SENDS_FRAME | CW_STEADY_TRAFFIC,
        .traffic = cw_babble),
    ROW(LOAD, "load", TRAFFIC, CW_LASTS | CW_EACH_BIT | CW_STEADY_TRAFFIC,
        .ranges = {NUMBER(load_permille, 0, 1000)}, .traffic = cw_fill_up),
    ROW(REPLY, "reply", TRAFFIC, CW_NEEDS_FRAME | CW_AT_HOST | CW_SENDS_FRAME),
    ROW(RAW_FRAME, "raw-frame", TRAFFIC, CW_LASTS | CW_SENDS_FRAME | CW_DEVIATES,
        .traffic = cw_send_periodically),
};

const char *cw_action_name(cw_action action)
{
    return cw_actions[action].name;
}

cw_action_kind cw_action_kind_of(cw_action action)
{
    return cw_actions[action].kind;
}

bool cw_action_needs_frame(cw_action action)
{
    return cw_actions[action].traits & CW_NEEDS_FRAME;
}
