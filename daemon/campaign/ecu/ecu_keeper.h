/* SPDX-License-Identifier: MIT
 *
 * ecu_keeper.h - runs canwired and the programs of a row in real time, in a process that ends all
 * of them.
 *
 * This process, the keeper, is a child of the one that makes the row. When that ends, however it
 * does, the keeper ends the programs and all that they have started, and removes the folders.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_KEEPER_H
#define CANWIRE_CAMPAIGN_ECU_ECU_KEEPER_H

#include "campaign/campaign.h"
#include "campaign/ecu/ecu_folder.h"
#include "campaign/ecu/ecu_text.h"

#define ECU_NO_TIME UINT64_MAX

typedef struct ecu_task {
    const campaign *campaign;
    ecu_folder *folder; /* with the scenario in it */
    ecu_changes changes;
    const char *here;     /* the folder of the campaign, absolute */
    const char *tool;     /* absolute paths of canwire ... */
    const char *canwired; /* ... and canwired */
    const char *bus;      /* its name */
    uint64_t row;
    uint64_t seed;
    uint64_t until_ns;    /* bus time from the moment that all are ready; ECU_NO_TIME: until all
                             programs have ended. In virtual time it is from 0 on */
    bool own_network;
} ecu_task;

typedef enum ecu_verdict {
    ECU_DONE = 0,
    ECU_CRASHED, /* a program has */
    ECU_LATE,    /* it took too long */
    ECU_BROKEN   /* canwired, or a program, could not be started */
} ecu_verdict;

/* The end of a program. */
typedef struct ecu_end {
    bool ready;
    uint64_t ready_ns; /* bus time */
    bool started;
    bool ended;        /* by itself, before the end of the run */
    bool killed;       /* it has not ended when it was told to */
    int status;        /* of waitpid(), when ended */
} ecu_end;

typedef struct ecu_result {
    ecu_verdict verdict;
    char why[ECU_WHY_MAX]; /* "": there is nothing to say */
    uint64_t end_ns;       /* bus time of the end of the run; ECU_NO_TIME: that of the journal */
    ecu_end ends[ECUS_MAX];
} ecu_result;

/* Runs a row. The journal is in its folder then. */
void ecu_keep(const ecu_task *task, ecu_result *result);

#endif
