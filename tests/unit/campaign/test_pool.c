/* SPDX-License-Identifier: MIT
 *
 * test_pool.c - lines of several processes come in order, whatever becomes of the processes.
 */
#include "cases.h"
#include "campaign/pool.h"

#include <errno.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define FIRST 1000u
#define LINE_BYTES 64
#define SHAKY_ENDS 2u /* of the process of a shaky line, before it is made */

/* The end of the process that makes a line. */
typedef enum fate { MADE = 'm', CRASHED = 'c', EXITED = 'e', LATE = 'l', SHAKY = 's' } fate;

typedef struct lines {
    fate (*fate_of)(uint64_t number);
    pid_t parent;
    int file; /* of a byte for each line that is shaky: its attempts */
    char *text;
    size_t size;
    FILE *out;
    uint64_t taken;
    uint64_t stop_at; /* 0: never */
    unsigned few;     /* processes that there could be */
    unsigned told;    /* times that it was said */
    unsigned codes[256];
} lines;

static fate all_made(uint64_t number)
{
    (void)number;
    return MADE;
}

static fate some_lost(uint64_t number)
{
    return number == FIRST + 7 ? CRASHED : number == FIRST + 8 ? EXITED : MADE;
}

static fate one_late(uint64_t number)
{
    return number == FIRST + 3 ? LATE : MADE;
}

static fate some_shaky(uint64_t number)
{
    return number % 2 ? SHAKY : MADE;
}

static void put_line(buffer *line, const char *word, uint64_t number)
{
    char text[LINE_BYTES];
    (void)snprintf(text, sizeof text, "%s %u\n", word, (unsigned)number);
    buffer_put(line, text);
}

/* Ends the process of a shaky line that has been tried too seldom. */
static void shake(const lines *l, uint64_t number)
{
    unsigned char attempts = 0;
    const off_t at = (off_t)(number - FIRST);
    (void)!pread(l->file, &attempts, 1, at);
    attempts++;
    assert_int_equal(pwrite(l->file, &attempts, 1, at), 1);
    if (attempts <= SHAKY_ENDS)
        (void)raise(SIGKILL);
}

static unsigned char make(void *user, uint64_t number, buffer *line)
{
    const lines *l = user;
    const fate f = l->fate_of(number);
    assert_int_not_equal(getpid(), l->parent);
    if (f == CRASHED)
        (void)raise(SIGKILL);
    if (f == EXITED)
        _exit(9);
    while (f == LATE)
        (void)pause();
    if (f == SHAKY)
        shake(l, number);
    put_line(line, "made", number);
    return MADE;
}

static unsigned char lose(void *user, uint64_t number, const pool_loss *loss, buffer *line)
{
    const lines *l = user;
    assert_int_equal(getpid(), l->parent);
    put_line(line, loss->timeout ? "late" : WIFSIGNALED(loss->status) ? "crashed" : "exited",
             number);
    return loss->timeout ? LATE : WIFSIGNALED(loss->status) ? CRASHED : EXITED;
}

static bool take(void *user, unsigned char code, const char *line, size_t length)
{
    lines *l = user;
    if (l->stop_at && l->taken == l->stop_at)
        return false;
    l->taken++;
    l->codes[code]++;
    return fwrite(line, 1, length, l->out) == length;
}

static void few(void *user, unsigned jobs, int error)
{
    lines *l = user;
    assert_int_equal(error, EMFILE);
    l->few = jobs;
    l->told++;
}

static bool run(lines *l, uint64_t count, unsigned jobs, int64_t limit_ms)
{
    static const pool_calls calls = {.make = make, .lose = lose, .take = take, .few = few};
    const pool_work work = {.calls = &calls, .user = l, .first = FIRST, .count = count,
                            .jobs = jobs, .limit_ms = limit_ms};
    l->parent = getpid();
    l->out = open_memstream(&l->text, &l->size);
    assert_non_null(l->out);
    const bool good = pool_run(&work);
    assert_int_equal(fclose(l->out), 0);
    return good;
}

/* Asserts that the lines are all there, with other words for those that are lost. */
static void assert_lines(const lines *l, uint64_t count, const char *const words[],
                         const uint64_t numbers[], size_t lost)
{
    const char *at = l->text;
    assert_int_equal(l->taken, count);
    for (uint64_t i = 0; i < count; i++) {
        char expected[LINE_BYTES];
        const char *word = "made";
        for (size_t k = 0; k < lost; k++)
            word = numbers[k] == i ? words[k] : word;
        (void)snprintf(expected, sizeof expected, "%s %u\n", word, (unsigned)(FIRST + i));
        assert_memory_equal(at, expected, strlen(expected));
        at += strlen(expected);
    }
    assert_int_equal(at - l->text, l->size);
}

TEST(lines_are_in_order_for_any_number_of_processes)
{
    static const unsigned jobs[] = {1, 2, 3, 7};
    static const uint64_t counts[] = {0, 1, 2, 100, 5000};
    for (size_t i = 0; i < COUNT(jobs); i++) {
        for (size_t k = 0; k < COUNT(counts); k++) {
            lines l = {.fate_of = all_made};
            assert_true(run(&l, counts[k], jobs[i], 0));
            assert_lines(&l, counts[k], NULL, NULL, 0);
            free(l.text);
        }
    }
}

TEST(a_process_that_ends_costs_its_line_alone)
{
    static const char *const words[] = {"crashed", "exited"};
    static const uint64_t numbers[] = {7, 8};
    for (unsigned jobs = 1; jobs <= 3; jobs++) {
        lines l = {.fate_of = some_lost};
        assert_true(run(&l, 400, jobs, 0));
        assert_lines(&l, 400, words, numbers, COUNT(numbers));
        assert_int_equal(l.codes[CRASHED], 1);
        assert_int_equal(l.codes[EXITED], 1);
        free(l.text);
    }
}

TEST(a_process_that_hangs_is_ended)
{
    static const char *const words[] = {"late"};
    static const uint64_t numbers[] = {3};
    lines l = {.fate_of = one_late};
    assert_true(run(&l, 40, 2, 2000));
    assert_lines(&l, 40, words, numbers, COUNT(numbers));
    free(l.text);
}

TEST(lines_whose_processes_are_killed_are_not_lost)
{
    for (unsigned jobs = 1; jobs <= 2; jobs++) {
        char name[] = "/tmp/test_pool.XXXXXX";
        lines l = {.fate_of = some_shaky, .file = mkstemp(name)};
        assert_true(l.file >= 0);
        assert_int_equal(unlink(name), 0);
        assert_true(run(&l, 60, jobs, 0));
        assert_lines(&l, 60, NULL, NULL, 0);
        assert_int_equal(lseek(l.file, 0, SEEK_END), 60);
        assert_int_equal(close(l.file), 0);
        free(l.text);
    }
}

TEST(whoever_takes_the_lines_may_end_it)
{
    lines l = {.fate_of = all_made, .stop_at = 300};
    assert_false(run(&l, 100000, 2, 0));
    assert_int_equal(errno, 0);
    assert_int_equal(l.taken, 300);
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1); /* no process is left */
    free(l.text);
}

/* Allows so many descriptors beside the lowest that is free. Returns the limit before. */
static rlim_t allow_descriptors(rlim_t more)
{
    struct rlimit limit;
    const int lowest = dup(STDERR_FILENO);
    assert_true(lowest >= 0 && close(lowest) == 0);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    const rlim_t before = limit.rlim_cur;
    limit.rlim_cur = (rlim_t)lowest + more;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    return before;
}

static void restore_descriptors(rlim_t before)
{
    struct rlimit limit;
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    limit.rlim_cur = before;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
}

/* A process takes a descriptor, and one more while it is made. */
TEST(fewer_processes_than_wanted_do_the_work)
{
    for (unsigned most = 1; most <= 4; most++) {
        lines l = {.fate_of = all_made};
        const rlim_t before = allow_descriptors(most + 1);
        assert_true(run(&l, 3000, 16, 0));
        restore_descriptors(before);
        assert_lines(&l, 3000, NULL, NULL, 0);
        assert_int_equal(l.few, most);
        assert_int_equal(l.told, 1);
        free(l.text);
    }
}

/* ... also when processes end, whose places others could take. */
TEST(few_processes_that_end_are_replaced)
{
    static const char *const words[] = {"crashed", "exited"};
    static const uint64_t numbers[] = {7, 8};
    for (unsigned most = 1; most <= 3; most++) {
        lines l = {.fate_of = some_lost};
        const rlim_t before = allow_descriptors(most + 1);
        assert_true(run(&l, 400, 8, 0));
        restore_descriptors(before);
        assert_lines(&l, 400, words, numbers, COUNT(numbers));
        free(l.text);
    }
}

TEST(without_any_process_there_is_no_work)
{
    lines l = {.fate_of = all_made};
    const rlim_t before = allow_descriptors(1);
    assert_false(run(&l, 400, 8, 0));
    assert_int_equal(errno, EMFILE);
    restore_descriptors(before);
    assert_int_equal(l.told, 0);
    free(l.text);
}
