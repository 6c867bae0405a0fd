/* SPDX-License-Identifier: MIT
 *
 * tt.h - time-triggered operation of one node: captures of its local time, its schedule, and the
 * outcomes of its slots (section 9 of RULES.md).
 */
#ifndef CANWIRE_STATE_TT_H
#define CANWIRE_STATE_TT_H

#include "canwire.h"
#include "time/local.h"

#define CW_TT_CAPTURES_KEPT 4u

/* A capture of a reference message. */
typedef struct cw_tt_capture {
    uint64_t local; /* local time */
    uint64_t tick;  /* at which it has become known */
    uint8_t master; /* the sender of the message */
} cw_tt_capture;

/* A frame whose capture becomes known at its end. */
typedef struct cw_tt_pending {
    uint64_t due;   /* tick, or CW_NEVER: there is none */
    uint64_t local; /* SOF, and own frames: the capture */
    bool known;     /* ... is it */
    bool own;
    uint8_t from;   /* the sender */
    uint64_t all_from;
    cw_frame frame;
} cw_tt_pending;

/* All 0: the node has no local time. */
typedef struct cw_tt {
    cw_local_time config;
    cw_local_clock clock;
    uint64_t sof;       /* local time at the last SOF */
    uint64_t eof;       /* ... and at the last bit of EOF, in bits of the node's own clock */
    bool eof_seen;
    cw_tt_pending pending;
    uint64_t captures;
    uint64_t captured;  /* the last one */

    cw_schedule schedule; /* triggers in own memory */
    cw_trigger_stats *stats; /* of each trigger */
    uint64_t references;
    uint64_t base;      /* local time at which the basic cycle has begun */
    bool in_cycle;      /* a reference message has begun it, and the next one is not due */
    uint16_t cycle;     /* number of the basic cycle */
    unsigned next;      /* trigger to come; trigger_count: none */
    uint64_t next_tick; /* its tick */
    uint64_t hand_in;   /* tick at which its frame goes to the inbox, or CW_NEVER */
    unsigned open;      /* trigger of the slot that is open */
    uint64_t deadline;  /* tick of its end, or CW_NEVER: none is open */
    uint64_t end;       /* ... the same in local time */
    uint64_t started;   /* tick at which the last frame of a trigger has begun */
    cw_tt_capture own[CW_TT_CAPTURES_KEPT];  /* reference messages sent, the newest first */
    cw_tt_capture seen[CW_TT_CAPTURES_KEPT]; /* ... and received */
} cw_tt;

#endif
