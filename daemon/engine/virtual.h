/* SPDX-License-Identifier: MIT
 *
 * virtual.h - the state of virtual time, for those parts of the engine that ask what time it is.
 */
#ifndef CANWIRE_ENGINE_VIRTUAL_H
#define CANWIRE_ENGINE_VIRTUAL_H

#include "engine/programs.h"

#include <ev.h>
#include <stdbool.h>
#include <stdint.h>

struct engine_virtual {
    programs *programs;
    turns *turns;      /* of them */
    int64_t now_ns;    /* bus time */
    int64_t left_ns;   /* when the last program has gone */
    bool begun;        /* enough programs have been there */
    bool unread;       /* somebody may have sent something since the ports were read */
    bool more;         /* the time of the last wake-up was too short */
    uint64_t given;    /* turns */
    ev_timer look;     /* tells who holds time */
    uint64_t seen;     /* turns at its last look that differed from the one before ... */
    unsigned same;     /* ... and the looks since then */
};

#endif
