/* SPDX-License-Identifier: MIT
 *
 * pool.c - makes numbered lines in several processes, and hands them on in the order of numbers.
 */
#include "campaign/pool.h"

#include "base/text/counted.h"
#include "base/stopped.h"
#include "base/wall.h"

#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define CHUNK_MAX 256u    /* lines that a process makes at a time */
#define CHUNKS_A_JOB 16u  /* at least, so that all processes end at about the same time */
#define AHEAD_A_JOB 4u    /* chunks that wait for earlier ones */
#define TRIES_ALONE 1u    /* of a line whose process has ended */
#define TRIES_KILLED 2u   /* of one whose process was killed, perhaps for want of memory */
#define LOOK_MS 200
#define NS_PER_MS 1000000
#define READ_BYTES (64u << 10)
#define HEAD_BYTES 5u     /* of a line: its code, and its length as 4 bytes of this machine */
#define GIVE_BYTES (32u << 10) /* lines are given when there are so many bytes ... */
#define GIVE_NS INT64_C(50000000) /* ... or after this time */

/* An order to a process, which gives a line for each of its numbers. */
typedef struct pool_order {
    uint64_t first;
    uint64_t count;
    bool singly; /* each line is given as soon as it is made */
} pool_order;

/* Numbers that one process gets at a time. */
typedef struct chunk {
    uint64_t first;
    uint64_t count;
    uint64_t made; /* lines that have come */
    buffer lines;  /* as processes give them */
} chunk;

typedef struct worker {
    pid_t pid; /* 0: there is none */
    int fd;
    chunk *chunk; /* NULL: it has nothing to do; without a process it waits for one */
    unsigned tries; /* of the first line that has not come, alone */
    bool late;
    int64_t since_ms; /* the last sign of it */
    buffer part;      /* of a line */
} worker;

typedef struct pool {
    const pool_work *work;
    pid_t parent; /* of the processes */
    worker workers[POOL_JOBS_MAX];
    chunk *chunks; /* a ring */
    size_t chunk_room;
    uint64_t chunk_size;
    uint64_t opened; /* chunks that have been given out */
    uint64_t closed; /* chunks whose lines have been taken */
    uint64_t made;
    bool crowded; /* no further process could be made */
    int64_t looked_ms;
    buffer line;
    int error; /* errno */
} pool;

static int64_t wall_ms(void)
{
    return wall_ns() / NS_PER_MS;
}

static bool pool_fail(pool *p, int error)
{
    p->error = p->error ? p->error : error;
    return false;
}

/* Appends a line, with its code and length before it. Returns false without memory. */
static bool pool_add_line(buffer *lines, unsigned char flag, const buffer *line)
{
    char head[HEAD_BYTES] = {(char)flag};
    const uint32_t length = (uint32_t)buffer_length(line);
    memcpy(head + 1, &length, sizeof length);
    return !line->no_memory && buffer_append(lines, head, sizeof head) &&
           buffer_append(lines, buffer_first(line), length);
}

/* ---- In a process --------------------------------------------------------------------------- */

/* Returns false when the other end is gone. */
static bool give(int fd, buffer *lines)
{
    while (buffer_length(lines) > 0) {
        const ssize_t count = write(fd, buffer_first(lines), buffer_length(lines));
        if (count < 0 && errno != EINTR)
            return false;
        if (count > 0)
            buffer_take(lines, (size_t)count);
    }
    return true;
}

/* Waits for an order. Returns false when there are no more. */
static bool get(int fd, pool_order *order)
{
    char *at = (char *)order;
    size_t left = sizeof *order;
    while (left > 0) {
        const ssize_t count = read(fd, at, left);
        if (count == 0 || (count < 0 && errno != EINTR))
            return false;
        if (count > 0) {
            at += count;
            left -= (size_t)count;
        }
    }
    return true;
}

/* Adds a line to those that wait. */
static bool pool_worker_add(const pool_work *work, uint64_t number, buffer *line, buffer *lines)
{
    buffer_clear(line);
    return pool_add_line(lines, work->calls->make(work->user, number, line), line);
}

/* Makes the lines of an order, and gives them now and then. It gives what it has before it ends for
 * want of memory. */
static bool pool_worker_obey(const pool_work *work, int fd, const pool_order *order, buffer *line,
                             buffer *lines)
{
    int64_t given = wall_ns();
    for (uint64_t i = 0; i < order->count; i++) {
        if (!pool_worker_add(work, order->first + i, line, lines)) {
            (void)give(fd, lines);
            _exit(POOL_EXIT_SHORT);
        }
        if (!order->singly && buffer_length(lines) < GIVE_BYTES && wall_ns() - given < GIVE_NS)
            continue;
        if (!give(fd, lines))
            return false;
        given = wall_ns();
    }
    return give(fd, lines);
}

/* Does orders that come by a socket until that ends; it then ends the process. */
_Noreturn static void pool_worker(const pool_work *work, int fd)
{
    pool_order order;
    buffer line = {.data = NULL};
    buffer lines = {.data = NULL};
    bool good = true;
    while (good && get(fd, &order))
        good = pool_worker_obey(work, fd, &order, &line, &lines);
    _exit(good ? EXIT_SUCCESS : EXIT_FAILURE);
}

/* ---- Processes ------------------------------------------------------------------------------- */

/* A process that outlives this program would hold its locks. One keeps no end of another one's
 * socket: that one ends when this program does. */
_Noreturn static void be_worker(pool *p, const int ends[2])
{
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != p->parent)
        _exit(EXIT_FAILURE);
    for (unsigned i = 0; i < p->work->jobs; i++)
        if (p->workers[i].pid > 0)
            (void)close(p->workers[i].fd);
    (void)close(ends[0]);
    pool_worker(p->work, ends[1]);
}

/* Returns false with errno. */
static bool pool_start(pool *p, worker *w)
{
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        return false;
    (void)fflush(NULL); /* nothing is written twice */
    const pid_t pid = fork();
    if (pid == 0)
        be_worker(p, ends);
    const int error = errno;
    (void)close(ends[1]);
    if (pid < 0) {
        (void)close(ends[0]);
        errno = error;
        return false;
    }
    w->pid = pid;
    w->fd = ends[0];
    w->late = false;
    return true;
}

/* Ends a process and returns its status. */
static int stop(worker *w)
{
    int status = 0;
    (void)close(w->fd);
    while (waitpid(w->pid, &status, 0) < 0 && errno == EINTR)
        continue;
    w->pid = 0;
    buffer_free(&w->part);
    return status;
}

static unsigned count_processes(const pool *p)
{
    unsigned count = 0;
    for (unsigned i = 0; i < p->work->jobs; i++)
        count += p->workers[i].pid > 0;
    return count;
}

/* Takes over the process of a worker that has nothing to do, if there is one. */
static void take_over(pool *p, worker *w)
{
    for (unsigned i = 0; i < p->work->jobs && w->pid == 0; i++) {
        worker *idle = &p->workers[i];
        if (idle->pid == 0 || idle->chunk)
            continue;
        w->pid = idle->pid;
        w->fd = idle->fd;
        w->late = false;
        idle->pid = 0;
        buffer_free(&idle->part);
    }
}

/* Makes a process. Without one more the others go on; a worker then waits. Returns false when there
 * are no others. */
static bool provide(pool *p, worker *w)
{
    if (w->pid > 0 || pool_start(p, w))
        return true;
    const int error = errno;
    const unsigned others = count_processes(p);
    if (others == 0)
        return pool_fail(p, error);
    if (!p->crowded && p->work->calls->few)
        p->work->calls->few(p->work->user, others, error);
    p->crowded = true;
    if (w->chunk)
        take_over(p, w);
    return true;
}

/* An order is small enough for the socket of a process that waits. One that has just ended is found
 * by its end. */
static bool send_order(const worker *w, const pool_order *o)
{
    const char *at = (const char *)o;
    size_t left = sizeof *o;
    while (left > 0) {
        const ssize_t count = send(w->fd, at, left, MSG_NOSIGNAL);
        if (count < 0 && errno != EINTR)
            return false;
        at += count > 0 ? count : 0;
        left -= count > 0 ? (size_t)count : 0;
    }
    return true;
}

/* Gives a worker its chunk, as soon as it has a process. */
static bool order(pool *p, worker *w)
{
    const pool_order o = {.first = w->chunk->first + w->chunk->made,
                          .count = w->chunk->count - w->chunk->made,
                          .singly = w->tries > 0};
    if (!provide(p, w))
        return false;
    w->since_ms = wall_ms();
    if (w->pid > 0 && !send_order(w, &o))
        (void)kill(w->pid, SIGKILL); /* its end is found as that of others */
    return true;
}

/* ---- Chunks ---------------------------------------------------------------------------------- */

static chunk *chunk_at(const pool *p, uint64_t number)
{
    return &p->chunks[number % p->chunk_room];
}

static bool is_all_opened(const pool *p)
{
    return p->opened * p->chunk_size >= p->work->count;
}

/* Gives a worker the next chunk. */
static void open_chunk(pool *p, worker *w)
{
    const uint64_t begin = p->opened * p->chunk_size;
    const uint64_t rest = p->work->count - begin;
    w->chunk = chunk_at(p, p->opened++);
    w->chunk->first = p->work->first + begin;
    w->chunk->count = rest < p->chunk_size ? rest : p->chunk_size;
    w->chunk->made = 0;
    w->tries = 0;
}

/* Gives an idle worker the next chunk, if it has or gets a process. */
static bool employ(pool *p, worker *w)
{
    if (is_all_opened(p) || p->opened - p->closed == p->chunk_room)
        return true;
    if (w->pid == 0 && p->crowded && count_processes(p) > 0)
        return true;
    if (!provide(p, w))
        return false;
    if (w->pid == 0)
        return true;
    open_chunk(p, w);
    return order(p, w);
}

/* Gives processes that wait the next chunks, and chunks that wait a process. */
static bool give_out(pool *p)
{
    for (unsigned i = 0; i < p->work->jobs; i++) {
        worker *w = &p->workers[i];
        if (!w->chunk && !employ(p, w))
            return false;
        if (w->chunk && w->pid == 0 && !order(p, w))
            return false;
    }
    return true;
}

/* Hands the lines of a whole chunk on. */
static bool hand_on(pool *p, chunk *c)
{
    for (uint64_t i = 0; i < c->count; i++) {
        uint32_t length;
        const char *head = buffer_first(&c->lines);
        memcpy(&length, head + 1, sizeof length);
        if (!p->work->calls->take(p->work->user, (unsigned char)head[0], head + HEAD_BYTES,
                                  length))
            return false;
        buffer_take(&c->lines, HEAD_BYTES + length);
    }
    return true;
}

/* Hands lines on, in order, up to the first chunk that is not whole. */
static bool take_chunks(pool *p)
{
    while (p->closed < p->opened) {
        chunk *c = chunk_at(p, p->closed);
        if (c->made < c->count)
            break;
        if (!hand_on(p, c))
            return false;
        p->closed++;
    }
    return true;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Counts a line that has come. After the last one of its chunk the worker has nothing to do. */
static void count_line(pool *p, worker *w)
{
    p->made++;
    w->tries = 0;
    if (++w->chunk->made == w->chunk->count)
        w->chunk = NULL;
}

/* Moves whole lines to the chunk. */
static bool sort_lines(pool *p, worker *w)
{
    while (w->chunk && buffer_length(&w->part) >= HEAD_BYTES) {
        uint32_t length;
        memcpy(&length, buffer_first(&w->part) + 1, sizeof length);
        const size_t size = HEAD_BYTES + (size_t)length;
        if (buffer_length(&w->part) < size)
            break;
        if (!buffer_append(&w->chunk->lines, buffer_first(&w->part), size))
            return pool_fail(p, ENOMEM);
        buffer_take(&w->part, size);
        count_line(p, w);
    }
    return true;
}

/* A line is lost that its process has tried alone. */
static bool lose_line(pool *p, worker *w, int status)
{
    const pool_loss loss = {.timeout = w->late, .status = status};
    const uint64_t number = w->chunk->first + w->chunk->made;
    buffer_clear(&p->line);
    if (!pool_add_line(&w->chunk->lines, p->work->calls->lose(p->work->user, number, &loss,
                                                              &p->line), &p->line))
        return pool_fail(p, ENOMEM);
    count_line(p, w);
    return true;
}

/* Returns how often a line may be tried alone, by the end of its process. */
static unsigned tries_allowed(const pool *p, const worker *w, int status)
{
    if (w->late && p->work->once)
        return 0;
    const bool killed = !w->late && WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
    return killed ? TRIES_KILLED : TRIES_ALONE;
}

/* The process has ended: another one goes on with the first line that has not come. */
static bool replace(pool *p, worker *w)
{
    const int status = stop(w);
    if (!w->chunk)
        return true;
    if (w->tries < tries_allowed(p, w, status))
        w->tries++;
    else if (!lose_line(p, w, status))
        return false;
    return !w->chunk || order(p, w);
}

/* Reads what a process gives. Another one takes the place of a process that has ended. */
static bool listen_to(pool *p, worker *w)
{
    if (!buffer_reserve(&w->part, READ_BYTES))
        return pool_fail(p, ENOMEM);
    const ssize_t count = read(w->fd, w->part.data + w->part.end, READ_BYTES);
    if (count < 0 && errno == EINTR)
        return true;
    if (count <= 0)
        return replace(p, w);
    w->part.end += (size_t)count;
    w->since_ms = wall_ms();
    return sort_lines(p, w);
}

/* ---- The work -------------------------------------------------------------------------------- */

/* Ends processes that take too long; their ends come as those of others. One that a program of a
 * row has stopped goes on. */
static void end_late(pool *p, int64_t now)
{
    for (unsigned i = 0; i < p->work->jobs && p->work->limit_ms > 0; i++) {
        worker *w = &p->workers[i];
        if (w->pid > 0)
            (void)stopped_go_on(w->pid);
        if (!w->chunk || w->pid == 0 || w->late || now - w->since_ms < p->work->limit_ms)
            continue;
        w->late = true;
        (void)kill(w->pid, SIGKILL);
    }
}

/* Tells the caller how many lines are made, a few times a second at most. */
static void pool_look(pool *p, int64_t now)
{
    if (!p->work->calls->look || now - p->looked_ms < LOOK_MS)
        return;
    p->looked_ms = now;
    p->work->calls->look(p->work->user, p->made);
}

/* Finds the workers with a process. Returns their number. poll() takes no more descriptors than a
 * process may have. */
static unsigned list_polled(pool *p, struct pollfd polled[], worker *workers[])
{
    unsigned count = 0;
    for (unsigned i = 0; i < p->work->jobs; i++) {
        worker *w = &p->workers[i];
        if (w->pid == 0)
            continue;
        polled[count] = (struct pollfd){.fd = w->fd, .events = POLLIN};
        workers[count++] = w;
    }
    return count;
}

/* Waits for lines, but not longer than the progress is shown or a line may take. */
static bool wait_for_lines(pool *p)
{
    struct pollfd polled[POOL_JOBS_MAX];
    worker *workers[POOL_JOBS_MAX];
    const unsigned count = list_polled(p, polled, workers);
    const int64_t limit_ms = p->work->limit_ms;
    const int ready = poll(polled, count,
                           limit_ms > 0 && limit_ms < LOOK_MS ? (int)limit_ms : LOOK_MS);
    if (ready < 0 && errno != EINTR)
        return pool_fail(p, errno);
    bool good = true;
    for (unsigned i = 0; i < count && ready > 0 && good; i++)
        if (polled[i].revents && workers[i]->pid > 0) /* another one may have its process now */
            good = listen_to(p, workers[i]);
    const int64_t now = wall_ms();
    end_late(p, now);
    pool_look(p, now);
    return good;
}

/* Chooses the size of chunks: small enough that all processes end together. */
static bool set_up(pool *p)
{
    const uint64_t chunks = (uint64_t)p->work->jobs * CHUNKS_A_JOB;
    const uint64_t size = p->work->count / chunks + 1;
    p->chunk_size = size < CHUNK_MAX ? size : CHUNK_MAX;
    p->chunk_room = p->work->jobs * AHEAD_A_JOB;
    p->chunks = calloc(p->chunk_room, sizeof *p->chunks);
    return p->chunks || pool_fail(p, ENOMEM);
}

/* Ends all processes, those with work at once. */
static void tear_down(pool *p)
{
    for (unsigned i = 0; i < p->work->jobs; i++) {
        worker *w = &p->workers[i];
        if (w->pid > 0 && w->chunk)
            (void)kill(w->pid, SIGKILL);
        if (w->pid > 0)
            (void)stop(w);
    }
    for (uint64_t i = 0; p->chunks && i < p->chunk_room; i++)
        buffer_free(&p->chunks[i].lines);
    free(p->chunks);
    buffer_free(&p->line);
}

bool pool_run(const pool_work *work)
{
    pool *p = calloc(1, sizeof *p);
    if (!p)
        return false;
    p->work = work;
    p->parent = getpid();
    p->looked_ms = wall_ms();
    bool good = set_up(p);
    while (good && !(is_all_opened(p) && p->closed == p->opened))
        good = give_out(p) && wait_for_lines(p) && take_chunks(p);
    tear_down(p);
    errno = p->error;
    free(p);
    return good;
}

void pool_tell_few(const char *command, unsigned jobs, int error)
{
    fprintf(stderr, "%s: %s at a time, as no more can be made: %s\n", command,
            counted(jobs, "process").text, strerror(error));
}

unsigned pool_jobs_default(void)
{
    cpu_set_t set;
    const int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : (unsigned)count > POOL_JOBS_MAX ? POOL_JOBS_MAX : (unsigned)count;
}
