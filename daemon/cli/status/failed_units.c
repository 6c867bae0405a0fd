/* SPDX-License-Identifier: MIT
 *
 * failed_units.c - asks systemctl for the units of canwire that have failed.
 */
#include "cli/status/failed_units.h"

#include "base/moment.h"
#include "cli/buses.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define SYSTEMD_FOLDER "/run/systemd/system"
#define UNITS_PATIENCE_S 5
#define PIECE_BYTES 4096
#define END_POLL_MS 5
#define UNIT_WHY_BYTES 128
#define TOLD_BYTES 512 /* a unit has a name of at most 255 bytes */

static const char *const systemctl_words[] = {
    "systemctl",
    "list-units",
    "--state=failed",
    "--plain",
    "--no-legend",
    "--no-pager",
    "canwired@*.service",
    "canwire-vcan@*.service",
    "canwire-usb@*.service",
    NULL,
};

/* Returns the rest of the time in ms, 0 at its end. */
static int rest_ms(int64_t until_ns)
{
    const int64_t rest_ns = until_ns - clock_ns(CLOCK_MONOTONIC);
    return rest_ns > 0 ? (int)(rest_ns / 1000000) + 1 : 0;
}

/* Starts systemctl with its output at a descriptor. Returns an errno. */
static int start_systemctl(pid_t *pid, int out)
{
    posix_spawn_file_actions_t actions;
    int error = posix_spawn_file_actions_init(&actions);
    if (error)
        return error;
    error = posix_spawn_file_actions_adddup2(&actions, out, STDOUT_FILENO);
    if (!error)
        error = posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    if (!error)
        error = posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    if (!error)
        error = posix_spawnp(pid, systemctl_words[0], &actions, NULL,
                             (char *const *)systemctl_words, environ);
    (void)posix_spawn_file_actions_destroy(&actions);
    return error;
}

/* Reads up to the end of the output, or of the time. */
static void read_units(buffer *text, int in, int64_t until_ns)
{
    struct pollfd wait = {.fd = in, .events = POLLIN};
    char piece[PIECE_BYTES];
    ssize_t got = 1;
    while (got > 0 && poll(&wait, 1, rest_ms(until_ns)) > 0) {
        got = read(in, piece, sizeof piece);
        if (got > 0)
            (void)buffer_append(text, piece, (size_t)got);
    }
}

/* Waits for the end of systemctl, and makes one at the end of the time. Returns why its output is
 * not the answer, or NULL. */
static const char *end_systemctl(char why[UNIT_WHY_BYTES], pid_t pid, int64_t until_ns)
{
    int status = 0;
    pid_t ended;
    while ((ended = waitpid(pid, &status, WNOHANG)) == 0 && rest_ms(until_ns) > 0)
        (void)poll(NULL, 0, END_POLL_MS);
    if (ended == 0) {
        (void)kill(pid, SIGKILL);
        (void)waitpid(pid, &status, 0);
        (void)snprintf(why, UNIT_WHY_BYTES, "no answer within %d s", UNITS_PATIENCE_S);
        return why;
    }
    if (ended == pid && WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return NULL;
    (void)snprintf(why, UNIT_WHY_BYTES, "%s %d",
                   WIFSIGNALED(status) ? "ended by signal" : "exit status",
                   WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status));
    return why;
}

/* Asks for the failed units, a line each. Returns why there is no answer, or NULL. */
static const char *ask_systemctl(buffer *text, char why[UNIT_WHY_BYTES])
{
    const int64_t until_ns = clock_ns(CLOCK_MONOTONIC) + UNITS_PATIENCE_S * INT64_C(1000000000);
    int ends[2];
    pid_t pid;
    (void)signal(SIGCHLD, SIG_DFL); /* some monitors leave it ignored: then there is no status */
    if (pipe2(ends, O_CLOEXEC) != 0)
        return strerror(errno);
    const int error = start_systemctl(&pid, ends[1]);
    (void)close(ends[1]);
    if (!error)
        read_units(text, ends[0], until_ns);
    (void)close(ends[0]);
    if (error)
        return strerror(error);
    return end_systemctl(why, pid, until_ns);
}

/* Returns true for a unit whose instance has the name, such as canwired@NAME.service. */
static bool is_unit_of(const char *unit, const char *name)
{
    const char *instance = strchr(unit, '@');
    const size_t length = strlen(name);
    return instance && strncmp(instance + 1, name, length) == 0 &&
           strcmp(instance + 1 + length, ".service") == 0;
}

/* Adds each line's unit, its first word. */
static void add_units(check *c, char *lines, const char *name)
{
    char *rest;
    for (char *line = strtok_r(lines, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest)) {
        char told[TOLD_BYTES];
        line[strcspn(line, " ")] = '\0';
        if (name && !is_unit_of(line, name))
            continue;
        (void)snprintf(told, sizeof told, "%s has failed", line);
        check_tell(c, CHECK_CRITICAL, told);
    }
}

void check_failed_units(check *c, const char *name)
{
    buffer text = {.size = 0};
    char reason[UNIT_WHY_BYTES], told[TOLD_BYTES];
    struct stat found; /* as sd_booted() does it */
    if (!buses_are_of_service() || lstat(SYSTEMD_FOLDER, &found) != 0 || !S_ISDIR(found.st_mode))
        return;
    const char *why = ask_systemctl(&text, reason);
    if (!why && buffer_text(&text))
        add_units(c, buffer_first(&text), name);
    else {
        (void)snprintf(told, sizeof told, "failed units are not known: systemctl: %s",
                       why ? why : "out of memory");
        check_tell(c, CHECK_UNKNOWN, told);
    }
    buffer_free(&text);
}
