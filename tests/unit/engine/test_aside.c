/* SPDX-License-Identifier: MIT
 *
 * test_aside.c - what is done beside the bus: done, given up, left alone, and files read ahead.
 */
#include "cases.h"
#include "base/file/aside.h"
#include "engine/reloader.h"
#include "trace/ahead.h"

#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <time.h>
#include <unistd.h>
#include <yaml.h>

#define PATIENCE_S 60
#define ALONE_MAX 100
#define SOON_S 0.01
#define NEVER_S 1e6
#define BUSY_NS 20000000

/* ---- Detached threads ------------------------------------------------------------------------ */

static pthread_t alone[ALONE_MAX];
static unsigned alone_count;

/* Replaces the C library's function: these tests do wait for such threads. */
int pthread_detach(pthread_t thread)
{
    assert_in_range(alone_count, 0, ALONE_MAX - 1);
    alone[alone_count++] = thread;
    return 0;
}

static void wait_for_threads(void)
{
    while (alone_count > 0)
        assert_int_equal(pthread_join(alone[--alone_count], NULL), 0);
}

/* ---- Reading that takes long ----------------------------------------------------------------- */

static struct {
    sem_t *goes_on; /* NULL: reading takes no time */
    sem_t *begun;   /* set together with goes_on */
    int busy_s;     /* that any thread has used */
} reading;

int yaml_parser_initialize(yaml_parser_t *parser)
{
    static int (*real)(yaml_parser_t *);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "yaml_parser_initialize");
    if (reading.goes_on)
        (void)sem_post(reading.begun);
    while (reading.goes_on && sem_wait(reading.goes_on) != 0)
        continue;
    if (reading.goes_on)
        (void)sem_post(reading.goes_on);
    return real(parser);
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "clock_gettime");
    if (reading.goes_on && clock < 0) {
        *now = (struct timespec){.tv_sec = reading.busy_s};
        return 0;
    }
    return real(clock, now);
}

/* Shortens a time limit, which takes too long otherwise. */
void ev_timer_start(struct ev_loop *loop, ev_timer *timer)
{
    static void (*real)(struct ev_loop *, ev_timer *);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "ev_timer_start");
    if (reading.goes_on)
        ev_timer_set(timer, SOON_S, 0.0);
    real(loop, timer);
}

/* ---- Tasks ----------------------------------------------------------------------------------- */

/* A task of a given duration. */
typedef struct task {
    sem_t *works; /* it works first, and says when it has; or NULL */
    sem_t *goes_on;
    atomic_uint *dropped;
} task;

typedef struct world {
    struct ev_loop *loop;
    unsigned done;
    unsigned late;
    double busy_s; /* of the late one */
    sem_t goes_on; /* once it has been posted, for all tasks */
    atomic_uint dropped;
} world;

static void be_busy(void)
{
    struct timespec used = {.tv_sec = 0};
    while (used.tv_nsec < BUSY_NS && used.tv_sec == 0)
        (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
}

static void work(void *argument)
{
    const task *t = argument;
    if (t->works)
        be_busy();
    if (t->works)
        (void)sem_post(t->works);
    while (sem_wait(t->goes_on) != 0)
        continue;
    (void)sem_post(t->goes_on);
}

static void drop(void *argument)
{
    task *t = argument;
    ++*t->dropped;
    free(t);
}

static void on_done(void *user, void *argument)
{
    world *w = user;
    w->done++;
    free(argument);
}

static void on_late(void *user, double busy_s)
{
    world *w = user;
    w->busy_s = busy_s;
    w->late++;
}

static const aside_calls calls = {.work = work, .drop = drop, .done = on_done, .late = on_late};

static aside *begin_work(world *w, double limit_s, sem_t *works)
{
    task *t = malloc(sizeof *t);
    *t = (task){.works = works, .goes_on = &w->goes_on, .dropped = &w->dropped};
    aside *a = aside_start(w->loop, &calls, t, w, limit_s);
    assert_non_null(a);
    return a;
}

static aside *begin(world *w, double limit_s)
{
    return begin_work(w, limit_s, NULL);
}

static int set_up(void **state)
{
    world *w = calloc(1, sizeof *w);
    w->loop = ev_loop_new(0);
    (void)sem_init(&w->goes_on, 0, 0);
    (void)alarm(PATIENCE_S); /* ends the program */
    *state = w;
    return 0;
}

static int tear_down(void **state)
{
    world *w = *state;
    wait_for_threads();
    (void)alarm(0);
    ev_loop_destroy(w->loop);
    (void)sem_destroy(&w->goes_on);
    free(w);
    return 0;
}

/* Turns of the loop, each of which waits for something, until it is so. */
#define WAIT_UNTIL(w, condition)                                                                   \
    do {                                                                                           \
        while (!(condition))                                                                       \
            ev_run((w)->loop, EVRUN_ONCE);                                                         \
    } while (0)

static void call_nobody(struct ev_loop *loop)
{
    (void)loop;
}

/* Waits until an event has come to the loop, which has not reported it yet. */
static void wait_untold(const world *w)
{
    ev_set_invoke_pending_cb(w->loop, call_nobody);
    while (ev_pending_count(w->loop) == 0)
        ev_run(w->loop, EVRUN_ONCE);
    ev_set_invoke_pending_cb(w->loop, ev_invoke_pending);
}

#define CASE(test) TEST_WITH(test, set_up, tear_down)

CASE(what_is_done_is_told_in_the_loop)
{
    world *w = *state;
    (void)sem_post(&w->goes_on);
    begin(w, NEVER_S);
    begin(w, NEVER_S);
    WAIT_UNTIL(w, w->done == 2);
    assert_int_equal(w->late + w->dropped, 0);
    assert_int_equal(aside_left(), 0);
}

CASE(what_takes_too_long_is_given_up_and_thrown_away)
{
    world *w = *state;
    begin(w, SOON_S);
    WAIT_UNTIL(w, w->late == 1);
    assert_int_equal(aside_left(), 1);
    assert_int_equal(w->dropped, 0);
    (void)sem_post(&w->goes_on);
    wait_for_threads();
    assert_int_equal(aside_left(), 0);
    assert_int_equal(w->dropped, 1);
    assert_int_equal(w->done, 0);
}

CASE(what_is_late_tells_whether_it_works)
{
    world *w = *state;
    sem_t works;
    (void)sem_init(&works, 0, 0);
    begin_work(w, SOON_S, &works);
    while (sem_wait(&works) != 0)
        continue;
    WAIT_UNTIL(w, w->late == 1);
    assert_true(w->busy_s >= BUSY_NS * 1e-9 && w->busy_s < PATIENCE_S);
    (void)sem_post(&w->goes_on);
    wait_for_threads();
    (void)sem_destroy(&works);
}

CASE(what_is_left_alone_tells_nothing)
{
    world *w = *state;
    aside_leave(begin(w, NEVER_S));
    assert_int_equal(aside_left(), 1);
    (void)sem_post(&w->goes_on);
    wait_for_threads();
    assert_int_equal(aside_left(), 0);
    aside *ready = begin(w, NEVER_S);
    wait_untold(w);
    aside_leave(ready);
    assert_int_equal(w->dropped, 2);
    assert_int_equal(aside_left(), 0);
    assert_int_equal(w->done + w->late, 0);
}

/* ---- Reloads --------------------------------------------------------------------------------- */

typedef struct told {
    unsigned began;
    unsigned taken;
    uint64_t good;
    uint64_t bad;
    char errors[400];
} told;

static void on_begins(void *user)
{
    told *t = user;
    t->began++;
}

static bool on_take(void *user, reload *r, FILE *errors)
{
    told *t = user;
    t->taken++;
    reload_free(r);
    if (t->taken > 2)
        fputs("not a third one\n", errors);
    return t->taken <= 2;
}

static void on_over(void *user, uint64_t round, char *errors)
{
    told *t = user;
    *(errors ? &t->bad : &t->good) = round;
    if (errors)
        (void)snprintf(t->errors, sizeof t->errors, "%s", errors);
}

static const reloader_calls reload_calls = {
    .begins = on_begins, .take = on_take, .over = on_over};

CASE(reloads_come_in_rounds)
{
    world *w = *state;
    char file[] = "/tmp/test_aside.XXXXXX";
    static const char text[] = "{ bus: { bitrate: 500000 }, nodes: [ { name: a } ] }\n";
    told t = {.began = 0};
    int fd = mkstemp(file);
    assert_true(write(fd, text, sizeof text - 1) == sizeof text - 1);
    close(fd);
    const fileuses none = {.count = 0};
    reloader *r = reloader_new(w->loop, &none, &reload_calls, &t);
    assert_false(reloader_is_busy(r));
    assert_int_equal(reloader_ask(r, file, stderr), 1);
    assert_int_equal(reloader_ask(r, file, stderr), 2); /* the first has begun to read it */
    assert_int_equal(reloader_ask(r, file, stderr), 2);
    assert_int_equal(t.began, 1);
    WAIT_UNTIL(w, t.good == 2);
    assert_int_equal(t.began, 2);
    assert_false(reloader_is_busy(r));
    assert_int_equal(reloader_ask(r, file, stderr), 3);
    WAIT_UNTIL(w, t.bad == 3);
    assert_string_equal(t.errors, "not a third one\n");
    unlink(file);
    assert_int_equal(reloader_ask(r, file, stderr), 4);
    WAIT_UNTIL(w, t.bad == 4);
    assert_non_null(strstr(t.errors, "No such file"));
    assert_int_equal(reloader_ask(r, "/dev/zero", stderr), 5);
    WAIT_UNTIL(w, t.bad == 5);
    assert_non_null(strstr(t.errors, "/dev/zero: not a regular file"));
    assert_int_equal(reloader_ask(r, file, stderr), 6);
    assert_int_equal(reloader_ask(r, file, stderr), 7);
    reloader_free(r);
    assert_int_equal(t.bad, 7);
    assert_string_equal(t.errors, "canwired is stopping\n");
    wait_for_threads();
    assert_int_equal(aside_left(), 0);
}

/* The remedy for a disk that hangs does not help against too much work. */
CASE(a_reload_that_is_given_up_says_what_helps)
{
    static const struct {
        int busy_s;
        const char *words;
    } cases[] = {
        {0, "takes longer than 10 s and is given up; does a disk or a network hang?\n"},
        {5, "takes longer than 10 s and is given up, after 5.0 s of work: are the files large, "
            "are large profiles loaded often, or is the machine busy?\n"},
    };
    world *w = *state;
    char file[] = "/tmp/test_aside.XXXXXX";
    close(mkstemp(file));
    sem_t begun;
    (void)sem_init(&begun, 0, 0);
    for (unsigned i = 0; i < 2; i++) {
        const fileuses none = {.count = 0};
        told t = {.began = 0};
        reloader *r = reloader_new(w->loop, &none, &reload_calls, &t);
        reading.begun = &begun;
        reading.goes_on = &w->goes_on;
        reading.busy_s = cases[i].busy_s;
        assert_int_equal(reloader_ask(r, file, stderr), 1);
        while (sem_wait(&begun) != 0) /* before that the thread has used no time */
            continue;
        WAIT_UNTIL(w, t.bad == 1);
        assert_non_null(strstr(t.errors, cases[i].words));
        reloader_free(r);
        (void)sem_post(&w->goes_on);
        wait_for_threads();
        while (sem_trywait(&w->goes_on) == 0 || sem_trywait(&begun) == 0) /* it reads twice */
            continue;
        reading.goes_on = NULL;
    }
    (void)sem_destroy(&begun);
    unlink(file);
}

/* ---- Files that are read ahead --------------------------------------------------------------- */

#define LINES 10000u

static trace_reader *open_lines(char *file, unsigned count)
{
    char problem[TRACE_PROBLEM_MAX];
    strcpy(file, "/tmp/test_aside.XXXXXX");
    FILE *out = fdopen(mkstemp(file), "w");
    assert_non_null(out);
    for (unsigned i = 0; i < count; i++)
        fprintf(out, "(%u.000000) can0 123#%08X\n", i, i);
    fclose(out);
    trace_reader *reader = trace_open(file, TRACE_DETECT, problem);
    assert_non_null(reader);
    unlink(file);
    return reader;
}

static trace_result take(trace_ahead *a, trace_record *record)
{
    uint64_t position;
    trace_result result;
    while ((result = trace_ahead_next(a, record, &position)) == TRACE_LATER)
        trace_ahead_fill(a);
    return result;
}

CASE(all_entries_come_in_their_order)
{
    char file[32];
    trace_record record;
    trace_ahead *a = trace_ahead_start(open_lines(file, LINES), false);
    for (unsigned i = 0; i < LINES; i++) {
        assert_int_equal(take(a, &record), TRACE_RECORD);
        assert_int_equal(record.place, i + 1);
        assert_int_equal(record.time_ns / 1000000000u, i);
    }
    assert_int_equal(take(a, &record), TRACE_END);
    assert_int_equal(take(a, &record), TRACE_END);
    trace_ahead_close(a);
}

CASE(a_small_file_comes_again_and_again)
{
    char file[32];
    trace_record record;
    trace_ahead *a = trace_ahead_start(open_lines(file, 3), true);
    trace_ahead_fill(a);
    for (unsigned i = 0; i < LINES; i++) {
        assert_int_equal(take(a, &record), i % 4 == 3 ? TRACE_END : TRACE_RECORD);
        if (i % 4 < 3)
            assert_int_equal(record.place, i % 4 + 1);
    }
    trace_ahead_close(a); /* its thread waits for room */
}

CASE(it_can_be_closed_at_any_time)
{
    char file[32];
    trace_record record;
    for (unsigned i = 0; i < 50; i++) {
        trace_ahead *a = trace_ahead_start(open_lines(file, i * 100), i % 2 == 0);
        if (i % 3 == 0)
            trace_ahead_fill(a);
        if (i % 5 == 0)
            (void)take(a, &record);
        trace_ahead_close(a);
    }
}
