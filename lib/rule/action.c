/* SPDX-License-Identifier: MIT
 *
 * action.c - the table of actions: kind, needs, ranges of numbers, and the function that acts.
 */
#include "rule/private.h"

#include "mac/confinement.h"

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

const cw_action_row cw_actions[CW_ACTION_COUNT] = {
    [CW_ACTION_FLIP] = {.name = "flip",
                        .kind = CW_KIND_POSITION,
                        .traits = CW_NEEDS_FRAME | CW_HAS_POSITION,
                        .levels = cw_flip},
    [CW_ACTION_FORCE] = {.name = "force",
                         .kind = CW_KIND_POSITION,
                         .traits = CW_NEEDS_FRAME | CW_HAS_POSITION,
                         .levels = cw_force},
    [CW_ACTION_GLITCH] = {.name = "glitch",
                          .kind = CW_KIND_POSITION,
                          .traits = CW_NEEDS_FRAME | CW_HAS_POSITION,
                          .ranges = {NUMBER(bits, 0, CW_PATTERN_MAX)},
                          .levels = cw_glitch},
    [CW_ACTION_STUCK] = {.name = "stuck",
                         .kind = CW_KIND_LEVEL,
                         .traits = CW_LASTS | CW_EACH_BIT | CW_ON_LINE,
                         .levels = cw_hold_level},
    [CW_ACTION_NOISE] = {.name = "noise",
                         .kind = CW_KIND_LEVEL,
                         .traits = CW_LASTS | CW_EACH_BIT | CW_FOR_ATTEMPT | CW_RANDOM_BITS,
                         .ranges = {NUMBER(burst_least, 0, CW_BURST_MAX),
                                    NUMBER(burst_most, 0, CW_BURST_MAX)},
                         .levels = cw_flip_at_random},
    [CW_ACTION_NO_ACK] = {.name = "no-ack",
                          .kind = CW_KIND_LEVEL,
                          .traits = CW_LASTS | CW_FOR_ATTEMPT | CW_REWIRES},
    [CW_ACTION_PULSE] = {.name = "pulse",
                         .kind = CW_KIND_POSITION,
                         .traits = CW_HAS_POSITION | CW_IN_TIME,
                         .levels = cw_hold_level},
    [CW_ACTION_JITTER] = {.name = "jitter",
                          .kind = CW_KIND_LEVEL,
                          .traits = CW_LASTS | CW_IN_TIME},
    [CW_ACTION_RAMP] = {.name = "ramp",
                        .kind = CW_KIND_LEVEL,
                        .traits = CW_LASTS | CW_EACH_BIT | CW_IN_TIME},
    [CW_ACTION_RAW] = {.name = "raw",
                       .kind = CW_KIND_LEVEL,
                       .traits = CW_EACH_BIT | CW_REWIRES,
                       .ranges = {NUMBER(bits, 1, CW_RAW_MAX)}},
    [CW_ACTION_DISCONNECT] = {.name = "disconnect",
                              .kind = CW_KIND_LEVEL,
                              .traits = CW_LASTS | CW_REWIRES},
    [CW_ACTION_PARTITION] = {.name = "partition",
                             .kind = CW_KIND_LEVEL,
                             .traits = CW_LASTS | CW_REWIRES},
    [CW_ACTION_WRONG_CRC] = {.name = "wrong-crc",
                             .kind = CW_KIND_CONTROL,
                             .traits = CW_NEEDS_FRAME | CW_IN_ENCODING},
    [CW_ACTION_BUS_OFF] = {.name = "bus-off",
                           .kind = CW_KIND_CONTROL},
    [CW_ACTION_ERROR_FLAG] = {.name = "error-flag",
                              .kind = CW_KIND_CONTROL},
    [CW_ACTION_RESTART] = {.name = "restart",
                           .kind = CW_KIND_CONTROL},
    [CW_ACTION_COUNTERS] = {.name = "counters",
                            .kind = CW_KIND_CONTROL,
                            .ranges = {KEEP_OR(tec, CW_TEC_MAX), KEEP_OR(rec, CW_REC_MAX)}},
    [CW_ACTION_OVERLOAD] = {.name = "overload",
                            .kind = CW_KIND_CONTROL,
                            .ranges = {NUMBER(number, 1, 2)}},
    [CW_ACTION_SET] = {.name = "set",
                       .kind = CW_KIND_CONTROL},
    [CW_ACTION_SOFTWARE_RESET] = {.name = "software-reset",
                                  .kind = CW_KIND_CONTROL},
    [CW_ACTION_HARDWARE_RESET] = {.name = "hardware-reset",
                                  .kind = CW_KIND_CONTROL},
    [CW_ACTION_DROP] = {.name = "drop",
                        .kind = CW_KIND_HOST,
                        .traits = CW_NEEDS_FRAME | CW_AT_HOST,
                        .host = cw_drop_frame},
    [CW_ACTION_DELAY] = {.name = "delay",
                         .kind = CW_KIND_HOST,
                         .traits = CW_NEEDS_FRAME | CW_AT_HOST,
                         .host = cw_delay_frame},
    [CW_ACTION_DUPLICATE] = {.name = "duplicate",
                             .kind = CW_KIND_HOST,
                             .traits = CW_NEEDS_FRAME | CW_AT_HOST,
                             .ranges = {NUMBER(number, 0, CW_COPIES_MAX)},
                             .host = cw_copy_frame},
    [CW_ACTION_REORDER] = {.name = "reorder",
                           .kind = CW_KIND_HOST,
                           .traits = CW_NEEDS_FRAME | CW_AT_HOST,
                           .host = cw_let_overtake},
    [CW_ACTION_CHANGE] = {.name = "change",
                          .kind = CW_KIND_HOST,
                          .traits = CW_NEEDS_FRAME | CW_AT_HOST,
                          .host = cw_change_frame},
    [CW_ACTION_COUNTER] = {.name = "counter",
                           .kind = CW_KIND_HOST,
                           .traits = CW_NEEDS_FRAME | CW_AT_HOST | CW_IN_MAKING,
                           .ranges = {NUMBER(number, 0, CW_COUNTER_FAULTS - 1)},
                           .host = cw_fault_counter},
    [CW_ACTION_CHECKSUM] = {.name = "checksum",
                            .kind = CW_KIND_HOST,
                            .traits = CW_NEEDS_FRAME | CW_AT_HOST | CW_IN_MAKING,
                            .host = cw_fault_checksum},
    [CW_ACTION_SEND] = {.name = "send",
                        .kind = CW_KIND_TRAFFIC,
                        .traits = CW_LASTS | CW_SENDS_FRAME,
                        .traffic = cw_send_periodically},
    [CW_ACTION_BABBLE] = {.name = "babble",
                          .kind = CW_KIND_TRAFFIC,
                          .traits = CW_LASTS | CW_EACH_BIT | CW_SENDS_FRAME | CW_STEADY_TRAFFIC,
                          .traffic = cw_babble},
    [CW_ACTION_LOAD] = {.name = "load",
                        .kind = CW_KIND_TRAFFIC,
                        .traits = CW_LASTS | CW_EACH_BIT | CW_STEADY_TRAFFIC,
                        .ranges = {NUMBER(load_permille, 0, 1000)},
                        .traffic = cw_fill_up},
    [CW_ACTION_REPLY] = {.name = "reply",
                         .kind = CW_KIND_TRAFFIC,
                         .traits = CW_NEEDS_FRAME | CW_AT_HOST | CW_SENDS_FRAME},
    [CW_ACTION_RAW_FRAME] = {.name = "raw-frame",
                             .kind = CW_KIND_TRAFFIC,
                             .traits = CW_LASTS | CW_SENDS_FRAME | CW_DEVIATES,
                             .traffic = cw_send_periodically},
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
