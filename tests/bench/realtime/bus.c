/* SPDX-License-Identifier: MIT
 *
 * bus.c - a process with the engine of canwired, which notes the lateness of its deliveries.
 */
#include "realtime.h"

#include "engine/engine.h"

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

void rt_port_path(char path[RT_PATH_MAX], const char *folder, unsigned node)
{
    (void)snprintf(path, RT_PATH_MAX, "%s/n%u", folder, node);
}

static void write_port(FILE *out, const rt_bus_options *o, const int ports[RT_NODES], unsigned node)
{
    char path[RT_PATH_MAX];
    if (o->folder) {
        rt_port_path(path, o->folder, node);
        fprintf(out, "  - { name: n%u, port: \"unix:%s\", order: fifo }\n", node, path);
    } else {
        fprintf(out, "  - { name: n%u, port: \"fd:%d\", order: fifo }\n", node, ports[node]);
    }
}

/* Makes the configuration file of a bus whose ports are sockets. */
static cfg *make_config(const rt_bus_options *o, const int ports[RT_NODES])
{
    char path[] = "/tmp/canwire-bench-XXXXXX";
    int fd = mkstemp(path);
    FILE *out = fd < 0 ? NULL : fdopen(fd, "w");
    if (!out)
        return NULL;
    fprintf(out, "bus: { bitrate: %u }\npacing: %s\ncatch-up: 60s\nnodes:\n", RT_BITRATE,
            o->pacing);
    for (unsigned i = 0; i < RT_NODES; i++)
        if (o->own_traffic && i == RT_NODES - 1)
            fprintf(out,
                    "  - { name: n%u, traffic: [ { send: 123#0123456789ABCDEF, every: 250us } ] "
                    "}\n",
                    i);
        else
            write_port(out, o, ports, i);
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
    r->cpu_ns = rt_cpu_ns();
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
