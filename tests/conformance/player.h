/* SPDX-License-Identifier: MIT
 *
 * player.h - one elementary test: the node, what is expected of it, one bit at a time.
 *
 * Internal to the bench.
 */
#ifndef PLAYER_H
#define PLAYER_H

#include "bench.h"

#define HISTORY 40
#define WHY_MAX 400
#define PASSIVE_LIMIT 128u
#define BUS_OFF_LIMIT 256u

/* The expected reports of the node in one bit. */
typedef struct expect {
    uint16_t what;
    unsigned lost_bit;
    cw_error error;
    int tec_change;
    int rec_change;
    bool zero; /* T=0 R=0 */
    bool check_place;
    bool check_role; /* as b->sender says */
    cw_place place;
} expect;

typedef enum sender { BY_NODE, BY_BENCH, BY_NOBODY_KNOWN } sender;

typedef struct player {
    cw_mac mac;
    cw_fd_part part;
    unsigned tec, rec; /* expected */
    cw_state state;    /* as reported last */
    unsigned modes;
    bool pending; /* the node has an offer, as far as we expect */
    bool away;
    wire wire;     /* the present frame ... */
    unsigned next; /* ... its next bit ... */
    sender sender; /* ... and who sends it */
    unsigned bit;
    char history[3][HISTORY + 1]; /* bench, node, bus */
    char why[WHY_MAX];            /* empty: nothing has failed yet */
    const char *token;            /* present place in the script */
    bool verbose;
} player;

/* Initialises a new node that integrates. */
void player_init(player *b, bool verbose);

/* Plays one bit and compares; forced puts recessive onto the bus whatever the node drives. Does
 * nothing after a failure. */
void player_bit(player *b, bool bench_level, bool own, bool forced, expect e);

/* Notes why the test fails; the first reason stays. */
void player_fail(player *b, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Plays a script (bench.h). */
void player_run(player *b, const char *script);

#endif
