/* SPDX-License-Identifier: MIT
 *
 * ecu_keeper.c - runs canwired and the programs of a row in real time, in a process that ends all
 * of them.
 */
#include "campaign/ecu/ecu_keeper.h"

#include "base/stopped.h"
#include "base/wall.h"
#include "campaign/ecu/ecu_bench.h"
#include "campaign/ecu/ecu_network.h"
#include "campaign/ecu/ecu_process.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define NS_PER_MS 1000000
#define LOOK_MS 5 /* between looks at virtual time */
#define WATCH_MS 100 /* between looks at the keeper */
#define STOPPED_MS 5000 /* for a keeper that was stopped, beside the limit and the grace */

/* ---- The run --------------------------------------------------------------------------------- */

/* Waits until all programs are ready. Returns false when the run is over before. */
static bool await_ready(ecu_bench *b)
{
    while (ecu_bench_start_programs(b)) {
        const size_t waiting = ecu_bench_unready(b);
        if (waiting == ECUS_MAX)
            return true;
        const ecu *e = &b->task->campaign->ecus.list[waiting];
        const int64_t limit = ecu_bench_ready_limit(b, waiting);
        if (ecu_bench_now() >= limit) {
            ecu_bench_conclude(b, ECU_LATE, "%s: not ready after %g s", e->name,
                               (double)e->ready_ms / 1000);
            return false;
        }
        ecu_bench_step(b, limit);
    }
    return false;
}

/* Lets bus time pass up to a moment. */
static void run_until(ecu_bench *b, uint64_t end_ns)
{
    uint64_t now_ns = 0;
    while (ecu_bench_goes_on(b) && ecu_bench_ask_time(b, &now_ns)) {
        if (now_ns >= end_ns) {
            b->result->end_ns = end_ns;
            return;
        }
        const int64_t wake = ecu_bench_now() + (int64_t)((end_ns - now_ns) / NS_PER_MS) + 1;
        while (ecu_bench_goes_on(b) && ecu_bench_now() < wake)
            ecu_bench_step(b, wake);
    }
}

static void run_to_end(ecu_bench *b)
{
    while (ecu_bench_goes_on(b) && !ecu_bench_all_ended(b))
        ecu_bench_step(b, INT64_MAX);
}

/* Waits until virtual time rests: at its end, or since all programs have ended. */
static void run_virtual(ecu_bench *b)
{
    uint64_t now_ns = 0;
    while (ecu_bench_goes_on(b)) {
        const bool ended = ecu_bench_all_ended(b);
        if (!ecu_bench_ask_time(b, &now_ns))
            return;
        const bool there = now_ns >= b->task->until_ns;
        ecu_bench_step(b, ecu_bench_now() + (b->rests && there ? 0 : LOOK_MS)); /* their ends */
        if (b->rests && there)
            b->result->end_ns = b->task->until_ns;
        if (b->rests && (there || ended))
            return;
    }
}

/* Runs a row: the bus, its programs, then the time that it lasts. */
static void ecu_keeper_run(ecu_bench *b)
{
    uint64_t begin_ns = 0;
    if (b->task->campaign->ecus.own_bus) {
        if (ecu_bench_start_programs(b))
            run_to_end(b);
        return;
    }
    if (!ecu_bench_start(b) || !await_ready(b))
        return;
    if (b->task->campaign->ecus.virtual_time) {
        run_virtual(b);
        return;
    }
    if (!ecu_bench_ask_time(b, &begin_ns))
        return;
    const uint64_t until_ns = b->task->until_ns;
    if (until_ns == ECU_NO_TIME)
        run_to_end(b);
    else
        run_until(b, until_ns < UINT64_MAX - begin_ns ? begin_ns + until_ns : UINT64_MAX);
}

/* ---- The process ----------------------------------------------------------------------------- */

/* The maker of the row has ended. */
_Noreturn static void ecu_keeper_give_up(const ecu_task *task)
{
    ecu_process_kill_all(0);
    ecu_folder_remove(task->folder->files);
    ecu_folder_close(task->folder);
    _exit(EXIT_FAILURE);
}

/* Signals are read by the bench, and the one at the end of the parent, too. */
static bool ecu_keeper_prepare(const ecu_task *task, pid_t parent)
{
    sigset_t all;
    (void)sigemptyset(&all);
    for (size_t i = 0; i < sizeof ecu_bench_signals / sizeof *ecu_bench_signals; i++)
        (void)sigaddset(&all, ecu_bench_signals[i]);
    (void)sigprocmask(SIG_BLOCK, &all, NULL);
    (void)setpgid(0, 0);
    (void)prctl(PR_SET_CHILD_SUBREAPER, 1);
    if (task->own_network)
        (void)ecu_network_enter();
    /* behind a change of the user namespace, which takes the signal away */
    return prctl(PR_SET_PDEATHSIG, SIGTERM) == 0 && getppid() == parent;
}

/* Closes all but two descriptors, and standard ones: the file of rows, for example, which would
 * stay locked. */
static void close_others(int a, int b)
{
    const unsigned low = (unsigned)(a < b ? a : b), high = (unsigned)(a < b ? b : a);
    if (low > STDERR_FILENO + 1)
        (void)close_range(STDERR_FILENO + 1, low - 1, 0);
    if (high > low + 1)
        (void)close_range(low + 1, high - 1, 0);
    (void)close_range(high + 1, ~0u, 0);
}

/* Is the process of a row. It ends with all that has been started, and gives its result to the
 * parent. */
_Noreturn static void be_keeper(const ecu_task *task, int out, pid_t parent)
{
    ecu_result result = {.end_ns = ECU_NO_TIME};
    close_others(out, task->folder->fd);
    if (!ecu_keeper_prepare(task, parent))
        ecu_keeper_give_up(task);
    ecu_bench *b = ecu_bench_new(task, &result);
    if (b)
        ecu_keeper_run(b);
    if (b && !ecu_bench_end(b))
        ecu_keeper_give_up(task);
    if (!b) {
        result.verdict = ECU_BROKEN;
        (void)snprintf(result.why, sizeof result.why, "%s", strerror(errno));
    }
    ecu_process_kill_all(0);
    _exit(write(out, &result, sizeof result) == (ssize_t)sizeof result ? EXIT_SUCCESS
                                                                      : EXIT_FAILURE);
}

static void ecu_keeper_fail(ecu_result *result, const char *why)
{
    *result = (ecu_result){.verdict = ECU_BROKEN, .end_ns = ECU_NO_TIME};
    (void)snprintf(result->why, sizeof result->why, "%s", why);
}

/* ---- The watch ------------------------------------------------------------------------------- */

/* The keeper ends the programs in time, unless one of them stops it: it is their parent. So the
 * process that makes the row lets it go on, and has a limit of its own for one that was stopped. */
typedef struct watch {
    pid_t keeper;
    int64_t end_ms; /* of a keeper that was stopped */
    bool stopped;
    bool late;
} watch;

/* Lets a keeper go on that was stopped. From then on it has a limit here, beside its own. */
static void look_at_keeper(watch *w)
{
    w->stopped = stopped_go_on(w->keeper) || w->stopped;
    if (!w->stopped || w->late || ecu_bench_now() < w->end_ms)
        return;
    w->late = true;
    (void)kill(w->keeper, SIGKILL); /* and with it all programs */
}

/* Reads what the keeper has to say, up to its end. */
static bool read_result(int in, watch *w, ecu_result *result)
{
    size_t used = 0;
    for (ssize_t count = 1; used < sizeof *result && count != 0;) {
        struct pollfd polled = {.fd = in, .events = POLLIN};
        const int ready = poll(&polled, 1, WATCH_MS);
        look_at_keeper(w);
        if (ready <= 0)
            continue;
        count = read(in, (char *)result + used, sizeof *result - used);
        if (count < 0 && errno != EINTR)
            return false;
        used += count > 0 ? (size_t)count : 0;
    }
    return used == sizeof *result;
}

/* The keeper has ended without a result, and its programs with it. Processes that these have
 * started are now children of this one. */
static void clean_up(const ecu_task *task, const watch *w, ecu_result *result)
{
    ecu_process_kill_all(0);
    ecu_keeper_fail(result, "the process that keeps the programs has ended");
    if (!w->late)
        return;
    result->verdict = ECU_LATE;
    (void)snprintf(result->why, sizeof result->why,
                   "it took longer than %g s, and a program stopped the process that keeps it",
                   (double)task->campaign->limit_ms / 1000);
    for (size_t i = 0; i < task->campaign->ecus.count; i++)
        result->ends[i] = (ecu_end){.started = true, .killed = true, .ready_ns = ECU_NO_TIME};
}

void ecu_keep(const ecu_task *task, ecu_result *result)
{
    int ends[2];
    const pid_t parent = getpid();
    if (pipe2(ends, O_CLOEXEC) != 0) {
        ecu_keeper_fail(result, strerror(errno));
        return;
    }
    (void)prctl(PR_SET_CHILD_SUBREAPER, 1);
    const pid_t pid = fork();
    if (pid == 0)
        be_keeper(task, ends[1], parent);
    const int error = errno;
    (void)close(ends[1]);
    watch w = {.keeper = pid, .end_ms = ecu_bench_now() + task->campaign->limit_ms +
                                        ecus_grace_ms(&task->campaign->ecus) + STOPPED_MS};
    const bool good = pid > 0 && read_result(ends[0], &w, result);
    (void)close(ends[0]);
    while (pid > 0 && waitpid(pid, NULL, 0) < 0 && errno == EINTR)
        continue;
    if (pid < 0)
        ecu_keeper_fail(result, strerror(error));
    else if (!good)
        clean_up(task, &w, result);
}
