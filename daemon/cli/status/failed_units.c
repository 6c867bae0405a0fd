/* SPDX-License-Identifier: MIT
 *
 * failed_units.c - asks systemctl for the units of canwire that have failed, and those that systemd
 *                  tries again.
 *
 * It asks first which units do not just run, and then for more of those: that takes far longer for
 * each of them.
 */
#include "cli/status/status_check.h"

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

#define UNITS_MAX 256

static const char *const list_words[] = {
    "systemctl",
    "list-units",
    "--state=failed,activating,inactive",
    "--plain",
    "--no-legend",
    "--no-pager",
    "canwired@*.service",
    "canwire-vcan@*.service",
    "canwire-usb@*.service",
    NULL,
};
static const char *const show_words[] = {
    "systemctl",
    "show",
    "--property=Id,ActiveState,SubState,NRestarts,Job",
    "--no-pager",
};
#define SHOW_WORDS (sizeof show_words / sizeof show_words[0])

/* Returns the rest of the time in ms, 0 at its end. */
static int rest_ms(int64_t until_ns)
{
    const int64_t rest_ns = until_ns - clock_ns(CLOCK_MONOTONIC);
    return rest_ns > 0 ? (int)(rest_ns / 1000000) + 1 : 0;
}

/* Starts systemctl with its output at a descriptor. Returns an errno. */
static int start_systemctl(pid_t *pid, const char *const *words, int out)
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
        error = posix_spawnp(pid, words[0], &actions, NULL, (char *const *)words, environ);
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

/* Runs systemctl. Returns why there is no answer, or NULL. */
static const char *ask_systemctl(buffer *text, char why[UNIT_WHY_BYTES], const char *const *words,
                                 int64_t until_ns)
{
    int ends[2];
    pid_t pid;
    if (pipe2(ends, O_CLOEXEC) != 0)
        return strerror(errno);
    const int error = start_systemctl(&pid, words, ends[1]);
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

/* The state of a unit as systemd tells it. */
typedef struct unit_state {
    const char *id, *active, *sub; /* NULL: not said */
    bool restarts;                 /* since somebody has started it */
    bool job;                      /* it is about to be started or stopped */
} unit_state;

/* Takes a line KEY=VALUE. */
static void take_property(unit_state *u, char *line)
{
    char *value = strchr(line, '=');
    if (!value)
        return;
    *value++ = '\0';
    if (strcmp(line, "Id") == 0)
        u->id = value;
    else if (strcmp(line, "ActiveState") == 0)
        u->active = value;
    else if (strcmp(line, "SubState") == 0)
        u->sub = value;
    else if (strcmp(line, "NRestarts") == 0)
        u->restarts = strcmp(value, "0") != 0;
    else if (strcmp(line, "Job") == 0)
        u->job = *value != '\0' && strcmp(value, "0") != 0;
}

/* Returns what is wrong with a unit, or NULL. One that systemd tries again goes through several
 * states: it waits for the next try, then for its interfaces, and then it starts. */
static const char *trouble_of(const unit_state *u)
{
    static const char pause[] = "auto-restart"; /* and more behind it since systemd 254 */
    if (!u->id || !u->active || !u->sub)
        return NULL;
    if (strcmp(u->active, "failed") == 0)
        return "has failed";
    const bool starts = strcmp(u->active, "activating") == 0 ||
                        (strcmp(u->active, "inactive") == 0 && u->job);
    return strncmp(u->sub, pause, strlen(pause)) == 0 || (starts && u->restarts)
               ? "has failed and is tried again"
               : NULL;
}

/* Adds what is wrong with a unit of the bus `name`, or of any with NULL. */
static void add_unit(check *c, const unit_state *u, const char *name)
{
    char told[TOLD_BYTES];
    const char *trouble = trouble_of(u);
    if (!trouble || (name && !is_unit_of(u->id, name)))
        return;
    (void)snprintf(told, sizeof told, "%s %s", u->id, trouble);
    check_tell(c, CHECK_CRITICAL, told);
}

/* Adds units from lines of properties, with an empty one between units. */
static void add_units(check *c, char *lines, const char *name)
{
    unit_state u = {.id = NULL};
    for (char *line; (line = strsep(&lines, "\n"));) {
        if (*line) {
            take_property(&u, line);
            continue;
        }
        add_unit(c, &u, name);
        u = (unit_state){.id = NULL};
    }
    add_unit(c, &u, name);
}

/* Takes the units from lines that begin with them. Returns their number. */
static size_t split_units(const char *units[UNITS_MAX], char *lines)
{
    size_t count = 0;
    char *rest;
    for (char *line = strtok_r(lines, "\n", &rest); line && count < UNITS_MAX;
         line = strtok_r(NULL, "\n", &rest)) {
        line[strcspn(line, " ")] = '\0';
        units[count++] = line;
    }
    return count;
}

/* Asks systemctl, and adds what is wrong. Returns why that is not known, or NULL. */
static const char *find_units(check *c, const char *name, buffer text[2], char why[UNIT_WHY_BYTES])
{
    const int64_t until_ns = clock_ns(CLOCK_MONOTONIC) + UNITS_PATIENCE_S * INT64_C(1000000000);
    const char *words[SHOW_WORDS + UNITS_MAX + 1];
    const char *error = ask_systemctl(&text[0], why, list_words, until_ns);
    if (error || !buffer_text(&text[0]))
        return error ? error : strerror(ENOMEM);
    const size_t count = split_units(words + SHOW_WORDS, buffer_first(&text[0]));
    if (count == 0)
        return NULL;
    memcpy(words, show_words, sizeof show_words);
    words[SHOW_WORDS + count] = NULL;
    error = ask_systemctl(&text[1], why, words, until_ns);
    if (error || !buffer_text(&text[1]))
        return error ? error : strerror(ENOMEM);
    add_units(c, buffer_first(&text[1]), name);
    return count < UNITS_MAX ? NULL : "too many units";
}

/* Says that a bus is not away because of a failure. */
static void tell_stopped(check *c, const char *name)
{
    char told[TOLD_BYTES];
    if (name)
        (void)snprintf(told, sizeof told, "canwired@%.255s.service has not failed: it is "
                       "stopped, or just starts", name);
    check_tell(c, CHECK_CRITICAL,
               name ? told : "no unit has failed: they are stopped, or just start");
}

void check_failed_units(check *c, const char *name, bool absent)
{
    const size_t before = buffer_length(&c->text);
    buffer text[2] = {{.size = 0}, {.size = 0}};
    char reason[UNIT_WHY_BYTES], told[TOLD_BYTES];
    struct stat found; /* as sd_booted() does it */
    if (!buses_are_of_service() || lstat(SYSTEMD_FOLDER, &found) != 0 || !S_ISDIR(found.st_mode))
        return;
    (void)signal(SIGCHLD, SIG_DFL); /* some monitors leave it ignored: then there is no status */
    const char *why = find_units(c, name, text, reason);
    if (why) {
        (void)snprintf(told, sizeof told, "failed units are not known: systemctl: %s", why);
        check_tell(c, CHECK_UNKNOWN, told);
    }
    if (absent && buffer_length(&c->text) == before)
        tell_stopped(c, name);
    buffer_free(&text[0]);
    buffer_free(&text[1]);
}
