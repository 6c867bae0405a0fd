/* SPDX-License-Identifier: MIT
 *
 * realtime.h - the daemon's engine in real time, on sockets. Each bus is a process, or all of them
 * are one, on one processor. The ECUs of all buses are another process.
 */
#ifndef CANWIRE_BENCH_REALTIME_H
#define CANWIRE_BENCH_REALTIME_H

#include <semaphore.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#define RT_BUSES_MAX 16u
#define RT_PATH_MAX 64
#define RT_NODES 4u       /* of a bus */
#define RT_QUEUE 128u     /* of a node */
#define RT_BITRATE 1000000u
#define RT_SAMPLES_MAX 400000u
#define RT_ENGINE_CPU 0   /* the buses' processor; the ECUs are on the others */
#define RT_NS_PER_S INT64_C(1000000000)

/* The results of a process, in memory that it shares with its parent. */
typedef struct rt_result {
    sem_t ready;
    bool good;             /* false: it could not be started, or frames are unaccounted for */
    uint32_t sample_count;
    int32_t late_ns[RT_SAMPLES_MAX]; /* each delivery, or each wake-up */
    int64_t cpu_ns;
    int64_t wall_ns;
    uint64_t tx_frames[RT_NODES];
    uint64_t rx_frames[RT_NODES]; /* given to the ECU */
    uint64_t lost;         /* dropped, failed to be written, unheard, lost in the kernel */
    uint64_t skips;        /* times when the bus fell too far behind */
    uint64_t busy_bits;    /* between the first and the last frame received, like bits */
    uint64_t bits;
} rt_result;

int64_t rt_now_ns(void);
int64_t rt_cpu_ns(void);

/* Ends the program with a message. */
_Noreturn void rt_fail(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* This process runs on one processor, or on all the others. Does nothing where there is only
 * one. */
void rt_run_on_engine_cpu(void);
void rt_run_elsewhere(void);

void rt_add_sample(rt_result *r, int64_t late_ns);

/* Returns memory for so many results. */
rt_result *rt_share_results(unsigned count);
void rt_unshare_results(rt_result *results, unsigned count);

/* Gives this process priority over all that are not real-time processes. Returns false when that is
 * not permitted. */
bool rt_take_priority(void);

/* ---- bus.c ----------------------------------------------------------------------------------- */

typedef struct rt_bus_options {
    const char *pacing;
    bool own_traffic;   /* its last node sends by itself, 46 % load, and has no ECU */
    bool own_clocks;    /* its nodes have clocks of their own, within 45 ppm */
    const char *folder; /* its ports are sockets there, see rt_port_path(); NULL: inherited ones */
} rt_bus_options;

/* Prints the path at which the ECU of a node connects. */
void rt_port_path(char path[RT_PATH_MAX], const char *folder, unsigned node);

/* Starts a process with an engine. ports: its ends of the sockets of the nodes, which are closed
 * here; not looked at where it has a folder. It ends with SIGTERM. */
pid_t rt_start_bus(rt_result *result, const rt_bus_options *options, const int ports[RT_NODES]);

/* Starts one process for so many buses: those of a rig whose gateways look at each frame. ports:
 * the ends of all nodes of the first bus, and so on, which are closed here. */
pid_t rt_start_rig(rt_result *results, unsigned buses, const rt_bus_options *options,
                   const int *ports);

/* ---- timer.c --------------------------------------------------------------------------------- */

/* Starts a process that waits for a bare timerfd again and again. It ends with SIGTERM. */
pid_t rt_start_timer(rt_result *result);

/* ---- ecus.c ---------------------------------------------------------------------------------- */

/* The ECUs of one node each. */
typedef struct rt_ecu {
    int fd;
    unsigned bus;
    unsigned node;
    uint32_t sent;
    uint32_t owed;                 /* frames that it is to send */
    uint32_t received;             /* in all */
    uint32_t expected[RT_NODES];   /* number of the next frame of each node */
    uint64_t wrong;                /* frames that are not the next one of their sender */
} rt_ecu;

/* Keeps frames in all queues of the buses for this time, then waits for the last ones. */
void rt_saturate(rt_ecu *ecus, unsigned count, int64_t duration_ns);

/* Reads frames for this time. */
void rt_listen(rt_ecu *ecus, unsigned count, int64_t duration_ns);

#endif
