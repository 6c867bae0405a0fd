/* SPDX-License-Identifier: MIT
 *
 * main.c - the differential test: random scenarios until enough bits have gone by.
 *
 * Scenarios run in a child process; one that fails, crashes or hangs there is shrunk by the parent.
 */
#include "differential.h"

#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define BITS_DEFAULT UINT64_C(10000000)
#define BITS_COVERING BITS_DEFAULT /* runs of so many bits must exercise everything */
#define HANG_SECONDS 120           /* of CPU time, for one scenario */

/* Options without a value. */
enum {
    FOREVER = 1,
    VERBOSE = 2,
    SHOW = 4, /* the scenario of the seed, without running it */
    HERE = 8, /* in this process */
    NO_SHRINK = 16,
    HELP = 32,
    OWN_CLOCKS = 64,
};

typedef struct options {
    uint64_t bits;
    uint64_t seed;
    uint64_t seconds; /* 0: until the bits have gone by */
    unsigned flags;
} options;

/* Seen by parent and child. */
typedef struct shared {
    uint64_t seed; /* of the present scenario */
    uint64_t tick; /* tick of the difference */
    diff_coverage coverage;
} shared;

static volatile shared *common;

static const char usage[] =
    "usage: differential [--bits N | --seconds N | --forever] [--seed N] [--verbose]\n"
    "                    [--own-clocks] [--no-shrink] [--show | --here] [--help]\n"
    "Runs random scenarios on a bus that takes short cuts and on one that steps every node\n"
    "through every bit, until N bits have gone by (default 10000000), and compares all that can\n"
    "be read. The scenarios are those of the seeds N, N + 1, ... (default 1). One that differs is\n"
    "made small and written as calls of the library. --show writes the scenario of the seed,\n"
    "--here runs it in this process, for a debugger. With --own-clocks the nodes of the second\n"
    "bus go by clocks of their own, which agree.\n"
    "Exit status: 0, 1 they differ, 2 wrong usage.\n";

/* ---- Running --------------------------------------------------------------------------------- */

/* Limits the CPU time of the child, which a signal ends when a scenario takes too much. */
static void limit_time(unsigned seconds)
{
    const struct itimerval limit = {.it_value = {.tv_sec = (time_t)seconds}};
    (void)setitimer(ITIMER_VIRTUAL, &limit, NULL);
}

diff_outcome diff_try(const diff_scenario *s, uint64_t *tick, bool tell)
{
    static diff_coverage unused;
    diff_verdict verdict;
    int status;
    fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        if (!tell)
            (void)!freopen("/dev/null", "w", stderr);
        limit_time(HANG_SECONDS / 10);
        diff_run(&verdict, s, &unused, tell ? stdout : NULL);
        fflush(stdout);
        common->tick = verdict.tick;
        _exit(verdict.differs ? 1 : 0);
    }
    if (child < 0 || waitpid(child, &status, 0) < 0)
        exit(2);
    *tick = common->tick;
    if (WIFEXITED(status))
        return WEXITSTATUS(status) == 0   ? DIFF_SAME
               : WEXITSTATUS(status) == 1 ? DIFF_DIFFERS
                                          : DIFF_CRASHES;
    return WTERMSIG(status) == SIGVTALRM ? DIFF_HANGS : DIFF_CRASHES;
}

static void tell_scenario(const diff_scenario *s)
{
    printf("seed %" PRIu64 ": %s, %u nodes, %" PRIu64 " bits, %u rules, %u operations\n", s->seed,
           diff_style_name(s->style), s->plans[0].config.node_count,
           s->end / s->plans[0].config.bit_ticks, s->plans[0].config.rule_count, s->op_count);
    fflush(stdout);
}

static bool is_done(const options *o, const diff_coverage *c, time_t begin)
{
    if ((o->flags & FOREVER) || c->scenarios == 0)
        return false;
    return o->seconds ? (uint64_t)(time(NULL) - begin) >= o->seconds : c->bits >= o->bits;
}

static void generate(diff_scenario *s, const options *o, uint64_t seed)
{
    diff_generate(s, seed);
    s->own_clocks = o->flags & OWN_CLOCKS;
    for (unsigned i = 0; i < s->plan_count && s->own_clocks; i++)
        s->plans[i].config.start_at_tick = false; /* it is for a bus on the grid */
}

/* Runs the child: exit status 1 when a scenario differs. */
static int run_all(const options *o)
{
    static diff_scenario s;
    diff_verdict verdict = {.differs = false};
    diff_coverage c;
    memset(&c, 0, sizeof c);
    time_t begin = time(NULL);
    for (uint64_t seed = o->seed; !verdict.differs && !is_done(o, &c, begin); seed++) {
        common->seed = seed;
        limit_time(HANG_SECONDS);
        generate(&s, o, seed);
        if (o->flags & VERBOSE)
            tell_scenario(&s);
        diff_run(&verdict, &s, &c, NULL);
        diff_scenario_free(&s);
        memcpy((void *)(uintptr_t)&common->coverage, &c, sizeof c);
    }
    return verdict.differs ? 1 : 0;
}

static int show_or_run_here(const options *o)
{
    static diff_scenario s;
    static diff_coverage unused;
    diff_verdict verdict = {.differs = false};
    generate(&s, o, o->seed);
    if (o->flags & SHOW)
        diff_write_scenario(stdout, &s);
    else
        diff_run(&verdict, &s, &unused, stdout);
    diff_scenario_free(&s);
    return verdict.differs;
}

static void shrink_and_tell(const options *o, uint64_t seed)
{
    static diff_scenario s;
    uint64_t tick;
    generate(&s, o, seed);
    tell_scenario(&s);
    diff_outcome outcome = diff_try(&s, &tick, true);
    static const char *const outcomes[] = {"it is the same when run alone", "it differs",
                                           "it crashes", "it hangs"};
    printf("seed %" PRIu64 ": %s, at tick %" PRIu64 "\n", seed, outcomes[outcome], tick);
    if (outcome == DIFF_SAME || (o->flags & NO_SHRINK))
        return;
    diff_shrink(&s, outcome, tick);
    printf("\n");
    diff_write_scenario(stdout, &s);
    printf("\n");
    (void)diff_try(&s, &tick, true);
    diff_scenario_free(&s);
    printf("again with: --seed %" PRIu64 " --bits 1\n", seed);
}

/* ---- Main ------------------------------------------------------------------------------------ */

static bool read_number(uint64_t *value, const char *text)
{
    char *end;
    *value = strtoull(text, &end, 0);
    return *text != '\0' && *end == '\0';
}

static bool read_value(options *o, int option)
{
    switch (option) {
    case 'b':
        return read_number(&o->bits, optarg);
    case 's':
        return read_number(&o->seed, optarg);
    case 't':
        return read_number(&o->seconds, optarg);
    default:
        return false;
    }
}

static bool read_options(options *o, int argc, char **argv)
{
    static const struct option names[] = {
        {"bits", required_argument, NULL, 'b'},    {"seed", required_argument, NULL, 's'},
        {"seconds", required_argument, NULL, 't'}, {"forever", no_argument, NULL, FOREVER},
        {"verbose", no_argument, NULL, VERBOSE},   {"show", no_argument, NULL, SHOW},
        {"here", no_argument, NULL, HERE},         {"no-shrink", no_argument, NULL, NO_SHRINK},
        {"own-clocks", no_argument, NULL, OWN_CLOCKS}, {"help", no_argument, NULL, HELP},
        {NULL, 0, NULL, 0}};
    *o = (options){.bits = BITS_DEFAULT, .seed = 1};
    for (int c; (c = getopt_long(argc, argv, "", names, NULL)) != -1;) {
        if (c <= OWN_CLOCKS)
            o->flags |= (unsigned)c;
        else if (!read_value(o, c))
            return false;
    }
    return optind == argc;
}

/* Prints the results of two tests: nothing differs, and everything was exercised. */
static int summarise(const options *o, bool same)
{
    diff_coverage c;
    memcpy(&c, (const void *)(uintptr_t)&common->coverage, sizeof c);
    printf("seeds %" PRIu64 " to %" PRIu64 "\n", o->seed, common->seed);
    diff_cover_write(&c, stdout);
    unsigned missing = c.bits >= BITS_COVERING ? diff_cover_missing(&c, stdout) : 0;
    unsigned failed = (same ? 0u : 1u) + (missing > 0 ? 1u : 0u);
    printf("%u passed, %u failed\n", 2 - failed, failed);
    return failed > 0;
}

static int compare_all(const options *o)
{
    int status;
    common = mmap(NULL, sizeof *common, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (common == MAP_FAILED)
        return 2;
    pid_t child = fork();
    if (child == 0)
        _exit(run_all(o));
    if (child < 0 || waitpid(child, &status, 0) < 0)
        return 2;
    bool same = WIFEXITED(status) && WEXITSTATUS(status) == 0;
    if (!same)
        shrink_and_tell(o, common->seed);
    return summarise(o, same);
}

int main(int argc, char **argv)
{
    options o;
    if (!read_options(&o, argc, argv)) {
        fputs(usage, stderr);
        return 2;
    }
    if (o.flags & HELP) {
        fputs(usage, stdout);
        return 0;
    }
    if (!(o.flags & (SHOW | HERE)))
        return compare_all(&o);
    return show_or_run_here(&o);
}
