/* SPDX-License-Identifier: MIT
 *
 * outcome.h - the outcome of one scenario, as a part of its row.
 */
#ifndef CANWIRE_CAMPAIGN_OUTCOME_H
#define CANWIRE_CAMPAIGN_OUTCOME_H

#include "base/text/buffer.h"
#include "campaign/scenario.h"

/* The outcomes of a scenario. */
typedef enum outcome {
    OUTCOME_PASSED = 0, /* all expectations are met */
    OUTCOME_FAILED,     /* some are not */
    OUTCOME_INVALID,    /* the values of its factors make no configuration */
    OUTCOME_BROKEN,     /* a file of traffic could not be read */
    OUTCOME_CRASHED,    /* its process has ended */
    OUTCOME_TIMEOUT,    /* it took too long */
    OUTCOME_COUNT
} outcome;

/* The counters of a row, in their order: those of all buses together, then those of each node. The
 * latter are a key and a member of cw_node_stats; for an array, the sum of its values. */
#define OUTCOME_BUS_COUNTERS(X) X(frames) X(error_frames) X(undetected_errors) X(faults)
#define OUTCOME_NODE_COUNTERS(X)                                                                   \
    X(tx_frames, tx_frames, 1)                                                                     \
    X(rx_frames, rx_frames, 1)                                                                     \
    X(retransmissions, retransmissions, 1)                                                         \
    X(bus_errors, errors, CW_ERROR_COUNT)                                                          \
    X(undetected_errors, undetected_errors, 1)                                                     \
    X(dropped, dropped, CW_DROP_COUNT)                                                             \
    X(rx_dropped, rx_dropped, CW_DROP_COUNT)                                                       \
    X(error_passive, error_passive, 1)                                                             \
    X(bus_off, bus_off, 1)                                                                         \
    X(restarts, restarts, 1)

/* Returns the word of a row for it. */
const char *outcome_name(outcome o);

/* Writes the keys of the last run of a scenario, from `outcome` on. Returns its outcome. */
outcome outcome_write(buffer *row, const scenario *s);

/* Writes the same keys for a run that has ended too early, with its outcome and the reason. */
outcome outcome_write_as(buffer *row, const scenario *s, outcome o, const char *why);

/* Writes the same keys as far as there are any for a scenario that has no result. `why` says what
 * has happened, and may be "". */
void outcome_write_none(buffer *row, outcome o, const char *why);

/* Returns the first of some lines of messages that is not a warning, and ends it there. */
const char *outcome_first_error(char *messages);

/* Does this for values that make no scenario, with the first of the messages that is not a warning;
 * it changes them. NULL: there are none. The row has no memory then, nor when memory was short: the
 * scenario may be valid. */
outcome outcome_write_invalid(buffer *row, char *messages);

/* Does this for a scenario whose last run has failed. Returns the outcome. The row has no memory
 * when the process lacked something: it is not a row then. */
outcome outcome_write_broken(buffer *row, scenario *s);

/* Returns true when a message is about what this process lacks at the moment, memory or
 * descriptors for example: it says nothing about the scenario. */
bool outcome_is_shortage(const char *message);

/* Ends a row with the command that repeats it. */
void outcome_end_row(buffer *row, buffer *command);

#endif
