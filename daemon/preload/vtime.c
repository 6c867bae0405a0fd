/* SPDX-License-Identifier: MIT
 *
 * vtime.c - the virtual time of a program.
 */
#include "preload/vtime.h"

#include "base/epoch.h"
#include "base/moment.h"
#include "preload/hooks/real.h"
#include "preload/table.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)
#define WORDS_FILE "/proc/self/cmdline"

typedef enum vtime_state {
    VTIME_OFF = 0,
    VTIME_LATER, /* it joins when it needs time */
    VTIME_ON,
    VTIME_LOST   /* the bus has gone: time goes on with the machine's clock */
} vtime_state;

static vtime_state state;
static pid_t owner; /* the process that has joined */
static int fd = -1;
static int64_t now_ns;
#define LOOK_NS INT64_C(10000000) /* real time between two looks at ports, without a bus */

static int64_t lost_ns; /* CLOCK_MONOTONIC when the bus went */
static bool waits;      /* its turn has ended: this is a handler of a signal */
static char node[MESSAGE_NAME_BYTES];
static char path[sizeof((struct sockaddr_un *)0)->sun_path];
static int fork_pipe[2] = {-1, -1}; /* its end: the child has joined */

static int64_t real_ns(void)
{
    struct timespec now;
    (void)real()->clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * NS_PER_S + now.tv_nsec;
}

/* The bus has gone. From here on time goes by the machine's clock, from the last bus time on. */
static void vtime_lose(void)
{
    if (state != VTIME_ON)
        return;
    table_close_hidden(fd);
    fd = -1;
    state = VTIME_LOST;
    lost_ns = real_ns();
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Sends a message without a body. A bus that has gone is lost then. */
static void say(timing_type type, unsigned flags, int64_t bus_ns)
{
    const message_head head = {.type = (uint8_t)type,
                               .flags = (uint8_t)flags,
                               .size = sizeof head,
                               .bus_ns = (uint64_t)bus_ns};
    while (real()->send(fd, &head, sizeof head, MSG_NOSIGNAL) < 0)
        if (errno != EINTR) {
            vtime_lose();
            return;
        }
}

/* Ends a program that cannot have virtual time. */
static void vtime_give_up(const char *why)
{
    (void)fprintf(stderr, "libcanwire-socketcan: virtual time: %s: %s\n", path, why);
    real()->_exit(1);
    abort();
}

/* Takes a message. Returns true when the turn has begun. */
static bool vtime_take(timing_message *m, ssize_t size)
{
    if (size < (ssize_t)sizeof m->head) {
        vtime_lose();
        return true;
    }
    if (m->head.type == TIMING_ERROR) {
        m->error.text[sizeof m->error.text - 1] = '\0';
        vtime_give_up(m->error.text);
    }
    if (m->head.type == TIMING_NOW)
        now_ns = (int64_t)m->head.bus_ns;
    return m->head.type == TIMING_NOW;
}

/* Waits for the turn, whatever signals come. */
static void await_turn(void)
{
    timing_message m;
    while (state == VTIME_ON) {
        const ssize_t size = real()->recv(fd, &m, sizeof m, 0);
        if (size < 0 && errno == EINTR)
            continue;
        if (vtime_take(&m, size))
            return;
    }
}

/* ---- Joining --------------------------------------------------------------------------------- */

/* Returns the parent of a process, 0 when it is not known. */
static int parent_of(int pid)
{
    char name[40], text[512];
    (void)snprintf(name, sizeof name, "/proc/%d/stat", pid);
    const int file = open(name, O_RDONLY | O_CLOEXEC);
    const ssize_t size = file >= 0 ? real()->read(file, text, sizeof text - 1) : -1;
    if (file >= 0)
        (void)real()->close(file);
    text[size > 0 ? size : 0] = '\0';
    const char *behind = strrchr(text, ')'); /* the name of the program may have blanks */
    return behind && strlen(behind) > 4 ? atoi(behind + 4) : 0;
}

/* Reads the command line of the program, by which the bus names it and orders programs. */
static void read_words(char words[TIMING_PROGRAM_BYTES])
{
    const int file = open(WORDS_FILE, O_RDONLY | O_CLOEXEC);
    const ssize_t size = file >= 0 ? real()->read(file, words, TIMING_PROGRAM_BYTES - 1) : -1;
    if (file >= 0)
        (void)real()->close(file);
    words[size > 0 ? size : 0] = '\0';
    for (ssize_t i = 0; i + 1 < size; i++)
        if (words[i] == '\0')
            words[i] = ' ';
}

/* Says who joins: node, process, ancestors and command line, by which the bus orders turns. */
static void say_join(void)
{
    timing_message m = {.head = {.type = TIMING_JOIN}};
    m.head.size = (uint16_t)(sizeof m.head + sizeof m.join);
    m.join = (timing_join){.magic = MESSAGE_MAGIC, .version = TIMING_VERSION, .pid = getpid()};
    memcpy(m.join.node, node, sizeof m.join.node);
    read_words(m.join.program);
    int pid = m.join.pid;
    for (unsigned i = 0; i < TIMING_ANCESTORS && pid > 1; i++)
        m.join.ancestors[i] = pid = parent_of(pid);
    while (real()->send(fd, &m, m.head.size, MSG_NOSIGNAL) < 0)
        if (errno != EINTR)
            vtime_give_up(strerror(errno));
}

/* Connects, and says that the program is there. Its turn has not begun. */
static void vtime_join(void)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const struct sockaddr *any = (const struct sockaddr *)&address;
    memcpy(address.sun_path, path, sizeof path);
    fd = table_hide(real()->socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
    if (fd < 0)
        vtime_give_up(strerror(errno));
    while (real()->connect(fd, any, sizeof address) != 0) /* it may wait for room in the backlog */
        if (errno != EINTR)
            vtime_give_up(strerror(errno));
    say_join();
    owner = getpid();
    state = VTIME_ON;
}

/* Copies a field up to a tab or the end. Returns what is behind it. */
static const char *take_field(char *out, size_t room, const char *text)
{
    const size_t length = strcspn(text, "\t");
    if (length >= room)
        vtime_give_up(VTIME_VARIABLE " cannot be read");
    memcpy(out, text, length);
    out[length] = '\0';
    return text + length + (text[length] == '\t');
}

void vtime_begin(void)
{
    char pid[16];
    const char *text = getenv(VTIME_VARIABLE);
    if (!text || !*text)
        return;
    text = take_field(pid, sizeof pid, text);
    text = take_field(node, sizeof node, text);
    (void)take_field(path, sizeof path, text);
    state = VTIME_LATER;
    if (atoi(pid) != getpid())
        return;
    vtime_join();
    await_turn();
}

bool vtime_is_on(void)
{
    if (state == VTIME_LATER) {
        vtime_join();
        await_turn();
    }
    return state != VTIME_OFF;
}

bool vtime_has_turn(void)
{
    return state == VTIME_ON && !waits;
}

/* ---- The clock ------------------------------------------------------------------------------- */

int64_t vtime_now_ns(void)
{
    return state == VTIME_LOST ? now_ns + real_ns() - lost_ns : now_ns;
}

static int64_t epoch_of(clockid_t clock)
{
    const bool real_time =
        clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI;
    return real_time ? EPOCH_REALTIME_NS : EPOCH_MONOTONIC_NS;
}

int64_t vtime_of(clockid_t clock, int64_t ns)
{
    return ns - epoch_of(clock);
}

int64_t vtime_on(clockid_t clock, int64_t bus_ns)
{
    return bus_ns + epoch_of(clock);
}

/* ---- Waiting --------------------------------------------------------------------------------- */

/* Waits for the turn, and for what else the caller waits for, with a mask of signals. Returns 0 or
 * EINTR; the turn may not have begun. */
static int await_any(const vtime_wait *wait, const sigset_t *mask, bool *begun)
{
    struct pollfd few[16];
    struct pollfd *all = few;
    timing_message m;
    if (wait->count + 1 > sizeof few / sizeof *few)
        all = calloc(wait->count + 1, sizeof *all);
    const nfds_t count = all ? wait->count : 0;
    all = all ? all : few;
    all[0] = (struct pollfd){.fd = fd, .events = POLLIN};
    if (count > 0)
        memcpy(all + 1, wait->fds, count * sizeof *all);
    const int found = real()->ppoll(all, count + 1, NULL, mask);
    const int error = found < 0 ? errno : 0;
    if (found > 0 && all[0].revents)
        *begun = vtime_take(&m, real()->recv(fd, &m, sizeof m, 0));
    if (all != few)
        free(all);
    return error;
}

/* The same for a call that restarts after handlers with SA_RESTART. */
static int await_restarting(bool *begun)
{
    timing_message m;
    const ssize_t size = real()->recv(fd, &m, sizeof m, 0);
    if (size < 0 && errno == EINTR)
        return EINTR;
    *begun = vtime_take(&m, size);
    return 0;
}

/* Without a bus calls wait in real time. Ports may go a little later than time. They are not among
 * the caller's descriptors, and no thread looks at them: a wait for them ends now and then. */
static int wait_really(const vtime_wait *wait, bool has_ports)
{
    int64_t left_ns = wait->until_ns == VTIME_NEVER ? VTIME_NEVER
                                                    : wait->until_ns - vtime_now_ns();
    if (has_ports && left_ns > LOOK_NS)
        left_ns = LOOK_NS;
    const struct timespec left = moment_of(left_ns > 0 ? left_ns : 0);
    const int found = real()->ppoll(wait->fds, wait->count,
                                    left_ns == VTIME_NEVER ? NULL : &left, wait->mask);
    return found < 0 ? errno : 0;
}

/* Ends the turn and waits for the next one or for a signal. A signal that comes between them stays
 * pending until the wait, and ends it, as it does in a call of the kernel. Returns 0 or EINTR; the
 * turn may not have begun. */
static int end_turn(const vtime_wait *wait, const vtime_wait *own, bool *begun)
{
    sigset_t all, before;
    int error = 0;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    say(TIMING_WAIT, wait->wants | own->wants,
        wait->until_ns < own->until_ns ? wait->until_ns : own->until_ns);
    if (state == VTIME_ON && !wait->restarts)
        error = await_any(wait, wait->mask ? wait->mask : &before, begun);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (state == VTIME_ON && wait->restarts)
        error = await_restarting(begun);
    return error;
}

int vtime_turn(const vtime_wait *wait, const vtime_wait *own, bool *turned)
{
    bool begun = false;
    *turned = false;
    if (waits || (state == VTIME_ON && owner != getpid()))
        return EINTR;
    if (state == VTIME_LOST)
        return wait_really(wait, (wait->wants | own->wants) != 0);
    waits = true;
    const int error = end_turn(wait, own, &begun);
    if (!begun && state == VTIME_ON) {
        say(TIMING_CANCEL, 0, 0);
        await_turn();
    }
    waits = false;
    *turned = true;
    return error;
}

/* ---- Children -------------------------------------------------------------------------------- */

void vtime_leave_to_children(void)
{
    if (state != VTIME_ON || waits || owner != getpid())
        return;
    waits = true;
    say(TIMING_CHILDREN, 0, 0);
}

void vtime_come_back(void)
{
    const int error = errno;
    if (!waits || owner != getpid())
        return;
    say(TIMING_CANCEL, 0, 0);
    await_turn();
    waits = false;
    errno = error;
}

static void close_end(int end)
{
    if (fork_pipe[end] >= 0)
        (void)real()->close(fork_pipe[end]);
    fork_pipe[end] = -1;
}

void vtime_fork_prepare(void)
{
    if (state == VTIME_ON && owner == getpid())
        (void)!pipe2(fork_pipe, O_CLOEXEC);
}

/* The parent waits until the child has joined, so that time does not go on without it. */
void vtime_fork_parent(void)
{
    char byte;
    close_end(1);
    while (fork_pipe[0] >= 0 && real()->read(fork_pipe[0], &byte, 1) < 0 && errno == EINTR)
        continue;
    close_end(0);
}

void vtime_fork_child(void)
{
    if (state != VTIME_ON)
        return;
    table_close_hidden(fd);
    close_end(0);
    vtime_join();
    waits = false;
    close_end(1);
    await_turn();
}
