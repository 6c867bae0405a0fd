/* SPDX-License-Identifier: MIT
 *
 * main.c - bench: what the library costs. `make bench` runs it, beside others, by scripts/bench.
 *
 * Times are those of this process, the best of several rounds, since noise only ever adds. A round
 * goes through all works, so that what is compared has the same noise.
 */
#include "works.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ROUNDS 15
#define ROUND_NS 10e6 /* of one work */

static const char usage[] =
    "usage: bench              times as text\n"
    "       bench --json       times as JSON\n"
    "       bench --check      does a little of each work and checks what was done\n"
    "       bench --compiler   what has built it\n"
    "       bench --memory     bytes of a node besides its queue and statistics\n"
    "       bench NAME UNITS   does that much of one work and says how much it was\n";

#ifdef __clang__
#define COMPILER "clang " __clang_version__
#else
#define COMPILER "gcc " __VERSION__
#endif

typedef struct measurement {
    void *state;
    uint64_t units;
    double ns[ROUNDS]; /* a unit; sorted at the end */
} measurement;

static double now_ns(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static double measure_once(const bench_work *w, void *state, uint64_t units)
{
    double start = now_ns();
    uint64_t done = w->run(state, units);
    return (now_ns() - start) / (double)done;
}

/* Finds a number of units that makes a round long enough. */
static void calibrate(measurement *m, const bench_work *w)
{
    m->units = w->units;
    while (measure_once(w, m->state, m->units) * (double)m->units < ROUND_NS)
        m->units *= 2;
}

static int by_size(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;
    return left < right ? -1 : left > right;
}

static void measure_all(measurement *all)
{
    for (unsigned i = 0; i < bench_work_count; i++) {
        all[i].state = bench_works[i].start(bench_works[i].options);
        calibrate(&all[i], &bench_works[i]);
    }
    for (unsigned round = 0; round < ROUNDS; round++)
        for (unsigned i = 0; i < bench_work_count; i++)
            all[i].ns[round] = measure_once(&bench_works[i], all[i].state, all[i].units);
    for (unsigned i = 0; i < bench_work_count; i++)
        qsort(all[i].ns, ROUNDS, sizeof(double), by_size);
}

static unsigned load_of_mix(const measurement *all)
{
    for (unsigned i = 0; i < bench_work_count; i++)
        if (strcmp(bench_works[i].name, "mix") == 0)
            return bench_mix_load_permille(all[i].state);
    return 0;
}

static void print_text(const measurement *all)
{
    printf("best and median of %d rounds\n", ROUNDS);
    for (unsigned i = 0; i < bench_work_count; i++)
        printf("%-16s %12.1f %12.1f ns a %s\n", bench_works[i].name, all[i].ns[0],
               all[i].ns[ROUNDS / 2], bench_works[i].unit);
    printf("%-16s %12zu bytes\n", "node", bench_bytes_per_node());
}

static void print_json(const measurement *all)
{
    printf("{\"compiler\": \"%s\", \"rounds\": %d, \"bytes_per_node\": %zu, "
           "\"mix_load_permille\": %u,\n \"works\": {",
           COMPILER, ROUNDS, bench_bytes_per_node(), load_of_mix(all));
    for (unsigned i = 0; i < bench_work_count; i++)
        printf("%s\n  \"%s\": {\"unit\": \"%s\", \"units\": %" PRIu64
               ", \"best_ns\": %.2f, \"median_ns\": %.2f}",
               i ? "," : "", bench_works[i].name, bench_works[i].unit, bench_works[i].units,
               all[i].ns[0], all[i].ns[ROUNDS / 2]);
    puts("}}");
}

static int run_one(const char *name, const char *units)
{
    for (unsigned i = 0; i < bench_work_count; i++) {
        const bench_work *w = &bench_works[i];
        if (strcmp(w->name, name) != 0)
            continue;
        void *state = w->start(w->options);
        printf("%" PRIu64 "\n", w->run(state, strtoull(units, NULL, 10)));
        w->end(state);
        return 0;
    }
    bench_fail("there is no work '%s'", name);
}

/* Checks all works and stops at the first violation. */
static void check_all(void)
{
    for (unsigned i = 0; i < bench_work_count; i++) {
        const bench_work *w = &bench_works[i];
        void *state = w->start(w->options);
        if (w->run(state, w->units) < w->units)
            bench_fail("%s: too little was done", w->name);
        w->end(state);
    }
    printf("%u passed, 0 failed\n", bench_work_count);
}

/* Answers an option that measures no time. */
static bool answer(const char *option)
{
    if (strcmp(option, "--check") == 0)
        check_all();
    else if (strcmp(option, "--compiler") == 0)
        puts(COMPILER);
    else if (strcmp(option, "--memory") == 0)
        printf("%zu\n", bench_bytes_per_node());
    else
        return false;
    return true;
}

int main(int argc, char **argv)
{
    bool json = argc == 2 && strcmp(argv[1], "--json") == 0;
    if (argc == 3)
        return run_one(argv[1], argv[2]);
    if (argc == 2 && answer(argv[1]))
        return 0;
    if (argc != 1 && !json) {
        fputs(usage, stderr);
        return 2;
    }
    measurement *all = bench_alloc(bench_work_count * sizeof *all);
    measure_all(all);
    (json ? print_json : print_text)(all);
    for (unsigned i = 0; i < bench_work_count; i++)
        bench_works[i].end(all[i].state);
    free(all);
    return 0;
}
