/* SPDX-License-Identifier: MIT
 *
 * resim.c - `canwire sim --journal`, in a process of its own.
 */
#include "world.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define EVENTS "resim.events"
#define ERRORS "resim.errors"

static _Noreturn void simulate(const char *journal)
{
    char program[] = "canwire", command[] = "sim", journal_option[] = "--journal";
    char events_option[] = "--events", events[] = EVENTS, file[300];
    char *arguments[] = {program, command, journal_option, file, events_option, events, NULL};
    (void)snprintf(file, sizeof file, "%s", journal);
    (void)close_range(3, ~0u, 0);
    int errors = open(ERRORS, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    (void)dup2(errors, 2);
    (void)dup2(errors, 1);
    exit(canwire_main(6, arguments));
}

static char *take_file(const char *name)
{
    struct stat s;
    int fd = open(name, O_RDONLY | O_CLOEXEC);
    size_t size = fd >= 0 && fstat(fd, &s) == 0 ? (size_t)s.st_size : 0;
    char *text = malloc(size + 1);
    ssize_t got = fd >= 0 ? read(fd, text, size) : 0;
    text[got > 0 ? got : 0] = '\0';
    if (fd >= 0)
        (void)close(fd);
    (void)unlink(name);
    return text;
}

void resim_run(resim *run, const char *journal)
{
    int status = 0;
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0)
        simulate(journal);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    *run = (resim){.events = take_file(EVENTS), .errors = take_file(ERRORS)};
    run->crashed = !WIFEXITED(status) || WEXITSTATUS(status) > 3;
    run->status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

void resim_free(resim *run)
{
    free(run->events);
    free(run->errors);
}
