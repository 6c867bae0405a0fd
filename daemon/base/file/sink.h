/* SPDX-License-Identifier: MIT
 *
 * sink.h - what takes a bus's events away from it: LCM, recordings, the journal, the report of
 * expectations. Each tells its state in the same way, for the service manager, the status, and the
 * messages over LCM.
 */
#ifndef CANWIRE_BASE_SINK_H
#define CANWIRE_BASE_SINK_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SINKS_MAX 20u /* CFG_RECORDS_MAX, LCM, a journal, a report */

typedef enum sink_kind {
    SINK_LCM = 0,
    SINK_RECORD,
    SINK_JOURNAL,
    SINK_EXPECT,
    SINK_KINDS
} sink_kind;

/* The texts belong to the sink. */
typedef struct sink_info {
    sink_kind kind;
    const char *name;  /* the file, or the URL */
    const char *state; /* a word */
    const char *why;   /* the reason of a state that is not good, or NULL */
    bool good;
    uint64_t written; /* entries, lines, messages */
    uint64_t lost;    /* ... that were not written */
    uint64_t bytes;   /* of a recording or a journal, in its files */
    uint64_t gaps;    /* of a journal */
} sink_info;

/* All zeros is an empty list. */
typedef struct sink_list {
    size_t count;
    sink_info all[SINKS_MAX];
} sink_list;

void sinks_add(sink_list *all, const sink_info *one);

const char *sink_kind_name(sink_kind kind);

/* Returns the list of canwire-control(7), to be released by the caller. */
json_t *sinks_json(const sink_list *all);

/* Prints ", record drive.log stopped: No space left on device, 3 lost" and so on, first those that
 * are not good. Others without room are counted. Returns the length. */
size_t sinks_print(char *out, size_t size, const sink_list *all);

#endif
