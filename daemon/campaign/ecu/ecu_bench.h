/* SPDX-License-Identifier: MIT
 *
 * ecu_bench.h - the bench of a row: a canwired, the programs at its nodes, and what they tell.
 *
 * It belongs to a process of its own, whose children are all part of it. Times in ms are those of
 * the machine's clock.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_BENCH_H
#define CANWIRE_CAMPAIGN_ECU_ECU_BENCH_H

#include "base/arena.h"
#include "campaign/ecu/ecu_control.h"
#include "campaign/ecu/ecu_keeper.h"
#include "campaign/ecu/ecu_process.h"

#include <fcntl.h>

/* They must be blocked before a bench is made. */
extern const int ecu_bench_signals[4];

typedef struct ecu_program {
    pid_t pid; /* 0: it has not been started, or has ended */
    int64_t start_ms;
    ecu_output output;
} ecu_program;

typedef struct ecu_bench {
    const ecu_task *task;
    ecu_result *result;
    int64_t limit_ms; /* the row must be over */
    bool over;        /* the result is known */
    bool aborted;     /* the maker of the row has ended */
    bool bus_ready;
    pid_t bus;        /* canwired; 0: it has ended */
    int signals;
    int notify;       /* from canwired (sd_notify) */
    int bus_log;
    ecu_control control;
    bool watching;    /* the control socket has answered to `watch` */
    unsigned asked;   /* the number of the last question for its status */
    bool told;        /* it has answered it */
    uint64_t time_ns;
    bool rests;       /* virtual time goes no further */
    ecu_program programs[ECUS_MAX];
} ecu_bench;

/* Makes a bench; the result is filled while it runs. Returns NULL with errno. */
ecu_bench *ecu_bench_new(const ecu_task *task, ecu_result *result);

/* Starts canwired. Returns false when the run is over. */
bool ecu_bench_start(ecu_bench *b);

/* Starts the programs that wait for no other one, or no longer. Returns false when the run is
 * over. */
bool ecu_bench_start_programs(ecu_bench *b);

/* Waits for something to happen, up to a moment, and takes it. */
void ecu_bench_step(ecu_bench *b, int64_t until_ms);

/* Returns false when the run is over: canwired has ended, it took too long, or a program has
 * crashed. In virtual time a run goes on after a crash: its end would be another moment each
 * time. */
bool ecu_bench_goes_on(ecu_bench *b);

/* Asks for bus time. Returns false when the run is over before the answer comes. */
bool ecu_bench_ask_time(ecu_bench *b, uint64_t *time_ns);

/* Returns the program that must be ready first, of those that are not; ECUS_MAX: all are. */
size_t ecu_bench_unready(const ecu_bench *b);

/* Returns the moment at which a program must be ready; INT64_MAX: it has not been started. */
int64_t ecu_bench_ready_limit(const ecu_bench *b, size_t program);

bool ecu_bench_all_ended(const ecu_bench *b);

/* Says how the run has ended, once. */
void ecu_bench_conclude(ecu_bench *b, ecu_verdict verdict, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Ends programs and canwired, and frees the bench. Returns false when it has been aborted. */
bool ecu_bench_end(ecu_bench *b);

/* Returns the present time of the machine's clock. */
int64_t ecu_bench_now(void);

/* Makes the command line of a program, its environment and working directory, in memory of the
 * arena; see ecu_command.c. Returns false without memory. */
bool ecu_command_make(ecu_start *out, const ecu_task *task, size_t program, arena *memory);

#endif
