/* SPDX-License-Identifier: MIT
 *
 * sleep.h - the sleep of one node, which its bus counts and ends.
 */
#ifndef CANWIRE_STATE_SLEEP_H
#define CANWIRE_STATE_SLEEP_H

#include "canwire.h"

typedef struct cw_sleep {
    cw_sleep_settings settings;
    cw_wake_filter filter; /* in CW_TICK */
    uint64_t since;        /* tick at which it fell asleep */
    uint64_t awake_at;     /* tick at which it integrates, after it has been woken; or CW_NEVER */
    uint8_t modes;         /* of a node that listens: its own ones */
    bool called;           /* its host wants it awake */
    cw_sleep_stats stats;  /* without the present sleep */
} cw_sleep;

#endif
