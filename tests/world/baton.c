/* SPDX-License-Identifier: MIT
 *
 * baton.c - tasks that run one at a time, virtual time, chance and the trace.
 */
#include "world.h"

#include <errno.h>
#include <linux/futex.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define ACTORS_MAX 64u
#define CALL_NS 300             /* cost of a call besides its work */
#define LONG_WORK_NS (200 * MS) /* without a call: too much for a bus in real time */
#define REAL_PATIENCE_S 120     /* for a life that does not give the baton back */
#define SLICE_NS (1 * MS)       /* of a processor, when others want it, too */
#define EPOCH_NS (1700000000 * S)
#define TEXT_BYTES 400

world_state *world;
bool world_inside;
int world_trace_fd = -1;

static __thread world_task *me;
static uint64_t work; /* basic blocks of canwired's code since the last charge */
static actor *actors[ACTORS_MAX];
static unsigned actor_count;

/* ---- Chance ---------------------------------------------------------------------------------- */

static uint64_t next_random(void)
{
    uint64_t z = world->random += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

uint64_t world_draw(uint64_t below)
{
    return below ? next_random() % below : 0;
}

bool world_chance(unsigned permille)
{
    return permille && world_draw(1000) < permille;
}

int64_t world_between(int64_t low, int64_t high)
{
    unsigned doublings = 0;
    while ((low + 1) << (doublings + 1) < high && doublings < 40)
        doublings++;
    int64_t top = (low + 1) << world_draw(doublings + 1);
    int64_t value = low + (int64_t)world_draw((uint64_t)top);
    return value < high ? value : high;
}

/* ---- Trace ----------------------------------------------------------------------------------- */

uint64_t world_hash(const void *bytes, size_t size)
{
    const unsigned char *at = bytes;
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < size; i++)
        hash = (hash ^ at[i]) * UINT64_C(0x100000001b3);
    return hash;
}

static void mix(const char *line, size_t size)
{
    world->digest = (world->digest ^ world_hash(line, size)) * UINT64_C(0x100000001b3);
}

void world_trace(const char *format, ...)
{
    char line[TEXT_BYTES];
    va_list args;
    int used = snprintf(line, sizeof line, "%5lld.%09lld ", (long long)(world->now_ns / S),
                        (long long)(world->now_ns % S));
    if (me)
        used += snprintf(line + used, sizeof line - (size_t)used, "life %d%s ", me->life,
                         me->is_main ? "" : " thread");
    else
        used += snprintf(line + used, sizeof line - (size_t)used, "world ");
    va_start(args, format);
    int more = vsnprintf(line + used, sizeof line - (size_t)used - 1, format, args);
    va_end(args);
    used += more < (int)sizeof line - used - 1 ? more : (int)sizeof line - used - 2;
    line[used++] = '\n';
    mix(line, (size_t)used);
    if (world_trace_fd >= 0)
        (void)!write(world_trace_fd, line, (size_t)used);
}

/* ---- The baton ------------------------------------------------------------------------------- */

/* Returns when *word may be another value, or soon. */
static void futex_wait(atomic_int *word, int value)
{
    const struct timespec soon = {.tv_nsec = 50 * MS};
    (void)syscall(SYS_futex, (int *)word, FUTEX_WAIT, value, &soon, NULL, 0);
}

static void futex_wake(atomic_int *word)
{
    (void)syscall(SYS_futex, (int *)word, FUTEX_WAKE, 1, NULL, NULL, 0);
}

static void hand_back(void)
{
    atomic_store(&world->back, 1);
    futex_wake(&world->back);
}

static void await_baton(void)
{
    while (atomic_exchange(&me->go, 0) == 0)
        futex_wait(&me->go, 0);
    work = 0;
}

world_task *world_me(void)
{
    return me;
}

world_life *world_my_life(void)
{
    return &world->lives[me->life];
}

/* Signals are for the main thread; the others block them all. */
static bool take_signals(void)
{
    world_life *life = world_my_life();
    if (!me->is_main || life->signals == 0)
        return false;
    for (int i = 1; i < 32; i++)
        if (life->signals >> i & 1u) {
            life->signals &= ~(1u << i);
            world_trace("takes signal %d", i);
            (void)raise(i);
        }
    return true;
}

static int64_t lateness(void)
{
    if (world_chance(3))
        return (int64_t)world_draw(30 * MS);
    return (int64_t)world_draw(1 + (uint64_t)world->late_us * US);
}

static void pass(void)
{
    hand_back();
    await_baton();
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* Counts work. gcc and clang call it at each basic block of code built with
 * -fsanitize-coverage=trace-pc: the count is the same in each run. */
void __sanitizer_cov_trace_pc(void);
void __sanitizer_cov_trace_pc(void)
{
    work++;
    if (world_inside && work > (uint64_t)LONG_WORK_NS * 1000 / world->work_ps) {
        world_complain("works for more than %d ms without any call", (int)(LONG_WORK_NS / MS));
        abort();
    }
}

void world_charge(int64_t more_ns)
{
    int64_t ns = (int64_t)(work * world->work_ps / 1000) + more_ns;
    work = 0;
    world->now_ns += ns;
    me->cpu_ns += ns;
}

void world_enter(const char *call)
{
    world_life *life = world_my_life();
    world->calls++;
    world_charge(CALL_NS);
    me->call = call;
    if (life->die_at_call >= 0 && life->die_at_call-- == 0) {
        world_trace("is killed at %s", call);
        life->killed = true;
        (void)kill(getpid(), SIGKILL);
    }
    if (world->now_ns >= world->others_ns || world_chance(world->preempt_permille)) {
        me->state = TASK_READY;
        me->ready_ns = world->now_ns + (world_chance(100) ? lateness() : 0);
        pass();
    }
    (void)take_signals();
}

bool world_block(wait_kind kind, const void *object, int64_t deadline_ns, const char *call,
                 bool *interrupted)
{
    me->kind = kind;
    me->object = object;
    me->call = call;
    me->woken = false;
    me->deadline_ns = deadline_ns == NEVER ? NEVER : deadline_ns + lateness();
    do {
        me->state = TASK_BLOCKED;
        pass();
        bool signal = take_signals();
        if (interrupted && signal) {
            *interrupted = true;
            return false;
        }
    } while (!me->woken && world->now_ns < me->deadline_ns);
    return me->woken;
}

static void wake_task(world_task *t)
{
    t->woken = true;
    t->state = TASK_READY;
    t->ready_ns = world->now_ns + lateness();
}

void world_wake(int life, wait_kind kind, const void *object, bool only_one)
{
    unsigned first = only_one ? (unsigned)world_draw(TASKS_MAX) : 0;
    for (unsigned i = 0; i < TASKS_MAX; i++) {
        world_task *t = &world->tasks[(first + i) % TASKS_MAX];
        if (t->state != TASK_BLOCKED || t->life != life || t->kind != kind || t->object != object)
            continue;
        wake_task(t);
        if (only_one)
            return;
    }
}

void world_wake_all_fds(void)
{
    for (unsigned i = 0; i < TASKS_MAX; i++)
        if (world->tasks[i].state == TASK_BLOCKED && world->tasks[i].kind == WAIT_FD)
            wake_task(&world->tasks[i]);
}

/* ---- Tasks ----------------------------------------------------------------------------------- */

int world_add_task(int life, bool is_main)
{
    for (int i = 0; i < (int)TASKS_MAX; i++) {
        world_task *t = &world->tasks[i];
        if (t->state != TASK_NONE)
            continue;
        *t = (world_task){.life = life,
                          .state = TASK_READY,
                          .is_main = is_main,
                          .call = "start",
                          .ready_ns = world->now_ns,
                          .deadline_ns = NEVER};
        return i;
    }
    fprintf(stderr, "world: too many tasks\n");
    abort();
}

void world_begin_task(int task)
{
    me = &world->tasks[task];
    await_baton();
}

void world_end_task(void)
{
    world_charge(0);
    me->state = TASK_DONE;
    world_wake(me->life, WAIT_TASK, me, false);
    hand_back();
}

void world_exit(int status)
{
    if (world_inside) {
        world_charge(0);
        world_trace("exits with %d", status);
        world_inside = false;
        world_my_life()->exiting = true;
        hand_back();
    }
    exit(status);
}

void world_complain(const char *format, ...)
{
    world_life *life = world_my_life();
    va_list args;
    if (life->complaint[0])
        return;
    va_start(args, format);
    (void)vsnprintf(life->complaint, sizeof life->complaint, format, args);
    va_end(args);
    world_trace("COMPLAINT: %s", life->complaint);
}

/* ---- In the world ---------------------------------------------------------------------------- */

void world_make(uint64_t seed)
{
    if (!world)
        world =
            mmap(NULL, sizeof *world, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (world == MAP_FAILED)
        abort();
    memset(world, 0, sizeof *world);
    world->seed = seed;
    world->random = seed * UINT64_C(0xD1342543DE82EF95) + 1;
    world->now_ns = 1000 * S;
    world->realtime_ns = EPOCH_NS;
    world_trace_fd = -1;
    world->disk.room = NEVER;
    actor_count = 0;
}

void world_add_actor(actor *a)
{
    if (actor_count == ACTORS_MAX)
        abort();
    actors[actor_count++] = a;
}

/* Returns true for a life that is stuck where the world cannot see it, or has died with the
 * baton. */
static bool baton_is_lost(int life, const struct timespec *since)
{
    struct timespec now;
    world_life *l = &world->lives[life];
    if (waitpid(l->pid, &l->status, WNOHANG) == l->pid) {
        l->pid = 0;
        return true;
    }
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    if (now.tv_sec - since->tv_sec < REAL_PATIENCE_S)
        return false;
    (void)snprintf(l->complaint, sizeof l->complaint,
                   "hangs in a call that the world does not see");
    (void)kill(l->pid, SIGKILL);
    return false;
}

static int64_t task_time(const world_task *t)
{
    int64_t ns = t->state == TASK_READY ? t->ready_ns : t->deadline_ns;
    const world_life *l = &world->lives[t->life];
    if (t->state == TASK_BLOCKED && t->is_main && l->signals)
        ns = world->now_ns;
    if (ns != NEVER && ns < l->stopped_until_ns)
        ns = l->stopped_until_ns;
    return ns;
}

/* A task keeps the baton no longer than until others have been waiting for a while. */
static void set_limit(const world_task *t)
{
    world->others_ns = NEVER;
    for (unsigned i = 0; i < TASKS_MAX; i++) {
        const world_task *other = &world->tasks[i];
        if (other == t || (other->state != TASK_READY && other->state != TASK_BLOCKED))
            continue;
        if (task_time(other) < world->others_ns)
            world->others_ns = task_time(other);
    }
    for (unsigned i = 0; i < actor_count; i++)
        if (actors[i]->next_ns < world->others_ns)
            world->others_ns = actors[i]->next_ns;
    if (world->others_ns < world->now_ns)
        world->others_ns = world->now_ns;
    if (world->others_ns != NEVER)
        world->others_ns += SLICE_NS;
}

static void give_baton(world_task *t)
{
    struct timespec since;
    set_limit(t);
    (void)clock_gettime(CLOCK_MONOTONIC, &since);
    atomic_store(&t->go, 1);
    futex_wake(&t->go);
    while (atomic_exchange(&world->back, 0) == 0) {
        futex_wait(&world->back, 0);
        if (atomic_load(&world->back) == 0 && baton_is_lost(t->life, &since))
            break;
    }
    if (world->lives[t->life].complaint[0])
        verdict("life %d: %s", t->life, world->lives[t->life].complaint);
    if (world->lives[t->life].exiting || world->lives[t->life].pid == 0)
        life_reap(t->life);
}

/* Finds the next task or actor; of several whose time has come, any. */
static int64_t find_next(world_task **task, actor **who)
{
    int64_t first_ns = NEVER;
    unsigned found = 0;
    for (unsigned i = 0; i < TASKS_MAX + actor_count; i++) {
        world_task *t = i < TASKS_MAX ? &world->tasks[i] : NULL;
        actor *a = t ? NULL : actors[i - TASKS_MAX];
        if (t && t->state != TASK_READY && t->state != TASK_BLOCKED)
            continue;
        int64_t ns = t ? task_time(t) : a->next_ns;
        ns = ns < world->now_ns ? world->now_ns : ns;
        if (ns > first_ns || ns == NEVER)
            continue;
        found = ns < first_ns ? 1 : found + 1;
        first_ns = ns;
        if (found > 1 && world_draw(found) != 0)
            continue;
        *task = t;
        *who = a;
    }
    return first_ns;
}

void world_run(int64_t until_ns)
{
    while (verdict_count() == 0) {
        world_task *task = NULL;
        actor *who = NULL;
        int64_t ns = find_next(&task, &who);
        if (ns >= until_ns)
            break;
        world->now_ns = ns;
        if (task)
            give_baton(task);
        else
            who->act(who);
    }
    if (world->now_ns < until_ns)
        world->now_ns = until_ns;
}
