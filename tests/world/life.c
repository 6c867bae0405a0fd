/* SPDX-License-Identifier: MIT
 *
 * life.c - the lives of canwired: started, signalled, killed; and what they leave behind.
 */
#include "world.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define TRACE_FD 4000            /* far above those of a life */
#define WATCHDOG_USEC "10000000" /* as in canwired@.service */
#define LOG_BYTES (1 << 20)

static void log_name(char out[32], int life)
{
    (void)snprintf(out, 32, "life.%d.log", life);
}

/* ---- Start ----------------------------------------------------------------------------------- */

/* Gives the process only the settings of a service manager, and nothing of the world. */
static void prepare_process(int life)
{
    char name[32];
    char notify[64];
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL); /* none is left when the world is killed */
    log_name(name, life);
    if (world_trace_fd >= 0)
        world_trace_fd = dup2(world_trace_fd, TRACE_FD);
    (void)!freopen("/dev/null", "w", stdout);
    int log = open(name, O_WRONLY | O_CREAT | O_APPEND, 0600);
    (void)dup2(log, 2);
    (void)close_range(3, TRACE_FD - 1, 0);
    (void)snprintf(notify, sizeof notify, WORLD_ROOT "run/notify.%d", life);
    (void)setenv("NOTIFY_SOCKET", notify, 1);
    (void)setenv("WATCHDOG_USEC", WATCHDOG_USEC, 1);
    (void)setenv("LIBEV_FLAGS", "4", 1); /* EVBACKEND_EPOLL */
    (void)unsetenv("JOURNAL_STREAM");
}

static _Noreturn void live(int life, int task, const char *journal)
{
    char program[] = "canwired", option[] = "-c", config[] = WORLD_ROOT "bus.yaml";
    char journal_option[] = "--journal", file[64];
    char *arguments[] = {program, option, config, journal ? journal_option : NULL, file, NULL};
    (void)snprintf(file, sizeof file, "%s", journal ? journal : "");
    prepare_process(life);
    world_begin_task(task);
    world_inside = true;
    world_exit(canwired_main(journal ? 5 : 3, arguments));
}

int life_start(const char *journal)
{
    int n = (int)world->life_count++;
    if (n >= (int)LIVES_MAX)
        abort();
    world_life *l = &world->lives[n];
    *l = (world_life){.alive = true,
                      .started_ns = world->now_ns,
                      .ready_ns = NEVER,
                      .stop_ns = NEVER,
                      .ended_ns = NEVER,
                      .die_at_call = -1,
                      .may_fail = world->config_is_bad};
    world_trace("starts life %d", n);
    int task = world_add_task(n, true);
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0)
        live(n, task, journal);
    if (child < 0)
        abort();
    l->pid = child; /* not before: it is in shared memory */
    return n;
}

int life_now(void)
{
    for (int i = (int)world->life_count - 1; i >= 0; i--)
        if (world->lives[i].alive)
            return i;
    return -1;
}

/* ---- End ------------------------------------------------------------------------------------- */

void life_signal(int life, int signal)
{
    world_life *l = &world->lives[life];
    if (!l->alive)
        return;
    world_trace("sends signal %d to life %d", signal, life);
    if (signal == SIGTERM && l->stop_ns == NEVER)
        l->stop_ns = world->now_ns;
    l->signals |= 1u << signal;
}

void life_kill(int life)
{
    world_life *l = &world->lives[life];
    if (!l->alive)
        return;
    world_trace("kills life %d", life);
    l->killed = true;
    (void)kill(l->pid, SIGKILL);
    life_reap(life);
}

void life_reap(int life)
{
    world_life *l = &world->lives[life];
    if (!l->alive)
        return;
    if (l->pid != 0)
        while (waitpid(l->pid, &l->status, 0) < 0 && errno == EINTR)
            continue;
    l->pid = 0;
    l->alive = false;
    l->ended_ns = world->now_ns;
    for (unsigned i = 0; i < TASKS_MAX; i++)
        if (world->tasks[i].state != TASK_NONE && world->tasks[i].life == life)
            world->tasks[i].state = TASK_NONE;
    life_read_log(life);
    world_trace("life %d has ended, status %#x", life, (unsigned)l->status);
    verdict_life_ended(life);
}

/* ---- What it leaves behind ------------------------------------------------------------------- */

static char *read_whole(const char *name, size_t *size)
{
    static char text[LOG_BYTES];
    int fd = open(name, O_RDONLY | O_CLOEXEC);
    ssize_t count = fd >= 0 ? read(fd, text, sizeof text - 1) : 0;
    if (fd >= 0)
        (void)close(fd);
    *size = count > 0 ? (size_t)count : 0;
    text[*size] = '\0';
    return text;
}

void life_read_log(int life)
{
    char name[32];
    size_t size;
    world_life *l = &world->lives[life];
    log_name(name, life);
    char *text = read_whole(name, &size);
    while (l->log_read < size) {
        char *line = text + l->log_read;
        size_t length = strcspn(line, "\n");
        if (line[length] == '\0' && l->alive)
            break;
        line[length] = '\0';
        world_trace("log of life %d: %s", life, line);
        l->log_read += length + 1;
    }
}

bool life_log_has(int life, const char *text)
{
    char name[32];
    size_t size;
    log_name(name, life);
    return strstr(read_whole(name, &size), text) != NULL;
}

uint64_t file_identity_at(int folder, const char *name, int flags)
{
    struct statx s;
    if (statx(folder, name, flags, STATX_INO | STATX_BTIME, &s) != 0)
        return 0;
    return s.stx_ino ^ (uint64_t)s.stx_btime.tv_sec << 40 ^ (uint64_t)s.stx_btime.tv_nsec << 20;
}

uint64_t file_identity(const char *name)
{
    return file_identity_at(AT_FDCWD, name, AT_SYMLINK_NOFOLLOW);
}

unsigned file_number(uint64_t identity)
{
    unsigned i = 0;
    while (i < world->file_count && world->files[i].identity != identity)
        i++;
    if (i == FILES_MAX) {
        fprintf(stderr, "world: too many files\n");
        abort();
    }
    if (i == world->file_count)
        world->files[world->file_count++] = (world_file){.identity = identity};
    return i;
}

/* Cuts a file: data that was not synced may be on the disk or not. */
static void cut_file(const char *name)
{
    struct stat s;
    if (stat(name, &s) != 0 || !S_ISREG(s.st_mode) || world_chance(300))
        return;
    int64_t keep = world->files[file_number(file_identity(name))].synced;
    int64_t lost = (int64_t)world_draw((uint64_t)(s.st_size - keep) + 1);
    world_trace("loses %lld of %lld bytes of %s", (long long)lost, (long long)s.st_size, name);
    (void)!truncate(name, s.st_size - lost);
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
    return strcmp((*a)->d_name, (*b)->d_name);
}

void life_power_loss(void)
{
    struct dirent **entries;
    for (int i = 0; i < (int)world->life_count; i++)
        life_kill(i);
    world_trace("power is lost");
    int count = scandir("log", &entries, NULL, by_name);
    for (int i = 0; i < count; i++) {
        char name[300];
        (void)snprintf(name, sizeof name, "log/%s", entries[i]->d_name);
        cut_file(name);
        free(entries[i]);
    }
    free(entries);
}
