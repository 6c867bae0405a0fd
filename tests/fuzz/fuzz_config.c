/* SPDX-License-Identifier: MIT
 *
 * fuzz_config.c - files that are configurations or profiles; and the bus that comes of them.
 *
 * The input is written to a file in a folder. The profiles of tests and users are beside it, under
 * the names that the seeds use.
 */
#include "fuzz.h"

#include "config/config.h"
#include "simulate.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

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

/* ---- The target ------------------------------------------------------------------------------ */

/* Checks that each message is a line that begins with the name of a file. */
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

/* Checks that cfg_check() and cfg_load() agree about a configuration. */
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
        fuzz_simulate(config);
    cfg_free(config);
    return 0;
}
