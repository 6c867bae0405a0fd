/* SPDX-License-Identifier: MIT
 *
 * bus.c - a process with the engine of canwired, which notes the lateness of its deliveries.
 */
#include "realtime.h"

#include "engine/group.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct bus_process {
    rt_result *result;
    struct ev_loop *loop;
    engine *engine;
    cw_bus_stats first; /* at the first frame received */
    cw_bus_stats last;
} bus_process;

typedef struct rig_process {
    bus_process buses[RT_BUSES_MAX];
    unsigned count;
} rig_process;

void rt_port_path(char path[RT_PATH_MAX], const char *folder, unsigned node)
{
    (void)snprintf(path, RT_PATH_MAX, "%s/n%u", folder, node);
}

/* Writes the beginning of a node. */
static void write_node(FILE *out, const rt_bus_options *o, unsigned node)
{
    fprintf(out, "  - { name: n%u, ", node);
    if (o->own_clocks)
        fprintf(out, "ppm: %d, ", 30 * (int)node - 45);
}

static void write_port(FILE *out, const rt_bus_options *o, const int ports[RT_NODES], unsigned node)
{
    char path[RT_PATH_MAX];
    write_node(out, o, node);
    if (o->folder) {
        rt_port_path(path, o->folder, node);
        fprintf(out, "port: \"unix:%s\", order: fifo }\n", path);
    } else {
        fprintf(out, "port: \"fd:%d\", order: fifo, queue: %u }\n", ports[node], RT_QUEUE);
    }
}

static void write_bus(FILE *out, unsigned number, const rt_bus_options *o,
                      const int ports[RT_NODES])
{
    fprintf(out, "bus: { name: b%u, bitrate: %u }\npacing: %s\ncatch-up: 60s\nnodes:\n", number,
            RT_BITRATE, o->pacing);
    for (unsigned i = 0; i < RT_NODES - o->own_traffic; i++)
        write_port(out, o, ports, i);
    if (!o->own_traffic)
        return;
    write_node(out, o, RT_NODES - 1);
    fputs("traffic: [ { send: 123#0123456789ABCDEF, every: 250us } ] }\n", out);
}

/* Makes the configuration file of a bus whose ports are sockets. */
static cfg *make_config(const rt_bus_options *o, const int ports[RT_NODES])
{
    char path[] = "/tmp/canwire-bench-XXXXXX";
    int fd = mkstemp(path);
    FILE *out = fd < 0 ? NULL : fdopen(fd, "w");
    if (!out)
        return NULL;
    write_bus(out, 0, o, ports);
    fclose(out);
    cfg *config = cfg_load(path, stderr);
    (void)unlink(path);
    return config;
}

/* Notes the lateness of a reception; the frame is with its ECUs by now. */
static void on_event(void *user, const cw_event *event)
{
    bus_process *p = user;
    p->result->skips += event->kind == CW_EVENT_SKIP;
    if (event->kind != CW_EVENT_RX)
        return;
    rt_add_sample(p->result, rt_now_ns() - engine_time_ns(p->engine, event->tick));
    cw_bus_get_stats(engine_bus(p->engine), &p->last);
    if (p->first.bits == 0)
        p->first = p->last;
}

static void on_end(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    engine_stop(((bus_process *)watcher->data)->engine);
}

static uint64_t count_lost(const cw_node_stats *s, const port_stats *own)
{
    uint64_t lost = own->write_failed + own->unheard + own->kernel_dropped + own->malformed;
    for (unsigned why = 0; why < CW_DROP_COUNT; why++)
        lost += s->dropped[why] + s->rx_dropped[why];
    return lost;
}

static void note_end(bus_process *p)
{
    rt_result *r = p->result;
    report beyond;
    engine_report(p->engine, &beyond);
    for (unsigned i = 0; i < RT_NODES; i++) {
        cw_node_stats s;
        (void)cw_node_get_stats(engine_bus(p->engine), i, &s);
        r->tx_frames[i] = s.tx_frames;
        r->rx_frames[i] = beyond.nodes[i].interface.written;
        r->lost += count_lost(&s, &beyond.nodes[i].interface);
    }
    r->busy_bits = p->last.busy_bits - p->first.busy_bits;
    r->bits = p->last.bits - p->first.bits;
    r->good = engine_check_books(p->engine) == 0;
}

static void run(rt_result *result, cfg *config)
{
    bus_process p = {.result = result, .loop = ev_loop_new(EVFLAG_AUTO)};
    live *rules = live_new(config);
    ev_signal term;
    p.engine = engine_start(p.loop, rules);
    if (!p.engine)
        return;
    engine_observe(p.engine, on_event, &p);
    ev_signal_init(&term, on_end, SIGTERM);
    term.data = &p;
    ev_signal_start(p.loop, &term);
    int64_t start_ns = rt_now_ns();
    (void)sem_post(&result->ready);
    ev_run(p.loop, 0);
    result->wall_ns = rt_now_ns() - start_ns;
    result->cpu_ns = rt_cpu_ns();
    note_end(&p);
    engine_free(p.engine);
}

pid_t rt_start_bus(rt_result *result, const rt_bus_options *options, const int ports[RT_NODES])
{
    pid_t pid = fork();
    if (pid == 0) {
        rt_run_on_engine_cpu();
        cfg *config = make_config(options, ports);
        if (config)
            run(result, config);
        (void)sem_post(&result->ready);
        _exit(result->good ? 0 : 1);
    }
    for (unsigned i = 0; i < RT_NODES && !options->folder; i++)
        (void)close(ports[i]);
    return pid;
}

/* ---- Rigs ------------------------------------------------------------------------------------ */

/* Writes a file of a folder. Returns false when that fails. */
static bool write_rig_bus(const char *folder, unsigned bus, const rt_bus_options *o,
                          const int ports[RT_NODES])
{
    char path[RT_PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/%u.yaml", folder, bus);
    FILE *out = fopen(path, "w");
    if (!out)
        return false;
    write_bus(out, bus, o, ports);
    fputs("  - { name: gw }\n", out);
    return fclose(out) == 0;
}

/* Gateways connect each bus with the next one. No frame matches their rules. */
static bool write_rig(char path[RT_PATH_MAX], const char *folder, unsigned buses)
{
    (void)snprintf(path, RT_PATH_MAX, "%s/rig.yaml", folder);
    FILE *out = fopen(path, "w");
    if (!out)
        return false;
    fputs("buses: [", out);
    for (unsigned bus = 0; bus < buses; bus++)
        fprintf(out, "%s %u.yaml", bus > 0 ? "," : "", bus);
    fputs(" ]\ngateways:\n", out);
    for (unsigned bus = 0; bus + 1 < buses; bus++)
        fprintf(out,
                "  - { name: g%u, between: [ \"b%u:gw\", \"b%u:gw\" ], rules: [ { filter: "
                "\"1FFFFFFF\", delay: 1ms, direction: forward } ] }\n", bus, bus, bus + 1);
    return fclose(out) == 0;
}

static rig *make_rig(const rt_bus_options *o, unsigned buses, const int *ports)
{
    char folder[] = "/tmp/canwire-bench-XXXXXX";
    char path[RT_PATH_MAX];
    bool good = mkdtemp(folder) != NULL;
    for (unsigned bus = 0; good && bus < buses; bus++)
        good = write_rig_bus(folder, bus, o, ports + (size_t)bus * RT_NODES);
    good = good && write_rig(path, folder, buses);
    rig *config = good ? rig_load(path, stderr) : NULL;
    for (unsigned bus = 0; bus < buses; bus++) {
        char file[RT_PATH_MAX];
        (void)snprintf(file, sizeof file, "%s/%u.yaml", folder, bus);
        (void)unlink(file);
    }
    (void)unlink(path);
    (void)rmdir(folder);
    return config;
}

static void on_rig_end(struct ev_loop *loop, ev_signal *watcher, int events)
{
    (void)loop;
    (void)events;
    const rig_process *p = watcher->data;
    for (unsigned bus = 0; bus < p->count; bus++)
        engine_stop(p->buses[bus].engine);
}

static void run_rig(rt_result *results, rig *config)
{
    static rig_process p;
    struct ev_loop *loop = ev_loop_new(EVFLAG_AUTO);
    live *lives[RT_BUSES_MAX];
    ev_signal term;
    p.count = (unsigned)config->bus_count;
    for (unsigned bus = 0; bus < p.count; bus++) {
        lives[bus] = live_new(config->buses[bus]);
        config->buses[bus] = NULL;
    }
    engine_group *group = engine_group_start(loop, config, lives);
    if (!group)
        return;
    for (unsigned bus = 0; bus < p.count; bus++) {
        p.buses[bus] = (bus_process){.result = &results[bus],
                                     .engine = engine_group_bus(group, bus)};
        engine_observe(p.buses[bus].engine, on_event, &p.buses[bus]);
    }
    ev_signal_init(&term, on_rig_end, SIGTERM);
    term.data = &p;
    ev_signal_start(loop, &term);
    int64_t start_ns = rt_now_ns();
    for (unsigned bus = 0; bus < p.count; bus++)
        (void)sem_post(&results[bus].ready);
    ev_run(loop, 0);
    for (unsigned bus = 0; bus < p.count; bus++) {
        results[bus].wall_ns = rt_now_ns() - start_ns;
        results[bus].cpu_ns = rt_cpu_ns() / p.count;
        note_end(&p.buses[bus]);
    }
    engine_group_free(group);
}

pid_t rt_start_rig(rt_result *results, unsigned buses, const rt_bus_options *options,
                   const int *ports)
{
    pid_t pid = fork();
    if (pid == 0) {
        rt_run_on_engine_cpu();
        rig *config = make_rig(options, buses, ports);
        if (config)
            run_rig(results, config);
        bool good = true;
        for (unsigned bus = 0; bus < buses; bus++) {
            (void)sem_post(&results[bus].ready);
            good = good && results[bus].good;
        }
        _exit(good ? 0 : 1);
    }
    for (unsigned i = 0; i < buses * RT_NODES; i++)
        (void)close(ports[i]);
    return pid;
}
