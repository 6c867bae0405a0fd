/* SPDX-License-Identifier: MIT
 *
 * main.c - every configuration, scenario and profile that is shipped, with something missing.
 *
 * usage: mutants [--every N]
 *
 * It runs at the top of the source tree. Whatever is missing, a configuration is refused with a
 * place, or it is valid and can be run. A running bus can then change to it and back. With --every
 * N only each N-th mutant is tried. A message about a process that dies names its files and the
 * missing part. The last line is "N passed, N failed".
 */
#include "mutants.h"

#include "config/config.h"
#include "config/rig.h"

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define PATH_BYTES 300
#define SERVICE_FOLDER "/var/lib/canwire/"
#define FILES_MAX 400
#define FILE_BYTES_MAX 65536u
#define HOST_BYTES 1000
#define LOG_BYTES 4000
#define OPEN_FOLDERS_MAX 8
#define SECONDS_MAX 300u /* for a file; with sanitizers on a busy machine */
#define MIN_GOOD 1000    /* mutants that are to be good, so that it is known that they are run */

/* The results of a process that tries a file, however it ends. */
typedef struct progress {
    char what[WHAT_BYTES];
    unsigned tried;
    unsigned good;
} progress;

static const char *const folders[] = {"config", "tests/config", "tests/scenarios", "tests/traces"};
static char top[] = "/tmp/canwire_mutants.XXXXXX";
static char *files[FILES_MAX];
static size_t file_count;
static progress *shared;
static unsigned every = 1;

void fail(const char *why, const char *detail)
{
    fprintf(stderr, "%s: %s\n", why, detail);
    (void)fflush(stderr);
    _exit(1);
}

/* ---- A copy of the folders, in which files can be written ------------------------------------ */

/* Returns true for all profiles but two: one is bad, and one cannot be loaded, since its parameters
 * have no meaning. Campaigns and their recipes are no configurations. tests/tool/ tries those with
 * something missing. */
static bool is_wanted(const char *path)
{
    size_t length = strlen(path);
    return length > 5 && strcmp(path + length - 5, ".yaml") == 0 && !strstr(path, "/.") &&
           !strstr(path, "/bad/") &&
           !strstr(path, "/campaign/") && !strstr(path, "/campaign.yaml") &&
           !strstr(path, "profiles/wrong.yaml") && !strstr(path, "good/profile.yaml");
}

static int copy_entry(const char *path, const struct stat *info, int kind, struct FTW *place)
{
    char own[PATH_BYTES];
    char *whole = realpath(path, NULL);
    (void)info;
    (void)place;
    (void)snprintf(own, sizeof own, "%s/%s", top, path);
    bool good = whole && (kind == FTW_D ? mkdir(own, 0700) : symlink(whole, own)) == 0;
    free(whole);
    if (!good || file_count == FILES_MAX)
        return -1;
    if (kind != FTW_D && is_wanted(path))
        files[file_count++] = strdup(path);
    return 0;
}

static int remove_entry(const char *path, const struct stat *info, int kind, struct FTW *place)
{
    (void)info;
    (void)kind;
    (void)place;
    return remove(path);
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static void copy_folders(void)
{
    char tests[PATH_BYTES];
    if (!mkdtemp(top))
        fail("cannot make a folder", top);
    (void)snprintf(tests, sizeof tests, "%s/tests", top);
    if (mkdir(tests, 0700) != 0)
        fail("cannot make a folder", tests);
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        if (nftw(folders[i], copy_entry, OPEN_FOLDERS_MAX, FTW_PHYS) != 0)
            fail("cannot copy", folders[i]);
    qsort(files, file_count, sizeof files[0], by_name);
}

/* ---- One file -------------------------------------------------------------------------------- */

/* Recordings of the service go into the folder of the copy: the machine need not have that one. */
static void leave_out_folder(char *text)
{
    const size_t length = strlen(SERVICE_FOLDER);
    for (char *found; (found = strstr(text, SERVICE_FOLDER));)
        memmove(found, found + length, strlen(found + length) + 1);
}

static char *read_text(size_t *size, const char *path)
{
    char *text = calloc(1, FILE_BYTES_MAX + 1);
    FILE *in = fopen(path, "rbe");
    if (!text || !in)
        fail("cannot read", path);
    *size = fread(text, 1, FILE_BYTES_MAX, in);
    (void)fclose(in);
    leave_out_folder(text);
    *size = strlen(text); /* none has a zero byte */
    return text;
}

static void take(void *user, const char *text, size_t size, const char *what)
{
    const trial *t = user;
    if (shared->tried++ % every != 0)
        return;
    (void)snprintf(shared->what, sizeof shared->what, "%s", what);
    shared->good += try_files(t, text, size);
}

static void try_trial(trial *t)
{
    (void)snprintf(shared->what, sizeof shared->what, "with nothing missing");
    if (!try_files(t, t->whole, t->whole_size))
        fail("the whole file is not good", t->config);
    mutants_of(t->whole, t->whole_size, take, t);
}

/* Returns a value for a parameter without default: that of the table, or a node. */
static const char *value_of(const char *parameter)
{
    static const char *const values[][2] = {
        {"frame", "\"32A\""}, {"rival", "32A#"}, {"every", "1ms"},
        {"delay", "900us"}, {"from", "\"data[0.0]\""}, {"bits", "0x0"},
    };
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        if (strcmp(parameter, values[i][0]) == 0)
            return values[i][1];
    return "engine";
}

/* Prints a configuration for a profile, with values for all parameters that have no default. */
static void print_host(char host[HOST_BYTES], const char *profile)
{
    int used = snprintf(host, HOST_BYTES,
                        "bus: { name: host, bitrate: 500000, dbitrate: 2000000 }\n"
                        "nodes:\n"
                        "  - name: engine\n"
                        "    traffic: [ { send: 32A#35403783970DB6A1, every: 1ms } ]\n"
                        "  - { name: gearbox, restart-ms: 2, port: vcan0 }\n"
                        "  - { name: dash, traffic: [ { send: 123#11, every: 3ms } ] }\n"
                        "profiles:\n"
                        "  - file: mutant.yaml\n"
                        "    with: {");
    const char *comma = "";
    const char *line = strstr(profile, "\nparameters:");
    line = line ? strchr(line + 1, '\n') : NULL;
    for (; line && line[1] == ' '; line = strchr(line, '\n')) {
        char name[40];
        int length = 0;
        if (sscanf(++line, "  %39[a-z]:%n", name, &length) != 1 || length == 0)
            continue;
        line += length + (int)strspn(line + length, " ");
        if (*line != '#' && *line != '\n')
            continue;
        used += snprintf(host + used, (size_t)(HOST_BYTES - used), "%s %s: %s", comma, name,
                         value_of(name));
        comma = ",";
    }
    (void)snprintf(host + used, (size_t)(HOST_BYTES - used), " }\n");
}

static bool is_profile(const char *path)
{
    cfg *config = NULL;
    size_t rules;
    bool good = cfg_check(&config, &rules, path, stderr);
    bool profile = good && !config;
    cfg_free(config);
    return profile;
}

static void try_profile(trial *t, const char *host_path)
{
    char host[HOST_BYTES];
    FILE *out = fopen(host_path, "we");
    print_host(host, t->whole);
    if (!out || fputs(host, out) == EOF || fclose(out) != 0)
        fail("cannot write", host_path);
    t->config = host_path;
    try_trial(t);
    FILE *profile = fopen(t->mutated, "we");
    if (!profile || fwrite(t->whole, 1, t->whole_size, profile) != t->whole_size ||
        fclose(profile) != 0)
        fail("cannot write", t->mutated);
    t->mutated = host_path;
    t->whole = host;
    t->whole_size = strlen(host);
    try_trial(t);
}

static void try_file(const char *path)
{
    char own[PATH_BYTES];
    char host[PATH_BYTES];
    char mutant[PATH_BYTES];
    size_t size;
    (void)snprintf(own, sizeof own, "%s/%s", top, path);
    int folder = (int)(strrchr(own, '/') - own);
    (void)snprintf(host, sizeof host, "%.*s/host.yaml", folder, own);
    (void)snprintf(mutant, sizeof mutant, "%.*s/mutant.yaml", folder, own);
    char *text = read_text(&size, own);
    trial t = {.config = mutant, .mutated = mutant, .whole = text, .whole_size = size,
               .folder = top, .is_rig = rig_is_rig(own)};
    if (!t.is_rig && is_profile(own))
        try_profile(&t, host);
    else
        try_trial(&t);
    free(text);
}

/* Prints the last message. */
static void print_log(const char *path)
{
    char text[LOG_BYTES + 1] = "";
    FILE *in = fopen(path, "rbe");
    if (!in)
        return;
    if (fseek(in, -(long)LOG_BYTES, SEEK_END) != 0)
        rewind(in);
    text[fread(text, 1, LOG_BYTES, in)] = '\0';
    (void)fclose(in);
    puts(text);
}

static bool try_in_process(const char *path)
{
    char log_path[PATH_BYTES];
    int status = 0;
    (void)snprintf(log_path, sizeof log_path, "%s/stderr", top);
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        (void)alarm(SECONDS_MAX);
        if (!freopen(log_path, "w", stderr))
            _exit(1);
        try_file(path);
        exit(0); /* not _exit(): leaks are looked for there */
    }
    if (child > 0 && waitpid(child, &status, 0) == child && status == 0)
        return true;
    printf("FAILED: %s %s (status %#x)\n", path, shared->what, (unsigned)status);
    print_log(log_path);
    return false;
}

/* ---- All ------------------------------------------------------------------------------------- */

int main(int argc, char **argv)
{
    unsigned failed = 0;
    if (argc == 3 && strcmp(argv[1], "--every") == 0)
        every = (unsigned)strtoul(argv[2], NULL, 10);
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED || every == 0)
        fail("usage", "mutants [--every N]");
    copy_folders();
    for (size_t i = 0; i < file_count; i++)
        failed += !try_in_process(files[i]);
    (void)nftw(top, remove_entry, OPEN_FOLDERS_MAX, FTW_DEPTH | FTW_PHYS);
    printf("%zu files, %u mutants, each %uth tried, %u of these good\n", file_count,
           shared->tried, every, shared->good);
    if (shared->good * every < MIN_GOOD) {
        printf("FAILED: hardly any is good\n");
        failed++;
    }
    printf("%zu passed, %u failed\n", file_count - failed, failed);
    for (size_t i = 0; i < file_count; i++)
        free(files[i]);
    return failed > 0;
}
