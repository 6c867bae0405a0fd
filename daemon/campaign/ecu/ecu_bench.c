/* SPDX-License-Identifier: MIT
 *
 * ecu_bench.c - the bench of a row: a canwired, the programs at its nodes, and what they tell.
 */
#include "campaign/ecu/ecu_bench.h"

#include "base/text/jsonput.h"
#include "base/wall.h"
#include "trace/frametext.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#define NS_PER_MS 1000000
#define ANSWER_MS 5000    /* for canwired to tell the time at the end of a run ... */
#define BUS_END_MS 10000  /* ... and to end */
#define KILLED_MS 10000   /* for a program that was killed to end */
#define WAIT_MAX_MS 60000
#define NOTIFY_BYTES 1200
#define NOTIFY_NAME "notify" /* in the folder of sockets */
#define LOG_END_BYTES 4096

const int ecu_bench_signals[4] = {SIGCHLD, SIGTERM, SIGINT, SIGHUP};

static bool is_virtual(const ecu_bench *b)
{
    return b->task->campaign->ecus.virtual_time || b->task->campaign->ecus.own_bus;
}

int64_t ecu_bench_now(void)
{
    return wall_ns() / NS_PER_MS;
}

void ecu_bench_conclude(ecu_bench *b, ecu_verdict verdict, const char *format, ...)
{
    va_list args;
    if (b->over || (verdict == ECU_CRASHED && b->result->verdict == ECU_CRASHED))
        return;
    b->over = verdict != ECU_CRASHED || !is_virtual(b);
    b->result->verdict = verdict;
    va_start(args, format);
    (void)vsnprintf(b->result->why, sizeof b->result->why, format, args);
    va_end(args);
}

static bool ecu_bench_fail(ecu_bench *b, const char *what)
{
    const int error = errno;
    ecu_bench_conclude(b, ECU_BROKEN, "%s: %s", what, strerror(error));
    return false;
}

static const ecu *config_of(const ecu_bench *b, size_t i)
{
    return &b->task->campaign->ecus.list[i];
}

static size_t count_of(const ecu_bench *b)
{
    return b->task->campaign->ecus.count;
}

/* ---- What programs tell ---------------------------------------------------------------------- */

/* Asks for the status. The id tells its answer from earlier ones that are still to come. */
static bool ask_status(ecu_bench *b)
{
    char request[64];
    (void)snprintf(request, sizeof request, "{\"id\":%u,\"request\":\"status\"}\n", ++b->asked);
    return ecu_control_ask(&b->control, request);
}

/* A program is ready. Without a time, the bus is asked for it. */
static void set_ready(ecu_bench *b, size_t i, uint64_t ready_ns)
{
    ecu_end *end = &b->result->ends[i];
    if (end->ready)
        return;
    end->ready = true;
    end->ready_ns = ready_ns;
    if (ready_ns == ECU_NO_TIME && !is_virtual(b))
        (void)ask_status(b);
}

/* Returns true when a program has ended, and nobody can say any more that it is ready. Its frames
 * may still be on their way, and its children may still write the line. */
static bool is_lost(const ecu_bench *b, size_t i)
{
    const ecu_end *end = &b->result->ends[i];
    const bool mute = config_of(b, i)->sign == ECU_SIGN_LINE && b->programs[i].output.in < 0;
    return end->ended && !end->ready && (end->status != 0 || mute);
}

static void find_lost(ecu_bench *b, size_t i)
{
    if (is_lost(b, i) && b->result->ends[i].status == 0)
        ecu_bench_conclude(b, ECU_CRASHED, "%s: it has ended before it was ready",
                           config_of(b, i)->name);
}

/* Takes output of a program, which may be the sign that it is ready. */
static void take_output(ecu_bench *b, size_t i)
{
    const ecu *e = config_of(b, i);
    if (ecu_output_take(&b->programs[i].output, e->sign == ECU_SIGN_LINE ? e->line : NULL))
        set_ready(b, i, ECU_NO_TIME);
    find_lost(b, i);
}

/* ---- What canwired tells --------------------------------------------------------------------- */

/* Takes a message that canwired sends to its service manager. The bench acts as that. */
static void take_notify(ecu_bench *b)
{
    char text[NOTIFY_BYTES + 1];
    const ssize_t count = recv(b->notify, text, NOTIFY_BYTES, MSG_DONTWAIT);
    text[count > 0 ? count : 0] = '\0';
    if (strstr(text, "READY=1"))
        b->bus_ready = true;
}

/* Takes a frame of the bus: it is the sign of those programs that wait for it at their node. */
static void ecu_bench_take_frame(ecu_bench *b, const json_t *event)
{
    cw_frame frame;
    const char *node = get_text(event, "node");
    const char *text = get_text(event, "frame");
    const double t = json_number_value(json_object_get(event, "t"));
    if (!node || !text || text_parse_frame(&frame, text))
        return;
    for (size_t i = 0; i < count_of(b); i++) {
        const ecu *e = config_of(b, i);
        if (e->sign == ECU_SIGN_FRAME && strcmp(e->node, node) == 0 &&
            cw_frame_matches(&frame, &e->filter, 1))
            set_ready(b, i, (uint64_t)llround(t * 1e9));
    }
}

/* Takes the answer to a question for bus time. Programs that have become ready since then did so at
 * that time. */
static void take_status(ecu_bench *b, const json_t *reply)
{
    const json_t *status = json_object_get(reply, "status");
    const json_t *bus = json_object_get(status, "bus");
    const json_t *programs = json_object_get(status, "virtual");
    const json_t *now = programs ? json_object_get(programs, "now_ns")
                                 : json_object_get(bus, "time_ns");
    b->time_ns = (uint64_t)json_integer_value(now);
    b->told = get_number(reply, "id") == (json_int_t)b->asked;
    b->rests = json_is_true(json_object_get(programs, "rests"));
    for (size_t i = 0; i < count_of(b) && !is_virtual(b); i++) {
        ecu_end *end = &b->result->ends[i];
        if (end->ready && end->ready_ns == ECU_NO_TIME)
            end->ready_ns = b->time_ns;
    }
}

/* Takes answers and events, in the order in which canwired has written them. */
static void take_control(ecu_bench *b)
{
    json_t *line;
    ecu_control_read(&b->control);
    while ((line = ecu_control_next(&b->control))) {
        if (json_object_get(line, "status"))
            take_status(b, line);
        else if (json_object_get(line, "events"))
            b->watching = true;
        else if (json_object_get(line, "event"))
            ecu_bench_take_frame(b, line);
        json_decref(line);
    }
}

/* ---- Processes that end ---------------------------------------------------------------------- */

/* Returns true for signals that programs do not end others with. */
static bool is_fault(int status)
{
    const int number = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    return number == SIGSEGV || number == SIGABRT || number == SIGBUS || number == SIGFPE ||
           number == SIGILL || number == SIGSYS || number == SIGTRAP;
}

/* Names the signal or the status alone: the row must be the same each time. */
static void tell_crash(ecu_bench *b, const ecu *e, int status)
{
    if (WIFSIGNALED(status))
        ecu_bench_conclude(b, ECU_CRASHED, "%s: signal %s", e->name,
                           sigabbrev_np(WTERMSIG(status)));
    else
        ecu_bench_conclude(b, ECU_CRASHED, "%s: exit status %d", e->name, WEXITSTATUS(status));
}

/* Notes the end of a process. One that fails, or ends before it was ready, has crashed the row;
 * after the run an end is expected. */
static void note_end(ecu_bench *b, pid_t pid, int status)
{
    if (pid == b->bus)
        b->bus = 0;
    for (size_t i = 0; i < count_of(b); i++) {
        ecu_end *end = &b->result->ends[i];
        if (b->programs[i].pid != pid)
            continue;
        b->programs[i].pid = 0;
        end->status = status;
        end->ended = !b->over;
        if ((status == 0 && end->ready) || b->over)
            continue;
        take_output(b, i); /* it may have said that it is ready, and ended */
        if (status != 0)
            tell_crash(b, config_of(b, i), status);
    }
}

/* Takes ended children. Any other signal aborts the bench. */
static void take_signals(ecu_bench *b)
{
    struct signalfd_siginfo signal;
    while (read(b->signals, &signal, sizeof signal) == (ssize_t)sizeof signal)
        b->aborted = b->aborted || signal.ssi_signo != (uint32_t)SIGCHLD;
    int status = 0;
    for (pid_t pid; (pid = waitpid(-1, &status, WNOHANG)) > 0;)
        note_end(b, pid, status);
}

/* ---- Waiting --------------------------------------------------------------------------------- */

static void ecu_bench_watch(struct pollfd *polled, int fd)
{
    *polled = (struct pollfd){.fd = fd, .events = POLLIN};
}

void ecu_bench_step(ecu_bench *b, int64_t until_ms)
{
    struct pollfd polled[3 + ECUS_MAX];
    const size_t count = count_of(b);
    int64_t wait = (until_ms < b->limit_ms || b->over ? until_ms : b->limit_ms) - ecu_bench_now();
    wait = wait < 0 ? 0 : wait > WAIT_MAX_MS ? WAIT_MAX_MS : wait;
    ecu_bench_watch(&polled[0], b->signals);
    ecu_bench_watch(&polled[1], b->notify);
    ecu_bench_watch(&polled[2], b->control.fd);
    for (size_t i = 0; i < count; i++)
        ecu_bench_watch(&polled[3 + i], b->programs[i].output.in);
    if (poll(polled, (nfds_t)(3 + count), (int)wait) <= 0)
        return;
    for (size_t i = 0; i < count; i++)
        if (polled[3 + i].revents)
            take_output(b, i);
    if (polled[1].revents)
        take_notify(b);
    if (polled[2].revents)
        take_control(b);
    if (polled[0].revents)
        take_signals(b);
}

/* Returns the last line of the log of canwired. */
static const char *last_line(const ecu_bench *b, char text[LOG_END_BYTES])
{
    const int fd = openat(b->task->folder->fd, ECU_BUS_LOG, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    const off_t size = fd >= 0 ? lseek(fd, 0, SEEK_END) : 0;
    const off_t from = size > LOG_END_BYTES - 1 ? size - (LOG_END_BYTES - 1) : 0;
    const ssize_t count = size > 0 ? pread(fd, text, LOG_END_BYTES - 1, from) : 0;
    size_t length = count > 0 ? (size_t)count : 0;
    if (fd >= 0)
        (void)close(fd);
    while (length > 0 && text[length - 1] == '\n')
        length--;
    text[length] = '\0';
    const char *line = strrchr(text, '\n');
    return line ? line + 1 : text;
}

static void tell_bus_end(ecu_bench *b)
{
    char text[LOG_END_BYTES];
    const char *line = last_line(b, text);
    ecu_bench_conclude(b, ECU_BROKEN, "canwired has ended%s%.200s", *line ? ": " : "", line);
}

bool ecu_bench_goes_on(ecu_bench *b)
{
    if (b->aborted)
        return false;
    if (!b->over && b->bus == 0 && !b->task->campaign->ecus.own_bus)
        tell_bus_end(b);
    if (!b->over && ecu_bench_now() >= b->limit_ms)
        ecu_bench_conclude(b, ECU_LATE, "it took longer than %g s",
                           (double)b->task->campaign->limit_ms / 1000);
    return !b->over;
}

/* Asks for the time, and waits for the answer. */
static bool ask_time(ecu_bench *b, int64_t until_ms)
{
    b->told = false;
    if (!ask_status(b))
        return false;
    while (!b->told && b->control.fd >= 0 && !b->aborted && ecu_bench_now() < until_ms)
        ecu_bench_step(b, until_ms);
    return b->told;
}

bool ecu_bench_ask_time(ecu_bench *b, uint64_t *time_ns)
{
    const bool told = ask_time(b, b->limit_ms);
    *time_ns = b->time_ns;
    if (!told && ecu_bench_goes_on(b)) {
        errno = ETIMEDOUT;
        return ecu_bench_fail(b, "canwired does not answer");
    }
    return told && ecu_bench_goes_on(b);
}

size_t ecu_bench_unready(const ecu_bench *b)
{
    size_t first = ECUS_MAX;
    for (size_t i = 0; i < count_of(b); i++)
        if (!b->result->ends[i].ready && !is_lost(b, i) &&
            (first == ECUS_MAX || ecu_bench_ready_limit(b, i) < ecu_bench_ready_limit(b, first)))
            first = i;
    return first;
}

int64_t ecu_bench_ready_limit(const ecu_bench *b, size_t program)
{
    return b->result->ends[program].started
               ? b->programs[program].start_ms + config_of(b, program)->ready_ms
               : INT64_MAX;
}

/* Programs that were never started count as ended. */
bool ecu_bench_all_ended(const ecu_bench *b)
{
    size_t i = 0;
    while (i < count_of(b) && b->programs[i].pid == 0)
        i++;
    return i == count_of(b);
}

/* ---- canwired -------------------------------------------------------------------------------- */

/* The socket is there before canwired, whose READY=1 would be lost otherwise. */
static bool open_notify(ecu_bench *b)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%.80s/" NOTIFY_NAME,
                   b->task->folder->sockets);
    b->notify = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    return (b->notify >= 0 &&
            bind(b->notify, (const struct sockaddr *)&address, sizeof address) == 0) ||
           ecu_bench_fail(b, address.sun_path);
}

/* Starts canwired with the scenario. It says by its notify socket that it is ready. */
static bool start_bus(ecu_bench *b)
{
    const ecu_folder *f = b->task->folder;
    char notify[PATH_MAX + 64], run[PATH_MAX + 64];
    char *const words[] = {(char *)b->task->canwired, "-c", ECU_SCENARIO, "--journal", ECU_JOURNAL,
                           NULL};
    const char *const env[] = {notify, run, NULL};
    (void)snprintf(notify, sizeof notify, "NOTIFY_SOCKET=%s/" NOTIFY_NAME, f->sockets);
    (void)snprintf(run, sizeof run, "CANWIRE_RUN=%s", f->sockets);
    b->bus_log = ecu_folder_open(f, ECU_BUS_LOG);
    if (b->bus_log < 0)
        return ecu_bench_fail(b, ECU_BUS_LOG);
    const ecu_start how = {.words = words, .env = env, .cwd = f->files, .output = b->bus_log};
    b->bus = ecu_process_start(&how);
    return b->bus > 0 || ecu_bench_fail(b, b->task->canwired);
}

/* Connects, and asks for frames when programs are ready by them. */
static bool open_control(ecu_bench *b)
{
    while (!b->bus_ready && ecu_bench_goes_on(b))
        ecu_bench_step(b, INT64_MAX);
    if (!ecu_bench_goes_on(b))
        return false;
    if (!ecu_control_open(&b->control, b->task->changes.control))
        return ecu_bench_fail(b, b->task->changes.control);
    bool frames = false;
    for (size_t i = 0; i < count_of(b); i++)
        frames = frames || config_of(b, i)->sign == ECU_SIGN_FRAME;
    (void)ecu_control_ask(&b->control, frames ? "{\"request\":\"watch\",\"events\":[\"tx\"]}\n"
                                              : "{\"request\":\"watch\",\"events\":[]}\n");
    while (!b->watching && ecu_bench_goes_on(b))
        ecu_bench_step(b, INT64_MAX);
    return ecu_bench_goes_on(b);
}

/* ---- Programs -------------------------------------------------------------------------------- */

/* Opens the log of a program, and the pipe through which its output comes. */
static bool open_output(ecu_bench *b, size_t i, int *out)
{
    char name[128];
    int ends[2];
    ecu_output *o = &b->programs[i].output;
    (void)snprintf(name, sizeof name, "%.100s.log", config_of(b, i)->name);
    o->log = ecu_folder_open(b->task->folder, name);
    if (o->log < 0 || pipe2(ends, O_CLOEXEC) != 0)
        return ecu_bench_fail(b, name);
    (void)fcntl(ends[0], F_SETFL, O_NONBLOCK);
    o->in = ends[0];
    *out = ends[1];
    return true;
}

/* Starts a program in its folder. One whose sign is its start is ready then. */
static bool start_program(ecu_bench *b, size_t i)
{
    const ecu *e = config_of(b, i);
    arena memory = {.blocks = NULL};
    ecu_start how = {.output = -1};
    if ((!e->cwd && !ecu_folder_add(b->task->folder, e->name)) || !open_output(b, i, &how.output))
        return ecu_bench_fail(b, e->name);
    if (ecu_command_make(&how, b->task, i, &memory))
        b->programs[i].pid = ecu_process_start(&how);
    const bool good = b->programs[i].pid > 0 || ecu_bench_fail(b, e->name);
    (void)close(how.output);
    arena_free(&memory);
    b->result->ends[i].started = good;
    b->programs[i].start_ms = ecu_bench_now();
    if (good && e->sign == ECU_SIGN_START)
        set_ready(b, i, ECU_NO_TIME);
    return good;
}

bool ecu_bench_start(ecu_bench *b)
{
    return open_notify(b) && start_bus(b) && open_control(b);
}

bool ecu_bench_start_programs(ecu_bench *b)
{
    for (size_t i = 0; i < count_of(b); i++) {
        const ecu *after = config_of(b, i)->after;
        const size_t first = after ? (size_t)(after - config_of(b, 0)) : i;
        const bool waits = after && !b->result->ends[first].ready;
        b->over = b->over || (waits && is_lost(b, first));
        if (!waits && !b->result->ends[i].started && !start_program(b, i))
            return false;
    }
    return ecu_bench_goes_on(b);
}

/* ---- The bench ------------------------------------------------------------------------------- */

ecu_bench *ecu_bench_new(const ecu_task *task, ecu_result *result)
{
    sigset_t all;
    ecu_bench *b = calloc(1, sizeof *b);
    if (!b)
        return NULL;
    (void)sigemptyset(&all);
    for (size_t i = 0; i < sizeof ecu_bench_signals / sizeof *ecu_bench_signals; i++)
        (void)sigaddset(&all, ecu_bench_signals[i]);
    b->task = task;
    b->result = result;
    b->limit_ms = ecu_bench_now() + task->campaign->limit_ms;
    b->notify = -1;
    b->bus_log = -1;
    b->control.fd = -1;
    for (size_t i = 0; i < ECUS_MAX; i++)
        b->programs[i].output = (ecu_output){.in = -1, .log = -1};
    b->signals = signalfd(-1, &all, SFD_CLOEXEC | SFD_NONBLOCK);
    if (b->signals >= 0)
        return b;
    free(b);
    return NULL;
}

/* Waits until a process has ended, up to a moment. */
static bool await_end(ecu_bench *b, const pid_t *pid, int64_t until_ms)
{
    while (*pid > 0 && !b->aborted && ecu_bench_now() < until_ms)
        ecu_bench_step(b, until_ms);
    return *pid <= 0;
}

/* Tells all programs to end, and kills those that do not. */
static void end_programs(ecu_bench *b)
{
    const int64_t now = ecu_bench_now();
    for (size_t i = 0; i < count_of(b); i++)
        if (b->programs[i].pid > 0)
            (void)kill(-b->programs[i].pid, SIGTERM);
    for (size_t i = 0; i < count_of(b); i++) {
        const pid_t *pid = &b->programs[i].pid;
        if (await_end(b, pid, now + config_of(b, i)->grace_ms) || b->aborted)
            continue;
        b->result->ends[i].killed = true;
        (void)kill(-*pid, SIGKILL);
        (void)await_end(b, pid, ecu_bench_now() + KILLED_MS);
    }
}

/* A program may crash when it is told to end. */
static void find_late_crash(ecu_bench *b)
{
    for (size_t i = 0; i < count_of(b) && b->result->verdict == ECU_DONE; i++) {
        const ecu_end *end = &b->result->ends[i];
        if (!end->started || end->ended || end->killed || !is_fault(end->status))
            continue;
        b->over = false;
        tell_crash(b, config_of(b, i), end->status);
    }
}

/* Takes what programs have written up to their end. */
static void drain_outputs(ecu_bench *b)
{
    for (size_t i = 0; i < count_of(b); i++) {
        ecu_output *o = &b->programs[i].output;
        for (uint64_t before = UINT64_MAX; o->in >= 0 && o->written != before;) {
            before = o->written;
            (void)ecu_output_take(o, NULL);
        }
        ecu_output_close(o);
    }
}

/* Ends canwired so that its journal is whole; one that does not end is killed. */
static void end_bus(ecu_bench *b)
{
    if (b->bus > 0)
        (void)kill(b->bus, SIGTERM);
    if (!await_end(b, &b->bus, ecu_bench_now() + BUS_END_MS) && !b->aborted)
        (void)kill(b->bus, SIGKILL);
}

bool ecu_bench_end(ecu_bench *b)
{
    b->over = true;
    if (b->result->end_ns == ECU_NO_TIME && b->control.fd >= 0 && !b->aborted &&
        ask_time(b, ecu_bench_now() + ANSWER_MS))
        b->result->end_ns = b->time_ns;
    end_programs(b);
    if (!b->aborted) {
        ecu_process_kill_all(b->bus);
        drain_outputs(b);
        find_late_crash(b);
        end_bus(b);
    }
    const bool good = !b->aborted;
    ecu_control_close(&b->control);
    (void)close(b->signals);
    (void)close(b->notify);
    (void)close(b->bus_log);
    free(b);
    return good;
}
