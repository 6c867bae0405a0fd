/* SPDX-License-Identifier: MIT
 *
 * status_check.h - judges the status of buses for monitoring, with the exit codes of Nagios.
 */
#ifndef CANWIRE_CLI_STATUS_CHECK_H
#define CANWIRE_CLI_STATUS_CHECK_H

#include "base/text/buffer.h"

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

/* The exit statuses. */
typedef enum check_level {
    CHECK_OK = 0,
    CHECK_WARNING,
    CHECK_CRITICAL,
    CHECK_UNKNOWN
} check_level;

typedef struct check_limits {
    uint64_t load_permille[CHECK_UNKNOWN]; /* that of WARNING and CRITICAL; 0: none */
    unsigned state[CHECK_UNKNOWN];         /* as well: a place in the row of states */
    check_level sinks;                     /* of one that is in trouble */
    check_level links;                     /* of a node without link */
    check_level losses;                    /* of frames, or of bus time, lately */
    bool given;                            /* there was an option */
} check_limits;

#define CHECK_LIMITS_DEFAULT                                                                       \
    (check_limits){.state = {0, 2, 3}, .sinks = CHECK_WARNING, .links = CHECK_WARNING,             \
                   .losses = CHECK_WARNING}

/* Take the arguments of options; `out` is a check_limits, or of a level that. They return false
 * after a message. */
bool check_take_load(void *out, const char *option, const char *text);
bool check_take_state(void *out, const char *option, const char *text);
bool check_take_level(void *out, const char *option, const char *text);

/* Judges a bus, whose status is NULL when it is not there; why says why. A status that is not one
 * is unknown. Prints its part of the line and, for check_end(), of the figures. */
typedef struct check {
    check_limits limits;
    check_level level;
    buffer text;
    buffer figures;
} check;

void check_bus(check *c, const char *bus, const json_t *status, const char *why);

/* Adds a part to the line, at least of this level. */
void check_tell(check *c, check_level level, const char *text);

/* failed_units.c: adds the failed units of the bus `name`, or of all with NULL, each of which is
 * critical. So is one that systemd tries again, since its bus does not run. absent: no bus runs;
 * then it also says that none has failed: somebody has stopped them. Without an answer of systemd
 * that is unknown. Nothing is added where systemd does not run, and for buses of another folder
 * than that of the service. */
void check_failed_units(check *c, const char *name, bool absent);

/* Prints the line and returns the exit status. */
int check_end(check *c);

#endif
