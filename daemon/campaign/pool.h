/* SPDX-License-Identifier: MIT
 *
 * pool.h - makes numbered lines in several processes, and hands them on in the order of numbers.
 *
 * The processes are forks of this one. If the system allows fewer of them, these do the work. A
 * line whose process ends, or makes none in time, is made once more alone, and twice more when the
 * process was killed. If that fails, too, the caller says what the line is.
 */
#ifndef CANWIRE_CAMPAIGN_POOL_H
#define CANWIRE_CAMPAIGN_POOL_H

#include "base/text/buffer.h"

#include <stdint.h>

#define POOL_JOBS_MAX 256u
#define POOL_EXIT_SHORT 75 /* EX_TEMPFAIL: a process has lacked memory for a line */

/* Why a process has made no line. */
typedef struct pool_loss {
    bool timeout; /* it took too long, and was ended */
    int status;   /* of waitpid() */
} pool_loss;

typedef struct pool_calls {
    /* Writes a line with its end, in a process of the pool. The code is for `take`. The process
     * ends with POOL_EXIT_SHORT when the line has no memory. */
    unsigned char (*make)(void *user, uint64_t number, buffer *line);
    /* Does the same for a lost line, in the calling process. */
    unsigned char (*lose)(void *user, uint64_t number, const pool_loss *loss, buffer *line);
    /* Takes the next line in the calling process. Returns false to end the work. */
    bool (*take)(void *user, unsigned char code, const char *line, size_t length);
    /* Is called a few times a second, with the number of lines that are made. NULL: it is not. */
    void (*look)(void *user, uint64_t made);
    /* Is called once when there can be fewer processes only, with the errno. NULL: it is not. */
    void (*few)(void *user, unsigned jobs, int error);
} pool_calls;

typedef struct pool_work {
    const pool_calls *calls;
    void *user;
    uint64_t first; /* the numbers are first to first + count - 1 */
    uint64_t count;
    unsigned jobs;    /* processes, 1 to POOL_JOBS_MAX */
    int64_t limit_ms; /* of real time for a line; 0: none */
    bool once;        /* a line that took too long is not tried again */
} pool_work;

/* Returns false with errno when the work could not be done, or `take` has ended it (errno 0). */
bool pool_run(const pool_work *work);

/* Says on standard error that there are fewer processes; `command` is the one that makes them. */
void pool_tell_few(const char *command, unsigned jobs, int error);

/* Returns the number of processors that this process may use, at most POOL_JOBS_MAX. */
unsigned pool_jobs_default(void);

#endif
