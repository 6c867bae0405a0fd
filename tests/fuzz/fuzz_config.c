/* SPDX-License-Identifier: MIT
 *
 * fuzz_config.c - files that are configurations or profiles; and the bus that comes of them.
 *
 * The input is written to a file in a folder beside which the profiles of tests and users are found
 * under the names that the seeds use.
 */
#include "fuzz.h"

#include "config.h"
#include "output.h"
#include "release.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define BITS 20000u
#define RELEASES_MAX 20000u
#define MEMORY_MAX (64u << 20) /* of a bus; what is larger is not simulated */
#define WORK 160000u           /* nodes times bits */

/* ---- The folder ------------------------------------------------------------------------------ */

static char top[] = "/tmp/fuzz_config.XXXXXX";
static const char *const links[][2] = {
    {"profiles", TESTS_DIR "/config/profiles"},
    {"files/profiles", TESTS_DIR "/../config/profiles"},
    {"files/traces", TESTS_DIR "/traces"},
};
static pid_t owner;

static int open_at(const char *name, int flags)
{
    int folder = open(top, O_DIRECTORY | O_CLOEXEC);
    int fd = openat(folder, name, flags | O_CLOEXEC, 0600);
    (void)close(folder);
    return fd;
}

static void path_of(char path[64], const char *name)
{
    (void)snprintf(path, 64, "%s/%s", top, name);
}

static void remove_folder(void)
{
    static const char *const names[] = {"files/input.yaml", "files/profiles", "files/traces",
                                        "profiles",
                                        "files", ""};
    char path[64];
    for (size_t i = 0; owner == getpid() && i < sizeof names / sizeof names[0]; i++) {
        path_of(path, names[i]);
        (void)remove(path);
    }
}

/* Returns the file for inputs. */
static int make_folder(void)
{
    char path[64];
    REQUIRE(mkdtemp(top) != NULL);
    owner = getpid();
    (void)atexit(remove_folder);
    path_of(path, "files");
    REQUIRE(mkdir(path, 0700) == 0);
    for (size_t i = 0; i < sizeof links / sizeof links[0]; i++) {
        path_of(path, links[i][0]);
        REQUIRE(symlink(links[i][1], path) == 0);
    }
    int fd = open_at("files/input.yaml", O_RDWR | O_CREAT);
    REQUIRE(fd >= 0);
    return fd;
}

/* ---- The bus --------------------------------------------------------------------------------- */

static void tell(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    REQUIRE(text[0] != '\0' && strchr(text, '\n') == NULL);
}

/* Hands in what is due before the end, as `canwire sim` does; returns where it has come to. */
static void run_releases(fuzz_bus *b, const cfg *config, uint64_t end)
{
    release_plan *plan = release_plan_new(config, tell, NULL);
    REQUIRE(plan != NULL);
    release_look(plan, b->bus);
    for (unsigned i = 0; i < RELEASES_MAX && release_next_tick(plan) <= end; i++) {
        if (release_hand_in(plan, b->bus) == CW_FULL)
            fuzz_bus_advance(b, cw_bus_inbox_first(b->bus) + b->bit_ticks);
        release_look(plan, b->bus);
    }
    release_plan_free(plan);
}

static void print_results(const fuzz_bus *b, const cfg *config)
{
    FILE *out = fopen("/dev/null", "we");
    REQUIRE(out != NULL);
    output_stats(out, config, b->bus);
    (void)fclose(out);
}

static void simulate(const cfg *config)
{
    fuzz_bus b;
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, config);
    size_t size = cw_bus_size(&bus_config);
    REQUIRE(size > 0);
    if (size > MEMORY_MAX)
        return;
    REQUIRE(fuzz_bus_open(&b, &bus_config));
    release_add_replies(b.bus, config);
    unsigned bits = (unsigned)(WORK / config->node_count);
    uint64_t end = (uint64_t)(bits < BITS ? bits : BITS) * config->bit_ticks;
    run_releases(&b, config, end);
    fuzz_bus_advance(&b, end);
    fuzz_bus_check(&b);
    print_results(&b, config);
    fuzz_bus_close(&b);
}

/* ---- The target ------------------------------------------------------------------------------ */

/* Each message is a line that begins with the name of a file. */
static void check_messages(const char *messages, size_t length, bool good)
{
    REQUIRE((length == 0) == good);
    REQUIRE(good || messages[length - 1] == '\n');
    REQUIRE(good || strncmp(messages, top, strlen(top)) == 0);
}

static cfg *load(const char *path)
{
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    cfg *config = cfg_load(path, errors);
    (void)fclose(errors);
    check_messages(messages, length, config != NULL);
    free(messages);
    return config;
}

/* cfg_check() must say of a configuration what cfg_load() says. */
static void check(const char *path, const cfg *loaded)
{
    char *messages = NULL;
    size_t length = 0;
    size_t rules = 0;
    cfg *config = NULL;
    FILE *errors = open_memstream(&messages, &length);
    bool good = cfg_check(&config, &rules, path, errors);
    (void)fclose(errors);
    check_messages(messages, length, good);
    REQUIRE((loaded != NULL) == (good && config != NULL));
    REQUIRE(!loaded || rules == loaded->rule_count);
    cfg_free(config);
    free(messages);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static int fd = -1;
    char path[64];
    if (owner != getpid()) {
        (void)strcpy(top, "/tmp/fuzz_config.XXXXXX");
        fd = make_folder();
    }
    REQUIRE(ftruncate(fd, 0) == 0 && pwrite(fd, data, size, 0) == (ssize_t)size);
    path_of(path, "files/input.yaml");
    cfg *config = load(path);
    check(path, config);
    if (config)
        simulate(config);
    cfg_free(config);
    return 0;
}
