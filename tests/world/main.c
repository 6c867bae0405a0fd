/* SPDX-License-Identifier: MIT
 *
 * main.c - runs seeds: world FIRST..LAST, or world SEED --trace for one of them call by call.
 */
#include "world.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/personality.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define QUIET_NS (700 * MS)
#define END_NS (20 * S)

typedef struct options {
    unsigned long long first;
    unsigned long long last;
    bool trace;
    bool twice;   /* each seed: the same digest */
    bool keep;    /* the folder */
    bool go_on;   /* after a seed that failed */
    bool digests; /* print them */
    bool story;   /* only print the subject of the seed */
} options;

static const char usage[] =
    "usage: world FIRST[..LAST] [--trace] [--twice] [--keep] [--go-on] [--digests] [--story]\n"
    "\n"
    "Runs canwired in simulated worlds, one from each seed.\n"
    "\n"
    "  --trace    every call, on standard output\n"
    "  --twice    each seed two times: its trace must be the same\n"
    "  --keep     the folder of the last world, with its files and logs\n"
    "  --go-on    after a seed that failed\n"
    "  --digests  of the trace of each seed\n"
    "  --story    only what a seed is about\n"
    "\n"
    "Exit status: 0, 1 a seed failed, 2 wrong usage.\n";

static char folder[] = "/tmp/canwire-world.XXXXXX";

/* ---- The folder of a world ------------------------------------------------------------------- */

static int remove_one(const char *path, const struct stat *s, int type, struct FTW *ftw)
{
    (void)s;
    (void)type;
    return ftw->level == 0 ? 0 : remove(path);
}

static void make_folders(void)
{
    static const char *const folders[] = {"run", "log", "c"};
    (void)nftw(".", remove_one, 16, FTW_DEPTH | FTW_PHYS);
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        (void)mkdir(folders[i], 0700);
}

/* ---- One seed -------------------------------------------------------------------------------- */

static void kill_all(void)
{
    for (int i = 0; i < (int)world->life_count; i++)
        if (world->lives[i].alive) {
            world->lives[i].alive = false;
            (void)kill(world->lives[i].pid, SIGKILL);
            (void)waitpid(world->lives[i].pid, NULL, 0);
        }
}

static bool anybody_lives(void)
{
    return life_now() >= 0;
}

/* Runs trouble, then quiet, then the end; then checks the rest. */
static void run_story(void)
{
    world_run(world->now_ns + the_story.length_ns);
    operator_quiet();
    ecus_quiet();
    world_run(world->now_ns + QUIET_NS / 2); /* data on its way arrives */
    clients_quiet();
    world_run(world->now_ns + QUIET_NS);
    ecus_drain();
    if (verdict_count() == 0)
        verdict_when_quiet();
    (void)manager_stop_all();
    for (int64_t end_ns = world->now_ns + END_NS; anybody_lives() && world->now_ns < end_ns;) {
        if (verdict_count() > 0)
            break;
        world_run(world->now_ns + 20 * MS);
    }
    ecus_drain();
    clients_drain();
    verdict_at_end();
}

static uint64_t run_seed(unsigned long long seed, const options *o)
{
    make_folders();
    world_make(seed);
    verdict_begin();
    if (o->trace)
        world_trace_fd = 1;
    story_draw();
    world_trace("seed %llu: %s", seed, story_name());
    operator_add();
    ecus_add();
    clients_add();
    manager_add();
    run_story();
    kill_all();
    return world->digest;
}

/* Returns true when the run had no violation. */
static bool try_seed(unsigned long long seed, const options *o, const char *program)
{
    uint64_t digest = run_seed(seed, o);
    unsigned wrong = verdict_count();
    if (wrong == 0 && o->twice && run_seed(seed, o) != digest) {
        printf("FAILED seed %llu: two runs differ\n", seed);
        wrong++;
    }
    if (o->digests || (o->trace && wrong == 0))
        printf("seed %llu: %016llx, %llu calls, %u lives: %s\n", seed, (unsigned long long)digest,
               (unsigned long long)world->calls, world->life_count, story_name());
    if (wrong)
        printf("  %s\n  again, call by call: %s %llu --trace --keep\n", story_name(), program,
               seed);
    (void)fflush(stdout);
    return wrong == 0;
}

/* ---- Start ----------------------------------------------------------------------------------- */

static bool parse(options *o, int argc, char **argv)
{
    char *end = NULL;
    *o = (options){.first = 0};
    if (argc < 2)
        return false;
    o->first = o->last = strtoull(argv[1], &end, 10);
    if (end != argv[1] && strncmp(end, "..", 2) == 0)
        o->last = strtoull(end + 2, &end, 10);
    bool good = end != argv[1] && *end == '\0' && o->last >= o->first;
    for (int i = 2; i < argc; i++) {
        o->trace |= strcmp(argv[i], "--trace") == 0;
        o->twice |= strcmp(argv[i], "--twice") == 0;
        o->keep |= strcmp(argv[i], "--keep") == 0;
        o->go_on |= strcmp(argv[i], "--go-on") == 0;
        o->digests |= strcmp(argv[i], "--digests") == 0;
        o->story |= strcmp(argv[i], "--story") == 0;
        good = good && argv[i][0] == '-';
    }
    return good;
}

/* Addresses are the same in each run, in case that anything depends on them. */
static void fix_addresses(char **argv)
{
    int now = personality(0xffffffff);
    if (now < 0 || (now & ADDR_NO_RANDOMIZE) ||
        personality((unsigned long)now | ADDR_NO_RANDOMIZE) < 0)
        return;
    (void)execv("/proc/self/exe", argv);
}

int main(int argc, char **argv)
{
    options o;
    unsigned long long failed = 0;
    if (!parse(&o, argc, argv)) {
        fputs(usage, stderr);
        return 2;
    }
    if (o.story) {
        world_make(o.first);
        story_draw();
        puts(story_name());
        return 0;
    }
    fix_addresses(argv);
    char *program = realpath(argv[0], NULL);
    if (!mkdtemp(folder) || chdir(folder) != 0) {
        perror(folder);
        return 1;
    }
    (void)signal(SIGPIPE, SIG_IGN);
    for (unsigned long long seed = o.first; seed <= o.last && (failed == 0 || o.go_on); seed++)
        failed += !try_seed(seed, &o, program ? program : argv[0]);
    if (o.keep) {
        printf("files and logs are in %s\n", folder);
    } else {
        (void)nftw(".", remove_one, 16, FTW_DEPTH | FTW_PHYS);
        (void)rmdir(folder);
    }
    free(program);
    printf("%llu passed, %llu failed\n", o.last - o.first + 1 - failed, failed);
    return failed ? 1 : 0;
}
