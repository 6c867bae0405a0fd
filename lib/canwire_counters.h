/* SPDX-License-Identifier: MIT
 *
 * canwire_counters.h - the one table of all counters of the library. From it come the structs of
 *                      canwire.h, the JSON of --stats and of the status, columns of `canwire
 *                      status`, fields of LCM and libcanwire-sim, tables of canwire-control(7).
 *
 * A row is X(form, type, name, unit, shown, also, column, sentence):
 *
 *   form      ONE: a member of the struct. NOW: one that can fall again, or is a largest value: a
 *             gauge of metrics. DROPS, ERRORS: an array, by cw_drop or cw_error_type.
 *             SUM: no member, but the sum of an array of errors. DERIVED: no member; whoever shows
 *             it works it out of others (daemon/record/output.c).
 *   type      of the member, unsigned; of SUM, the name of the array
 *   name      in C and in JSON. Members of a struct and keys of JSON are in the order of the rows.
 *   unit      one of cw_unit
 *   shown     in JSON and on the page: USUAL; where a bus has that: FD, HOST, SLEEP; CODE: never
 *   also      LCM: it is a field of the same name of node_stats_t, bus_stats_t or
 *             node_controller_t (config/lcm). SIM: one of canwire_sim_node. LCM_SIM, NONE
 *   column    of `canwire status`: AT(line, place, title), NOWHERE
 *   sentence  what it counts, read behind name and unit
 */
#ifndef CANWIRE_COUNTERS_H
#define CANWIRE_COUNTERS_H

#include <stddef.h>
#include <stdint.h>

/* Of a node (cw_node_stats). */
#define CW_NODE_COUNTERS(X)                                                                        \
    X(ONE, uint64_t, handed_in, FRAMES, USUAL, NONE, NOWHERE,                                      \
      "given to the node by the ECU, or by its own traffic, and due by now")                       \
    X(ONE, uint64_t, made_by_rules, FRAMES, USUAL, NONE, NOWHERE,                                  \
      "given to it by fault rules: `send`, `babble`, `load`, `reply`, `duplicate`; also by its "   \
      "`schedule`, and the replies of mailboxes")                                                  \
    X(ONE, uint64_t, stored, FRAMES, HOST, NONE, AT(HOST, 4, "stored"),                            \
      "of the ECU, put into mailboxes with replies")                                               \
    X(ONE, uint64_t, tx_frames, FRAMES, USUAL, LCM_SIM, NOWHERE, "transmitted")                    \
    X(ONE, uint64_t, tx_bytes, BYTES, USUAL, LCM, NOWHERE, "data of these")                        \
    X(ONE, uint64_t, tx_bits, BITS, USUAL, LCM, NOWHERE, "of these on the wire, SOF to EOF")       \
    X(ONE, uint64_t, rx_frames, FRAMES, USUAL, LCM_SIM, NOWHERE, "received and given to the ECU")  \
    X(ONE, uint64_t, rx_bytes, BYTES, USUAL, LCM, NOWHERE, "data of these")                        \
    X(ONE, uint64_t, rx_accepted, FRAMES, USUAL, NONE, NOWHERE,                                    \
      "received by its controller and not held back by its `filter`")                              \
    X(ONE, uint64_t, rx_made_by_rules, FRAMES, USUAL, NONE, NOWHERE,                               \
      "copies of these, made by `duplicate: rx`")                                                  \
    X(DROPS, uint64_t, dropped, FRAMES, USUAL, NONE, NOWHERE,                                      \
      "not transmitted, by reason: `queue-full`, `one-shot`, `bus-off`, `listen-only` (also for "  \
      "`restricted` nodes), `bad-frame`, `fault`, `removed`, `link-down`, `slot-missed`")          \
    X(DROPS, uint64_t, rx_dropped, FRAMES, USUAL, NONE, NOWHERE,                                   \
      "received and not given to the ECU, by reason: `fault`, `removed`, `queue-full` (by "        \
      "overruns, by newer frames in mailboxes, or by the ring of events)")                         \
    X(ONE, uint64_t, arbitration_lost, TIMES, USUAL, LCM_SIM, AT(LINK, 2, "arbit-lost"),           \
      "an arbitration was lost")                                                                   \
    X(ONE, uint64_t, retransmissions, TIMES, USUAL, LCM_SIM, AT(OWN, 2, "re-sent"),                \
      "a frame was tried again")                                                                   \
    X(ERRORS, uint64_t, errors, ERRORS, USUAL, NONE, NOWHERE,                                      \
      "detected, by type: `bit`, `stuff`, `form`, `crc`, `ack`")                                   \
    X(SUM, errors, bus_errors, ERRORS, USUAL, NONE, AT(LINK, 1, "bus-errors"), "the sum of these") \
    X(ONE, uint64_t, overloads, FRAMES, USUAL, LCM_SIM, AT(OWN, 3, "overloads"),                   \
      "overload frames sent")                                                                      \
    X(ONE, uint32_t, error_warning, TIMES, USUAL, LCM, AT(LINK, 3, "error-warn"),                  \
      "it became error-warning, from below")                                                       \
    X(ONE, uint32_t, error_passive, TIMES, USUAL, LCM, AT(LINK, 4, "error-pass"),                  \
      "it became error-passive")                                                                   \
    X(ONE, uint32_t, bus_off, TIMES, USUAL, LCM_SIM, AT(LINK, 5, "bus-off"),                       \
      "it went into bus-off")                                                                      \
    X(ONE, uint32_t, restarts, TIMES, USUAL, LCM_SIM, AT(LINK, 0, "re-started"),                   \
      "it left bus-off")                                                                           \
    X(ONE, uint64_t, undetected_errors, FRAMES, USUAL, LCM, AT(OWN, 4, "undetected"),              \
      "accepted although nobody had sent them so")                                                 \
    X(NOW, uint32_t, inbox, FRAMES, USUAL, SIM, NOWHERE,                                           \
      "handed in for a time that has not come yet")                                                \
    X(NOW, uint16_t, queue, FRAMES, USUAL, LCM_SIM, AT(OWN, 0, "queued"), "waiting or being sent") \
    X(NOW, uint16_t, queue_peak, FRAMES, USUAL, LCM, AT(OWN, 1, "queue-peak"),                     \
      "the most there were in the queue")                                                          \
    X(NOW, uint32_t, held, FRAMES, USUAL, NONE, NOWHERE,                                           \
      "held back by fault rules on their way onto the bus")                                        \
    X(NOW, uint32_t, rx_held, FRAMES, USUAL, NONE, AT(HOST, 5, "waiting"),                         \
      "held back by fault rules on their way to the ECU, or waiting in receive buffers and "       \
      "mailboxes")

/* Of a bus (cw_bus_stats). */
#define CW_BUS_COUNTERS(X)                                                                         \
    X(ONE, uint64_t, ticks, TICKS, CODE, NONE, NOWHERE, "cw_bus_now()")                            \
    X(ONE, uint64_t, bits, BITS, USUAL, LCM, NOWHERE, "bit times since the start of the bus")      \
    X(ONE, uint64_t, busy_bits, BITS, USUAL, LCM, NOWHERE,                                         \
      "that were not idle: SOF to third bit of intermission, error and overload frames")           \
    X(ONE, uint64_t, busy_ticks, TICKS, CODE, NONE, NOWHERE, "for which these last")               \
    X(DERIVED, uint64_t, load_permille, PERMILLE, USUAL, NONE, NOWHERE,                            \
      "of the time, in which the bus was not idle")                                                \
    X(DERIVED, uint64_t, load_second_permille, PERMILLE, USUAL, NONE, NOWHERE,                     \
      "the same of the last second")                                                               \
    X(ONE, uint64_t, data_bits, BITS, CODE, NONE, NOWHERE,                                         \
      "beginning at the data rate (D10); as long as nominal ones where bits are not common to "    \
      "all nodes")                                                                                 \
    X(ONE, uint64_t, data_ticks, TICKS, CODE, NONE, NOWHERE, "for which these last")               \
    X(ONE, uint64_t, frames, FRAMES, USUAL, LCM, NOWHERE, "carried by the bus")                    \
    X(ONE, uint64_t, fd_frames, FRAMES, FD, NONE, NOWHERE, "of `frames`, those of CAN FD")         \
    X(ONE, uint64_t, frame_bits, BITS, USUAL, LCM, NOWHERE, "of `frames` on the wire, SOF to EOF") \
    X(ONE, uint64_t, error_frames, TIMES, USUAL, LCM, NOWHERE,                                     \
      "an error was signalled on the wire; superposed flags count once")                           \
    X(DERIVED, uint64_t, error_rate_ppm, PPM, USUAL, NONE, NOWHERE,                                \
      "the frame error rate: error frames in a million of `frames` and `error_frames`")            \
    X(ONE, uint64_t, overload_frames, TIMES, USUAL, LCM, NOWHERE,                                  \
      "overload was signalled on the wire, likewise")                                              \
    X(ONE, uint64_t, arbitration_lost, TIMES, USUAL, LCM, NOWHERE,                                 \
      "some node lost an arbitration")                                                             \
    X(ONE, uint64_t, improper_arbitrations, TIMES, USUAL, NONE, NOWHERE,                           \
      "an arbitration was not won by the lowest identifier that was pending")                      \
    X(ONE, uint64_t, undetected_errors, FRAMES, USUAL, LCM, NOWHERE,                               \
      "accepted by some node although nobody had sent them so")                                    \
    X(DERIVED, uint64_t, undetected_expected_ppt, PPT, USUAL, NONE, NOWHERE,                       \
      "errors that nobody can be expected to find: at most 4.7 * 10^-11 of the error frames, "     \
      "where all frames are classical base frames. `undetected_errors` counts those that there "   \
      "were")                                                                                      \
    X(ONE, uint64_t, faults, TIMES, USUAL, LCM, NOWHERE, "a rule acted, of all rules")             \
    X(ONE, uint64_t, events_lost, TIMES, CODE, NONE, NOWHERE,                                      \
      "an event was lost: rules made more in one bit than the ring holds")                         \
    X(NOW, uint32_t, pending, FRAMES, USUAL, LCM, NOWHERE, "in all queues, or held back by rules")

/* Of what sits between one controller and its host (cw_host_stats). */
#define CW_HOST_COUNTERS(X)                                                                        \
    X(ONE, uint64_t, filtered, FRAMES, HOST, LCM, AT(HOST, 0, "filtered"),                         \
      "stopped by the filter, or taken by no mailbox")                                             \
    X(ONE, uint64_t, overruns, FRAMES, HOST, LCM, AT(HOST, 1, "overruns"),                         \
      "received into full buffers (in `rx_dropped`, `queue-full`, too)")                           \
    X(ONE, uint64_t, overwritten, FRAMES, HOST, LCM, AT(HOST, 2, "overwritten"),                   \
      "received into mailboxes and replaced by newer ones (likewise)")                             \
    X(ONE, uint64_t, replies, FRAMES, HOST, LCM, AT(HOST, 3, "replies"),                           \
      "remote frames answered by mailboxes; no ECU got them")

/* Of the sleep of one node (cw_sleep_stats). */
#define CW_SLEEP_COUNTERS(X)                                                                       \
    X(ONE, uint64_t, wake_ups, TIMES, SLEEP, NONE, NOWHERE, "it was woken")                        \
    X(ONE, uint64_t, ticks, TICKS, CODE, NONE, NOWHERE, "asleep up to now, until it integrates")

/* The members of the struct of a table. */
#define CW_MEMBER(form, type, member, ...) CW_MEMBER_##form(type, member)
#define CW_MEMBER_ONE(type, member) type member;
#define CW_MEMBER_NOW(type, member) type member;
#define CW_MEMBER_DROPS(type, member) type member[CW_DROP_COUNT];
#define CW_MEMBER_ERRORS(type, member) type member[CW_ERROR_COUNT];
#define CW_MEMBER_SUM(type, member)
#define CW_MEMBER_DERIVED(type, member)

/* ---- Rows for those who go through a table --------------------------------------------------- */

typedef enum cw_unit {
    CW_UNIT_FRAMES = 0,
    CW_UNIT_BYTES,
    CW_UNIT_BITS,
    CW_UNIT_ERRORS,
    CW_UNIT_TIMES,
    CW_UNIT_TICKS,
    CW_UNIT_NS,
    CW_UNIT_PERMILLE,
    CW_UNIT_PPM,
    CW_UNIT_PPT, /* 10^-12 */
    CW_UNIT_COUNT
} cw_unit;

typedef enum cw_stat_form {
    CW_STAT_ONE = 0,
    CW_STAT_NOW,
    CW_STAT_DROPS,
    CW_STAT_ERRORS,
    CW_STAT_SUM,
    CW_STAT_DERIVED,
} cw_stat_form;

typedef enum cw_stat_shown {
    CW_STAT_CODE = 0,
    CW_STAT_USUAL,
    CW_STAT_FD,
    CW_STAT_HOST,
    CW_STAT_SLEEP,
} cw_stat_shown;

/* The lines of counters that `canwire status` prints for a node. The first one is that of a driver
 * in the output of ip, the second one canwire's own. The third one is about what sits between
 * controller and host. */
typedef enum cw_stat_line {
    CW_LINE_NONE = 0,
    CW_LINE_LINK,
    CW_LINE_OWN,
    CW_LINE_HOST,
} cw_stat_line;

/* A row of canwire_counters.h. */
typedef struct cw_stat {
    const char *name; /* NULL: behind the last row */
    const char *sentence;
    const char *title;
    uint16_t offset;
    uint8_t size;     /* of one value */
    uint8_t count;    /* values; 0: DERIVED */
    uint8_t form;     /* cw_stat_form, cw_unit and so on */
    uint8_t unit;
    uint8_t shown;
    uint8_t line;
    uint8_t place;
} cw_stat;

extern const cw_stat cw_node_counters[];
extern const cw_stat cw_bus_counters[];
extern const cw_stat cw_host_counters[];
extern const cw_stat cw_sleep_counters[];

/* The row of a table; other tables have such rows, too. */
#define CW_STAT_ROW(stats, form_, type, name_, unit_, shown_, also, column, sentence_)          \
    {.name = #name_,                                                                               \
     .sentence = (sentence_),                                                                      \
     .form = CW_STAT_##form_,                                                                   \
     .unit = CW_UNIT_##unit_,                                                                      \
     .shown = CW_STAT_##shown_,                                                                 \
     CW_STAT_MEMBER_##form_(stats, type, name_),                                                \
     CW_COLUMN_##column},
#define CW_STAT_VALUES(stats, member, number)                                                   \
    .offset = offsetof(stats, member), .count = (number),                                          \
    .size = sizeof(((stats *)0)->member) / (number)
#define CW_STAT_MEMBER_ONE(stats, type, name) CW_STAT_VALUES(stats, name, 1)
#define CW_STAT_MEMBER_NOW(stats, type, name) CW_STAT_VALUES(stats, name, 1)
#define CW_STAT_MEMBER_DROPS(stats, type, name) CW_STAT_VALUES(stats, name, CW_DROP_COUNT)
#define CW_STAT_MEMBER_ERRORS(stats, type, name) CW_STAT_VALUES(stats, name, CW_ERROR_COUNT)
#define CW_STAT_MEMBER_SUM(stats, array, name) CW_STAT_VALUES(stats, array, CW_ERROR_COUNT)
#define CW_STAT_MEMBER_DERIVED(stats, type, name) .count = 0
#define CW_COLUMN_AT(line_, place_, title_)                                                        \
    .line = CW_LINE_##line_, .place = (place_), .title = (title_)
#define CW_COLUMN_NOWHERE .line = CW_LINE_NONE

/* Returns the name of a unit, a constant string. */
const char *cw_unit_name(cw_unit unit);

/* Returns the word of a value of DROPS or ERRORS. */
const char *cw_stat_word(const cw_stat *counter, unsigned value);

/* Returns a value of a counter of such statistics. */
uint64_t cw_stat_value(const cw_stat *counter, const void *stats, unsigned value);

/* Returns the sum of its values. */
uint64_t cw_stat_sum(const cw_stat *counter, const void *stats);

#endif
