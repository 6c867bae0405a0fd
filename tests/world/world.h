/* SPDX-License-Identifier: MIT
 *
 * world.h - a world for canwired: its clocks, disk, sockets, signals, threads and service manager,
 * in virtual time, from a seed.
 *
 * canwired's own code runs unchanged; only its calls of the C library are ours (`calls`). Files and
 * Unix sockets are the kernel's own, in a folder of the world, since they must behave as in Linux
 * when two daemons meet. The world decides the time of each operation, its delay, its size, and
 * refusals.
 *
 * Each life of a daemon is a process, forked from the world. One task (a thread of a life, or the
 * world itself) runs at a time: it holds the baton, and gives it back at calls. All that is drawn
 * is drawn from one generator in shared memory, so that a seed is a run.
 *
 *   baton.c    tasks, time, chance, the trace            in all processes
 *   seam_*.c   what canwired calls in place of libc      in the lives
 *   life.c     start, signals, kill, what is left        in the world
 *   story.c    what a seed is about                      in the world
 *   manager.c  the service manager                       in the world
 *   ecu.c, client.c, operator.c                          in the world
 *   verdict.c  whether all was right                     in the world
 */
#ifndef CANWIRE_TESTS_WORLD_H
#define CANWIRE_TESTS_WORLD_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define WORLD_ROOT "/world/" /* root of the daemons' paths; it is the folder of the world */
#define TASKS_MAX 96u
#define LIVES_MAX 24u
#define CONNECTIONS_MAX 1024u
#define STAMPS_MAX 2048u
#define FILES_MAX 4096u
#define PLACES_MAX 16u
#define NEVER INT64_MAX
#define US INT64_C(1000)
#define MS INT64_C(1000000)
#define S INT64_C(1000000000)

typedef enum task_state { TASK_NONE, TASK_READY, TASK_BLOCKED, TASK_DONE } task_state;

/* The reason why a task is blocked. */
typedef enum wait_kind {
    WAIT_FD,   /* any of its file descriptors: others poke it */
    WAIT_LOCK, /* a mutex or a condition: `object` */
    WAIT_DISK, /* a disk that does not answer, a FIFO */
    WAIT_TASK, /* the end of a thread: `object` is its task */
} wait_kind;

typedef struct world_task {
    atomic_int go; /* the baton is here */
    int life;
    task_state state;
    bool is_main;
    bool woken; /* ... and not by its deadline */
    wait_kind kind;
    const void *object;
    const char *call; /* that it is in */
    int64_t ready_ns; /* it runs no earlier */
    int64_t deadline_ns;
    int64_t cpu_ns;
    int64_t turn_cpu_ns; /* at the beginning of this turn of its event loop */
} world_task;

typedef struct world_life {
    pid_t pid; /* 0: none */
    bool alive;
    bool exiting;
    bool started_up;  /* READY=1 has come */
    bool stopping;    /* STOPPING=1 has, or it has got a signal to end */
    bool may_fail;    /* it is expected to refuse to start */
    bool killed;      /* by the world */
    bool disk_failed; /* one of its calls for a file was refused or held up by the world */
    bool faulted;     /* the same for any call, so that frames may be refused */
    int status;       /* of waitpid */
    uint32_t signals; /* to be delivered */
    int64_t started_ns;
    int64_t ready_ns;
    int64_t stop_ns; /* when its end was requested; NEVER */
    int64_t ended_ns;
    int64_t stopped_until_ns; /* SIGSTOP */
    int64_t die_at_call;      /* calls left; negative: it does not */
    int64_t longest_turn_ns;  /* CPU time of its event loop between two waits */
    uint64_t journal;         /* its file, see file_identity() */
    uint64_t log_read;        /* bytes of its log that the world has seen */
    char complaint[200];      /* violation that the seam itself found */
} world_life;

/* Of an ECU or client, by the name that its socket has. */
typedef struct world_connection {
    unsigned uid;
    int64_t stamps_from_ns; /* frames that were sent before have no time stamp of their own */
    uint32_t sent;
    uint32_t received;
    int64_t stamps[STAMPS_MAX];
} world_connection;

/* A socket at a path, and whose it is. */
typedef struct world_place {
    char path[32];
    int life;
} world_place;

typedef struct world_file {
    uint64_t identity;
    int64_t synced; /* bytes that a loss of power leaves */
} world_file;

/* The disk, as the world lets it be. */
typedef struct world_disk {
    int64_t room; /* bytes; NEVER: plenty */
    unsigned errors_permille;
    unsigned short_permille;
    int64_t slow_ns;
    int64_t hung_until_ns;
    char hung_path[64]; /* only this one; empty: all */
} world_disk;

typedef struct world_state {
    uint64_t seed;
    uint64_t random;
    int64_t now_ns;      /* CLOCK_MONOTONIC */
    int64_t realtime_ns; /* CLOCK_REALTIME is so much ahead */
    int64_t boottime_ns;
    int64_t others_ns; /* then others want the baton */
    uint64_t digest;   /* of the trace */
    uint64_t calls;
    atomic_int back;
    /* the state of the machine */
    unsigned work_ps;            /* picoseconds a piece of work (a basic block) */
    unsigned preempt_permille;   /* at a call */
    unsigned late_us;            /* wake-ups, at most, most of the time */
    unsigned interrupt_permille; /* EINTR, EAGAIN, short reads of sockets */
    unsigned refuse_permille;    /* ENOBUFS, EMFILE */
    world_disk disk;
    world_task tasks[TASKS_MAX];
    world_life lives[LIVES_MAX];
    bool config_is_bad; /* bus.yaml, so that no start can succeed */
    unsigned life_count;
    unsigned connection_count;
    world_connection connections[CONNECTIONS_MAX];
    unsigned place_count;
    world_place places[PLACES_MAX];
    unsigned file_count;
    world_file files[FILES_MAX];
} world_state;

extern world_state *world;
extern int world_trace_fd; /* of this process; -1: only the digest */
extern bool world_inside;  /* this process is a life, and its calls go through the seam */

/* ---- baton.c: in all processes --------------------------------------------------------------- */

void world_make(uint64_t seed);
uint64_t world_draw(uint64_t below);
bool world_chance(unsigned permille);
int64_t world_between(int64_t low, int64_t high); /* small ones are as likely as large ones */

/* Prints a line of the trace, with time and task. */
void world_trace(const char *format, ...) __attribute__((format(printf, 1, 2)));
uint64_t world_hash(const void *bytes, size_t size);

/* Returns the task of this thread, NULL in the world itself. */
world_task *world_me(void);
world_life *world_my_life(void);

/* Turns the work since the last time into virtual time. */
void world_charge(int64_t more_ns);

/* Begins each call: work costs time, another task may come first, a signal may come, this life may
 * end here. */
void world_enter(const char *call);

/* Waits until another task wakes it or the time has come. Returns true when it was woken;
 * *interrupted when a signal was handled meanwhile (NULL: it goes on waiting). */
bool world_block(wait_kind kind, const void *object, int64_t deadline_ns, const char *call,
                 bool *interrupted);

/* Wakes tasks of this life that are blocked so; of condition variables one, if only_one. */
void world_wake(int life, wait_kind kind, const void *object, bool only_one);
void world_wake_all_fds(void);

/* Adds a task; it runs when it has the baton. */
int world_add_task(int life, bool is_main);
void world_begin_task(int task); /* in the thread that is the task: waits for the baton */
void world_end_task(void);       /* gives the baton away for good */
_Noreturn void world_exit(int status);
void world_complain(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* ---- baton.c: in the world ------------------------------------------------------------------- */

typedef struct actor {
    int64_t next_ns; /* when it acts; NEVER */
    void (*act)(struct actor *self);
} actor;

void world_add_actor(actor *a);
void world_run(int64_t until_ns); /* until then, or all are at rest for ever */

/* ---- life.c ---------------------------------------------------------------------------------- */

int life_start(const char *journal); /* returns its number */
void life_signal(int life, int signal);
void life_kill(int life); /* -9 */
void life_reap(int life); /* its process has ended, or is about to */
void life_read_log(int life);
bool life_log_has(int life, const char *text);
int life_now(void); /* the newest one that is alive, or -1 */
void life_power_loss(void);
uint64_t file_identity(const char *name); /* not given again as inodes are; 0: it is not there */
uint64_t file_identity_at(int folder, const char *name, int flags); /* as for statx() */
unsigned file_number(uint64_t identity); /* of world->files: those seen earlier come first */

/* ---- story.c --------------------------------------------------------------------------------- */

#define ECUS_MAX 4u

typedef struct story {
    int64_t length_ns;
    unsigned ecus;
    unsigned bitrate;
    bool journal;
    bool record;
    bool watch;
    bool twins;    /* two starts at once */
    bool restarts; /* a loop of crashes */
    bool full_disk;
    bool bad_disk;
    bool slow_disk;
    bool hung_disk;
    bool power;     /* is lost */
    bool fifo;      /* in the place of a file that a reload reads */
    bool hung_file; /* the same on a mount that hangs */
    bool reloads;
    bool flood; /* of rules and sends that are due all the time */
    bool hostile;
    bool idlers;
    bool faults; /* rules */
    bool stops;  /* SIGSTOP, suspend */
    bool clock_steps;
    bool vanishing; /* ECUs go and come */
    bool deaf_ecus; /* that do not read */
    bool refusals;  /* of sockets */
    const char *pacing;
} story;

extern story the_story;

void story_draw(void);
void story_write_config(unsigned version); /* of bus.yaml, as a whole */
const char *story_name(void);

/* ---- actors ---------------------------------------------------------------------------------- */

void manager_add(void);
bool manager_is_up(void);
int manager_stop_all(void); /* Sends SIGTERM to all living daemons; returns their number. */
void ecus_add(void);
void ecus_quiet(void); /* write no more, read all */
void ecus_drain(void);
void ecus_count(uint64_t frames[ECUS_MAX], int life); /* that they have got, after draining */
void clients_add(void);
void clients_quiet(void);
void clients_drain(void);
void operator_add(void);
void operator_quiet(void);

/* The frames that they have seen. */
typedef struct ecu_seen {
    uint64_t sent; /* in this connection to this life */
    uint64_t received;
    uint64_t frames; /* all that are in `text` */
    int life;
    bool steady; /* was connected from before the start of traffic to the end, and read all */
    char *text;  /* a line per frame: "ID#DATA" */
    size_t size;
} ecu_seen;

const ecu_seen *ecu_seen_of(unsigned ecu, int life);
const char *client_watched(int life, size_t *size); /* lines of JSON */

/* The last status of a life that was requested and given while all was quiet, or NULL. It has the
 * number of frames that each ECU had got at the request and at the reply. */
typedef struct quiet_status {
    char *text;
    uint64_t before[ECUS_MAX];
    uint64_t after[ECUS_MAX];
} quiet_status;

const quiet_status *client_last_status(int life);

/* Connects a socket of the world under a name of its own; returns the number of its connection or
 * -1.
 */
int world_connect(const char *path, int type, unsigned uid, int *fd);
void world_sent(int connection);

/* ---- verdict.c ------------------------------------------------------------------------------- */

void verdict(const char *format, ...)
    __attribute__((format(printf, 1, 2))); /* something is wrong */
unsigned verdict_count(void);
void verdict_begin(void);
void verdict_when_quiet(void);
void verdict_life_ended(int life);
void verdict_at_end(void);

/* ---- What the simulated programs are called here --------------------------------------------- */

int canwired_main(int argc, char **argv);
int canwire_main(int argc, char **argv);

/* ---- resim.c: a journal once more, by the tool's own code, outside of the world's time ------- */

typedef struct resim {
    bool crashed;
    int status;
    char *events;
    char *errors;
} resim;

void resim_run(resim *run, const char *journal);
void resim_free(resim *run);

#endif
