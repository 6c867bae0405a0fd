/* SPDX-License-Identifier: MIT
 *
 * main.c - bench_realtime: the daemon's engine in real time, with socketpairs in place of CAN
 * sockets.
 *
 * First how late frames are delivered, for each pacing and beside a bare timerfd, in turns, once on
 * sockets at paths, too. Then 8 buses and 16 at 100 % load on one processor, and 16 as a rig in one
 * process. No frame may be lost, every count has to agree.
 * Exit status 1 when it does not.
 */
#include "realtime.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define TURNS 5u
#define START_S 30 /* for a process to be ready */

/* A kind of measurement; all kinds run in turns. */
typedef struct kind {
    const char *name;
    const char *pacing; /* NULL: a bare timer */
    bool paths;         /* ports are unix:PATH, not sockets that were inherited */
    bool own_clocks;    /* the nodes have clocks of their own */
} kind;

static const kind kinds[] = {
    {"timerfd", NULL, false, false},          {"precise", "precise", false, false},
    {"precise-path", "precise", true, false}, {"precise-ppm", "precise", false, true},
    {"tick", "tick", false, false},           {"spin", "spin", false, false},
};
#define KINDS (sizeof kinds / sizeof kinds[0])

static const char usage[] = "usage: bench_realtime [--check | --fifo | --rig]    prints JSON\n"
                            "  --check   in a short time\n"
                            "  --fifo    with real-time priority\n"
                            "  --rig     only 16 buses in one process, to be profiled\n";

/* The durations of the measurement. */
typedef struct plan {
    unsigned turns;
    int64_t turn_ns;
    int64_t buses_ns;
} plan;

static const plan whole = {.turns = TURNS, .turn_ns = RT_NS_PER_S, .buses_ns = 5 * RT_NS_PER_S};
static const plan check = {.turns = 1, .turn_ns = RT_NS_PER_S / 10, .buses_ns = RT_NS_PER_S / 5};

typedef struct lateness {
    size_t samples;
    double p50_us;
    double p99_us;
    double p999_us;
    double cpu; /* share of a processor */
} lateness;

/* ---- Processes ------------------------------------------------------------------------------- */

static void wait_until_ready(rt_result *results, unsigned count)
{
    struct timespec end;
    (void)clock_gettime(CLOCK_MONOTONIC, &end);
    end.tv_sec += START_S;
    for (unsigned i = 0; i < count; i++)
        while (sem_clockwait(&results[i].ready, CLOCK_MONOTONIC, &end) != 0)
            if (errno != EINTR)
                rt_fail("a process does not start");
}

static void end_process(pid_t pid)
{
    int status;
    (void)kill(pid, SIGTERM);
    if (waitpid(pid, &status, 0) != pid || status != 0)
        rt_fail("a process has ended with status 0x%x", (unsigned)status);
}

static void make_ecus(rt_ecu *ecus, int ports[RT_NODES], unsigned bus)
{
    for (unsigned node = 0; node < RT_NODES; node++) {
        int pair[2];
        if (socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair) != 0)
            rt_fail("no socketpair can be made");
        ports[node] = pair[0];
        ecus[node] = (rt_ecu){.fd = pair[1], .bus = bus, .node = node};
    }
}

static void close_ecus(const rt_ecu *ecus, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        if (ecus[i].fd >= 0)
            (void)close(ecus[i].fd);
}

/* ---- Lateness -------------------------------------------------------------------------------- */

static int by_value(const void *a, const void *b)
{
    int32_t left = *(const int32_t *)a, right = *(const int32_t *)b;
    return left < right ? -1 : left > right;
}

static double quantile_us(const int32_t *sorted, size_t count, double share)
{
    return sorted[(size_t)(share * (double)(count - 1))] / 1000.0;
}

/* Summarises the results of some processes together. */
static lateness summarise(const rt_result *results, unsigned count)
{
    lateness l = {.samples = 0};
    int32_t *all = malloc((size_t)count * sizeof results->late_ns);
    if (!all)
        rt_fail("out of memory");
    for (unsigned i = 0; i < count; i++) {
        memcpy(all + l.samples, results[i].late_ns, results[i].sample_count * sizeof *all);
        l.samples += results[i].sample_count;
        l.cpu += (double)results[i].cpu_ns / (double)results[i].wall_ns;
    }
    if (l.samples == 0)
        rt_fail("nothing was measured");
    qsort(all, l.samples, sizeof *all, by_value);
    l.p50_us = quantile_us(all, l.samples, 0.5);
    l.p99_us = quantile_us(all, l.samples, 0.99);
    l.p999_us = quantile_us(all, l.samples, 0.999);
    free(all);
    return l;
}

/* Connects the ECUs of a bus that is ready, except that of its last node. */
static void connect_ecus(rt_ecu *ecus, const char *folder)
{
    for (unsigned node = 0; node < RT_NODES; node++)
        ecus[node] = (rt_ecu){.fd = -1, .node = node};
    for (unsigned node = 0; node < RT_NODES - 1; node++) {
        struct sockaddr_un address = {.sun_family = AF_UNIX};
        rt_port_path(address.sun_path, folder, node);
        ecus[node].fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);
        if (connect(ecus[node].fd, (struct sockaddr *)&address, sizeof address) != 0)
            rt_fail("%s: no ECU can connect", address.sun_path);
    }
}

/* Checks a turn. Frames for an ECU that has not connected yet are no loss of the bus. */
static void check_turn(const kind *k, const rt_result *result)
{
    if (!result->good || (result->lost > 0 && !k->paths) || result->skips > 0)
        rt_fail("%s: %" PRIu64 " frames were lost, %" PRIu64 " times were skipped", k->name,
                result->lost, result->skips);
}

static lateness measure_turn(const kind *k, int64_t duration_ns)
{
    rt_result *result = rt_share_results(1);
    rt_ecu ecus[RT_NODES];
    int ports[RT_NODES] = {0};
    char folder[] = "/tmp/canwire-bench-XXXXXX";
    const rt_bus_options options = {.pacing = k->pacing,
                                    .own_traffic = true,
                                    .own_clocks = k->own_clocks,
                                    .folder = k->paths ? mkdtemp(folder) : NULL};
    if (k->paths && !options.folder)
        rt_fail("no folder can be made");
    if (!k->paths)
        make_ecus(ecus, ports, 0);
    pid_t pid = k->pacing ? rt_start_bus(result, &options, ports) : rt_start_timer(result);
    wait_until_ready(result, 1);
    if (k->paths)
        connect_ecus(ecus, folder);
    rt_listen(ecus, k->pacing ? RT_NODES - 1 : 0, duration_ns);
    end_process(pid);
    check_turn(k, result);
    close_ecus(ecus, RT_NODES);
    if (k->paths)
        (void)rmdir(folder);
    const lateness l = summarise(result, 1);
    rt_unshare_results(result, 1);
    return l;
}

static void print_lateness(const char *name, const lateness *l, const char *end)
{
    printf("  \"%s\": {\"samples\": %zu, \"p50_us\": %.2f, \"p99_us\": %.2f, \"p999_us\": %.2f, "
           "\"cpu\": %.3f}%s\n",
           name, l->samples, l->p50_us, l->p99_us, l->p999_us, l->cpu, end);
}

/* Takes the best turn of each kind, since noise only adds. */
static void measure_lateness(const plan *p)
{
    lateness best[KINDS];
    for (unsigned turn = 0; turn < p->turns; turn++)
        for (unsigned i = 0; i < KINDS; i++) {
            const lateness l = measure_turn(&kinds[i], p->turn_ns);
            if (turn == 0 || l.p99_us < best[i].p99_us)
                best[i] = l;
        }
    puts(" \"lateness\": {");
    for (unsigned i = 0; i < KINDS; i++)
        print_lateness(kinds[i].name, &best[i], i + 1 < KINDS ? "," : "},");
}

/* ---- Many buses ------------------------------------------------------------------------------ */

/* Returns true when the buses sent all frames of the ECUs, and every ECU got those of the others on
 * its bus, in order. */
static bool counts_agree(const rt_ecu *ecus, const rt_result *results, unsigned buses)
{
    bool good = true;
    for (unsigned bus = 0; bus < buses; bus++) {
        const rt_result *r = &results[bus];
        const rt_ecu *own = &ecus[bus * RT_NODES];
        uint64_t sent = 0;
        for (unsigned node = 0; node < RT_NODES; node++)
            sent += own[node].sent;
        for (unsigned node = 0; node < RT_NODES; node++)
            good = good && own[node].wrong == 0 && own[node].sent == r->tx_frames[node] &&
                   own[node].received == r->rx_frames[node] &&
                   own[node].received + own[node].sent == sent;
        good = good && r->good && r->lost == 0 && r->skips == 0;
    }
    return good;
}

static double least_load(const rt_result *results, unsigned buses)
{
    double least = 1;
    for (unsigned bus = 0; bus < buses; bus++) {
        const rt_result *r = &results[bus];
        double load = r->bits ? (double)r->busy_bits / (double)r->bits : 0;
        least = load < least ? load : least;
    }
    return least;
}

/* Returns the processors that all buses take at full load: the CPU time for the time in which
 * frames were on a bus. It does not depend on what else the machine does, as the load does. */
static double processors_at_full_load(const rt_result *results, unsigned buses)
{
    double cpu_ns = 0, busy_ns = 0;
    for (unsigned bus = 0; bus < buses; bus++) {
        cpu_ns += (double)results[bus].cpu_ns;
        busy_ns += (double)results[bus].busy_bits * RT_NS_PER_S / RT_BITRATE / buses;
    }
    return cpu_ns / busy_ns;
}

static void print_buses(const rt_result *results, unsigned buses, bool one, bool good)
{
    uint64_t frames = 0, lost = 0;
    const lateness l = summarise(results, buses);
    for (unsigned bus = 0; bus < buses; bus++) {
        lost += results[bus].lost;
        for (unsigned node = 0; node < RT_NODES; node++)
            frames += results[bus].tx_frames[node];
    }
    printf("  {\"buses\": %u, \"nodes\": %u, \"pacing\": \"tick\", \"processes\": %u, \"frames\": "
           "%" PRIu64 ", \"lost\": %" PRIu64 ", \"least_load\": %.4f, \"counts_agree\": %s,\n"
           "   \"processors_at_full_load\": %.3f,\n",
           buses, RT_NODES, one ? 1 : buses, frames, lost, least_load(results, buses),
           good ? "true" : "false", processors_at_full_load(results, buses));
    print_lateness("lateness", &l, "}");
}

/* one: they are a rig in one process. Returns false when frames are lost, or counts differ. */
static bool measure_buses(const plan *p, unsigned buses, bool one)
{
    rt_result *results = rt_share_results(buses);
    rt_ecu ecus[RT_BUSES_MAX * RT_NODES];
    pid_t pids[RT_BUSES_MAX];
    int ports[RT_BUSES_MAX * RT_NODES];
    const rt_bus_options options = {.pacing = "tick"};
    for (unsigned bus = 0; bus < buses; bus++) {
        make_ecus(ecus + bus * RT_NODES, ports + bus * RT_NODES, bus);
        if (!one)
            pids[bus] = rt_start_bus(&results[bus], &options, ports + bus * RT_NODES);
    }
    if (one)
        pids[0] = rt_start_rig(results, buses, &options, ports);
    wait_until_ready(results, buses);
    rt_saturate(ecus, buses * RT_NODES, p->buses_ns);
    for (unsigned i = 0; i < (one ? 1 : buses); i++)
        end_process(pids[i]);
    bool good = counts_agree(ecus, results, buses);
    print_buses(results, buses, one, good);
    close_ecus(ecus, buses * RT_NODES);
    rt_unshare_results(results, buses);
    return good;
}

static bool measure_all_buses(const plan *p, bool rig_only)
{
    bool good = true;
    puts(" \"buses\": [");
    if (!rig_only) {
        good = measure_buses(p, RT_BUSES_MAX / 2, false);
        puts(",");
        good = measure_buses(p, RT_BUSES_MAX, false) && good;
        puts(",");
    }
    good = measure_buses(p, RT_BUSES_MAX, true) && good;
    puts("]}");
    return good;
}

int main(int argc, char **argv)
{
    bool checks = argc == 2 && strcmp(argv[1], "--check") == 0;
    bool fifo = argc == 2 && strcmp(argv[1], "--fifo") == 0;
    bool rig_only = argc == 2 && strcmp(argv[1], "--rig") == 0;
    const plan *p = checks ? &check : &whole;
    if (argc != 1 && !checks && !fifo && !rig_only) {
        fputs(usage, stderr);
        return 2;
    }
    if (fifo && !rt_take_priority())
        rt_fail("there is no real-time priority for this user");
    rt_run_elsewhere();
    puts("{");
    if (!rig_only)
        measure_lateness(p);
    const bool good = measure_all_buses(p, rig_only);
    if (checks)
        printf("%d passed, %d failed\n", good, !good);
    return good ? 0 : 1;
}
