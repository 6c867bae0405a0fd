/* SPDX-License-Identifier: MIT
 *
 * replay.c - runs one fuzz target on files, so that what was found once is tested for ever.
 *
 * usage: replay_NAME FILE|FOLDER...
 *
 * Each file runs in a process of its own, which has some seconds. Prints the failing files and at
 * last "N passed, N failed".
 */
#include "fuzz.h"

#include <ftw.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#define SECONDS_MAX 60u /* with sanitizers on a busy machine */
#define FILE_BYTES_MAX (1u << 21)
#define OPEN_FOLDERS_MAX 8

static unsigned passed;
static unsigned failed;

/* Does not return. */
static void run(const char *path)
{
    uint8_t *data = malloc(FILE_BYTES_MAX);
    FILE *in = fopen(path, "rbe");
    if (!data || !in)
        _exit(1);
    size_t size = fread(data, 1, FILE_BYTES_MAX, in);
    (void)fclose(in);
    (void)alarm(SECONDS_MAX);
    (void)LLVMFuzzerTestOneInput(data, size);
    free(data);
    exit(0); /* not _exit(): leaks are looked for there */
}

static void replay(const char *path)
{
    int status = 0;
    pid_t child = fork();
    if (child == 0)
        run(path);
    if (child > 0 && waitpid(child, &status, 0) == child && status == 0) {
        passed++;
        return;
    }
    failed++;
    printf("FAILED: %s (status %#x)\n", path, (unsigned)status);
    (void)fflush(stdout);
}

static int visit(const char *path, const struct stat *info, int kind, struct FTW *place)
{
    (void)info;
    (void)place;
    if (kind == FTW_F)
        replay(path);
    return 0;
}

int main(int argc, char **argv)
{
    bool found = true;
    for (int i = 1; i < argc; i++)
        found = nftw(argv[i], visit, OPEN_FOLDERS_MAX, FTW_PHYS) == 0 && found;
    if (!found)
        printf("not all of the folders are there\n");
    printf("%u passed, %u failed\n", passed, failed);
    return found && passed > 0 && failed == 0 ? 0 : 1;
}
