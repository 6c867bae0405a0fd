/* SPDX-License-Identifier: MIT
 *
 * ecus.h - the keys of a campaign that are about programs at nodes: its real ECUs.
 */
#ifndef CANWIRE_CAMPAIGN_ECUS_H
#define CANWIRE_CAMPAIGN_ECUS_H

#include "base/schema.h"
#include "config/config.h"

#define ECUS_MAX 16u
#define ECU_WORDS_MAX 256u    /* of a command, and of its environment */
#define ECU_READY_MS 10000    /* by default */
#define ECU_GRACE_MS 2000     /* by default */

/* The sign that a program is ready. */
typedef enum ecu_sign {
    ECU_SIGN_START = 0, /* it has been started */
    ECU_SIGN_LINE,      /* a line of its output has this text in it */
    ECU_SIGN_FRAME      /* its node has sent such a frame */
} ecu_sign;

/* A program at a node. */
typedef struct ecu {
    const char *name; /* of its files, and in rows */
    const char *node;      /* NULL: with own_bus */
    const char *interface; /* as the program calls it; NULL: as the node */
    const char **command;  /* words, NULL at the end; a single one with `shell` */
    bool shell;            /* the command is a text for a shell */
    const char **env;      /* NAME=VALUE, NULL at the end; NULL: none */
    const char *cwd;       /* relative to the campaign's folder; NULL: a folder of its own */
    bool direct;           /* it speaks the protocol of ports: no `canwire run` */
    bool own_bus;          /* it is the bus by itself: node is NULL */
    const struct ecu *after; /* it starts when this one is ready; NULL: at once */
    ecu_sign sign;
    const char *line;
    cw_filter filter; /* of a frame */
    int64_t ready_ms; /* real time, from the start of the program */
    int64_t grace_ms; /* from SIGTERM to SIGKILL */
} ecu;

typedef struct ecu_plan {
    size_t count; /* 0: the campaign has no programs */
    ecu list[ECUS_MAX];
    bool host_network; /* no network of their own */
    bool virtual_time; /* the bus and the programs have it */
    bool own_bus;      /* the only program is the bus by itself: no canwired */
} ecu_plan;

/* Read the keys `ecu`, `network` and `virtual` of a campaign. */
schema_reader campaign_read_ecus;    /* object: a campaign_owner */
schema_reader campaign_read_network; /* object: a campaign_owner */
schema_reader campaign_read_virtual; /* object: a campaign_owner; behind `ecu` */

/* Returns the number of programs that have virtual time. */
unsigned ecus_virtual(const ecu_plan *plan);

/* Returns the time that all programs together have to end. */
int64_t ecus_grace_ms(const ecu_plan *plan);

#endif
