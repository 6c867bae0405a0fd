/* SPDX-License-Identifier: MIT
 *
 * ecu_process.c - the programs of a row: starting them, taking their output, and ending them.
 */
#include "campaign/ecu/ecu_process.h"

#include "base/text/number.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define NOT_FOUND 127
#define READ_BYTES 4096u
#define LOG_MAX (64u << 20) /* bytes of a file of output */
#define STAT_BYTES 256      /* of /proc/PID/stat: the parent is among its first words */
#define ROUNDS_MAX 1000u    /* of killing: a program may start others while it is killed */

/* ---- Starting -------------------------------------------------------------------------------- */

static void set_variables(const char *const *env)
{
    for (; env && *env; env++)
        (void)putenv((char *)*env);
}

/* Prepares a process for its program. Returns false when the parent has gone meanwhile. */
static bool ecu_process_prepare(const ecu_start *how, pid_t parent)
{
    sigset_t none;
    const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
    (void)sigemptyset(&none);
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != parent)
        return false;
    (void)setpgid(0, 0);
    (void)sigprocmask(SIG_SETMASK, &none, NULL);
    set_variables(how->env);
    return nothing >= 0 && dup2(nothing, STDIN_FILENO) >= 0 &&
           dup2(how->output, STDOUT_FILENO) >= 0 && dup2(how->output, STDERR_FILENO) >= 0;
}

/* Becomes the program, or says in its output why it cannot. */
_Noreturn static void be_program(const ecu_start *how, pid_t parent)
{
    if (!ecu_process_prepare(how, parent))
        _exit(NOT_FOUND);
    const bool there = !how->cwd || chdir(how->cwd) == 0;
    if (there)
        (void)execvp(how->words[0], how->words);
    (void)dprintf(STDERR_FILENO, "%s: %s\n", there ? how->words[0] : how->cwd, strerror(errno));
    _exit(NOT_FOUND);
}

pid_t ecu_process_start(const ecu_start *how)
{
    const pid_t parent = getpid();
    const pid_t pid = fork();
    if (pid == 0)
        be_program(how, parent);
    if (pid > 0)
        (void)setpgid(pid, pid); /* the program does it, too: whoever comes first */
    return pid;
}

/* ---- Output ---------------------------------------------------------------------------------- */

/* Writes into the file, up to its limit. Output that cannot be written is lost. */
static void write_log(ecu_output *o, const char *bytes, size_t count)
{
    static const char note[] = "\n... the rest is left out\n";
    if (o->written >= LOG_MAX)
        return;
    (void)!write(o->log, bytes, count);
    o->written += count;
    if (o->written >= LOG_MAX)
        (void)!write(o->log, note, sizeof note - 1);
}

/* Adds bytes to the line; a line that is too long loses its first half. */
static bool look_for(ecu_output *o, const char *bytes, size_t count, const char *text)
{
    bool found = false;
    for (size_t i = 0; i < count; i++) {
        if (o->used == ECU_LINE_MAX) {
            memmove(o->line, o->line + ECU_LINE_MAX / 2, ECU_LINE_MAX / 2);
            o->used = ECU_LINE_MAX / 2;
        }
        o->line[o->used++] = bytes[i];
        if (bytes[i] == '\0')
            o->line[o->used - 1] = ' ';
        o->line[o->used] = '\0';
        if (bytes[i] != '\n')
            continue;
        found = found || strstr(o->line, text);
        o->used = 0;
    }
    return found || (o->used > 0 && strstr(o->line, text));
}

bool ecu_output_take(ecu_output *o, const char *text)
{
    char bytes[READ_BYTES];
    const ssize_t count = o->in >= 0 ? read(o->in, bytes, sizeof bytes) : -1;
    if (count > 0) {
        write_log(o, bytes, (size_t)count);
        return text && look_for(o, bytes, (size_t)count, text);
    }
    if (o->in >= 0 && (count == 0 || (errno != EAGAIN && errno != EINTR))) {
        (void)close(o->in);
        o->in = -1;
    }
    return false;
}

void ecu_output_close(ecu_output *o)
{
    if (o->in >= 0)
        (void)close(o->in);
    if (o->log >= 0)
        (void)close(o->log);
    o->in = -1;
    o->log = -1;
}

/* ---- Ending ---------------------------------------------------------------------------------- */

/* Returns the parent of a process, 0: it has gone. */
static pid_t parent_of(const char *number)
{
    char path[64], text[STAT_BYTES + 1];
    int parent = 0;
    (void)snprintf(path, sizeof path, "/proc/%.20s/stat", number);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return 0;
    const ssize_t length = read(fd, text, STAT_BYTES);
    (void)close(fd);
    text[length > 0 ? length : 0] = '\0';
    const char *end = strrchr(text, ')'); /* of the name, which may have blanks and brackets */
    return end && sscanf(end + 1, " %*c %d", &parent) == 1 ? parent : 0;
}

/* Kills the children that there are now. Returns their number. */
static unsigned kill_children(DIR *all, pid_t but)
{
    unsigned count = 0;
    rewinddir(all);
    for (const struct dirent *entry; (entry = readdir(all));) {
        uint64_t number;
        if (text_parse_uint(&number, entry->d_name))
            continue;
        const pid_t pid = (pid_t)number;
        if (pid == but || parent_of(entry->d_name) != getpid())
            continue;
        (void)kill(pid, SIGKILL);
        while (waitpid(pid, NULL, 0) < 0 && errno == EINTR)
            continue;
        count++;
    }
    return count;
}

void ecu_process_kill_all(pid_t but)
{
    DIR *all = opendir("/proc");
    for (unsigned i = 0; i < ROUNDS_MAX && all && kill_children(all, but) > 0; i++)
        continue;
    if (all)
        (void)closedir(all);
}
